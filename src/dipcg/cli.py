"""The command line: words people type, one function each. Nothing heavy is imported before a command needs it.

Exit codes: 0 all done, 1 something failed and a sentence on stderr says what, 2 the command line itself is wrong.
"""

from __future__ import annotations

import json as jsons
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg

from dipcg.config import ModelConfig, TrainConfig

if TYPE_CHECKING:
    from dipcg.generators import Generator
    from dipcg.pipeline import Estimate, Inverter

Name = Annotated[str, arg(aliases=["-g"], metavar="NAME")]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
Settings = Annotated[tuple[tuple[str, ...], ...], UseAppendAction, arg(metavar="NAME=VALUE")]  # one or more, repeatable


def generators(name: Positional[str] = "", /, *, json: bool = False) -> None:
    """List the generators, or the parameters of one.

    Args:
        name: of a generator, or a path to a Python file
        json: print JSON
    """
    from dipcg import listing

    print(listing.parameters(name, json) if name else listing.generators(json))


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
        name: of a generator, or a path to a Python file
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
        generator: what they show, or a folder with a checkpoint
        output: mesh to write: .glb, .gltf, .obj, .ply or .stl
        candidates: how many samples to draw
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


def dataset_build(
    generator: Positional[str],
    /,
    *,
    output: Output,
    count: int = 20_000,
    seed: int = 0,
    workers: int = 2,
    timeout_s: float = 60.0,
    resume: bool = True,
) -> None:
    """Sample a generator and store parameters and light meshes.

    Args:
        generator: name, or a path to a Python file
        output: folder for the shards
        count: number of shapes
        seed: of the shapes
        workers: processes that build
        timeout_s: seconds after which a build is given up
        resume: go on with a folder that already has shards
    """
    from dipcg.store import build_dataset
    from dipcg.terminal import bar

    if not resume and any(output.glob("shard-*.parquet")):
        raise ValueError(f"{output} already has shards; choose another folder, or leave out --no-resume.")
    with bar("building", count) as update:
        failed = build_dataset(
            generator, output, count, seed, workers, timeout_s, lambda p: update(p.done, f"{p.failed} failed")
        )
    print(f"{count - failed} shapes in {output}, {failed} failed.")


def dataset_info(folder: Positional[Path], /, *, json: bool = False) -> None:
    """Say what a data set holds.

    Args:
        folder: with shards
        json: print JSON
    """
    from dipcg.store import Store

    found = Store(folder).summary()
    print(jsons.dumps(found, indent=1) if json else "\n".join(f"{key:12} {value}" for key, value in found.items()))


def dataset_gallery(folder: Positional[Path], /, *, output: Output, count: int = 48) -> None:
    """Draw a contact sheet of a data set.

    Args:
        folder: with shards
        output: PNG file
        count: number of shapes
    """
    from itertools import islice

    from dipcg.export import check_target
    from dipcg.preview import contact_sheet
    from dipcg.store import Store

    check_target(output, (".png",))
    meshes = [sample.mesh for sample in islice(Store(folder).samples(), count) if sample.mesh]
    if not meshes:
        raise ValueError(f"None of the first {count} samples in {folder} has a mesh to draw.")
    contact_sheet(meshes, output)
    print(f"Wrote {output}.")


def train(
    generator: Positional[str],
    /,
    *,
    data: Path,
    output: Output = Path("runs"),
    train: Annotated[TrainConfig, arg(name="")] = TrainConfig(),  # noqa: B008 - frozen
    model: Annotated[ModelConfig, arg(name="")] = ModelConfig(),  # noqa: B008 - frozen
) -> None:
    """Train an estimator on a data set; a killed run goes on where it was.

    Args:
        generator: name, or a path to a Python file; its checkpoint goes to a folder of this name in the output
        data: folder from `dipcg dataset build`
        output: folder for checkpoints
    """
    from dipcg.store import Store
    from dipcg.terminal import bar
    from dipcg.tracking import Log
    from dipcg.train import train as run

    info = Store(data).info
    if generator not in (info["generator"], info["ref"]):
        raise ValueError(f"{data} holds shapes of {info['generator']!r}, not of {generator!r}.")
    folder = output / info["generator"]
    with bar("training", 1000) as update, Log(folder) as log:

        def report(status: Any) -> None:
            update(int(1000 * status.share), f"loss {status.loss:.3f}, {status.pictures_per_s:.0f} pictures/s")
            log(status)

        run(data, folder, train, model, report)
    print(f"Wrote the best weights to {folder}. Try: dipcg estimate PICTURE -g {folder} -o out.glb")


