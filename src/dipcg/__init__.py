"""dipcg: from a picture to the parameters of a procedural generator, and so to an exact, light, editable asset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dipcg.pipeline import Candidate, Estimate, Inverter

__version__ = "0.1.0"
__all__ = ["Candidate", "Estimate", "Inverter"]


def __getattr__(name: str) -> Any:
    """Import what a person asks for when they ask for it: torch takes seconds."""
    if name in __all__:
        from dipcg import pipeline

        return getattr(pipeline, name)
    raise AttributeError(f"module 'dipcg' has no attribute {name!r}")
