"""The routes of the API, under /api/v1; docs/app.md describes them."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, Any

import anyio.to_thread
import numpy as np
from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import FileResponse, Response
from fastapi.sse import EventSourceResponse

from dipcg.app import about, models
from dipcg.app.comparing import Asked
from dipcg.app.cutout import SENTENCES, cut
from dipcg.app.desk import Desk
from dipcg.app.jobs import Job
from dipcg.app.limits import MOST_PICTURE_BYTES
from dipcg.app.making import Ordered, check
from dipcg.app.models import Corrections
from dipcg.app.pictures import Kept
from dipcg.images import Cutout
from dipcg.inference.estimate import Options
from dipcg.model.constraints import check_fixed

# Seconds between two looks at a job that is followed.
LOOK_S = 0.1

router = APIRouter(prefix="/api/v1", responses=models.Errors)


def _desk(request: Request) -> Desk:
    return request.app.state.desk


def _owner(request: Request) -> str:
    """Who keeps something here: the address of the client."""
    return request.client.host if request.client else ""


TheDesk = Annotated[Desk, Depends(_desk)]
Owner = Annotated[str, Depends(_owner)]


def _job(id: models.Id, desk: TheDesk) -> Job:
    try:
        return desk.jobs.get(id)
    except KeyError:
        raise HTTPException(404, "There is no such job here, or its time is over.") from None


TheJob = Annotated[Job, Depends(_job)]


@router.get("/about")
def get_about(desk: TheDesk) -> models.About:
    """What this server can do, its limits, and pictures to begin with."""
    return about.about(desk.studio, desk.trainings)


@router.get("/examples/{name}", response_class=FileResponse)
def get_example(name: models.Name, desk: TheDesk) -> FileResponse:
    """A picture to begin with."""
    found = next((path for path in about.example_images(desk.studio.names) if path.name == name), None)
    if found is None:
        raise HTTPException(404, f"There is no example {name!r}.")
    return FileResponse(found)


@router.get("/generators")
def get_generators(desk: TheDesk) -> list[models.GeneratorAnswer]:
    """The generators with their declared parameters."""
    return [about.generator(desk.studio, name) for name in desk.studio.names]


@router.get("/generators/{name}/random")
def get_random(name: models.Name, desk: TheDesk, seed: Annotated[int | None, models.Seed] = None) -> models.Drawn:
    """Random parameters."""
    space = _find(desk, name).space
    return models.Drawn(params=space.sample(np.random.default_rng(seed)))


@router.post("/pictures", status_code=201, max_body_size=MOST_PICTURE_BYTES, openapi_extra=models.PICTURE_BODY)
async def post_picture(request: Request, desk: TheDesk, owner: Owner) -> models.Picture:
    """Upload a picture: its bytes are the body. It is decoded, shrunk and kept for an hour after its last use."""
    if not request.headers.get("content-type", "").startswith("image/"):
        raise HTTPException(415, "Send the picture's bytes with a Content-Type of image/….")
    length = int(request.headers.get("content-length", "0"))
    # The file has no name, so nothing of it stays however this ends.
    with desk.uploads.take(length), tempfile.TemporaryFile() as file:
        async for chunk in request.stream():
            file.write(chunk)
        file.seek(0)
        read = partial(desk.pictures.read, file, owner)
        name, kept = await anyio.to_thread.run_sync(read, limiter=desk.decoding)
    return _kept_picture(name, kept)


@router.get("/pictures/{id}", response_class=Response, responses={200: {"content": {"image/png": {}}}})
def get_picture(id: models.Id, desk: TheDesk) -> Response:
    """A picture or a cut-out as PNG."""
    return Response(_picture(desk, id).png, media_type="image/png", headers={"cache-control": "private, max-age=3600"})


@router.delete("/pictures/{id}", status_code=204)
def delete_picture(id: models.Id, desk: TheDesk) -> None:
    """Forget a picture."""
    desk.pictures.remove(id)


@router.post("/pictures/{id}/object")
async def post_object(id: models.Id, wanted: Corrections, desk: TheDesk, owner: Owner) -> models.CutOut:
    """Cut the object out; the result is a picture too."""
    with desk.cut_outs.take(1):
        found: Cutout = await anyio.to_thread.run_sync(_cutter(desk, id, wanted), limiter=desk.cutting)
    name, kept = desk.pictures.add(found, owner)
    return models.CutOut(picture=_kept_picture(name, kept), how=found.background, sentence=SENTENCES[found.background])


@router.post("/estimates", status_code=202)
def post_estimate(wanted: models.EstimateRequest, desk: TheDesk, owner: Owner) -> models.Accepted:
    """Estimate the parameters with which a generator makes what a picture shows, or a sentence says."""
    if wanted.fixed and not wanted.generator:
        raise HTTPException(422, "Parameters can be fixed only of a generator that is named.")
    if wanted.generator:
        check_fixed(_find(desk, wanted.generator).space, wanted.fixed)
    if wanted.text is not None and wanted.generator and not desk.studio.reads_text(wanted.generator):
        raise HTTPException(422, f"There is no checkpoint that reads sentences for {wanted.generator!r} here.")
    source: Any = wanted.text if wanted.picture is None else _cutter(desk, wanted.picture, wanted.object)
    options = Options(
        generator=wanted.generator, candidates=wanted.candidates, seed=wanted.seed, fixed=dict(wanted.fixed)
    )
    job = desk.jobs.add("estimate", owner)
    desk.estimating.start(Asked(job, source, options, owner, wanted.thumbnails))
    return models.Accepted(job=job.id)


@router.post("/assets", status_code=202)
def post_asset(wanted: models.AssetRequest, desk: TheDesk, owner: Owner) -> models.Accepted:
    """Build an asset and write it as a file."""
    check(wanted)
    _find(desk, wanted.generator).space.validate(wanted.params)
    job = desk.jobs.add("asset", owner)
    desk.making.start(Ordered(job, wanted, owner))
    return models.Accepted(job=job.id)


@router.post("/assets/preview", response_class=Response, responses={200: {"content": {"model/gltf-binary": {}}}})
async def post_preview(wanted: models.PreviewRequest, desk: TheDesk) -> Response:
    """Build an asset in light detail; the answer is a GLB, and its header `X-Triangles` a number."""
    _find(desk, wanted.generator)
    with desk.previews.take(1):
        build = desk.studio.submit(wanted.generator, wanted.params, "light")
        mesh = await asyncio.wrap_future(build)
        content = await anyio.to_thread.run_sync(desk.making.preview, wanted.generator, mesh)
    headers = {"X-Triangles": str(len(mesh.faces))}
    return Response(content, media_type="model/gltf-binary", headers=headers)


@router.get("/jobs/{id}")
def get_job(job: TheJob, desk: TheDesk) -> models.JobAnswer:
    """How far a job is, and its result."""
    return _answer(job, desk)


@router.get("/jobs/{id}/events", response_class=EventSourceResponse)
async def get_events(job: TheJob, desk: TheDesk) -> AsyncIterator[models.JobAnswer]:
    """The job after each change, as server-sent events, until it is over."""
    seen = None
    while True:
        # What is read first may be too old when it is sent, and is then sent again.
        over, now = job.is_over, (job.version, desk.estimating.place(job))
        if now != seen:
            seen = now
            yield _answer(job, desk)
        if over:
            return
        await asyncio.sleep(LOOK_S)


@router.delete("/jobs/{id}", status_code=204)
def delete_job(job: TheJob) -> None:
    """Cancel a job."""
    job.cancel()


@router.get("/files/{id}/{name}", response_class=FileResponse)
def get_file(id: models.Id, name: models.Name, desk: TheDesk) -> FileResponse:
    """A finished file."""
    path = desk.making.file(id)
    if path.name != name:
        raise HTTPException(404, "There is no such file here.")
    return FileResponse(path, filename=name, content_disposition_type="attachment")


def _answer(job: Job, desk: Desk) -> models.JobAnswer:
    place = None if job.is_over else desk.estimating.place(job)
    return models.JobAnswer.model_validate(
        {"id": job.id, "kind": job.kind, "state": job.state, "share": job.share, "note": job.note}
        | {"place": place, "result": job.result, "error": job.error}
    )


def _find(desk: Desk, name: str) -> Any:
    try:
        return desk.studio.generator(name)
    except ValueError as error:
        raise HTTPException(404, str(error)) from None


def _picture(desk: Desk, name: str) -> Any:
    try:
        return desk.pictures.get(name)
    except LookupError as error:
        raise HTTPException(404, str(error)) from None


def _kept_picture(name: str, kept: Kept) -> models.Picture:
    return models.Picture(id=name, width=kept.width, height=kept.height, notes=list(kept.notes))


def _cutter(desk: Desk, name: str, wanted: Corrections | None) -> Any:
    """What cuts the object out of a picture; the pictures are found now, and decoded later."""
    picture, wanted = _picture(desk, name), wanted or Corrections()
    mask = _picture(desk, wanted.mask) if wanted.mask else None
    return lambda: cut(picture.open(), wanted, _pixels(mask.open()) if mask else None)


def _pixels(image: Any) -> Any:
    return image.image if isinstance(image, Cutout) else image
