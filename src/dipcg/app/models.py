"""The requests and the answers of the API, typed: what OpenAPI shows at /docs."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from dipcg.app.limits import MOST_CANDIDATES, MOST_FACES, MOST_LETTERS, MOST_TEXTURE
from dipcg.generators import Detail
from dipcg.materials import Colour
from dipcg.space import Value

Name = Annotated[str, Field(max_length=100)]
Id = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]
Given = bool | int | float | Annotated[str, Field(max_length=100)]
GivenParams = Annotated[dict[Name, Given], Field(max_length=500)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Seed = Field(ge=0, lt=2**53)
How = Literal["auto", "by colour", "as it is", "mask"]


class Request(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Crop(Request):
    """What is cut away at each side, as shares of the picture's width and height."""

    left: Share = 0.0
    right: Share = 0.0
    top: Share = 0.0
    bottom: Share = 0.0


class Stroke(Request):
    """A line drawn over the picture; points and radius are shares of its width and height, from the upper left."""

    points: Annotated[list[tuple[Share, Share]], Field(min_length=1, max_length=2000)]
    radius: Annotated[float, Field(gt=0, le=0.5)] = 0.01


Strokes = Annotated[list[Stroke], Field(max_length=200)]


class Corrections(Request):
    """How to cut the object out."""

    how: How = "auto"
    difference: Annotated[float, Field(ge=0, le=200)] = 14.0
    """the least difference from the background's colour, in CIELAB, for `by colour`"""
    mask: Id | None = None
    """a picture that is light where the object is, for `mask`"""
    crop: Crop = Crop()
    foreground: Strokes = []
    """strokes on the object"""
    background: Strokes = []
    """strokes beside it"""


class EstimateRequest(Request):
    """A picture or a sentence whose parameters are estimated."""

    picture: Id | None = None
    text: Annotated[str, Field(min_length=1, max_length=MOST_LETTERS)] | None = None
    generator: Name | None = None
    """recognised when left out"""
    candidates: Annotated[int, Field(ge=1, le=MOST_CANDIDATES)] = 8
    seed: Annotated[int, Seed] = 0
    fixed: GivenParams = {}
    """values of parameters, around which the rest is estimated"""
    object: Corrections | None = None
    thumbnails: bool = True

    @model_validator(mode="after")
    def _one_of_both(self) -> EstimateRequest:
        if (self.picture is None) == (self.text is None):
            raise ValueError("Give either a picture or a text")
        return self


class PreviewRequest(Request):
    """An asset to look at."""

    generator: Name
    params: GivenParams


class AssetRequest(PreviewRequest):
    """An asset to write as a file."""

    format: Annotated[str, Field(max_length=10)] = ".glb"
    detail: Detail = "standard"
    faces: Annotated[int, Field(ge=4, le=MOST_FACES)] | None = None
    """triangles to simplify to, about"""
    texture: Annotated[int, Field(ge=16, le=MOST_TEXTURE)] | None = None
    """side of baked maps in pixels"""
    colours: Annotated[dict[Name, tuple[Share, Share, Share]], Field(max_length=256)] = {}
    """colours of parts in sRGB, as candidates have them; without any, plausible materials"""


class Option(BaseModel):
    value: Value
    label: str


class Parameter(BaseModel):
    name: str
    label: str
    part: str
    kind: Literal["real", "choice"]
    low: float | None = None
    high: float | None = None
    unit: str
    options: list[Option] = []
    doc: str
    inactive: Value
    when: dict[str, list[Value]]
    input: str = ""
    """the identifier of the input of a Geometry Nodes modifier that it sets, if there is one"""
    component: str = ""
    """the axis, for an input that is a vector"""


class GeneratorAnswer(BaseModel):
    name: str
    label: str
    ref: str
    doc: str
    reads_text: bool
    parameters: list[Parameter]


class Drawn(BaseModel):
    params: dict[str, Value]


class Example(BaseModel):
    name: str
    label: str
    url: str


class About(BaseModel):
    version: str
    formats: list[str]
    textures: list[str]
    """the formats that hold baked maps"""
    details: list[str]
    limits: dict[str, int]
    examples: list[Example]
    words: bool
    """whether sentences are read"""
    learns: bool
    """whether generators are learned here"""
    takes_code: bool
    """whether Python files are learned, which run with all rights of the server"""


class Picture(BaseModel):
    id: str
    width: int
    height: int
    notes: list[str] = []
    """sentences about the file that its sender should know"""


class CutOut(BaseModel):
    picture: Picture
    how: Literal["alpha", "plain", "photo"]
    sentence: str


class Accepted(BaseModel):
    job: str


class View(BaseModel):
    azimuth_deg: float
    elevation_deg: float
    distance: float


class Candidate(BaseModel):
    params: dict[str, Value]
    view: View
    agreement: float | None
    thumbnail: str | None = None
    """a picture of it as a data: URL"""
    colours: dict[str, Colour] = {}
    """the colour of each part in the picture, in sRGB from 0 to 1: give them to POST /assets for a file with them"""


class EstimateResult(BaseModel):
    generator: str
    generators: dict[str, float]
    ranked: bool
    doubt: str | None
    note: str
    misfit: float | None
    picture: str | None
    """the id of the cut-out that was seen; null for a sentence"""
    candidates: list[Candidate]
    spread: dict[str, float]
    probabilities: dict[str, dict[str, float]]


class AssetResult(BaseModel):
    file: str
    name: str
    bytes: int
    triangles: int
    size_m: tuple[float, float, float]
    """extents along x, y and z"""


class JobAnswer(BaseModel):
    id: str
    kind: Literal["estimate", "asset"]
    state: Literal["waiting", "running", "done", "failed", "cancelled"]
    share: float
    note: str
    place: int | None = None
    """how many wait before it"""
    result: EstimateResult | AssetResult | None = None
    error: str | None = None


class ErrorAnswer(BaseModel):
    error: str


# The body of an upload, which is no JSON.
PICTURE_BODY = {
    "requestBody": {"required": True, "content": {"image/*": {"schema": {"type": "string", "format": "binary"}}}}
}
Errors: dict[int | str, dict[str, Any]] = {
    status: {"model": ErrorAnswer} for status in (400, 403, 404, 411, 413, 415, 421, 422, 503)
}
