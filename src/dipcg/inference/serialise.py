"""A result as plain values: what `dipcg estimate --json` prints and the endpoints of the app return."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from dipcg.inference.estimate import Result


def to_dict(result: Result) -> dict[str, Any]:
    """The result with every candidate and its camera, ready for JSON; meshes and the picture are left out."""
    estimate = result.estimate
    probabilities = {name: {str(o): p for o, p in options.items()} for name, options in estimate.probabilities.items()}
    return {
        "generator": estimate.generator,
        "generators": result.probabilities,
        "candidates": [
            {"params": c.params, "view": asdict(c.view), "agreement": c.agreement} for c in estimate.candidates
        ],
        "spread": estimate.spread,
        "probabilities": probabilities,
        # The name of the same values in version 0.1; it goes with version 0.3.
        "chances": probabilities,
        "misfit": estimate.misfit,
        "doubt": result.doubt,
        "notes": list(result.notes),
        "trace": [step._asdict() for step in estimate.trace],
    }
