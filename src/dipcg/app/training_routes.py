"""The routes of generators that are learned, under /api/v1/trainings; docs/app.md describes them."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Depends, HTTPException, Query, Request
from fastapi.responses import Response
from fastapi.sse import EventSourceResponse

from dipcg.app import models
from dipcg.app.limits import MOST_SOURCE_BYTES, MOST_TOML_BYTES
from dipcg.app.routes import TheDesk
from dipcg.app.training_folder import WORKING, NoTraining, Training
from dipcg.app.training_models import SOURCE_BODY, Learn, Proposed, Ranges, TrainingAnswer
from dipcg.app.trainings import Trainings
from dipcg.app.uploads import check_upload, receive
from dipcg.importing.editing import read_parameters
from dipcg.space import Value

# Seconds between two looks at a training that is followed.
LOOK_S = 0.5

router = APIRouter(prefix="/api/v1/trainings", responses=models.Errors)


def _trainings(desk: TheDesk) -> Trainings:
    return desk.trainings


All = Annotated[Trainings, Depends(_trainings)]


def _training(id: models.Id, every: All) -> Training:
    return every.get(id)


One = Annotated[Training, Depends(_training)]
Words = Annotated[str, Query(max_length=200)]
Head = Annotated[int, Query(ge=0, le=MOST_TOML_BYTES)]


@router.get("")
def get_trainings(every: All) -> list[TrainingAnswer]:
    """All generators that are learned here, the oldest first."""
    with every.changed:
        return [_answer(training, every) for training in every.all()]


@router.post("", status_code=201, max_body_size=MOST_SOURCE_BYTES, openapi_extra=SOURCE_BODY)
async def post_training(
    request: Request, desk: TheDesk, every: All, file: Words, object: Words = "", modifier: Words = "", toml: Head = 0
) -> TrainingAnswer:
    """Upload the source of a generator, whose bytes are the body, and have ranges proposed.

    `file` is its name, whose ending says what it is: .blend, .scad or .py. `object` and `modifier` name the one to
    learn in a Blender file. `toml` is the number of bytes before a Blender file that are a TOML file, as `dipcg
    generators add` writes it; its names and ranges are then taken, and none are proposed.
    """
    with desk.uploads.take(int(request.headers.get("content-length", "0"))):
        folder = every.start_upload(file)
        try:
            await receive(request.stream(), folder, toml)
            await anyio.to_thread.run_sync(check_upload, folder, file, every.blender)
            training = await anyio.to_thread.run_sync(every.add, folder, file, object, modifier)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    return _answer(training, every)


@router.get("/{id}")
def get_training(training: One, every: All) -> TrainingAnswer:
    """How far a training is, with its parameters and their ranges."""
    return _answer(training, every)


@router.get("/{id}/events", response_class=EventSourceResponse)
async def get_training_events(training: One, every: All) -> AsyncIterator[TrainingAnswer]:
    """The training after each change, as server-sent events, until nothing is done for it any more."""
    seen = None
    while True:
        try:
            now = await anyio.to_thread.run_sync(_answer, training, every)
        except NoTraining:
            return
        if now != seen:
            seen = now
            yield now
        if now.state not in WORKING:
            return
        await asyncio.sleep(LOOK_S)


@router.get("/{id}/samples/{number}", response_class=Response)
def get_sample(training: One, number: int) -> Response:
    """A picture of a random sample, as PNG."""
    try:
        picture = (training.samples / f"{number}.png").read_bytes()
    except FileNotFoundError:
        raise HTTPException(404, "There is no such sample.") from None
    return Response(picture, media_type="image/png")


@router.put("/{id}/ranges")
def put_ranges(wanted: Ranges, training: One, every: All) -> TrainingAnswer:
    """Edit the proposed ranges, all at once; samples of them are drawn, and what was learned with others goes."""
    every.edit(training, wanted.ranges, wanted.hold)
    return _answer(training, every)


@router.post("/{id}/learn", status_code=202)
def post_learn(wanted: Learn, training: One, every: All) -> TrainingAnswer:
    """Build data and train in the background, or go on with it."""
    every.learn(training, wanted.shapes, wanted.minutes)
    return _answer(training, every)


@router.post("/{id}/stop")
def post_stop(training: One, every: All) -> TrainingAnswer:
    """Stop, and keep what is there."""
    every.stop(training)
    return _answer(training, every)


@router.delete("/{id}", status_code=204)
def delete_training(training: One, every: All) -> None:
    """Forget the generator and all that was learned."""
    every.remove(training)


def _answer(training: Training, every: Trainings) -> TrainingAnswer:
    order, status, found = training.order, training.status, training.found
    return TrainingAnswer(
        id=training.id,
        name=order["name"],
        file=order["given"],
        state=every.state(training),
        **{key: order[key] for key in ("object", "modifier", "shapes", "minutes")},
        **{key: status[key] for key in ("share", "note", "error")},
        parameters=_parameters(training, order, found.get("values", {})),
        left_out=found.get("left_out", {}),
        notes=found.get("notes", []),
        samples=[f"/api/v1/trainings/{training.id}/samples/{name}" for name in _drawn(training.samples)],
    )


def _drawn(samples: Path) -> list[str]:
    """The number of each sample with when it was drawn, so that a browser asks for a new one."""
    try:
        return [f"{path.stem}?at={path.stat().st_mtime_ns}" for path in sorted(samples.glob("*.png"))]
    except FileNotFoundError:
        # They are being drawn again.
        return []


def _parameters(training: Training, order: dict, values: dict[str, str]) -> list[Proposed]:
    """What was proposed, with the edits."""
    if not training.proposed.is_file() or not values:
        return []
    return [_proposed(name, entry, values, order) for name, entry in read_parameters(training.proposed).items()]


def _proposed(name: str, entry: dict, values: dict[str, str], order: dict) -> Proposed:
    own = {} if entry.get("why") else {"lowest": entry.get("low"), "highest": entry.get("high")}
    low, high = order["ranges"].get(name, (entry.get("low"), entry.get("high")))
    options: list[Value] = [False, True] if entry["kind"] == "boolean" else entry.get("options", [])
    texts = {key: entry.get(key, "") for key in ("unit", "doc", "why")}
    return Proposed(
        name=name, kind=entry["kind"], value=values.get(name, ""), low=low, high=high, options=options,
        held=name in order["hold"], edited=name in order["ranges"], **own, **texts,
    )  # fmt: skip
