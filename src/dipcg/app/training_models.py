"""The requests and the answers about generators that are learned, typed."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field

from dipcg.app.limits import MOST_MINUTES, MOST_SHAPES
from dipcg.app.models import Name, Request
from dipcg.app.training_folder import State
from dipcg.space import Value

End = Annotated[float, Field(allow_inf_nan=False)]


class Ranges(Request):
    """Lowest and highest values in place of the proposed ones, and parameters that stay as in the source."""

    ranges: Annotated[dict[Name, tuple[End, End]], Field(max_length=500, default_factory=dict)]
    hold: Annotated[list[Name], Field(max_length=500, default_factory=list)]


class Learn(Request):
    """How much is built and how long is trained; what is there already counts."""

    shapes: Annotated[int, Field(ge=40, le=MOST_SHAPES)] = 3000
    minutes: Annotated[float, Field(gt=0, le=MOST_MINUTES, allow_inf_nan=False)] = 30.0


class Proposed(BaseModel):
    """A parameter with the range that was proposed or edited."""

    name: str
    kind: str
    value: str
    """in the source"""
    low: float | None = None
    high: float | None = None
    lowest: float | None = None
    """the source's own limit, which an edited range may not pass"""
    highest: float | None = None
    options: list[Value] = []
    unit: str
    doc: str
    why: str
    """how the range came about; empty for the source's own"""
    held: bool
    edited: bool
    """whether its range is another than the proposed one"""


class TrainingAnswer(BaseModel):
    id: str
    name: str
    """of the generator, which estimates are asked for when the training is done"""
    file: str
    """the name of the source"""
    object: str
    modifier: str
    state: State
    share: float
    note: str
    error: str | None = None
    parameters: list[Proposed] = []
    left_out: dict[str, str] = {}
    """inputs that are no parameters, and why"""
    notes: list[str] = []
    samples: list[str] = []
    """addresses of pictures of random samples"""
    shapes: int
    minutes: float


# The body of an upload, which is no JSON.
SOURCE_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
