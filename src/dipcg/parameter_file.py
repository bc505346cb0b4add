"""Parameter files: a generator's name, its parameters and what is stored beside them, as JSON."""

from __future__ import annotations

import json
from typing import Any

from dipcg.space import Params


def params_to_json(params: Params, generator: str, **others: Any) -> str:
    """Parameters as the JSON text that `dipcg edit` reads; `others` are stored beside them."""
    return json.dumps({"generator": generator, "params": params} | others, indent=1)


def params_from_json(text: str) -> tuple[str, dict[str, Any]]:
    """Read what `params_to_json` wrote: generator name and unchecked parameters; raises ValueError."""
    document = document_from_json(text)
    return document["generator"], document["params"]


def document_from_json(text: str) -> dict[str, Any]:
    """All that `params_to_json` wrote, unchecked except for a name and parameters; raises ValueError."""
    try:
        document = json.loads(text)
        return document | {"generator": str(document["generator"]), "params": dict(document["params"])}
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f'A parameter file is JSON like {{"generator": "chair", "params": {{…}}}}; this one is not ({error}).'
        ) from None
