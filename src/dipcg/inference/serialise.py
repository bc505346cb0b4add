"""An estimate as programs get it: the command line's `--json` and the app's endpoints say the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from dipcg.pipeline import Estimate


def answer(found: Estimate, generators: Mapping[str, float], doubt: str | None) -> dict[str, Any]:
    """Plain values for JSON: every candidate with its camera, and how sure each thing is.

    `generators` has the chance of each that was thought of, none when it was given; `doubt` is `recognise.doubt`'s
    sentence.
    """
    return {
        "generator": found.inverter.generator.name,
        "generators": dict(generators),
        "candidates": [
            {"params": c.params, "view": asdict(c.view), "agreement": c.agreement} for c in found.candidates
        ],
        "spread": found.spread,
        "chances": {name: {str(o): share for o, share in shares.items()} for name, shares in found.chances.items()},
        "misfit": found.misfit,
        "doubt": doubt,
        "trace": [step._asdict() for step in found.trace],
    }
