"""Assets as files: built in the detail that was asked for, simplified or textured, written, and kept for a while."""

from __future__ import annotations

import contextlib
import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from shutil import make_archive, rmtree
from typing import Any

from dipcg.app.jobs import Job, guarded
from dipcg.app.limits import FILES_BYTES, FILES_OF_ONE, KEPT_S
from dipcg.app.models import AssetRequest
from dipcg.app.store import Store
from dipcg.app.studio import Studio
from dipcg.export.asset import BLEND, FBX, FORMATS, NEEDS, TEXTURED, Asset, ExportError
from dipcg.export.gltf import glb
from dipcg.mesh import Mesh

PARAMETERS = ".json"


@dataclass(frozen=True)
class Ordered:
    """An asset that a visitor waits for."""

    job: Job
    request: AssetRequest
    owner: str


class Making:
    """The threads that write files, and the files, in folders of `folder`."""

    def __init__(self, studio: Studio, folder: Path) -> None:
        self._studio, self._folder = studio, folder
        self._files: Store[Path] = Store(KEPT_S, FILES_BYTES, FILES_OF_ONE, drop=_delete)
        self._writing = ThreadPoolExecutor(2, thread_name_prefix="write")
        # What needs Blender takes long, and each needs a process of its own.
        self._blender = ThreadPoolExecutor(1, thread_name_prefix="blender")

    def start(self, ordered: Ordered) -> None:
        """Begin; the job says how it goes on. Raises ValueError with a sentence."""
        request, job = ordered.request, ordered.job
        build = self._studio.submit(request.generator, request.params, request.detail)
        job.report(0.1, "Building")
        job.watch(build.cancel)
        threads = self._blender if request.texture or request.format in (BLEND, FBX) else self._writing
        build.add_done_callback(lambda build: self._write_later(threads, ordered, build))

    def file(self, name: str) -> Path:
        """A finished file; raises LookupError with a sentence."""
        try:
            return self._files.get(name)
        except KeyError:
            raise LookupError("There is no such file here, or its time is over; make it again.") from None

    def preview(self, generator: str, mesh: Mesh) -> bytes:
        """A mesh as GLB."""
        return glb(Asset(mesh, generator, {}).scene(copies=True))

    def sweep(self) -> None:
        self._files.sweep()

    def close(self) -> None:
        """Stop after what is being written."""
        for threads in (self._writing, self._blender):
            threads.shutdown(cancel_futures=True)

    def _write_later(self, threads: ThreadPoolExecutor, ordered: Ordered, build: Future[Mesh]) -> None:
        # Builds may end after this is closed.
        with contextlib.suppress(RuntimeError):
            threads.submit(guarded, ordered.job, partial(self._write, ordered, build))

    def _write(self, ordered: Ordered, build: Future[Mesh]) -> None:
        request, job = ordered.request, ordered.job
        generator = self._studio.generator(request.generator)
        params = generator.space.validate(request.params)
        asset = Asset(build.result(), generator.ref, params, colours=request.colours)
        asset = _finished(asset, request, job)
        job.report(0.9, "Writing")
        # Systems empty their folder of temporary files after some days, which a server may outlive.
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(dir=self._folder))
        try:
            written = _written(asset, folder / f"{generator.name}{request.format}")
        except BaseException:
            _delete(folder / "failed")
            raise
        name = self._files.add(written, written.stat().st_size, ordered.owner)
        job.finish(_answer(asset.mesh, written, name))


def check(request: AssetRequest) -> None:
    """Raise ExportError with a sentence for what cannot be written here."""
    if request.format not in endings():
        raise ExportError(f"There is no format {request.format!r}; use one of {', '.join(endings())}.")
    if request.texture and request.format not in TEXTURED:
        raise ExportError(f"{request.format} files hold no maps; use one of {', '.join(TEXTURED)}.")
    if request.texture and find_spec("bpy") is None:
        raise ExportError("Baking maps needs Blender's module, which this server lacks.")


def endings() -> list[str]:
    """The formats that can be written here, the parameters' last."""
    return [*(suffix for suffix in FORMATS if suffix not in NEEDS or find_spec(NEEDS[suffix][0])), PARAMETERS]


def _finished(asset: Asset, request: AssetRequest, job: Job) -> Asset:
    """The asset simplified and textured as it was asked for."""
    asset = asset.with_faces(request.faces) if request.faces else asset
    if not request.texture:
        return asset
    from dipcg.export.textures import texture

    job.report(0.2, "Baking the materials")
    return texture(asset, request.texture, progress=lambda share, note: job.report(0.2 + 0.7 * share, note))


def _written(asset: Asset, target: Path) -> Path:
    """The written file, or an archive when others were written beside it, as an OBJ's materials are."""
    if target.suffix == PARAMETERS:
        target.write_text(asset.document)
        return target
    asset.export(target)
    if len(list(target.parent.iterdir())) == 1:
        return target
    outside = Path(tempfile.mkdtemp(dir=target.parent.parent))
    archive = Path(make_archive(str(outside / target.stem), "zip", target.parent))
    rmtree(target.parent)
    return archive


def _answer(mesh: Mesh, written: Path, name: str) -> dict[str, Any]:
    low, high = mesh.bounds
    return {
        "file": f"/api/v1/files/{name}/{written.name}",
        "name": written.name,
        "bytes": written.stat().st_size,
        "triangles": len(mesh.faces),
        "size_m": tuple(float(side) for side in high - low),
    }


def _delete(file: Path) -> None:
    """Delete a file with the folder that was made for it."""
    rmtree(file.parent, ignore_errors=True)
