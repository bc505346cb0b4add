"""Commands that make assets: sample, edit, estimate."""

from __future__ import annotations

import json as jsons
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, UseAppendAction, arg

if TYPE_CHECKING:
    from dipcg.generators import Generator
    from dipcg.pipeline import Estimate, Inverter

Name = Annotated[str, arg(aliases=["-g"], metavar="NAME")]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
Settings = Annotated[tuple[tuple[str, ...], ...], UseAppendAction, arg(metavar="NAME=VALUE")]  # one or more, repeatable


def sample(
    name: Positional[str],
    /,
    *,
    output: Output,
    seed: int = 0,
    set: Settings = (),
    params_out: Path | None = None,
    light: bool = False,
    json: bool = False,
) -> None:
    """Build a random asset, or one with given parameters.

    Args:
        name: of a generator, or a path to a Python or TOML file
        output: mesh to write: .glb, .gltf, .obj, .ply or .stl
        seed: of the random parameters
        set: parameters to hold, as name=value
        params_out: JSON file for the parameters
        light: build the coarse mesh
        json: print what was made as JSON
    """
    import numpy as np

    from dipcg.generators import load_generator

    generator = load_generator(name)
    params = generator.space.sample(np.random.default_rng(seed))
    params = generator.space.replace(params, parse_settings(set))
    _build_and_write(generator, params, output, params_out, light, json)


def edit(
    file: Positional[Path],
    /,
    *,
    output: Output,
    set: Settings = (),
    params_out: Path | None = None,
    light: bool = False,
    json: bool = False,
) -> None:
    """Change parameters of an asset and build it again.

    Args:
        file: parameters as JSON, from --params-out
        output: mesh to write: .glb, .gltf, .obj, .ply or .stl
        set: parameters to change, as name=value
        params_out: JSON file for the changed parameters
        light: build the coarse mesh
        json: print what was made as JSON
    """
    from dipcg.generators import load_generator
    from dipcg.space import params_from_json

    try:
        text = file.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise ValueError(f"{file} cannot be read as a parameter file ({reason}).") from None
    name, params = params_from_json(text)
    generator = load_generator(name)
    params = generator.space.replace(generator.space.validate(params), parse_settings(set))
    _build_and_write(generator, params, output, params_out, light, json)


def estimate(
    images: Positional[tuple[Path, ...]],
    /,
    *,
    generator: Name,
    output: Output,
    candidates: int = 16,
    steps: int = 10,
    seed: int = 0,
    keep: Settings = (),
    params_out: Path | None = None,
    preview: Path | None = None,
    light: bool = False,
    json: bool = False,
) -> None:
    """Turn pictures into editable assets.

    With several pictures, files are named after them in the folder of the output: chair.glb becomes PICTURE.glb.

    Args:
        images: photographs, drawings or masks
        generator: what they show, or a folder with a checkpoint, or a generator's file whose checkpoint is in runs/
        output: mesh to write: .glb, .gltf, .obj, .ply or .stl
        candidates: how many to return: the expected one, then samples
        steps: of the sampler
        seed: of the samples
        keep: parameters to hold, as name=value; the rest is estimated around them
        params_out: JSON file for the parameters
        preview: PNG file for the photo beside the result
        light: build the coarse mesh
        json: print the estimates as JSON
    """
    from dipcg.export import check_target
    from dipcg.pipeline import Inverter

    if not images:
        raise ValueError("Give at least one picture.")
    check_target(output)
    for path, endings in ((params_out, (".json",)), (preview, (".png",))):
        if path is not None:
            check_target(path, endings)
    named = [[_named_after(path, image, len(images) > 1) for path in (output, params_out, preview)] for image in images]
    _check_distinct(images, [path for targets in named for path in targets if path])
    kept, failed = parse_settings(keep), 0
    with Inverter.load(generator) as inverter:
        for name, value in kept.items():
            inverter.generator.space.find(name)[1].check(value)
        inverter.pool.warm()
        for image, targets in zip(images, named, strict=True):
            try:
                found = inverter.estimate(image, candidates, steps, seed, kept)
                _write_estimate(inverter, found, targets, light)
                _tell_estimate(image, found, targets, json)
            except (ValueError, RuntimeError) as error:
                failed += 1
                print(f"{image}: {error}" if str(image) not in str(error) else str(error), file=sys.stderr)
    if failed:
        raise SystemExit(1)


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


def _build_and_write(
    generator: Generator, params: Any, output: Path, params_out: Path | None, light: bool, json: bool
) -> None:
    from dipcg.export import Asset, check_target
    from dipcg.worker import BuildPool

    check_target(output)
    if params_out is not None:
        check_target(params_out, (".json",))
    with BuildPool(generator.ref) as pool:
        asset = Asset(pool.build(params, "light" if light else "full"), generator.ref, params)
    asset.export(output)
    if params_out is not None:
        asset.save_params(params_out)
    faces = len(asset.mesh.faces)
    made = {"generator": generator.name, "output": str(output), "faces": faces, "params": params}
    print(jsons.dumps(made) if json else f"Wrote {output}, {faces:,} triangles.")


def _write_estimate(inverter: Inverter, found: Estimate, targets: list[Path | None], light: bool) -> None:
    from dipcg.preview import side_by_side

    output, params_out, preview = targets
    assert output is not None
    asset = found.build(detail="light" if light else "full")
    asset.export(output)
    if params_out:
        asset.save_params(params_out)
    if preview:
        side_by_side(found, asset.mesh, preview)


def _tell_estimate(image: Path, found: Estimate, targets: list[Path | None], json: bool) -> None:
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
