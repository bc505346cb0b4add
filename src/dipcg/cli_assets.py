"""Commands that make assets: sample, edit, estimate."""

from __future__ import annotations

import json as jsons
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, UseAppendAction, arg

if TYPE_CHECKING:
    from dipcg.generators import Detail, Generator
    from dipcg.pipeline import Estimate
    from dipcg.space import Params

Name = Annotated[str, arg(aliases=["-g"], metavar="NAME")]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
Settings = Annotated[tuple[tuple[str, ...], ...], UseAppendAction, arg(metavar="NAME=VALUE")]  # one or more, repeatable


@dataclass(frozen=True)
class Written:
    """What a command writes."""

    output: Output
    """mesh to write: .glb, .gltf, .obj, .ply or .stl"""
    params_out: Path | None = None
    """JSON file for the parameters"""
    light: bool = False
    """build the coarse mesh"""
    json: bool = False
    """print what was made as JSON"""

    @property
    def detail(self) -> Detail:
        return "light" if self.light else "full"

    def check(self) -> None:
        """Raise export.ExportError for a file that could not be written, before any work is done."""
        from dipcg.export import check_target

        check_target(self.output)
        if self.params_out is not None:
            check_target(self.params_out, (".json",))


Options = Annotated[Written, arg(name="")]


def sample(name: Positional[str], /, *, written: Options, seed: int = 0, set: Settings = ()) -> None:
    """Build a random asset, or one with given parameters.

    Args:
        name: of a generator, or a path to a Python or TOML file
        written: files and their detail
        seed: of the random parameters
        set: parameters to hold, as name=value
    """
    import numpy as np

    from dipcg.generators import load_generator

    generator = load_generator(name)
    params = generator.space.sample(np.random.default_rng(seed))
    _build_and_write(generator, generator.space.replace(params, parse_settings(set)), written)


def edit(file: Positional[Path], /, *, written: Options, set: Settings = ()) -> None:
    """Change parameters of an asset and build it again.

    Args:
        file: parameters as JSON, from --params-out
        written: files and their detail
        set: parameters to change, as name=value
    """
    from dipcg.generators import load_generator
    from dipcg.space import params_from_json

    name, params = params_from_json(_read(file))
    generator = load_generator(name)
    params = generator.space.replace(generator.space.validate(params), parse_settings(set))
    _build_and_write(generator, params, written)


def estimate(
    images: Positional[tuple[Path, ...]],
    /,
    *,
    generator: Name,
    written: Options,
    candidates: int = 16,
    steps: int = 10,
    seed: int = 0,
    keep: Settings = (),
    preview: Path | None = None,
) -> None:
    """Turn pictures into editable assets.

    With several pictures, files are named after them in the folder of the output: chair.glb becomes PICTURE.glb.

    Args:
        images: photographs, drawings or masks
        generator: what they show, or a folder with a checkpoint, or a generator's file whose checkpoint is in runs/
        written: files and their detail
        candidates: how many to return: the expected one, then samples
        steps: of the sampler
        seed: of the samples
        keep: parameters to hold, as name=value; the rest is estimated around them
        preview: PNG file for the photo beside the result
    """
    from dipcg.pipeline import Inverter

    targets, kept = _targets(images, written, preview), parse_settings(keep)
    with Inverter.load(generator) as inverter:
        for name, value in kept.items():
            inverter.generator.space.find(name)[1].check(value)
        inverter.pool.warm()
        wanted = partial(inverter.estimate, candidates=candidates, steps=steps, seed=seed, keep=kept)
        failed = [image for image in images if not _try_estimate(wanted, image, targets[image], written)]
    if failed:
        raise SystemExit(1)


Targets = tuple[Path | None, ...]  # of the mesh, the parameters and the preview


def _targets(images: Sequence[Path], written: Written, preview: Path | None) -> dict[Path, Targets]:
    """The files of each picture, all of which can be written; raises ValueError."""
    from dipcg.export import check_target

    if not images:
        raise ValueError("Give at least one picture.")
    written.check()
    if preview is not None:
        check_target(preview, (".png",))
    asked = (written.output, written.params_out, preview)
    targets = {image: tuple(_named_after(path, image, len(images) > 1) for path in asked) for image in images}
    _check_distinct(images, [path for image in images for path in targets[image] if path])
    return targets


def _try_estimate(wanted: Callable[[Path], Estimate], image: Path, targets: Targets, written: Written) -> bool:
    """Estimate one picture and write its files; what fails is told, so that the others go on."""
    try:
        found = wanted(image)
        _write_estimate(found, targets, written.detail)
        _tell_estimate(image, found, targets, written.json)
    except (ValueError, RuntimeError) as error:
        print(f"{image}: {error}" if str(image) not in str(error) else str(error), file=sys.stderr)
        return False
    return True


def parse_settings(settings: Sequence[Sequence[str]]) -> dict[str, str]:
    """`name=value` words, as given to each of several flags, as a dict; raises ValueError for a word without `=`."""
    words = [word for given in settings for word in given]
    for word in words:
        if "=" not in word:
            raise ValueError(f"A setting is written name=value, got {word!r}.")
    return {name.strip(): value.strip() for name, value in (word.split("=", 1) for word in words)}


def _check_distinct(images: Sequence[Path], targets: Sequence[Path]) -> None:
    """Raise ValueError where a file would be written twice, or over a picture that is read."""
    taken = {image.absolute() for image in images}
    for target in targets:
        if target.absolute() in taken:
            raise ValueError(f"{target} would be overwritten; choose another name or folder.")
        taken.add(target.absolute())


def _read(file: Path) -> str:
    try:
        return file.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise ValueError(f"{file} cannot be read as a parameter file ({reason}).") from None


def _build_and_write(generator: Generator, params: Params, written: Written) -> None:
    from dipcg.export import Asset
    from dipcg.worker import BuildPool

    written.check()
    with BuildPool(generator.ref) as pool:
        asset = Asset(pool.build(params, written.detail), generator.ref, params)
    asset.export(written.output)
    if written.params_out is not None:
        asset.save_params(written.params_out)
    faces = len(asset.mesh.faces)
    made = {"generator": generator.name, "output": str(written.output), "faces": faces, "params": params}
    print(jsons.dumps(made) if written.json else f"Wrote {written.output}, {faces:,} triangles.")


def _write_estimate(found: Estimate, targets: Targets, detail: Detail) -> None:
    from dipcg.preview import side_by_side

    output, params_out, preview = targets
    assert output is not None
    asset = found.build(detail=detail)
    asset.export(output)
    if params_out:
        asset.save_params(params_out)
    if preview:
        side_by_side(found, asset.mesh, preview)


def _tell_estimate(image: Path, found: Estimate, targets: Targets, json: bool) -> None:
    output, params_out, _ = targets
    if json:
        candidates = [{"params": c.params, "view": asdict(c.view)} for c in found.candidates]
        print(
            jsons.dumps({"image": str(image), "output": str(output), "candidates": candidates, "spread": found.spread})
        )
    else:
        print(f"{image} -> {output}" + (f", {params_out}" if params_out else ""))


def _named_after(path: Path | None, image: Path, many: bool) -> Path | None:
    return path.with_stem(image.stem) if path and many else path