def evaluate(
    generator: Positional[str],
    /,
    *,
    data: Path | None = None,
    pairs: Path | None = None,
    prefix: str = "",
    count: int = 100,
    candidates: int = 16,
    steps: int = 10,
    metric: tuple[str, ...] = (),
    json: Path | None = None,
) -> None:
    """Measure an estimator on unseen shapes of a data set, or on pictures with surface points.

    Args:
        generator: name, or a folder with a checkpoint
        data: folder from `dipcg dataset build`, of which the test split is used
        pairs: folder with NAME.png and NAME.npz (array `points`), compared at the best of four quarter turns
        prefix: only pairs whose names start so; the generator's name when left out
        count: at most so many shapes
        candidates: how many samples an estimate draws
        steps: of the sampler
        metric: names of metrics; all when left out
        json: file for the table as JSON
    """
    from itertools import islice

    from dipcg.evaluate import evaluate as measure
    from dipcg.evaluate import pair_cases, split_cases
    from dipcg.export import check_target
    from dipcg.pipeline import Inverter
    from dipcg.terminal import bar, table

    if (data is None) == (pairs is None):
        raise ValueError("Give one of --data and --pairs.")
    if json is not None:
        check_target(json, (".json",))
    with Inverter.load(generator, workers=2) as inverter, bar("measuring", count) as update:
        name = inverter.generator.name
        cases = split_cases(data, count) if data else islice(pair_cases(pairs or Path(), prefix or name), count)
        done = iter(range(1, count + 1))
        found = measure(
            inverter,
            cases,
            candidates,
            steps,
            pairs is not None,
            list(metric) or None,
            lambda case: update(next(done), case.name),
        )
    print(table(found))
    if json:
        json.write_text(jsons.dumps(found.to_dict(), indent=1))


def doctor(*, json: bool = False) -> None:
    """Say what is missing on this machine, and the command that mends it.

    Args:
        json: print JSON
    """
    from dipcg import doctor as checking

    found = checking.checks()
    print(jsons.dumps([asdict(check) for check in found], indent=1) if json else checking.report(found))
    if not all(check.ok for check in found):
        raise SystemExit(1)


ABOUT = "From a picture to the parameters of a procedural generator, and so to an exact, light, editable asset."
COMMANDS = {
    "generators": generators,
    "sample": sample,
    "estimate": estimate,
    "edit": edit,
    "dataset build": dataset_build,
    "dataset info": dataset_info,
    "dataset gallery": dataset_gallery,
    "train": train,
    "evaluate": evaluate,
    "doctor": doctor,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; a problem becomes one sentence on stderr and exit code 1."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if " ".join(words[:2]) in COMMANDS:  # tyro knows subcommands of one word
        words[:2] = [" ".join(words[:2])]
    try:
        tyro.extras.subcommand_cli_from_dict(
            COMMANDS, prog="dipcg", description=ABOUT, args=words, config=(FlagCreatePairsOff,)
        )
    except (ValueError, LookupError, RuntimeError, ImportError, OSError) as error:
        print(_sentence(error), file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("Stopped.", file=sys.stderr)
        raise SystemExit(130) from None


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


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename} cannot be used ({error.strerror})."
    return str(error.args[0] if error.args and isinstance(error, KeyError) else error)


def _build_and_write(
    generator: Generator, params: Any, output: Path, params_out: Path | None, light: bool, json: bool
) -> None:
    from dipcg.export import Asset, check_target
    from dipcg.worker import BuildPool

    check_target(output)
    if params_out is not None:
        check_target(params_out, (".json",))
    with BuildPool(generator.ref) as pool:
        asset = Asset(pool.build(params, "light" if light else "full"), generator.name, params)
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


if __name__ == "__main__":
    main()
