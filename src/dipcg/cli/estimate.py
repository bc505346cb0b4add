"""The command that turns pictures or a sentence into assets: estimate."""

from __future__ import annotations

import json as jsons
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from tyro.conf import OmitArgPrefixes, Positional, arg

from dipcg.cli.assets import Options as WrittenFlags
from dipcg.cli.assets import Settings, Written, parse_settings
from dipcg.cli.outputs import check_outputs

if TYPE_CHECKING:
    from dipcg.cli.batch import Batch
    from dipcg.inference.estimate import Options, Result
    from dipcg.inference.inverters import Inverters
    from dipcg.pipeline import Inverter

MAX_WORKERS = 4


@dataclass(frozen=True)
class Input:
    """What the pictures are."""

    text: str | None = None
    """a description of the object in English, in place of pictures"""
    views: bool = False
    """all pictures show one object, each from its own side; the camera of the first is estimated"""


@dataclass(frozen=True)
class Estimation:
    """How the parameters are estimated."""

    # The alias `Name | None` would lose the short flag.
    generator: Annotated[str | None, arg(aliases=["-g"], metavar="NAME")] = None
    """generator that makes such objects, a folder with a checkpoint, or a generator's file with a checkpoint in runs/;
    by default it is recognised among those that ship"""
    keep: Settings = ()
    """fixed parameters, as name=value; the rest is estimated around them"""
    candidates: int = 16
    """number of candidates: the expected one, and samples"""
    rank: bool = True
    """take the expected candidate; without this flag all candidates are built and compared with the picture, and the
    one that is likeliest near the truth is taken"""
    refine: Annotated[float | None, arg(metavar="SECONDS")] = None
    """seconds of search from the best candidate"""
    steps: int | None = None
    """steps of the sampler; by default as many as the checkpoint was made for"""
    seed: int = 0
    """random seed of the samples"""

    def check(self) -> None:
        """Raise ValueError for flags that cannot be used, before torch is imported."""
        if self.refine is not None and not self.refine > 0:
            raise ValueError(f"A search (--refine) takes more than 0 seconds, got {self.refine:g}.")
        parse_settings(self.keep)

    def options(self) -> Options:
        """The options of the workflow."""
        from dipcg.inference.estimate import Options

        return Options(
            candidates=self.candidates,
            steps=self.steps,
            seed=self.seed,
            fixed=parse_settings(self.keep),
            rank=self.rank and self.candidates > 1,
            refine_s=self.refine,
        )


def estimate(
    images: Positional[tuple[Path, ...]] = (),
    /,
    *,
    input: Annotated[Input, OmitArgPrefixes],
    estimation: Annotated[Estimation, OmitArgPrefixes],
    output: WrittenFlags,
    preview: Path | None = None,
) -> None:
    """Turn pictures into editable assets.

    With several pictures, files are named after them in the folder of the output: chair.glb becomes PICTURE.glb.
    A folder of pictures (`estimate FOLDER -o OUT/`) becomes a folder of assets, parameters and previews with a page,
    index.html, that shows all. Files that are there already are skipped, so a stopped run can be repeated.

    Args:
        images: photographs, drawings or masks, or one folder of them
        preview: PNG file for the photo beside the result
    """
    batch, targets = None, {}
    levels = output.levels(output.output)
    check_outputs((output.output, *levels, output.params_out, preview), (estimation.generator, *images))
    images, others = (images[:1], images[1:]) if input.views else (images, ())
    estimation.check()
    if input.text is None:
        batch = _open_batch(images, output, preview)
        targets = _targets(images, output, preview) if batch is None else _batch_targets(batch, output)
    elif images:
        raise ValueError("Give pictures or --text, not both: dipcg estimate --text 'a tall bar chair' -o OUT.glb")
    else:
        _check_outputs(output, preview)
    # This imports torch, which takes seconds, so what can be refused is refused before.
    options, generator = estimation.options(), estimation.generator
    if input.text is not None:
        _estimate_text(input.text, generator, output, options, preview)
    elif targets:
        _estimate_all(targets, others, generator, output, options, batch)


class Targets(NamedTuple):
    """The files to write for one picture."""

    output: Path
    params: Path | None
    preview: Path | None


def _estimate_all(
    targets: dict[Path, Targets],
    others: Sequence[Path],
    generator: str | None,
    written: Written,
    options: Options,
    batch: Batch | None,
) -> None:
    """Estimate every picture; `others` show the same object as the only one. Exits with code 1 if any fails."""
    from dipcg.inference.inverters import Inverters

    workers = _workers(once=len(targets) == 1 and options.refine_s is None) if _builds_many(options, generator) else 1
    problems: dict[Path, str] = {}
    with Inverters([generator] if generator else [], workers) as inverters:
        if generator:
            options = _prepare(inverters, options)
        for image in targets:
            problems |= _try_estimate(image, others, targets[image], inverters, written, options)
            if batch is not None:
                batch.write_page(problems)
    if problems:
        raise SystemExit(1)


def _prepare(inverters: Inverters, options: Options) -> Options:
    """The options with the one generator; its workers are started, and fixed values are checked before any work."""
    from dipcg.model.constraints import check_fixed

    ((name, inverter),) = inverters.items()
    check_fixed(inverter.generator.space, options.fixed)
    inverter.pool.warm()
    return replace(options, generator=name)


def _try_estimate(
    image: Path, others: Sequence[Path], targets: Targets, inverters: Inverters, written: Written, options: Options
) -> dict[Path, str]:
    """Estimate one picture and write its files; an error is printed and returned, so that the others go on."""
    from dipcg.cli.terminal import bar, error_text
    from dipcg.inference.estimate import estimate

    try:
        if options.refine_s is None:
            result = estimate([image, *others], inverters, options)
        else:
            with bar("searching", 1000) as update:
                result = estimate(
                    [image, *others], inverters, options, lambda share, note: update(int(1000 * share), note)
                )
        _write(result, inverters[result.estimate.generator], targets, written)
        _print(image, result, targets, written.json)
        for other, doubt in zip(others, result.view_doubts, strict=True):
            _warn(other, doubt)
    except (ValueError, RuntimeError) as error:
        text = error_text(error)
        print(text if str(image) in text else f"{image}: {text}", file=sys.stderr)
        return {image: text}
    return {}


def _estimate_text(text: str, generator: str | None, written: Written, options: Options, preview: Path | None) -> None:
    """Turn a sentence into an asset."""
    from dipcg.inference.estimate import describe
    from dipcg.inference.inverters import Inverters

    with Inverters([generator] if generator else [], reads="text") as inverters:
        if generator:
            options = replace(options, generator=next(iter(inverters)))
        result = describe(text, inverters, options)
        targets = Targets(written.output, written.params_out, preview)
        _write(result, inverters[result.estimate.generator], targets, written)
        _print(Path(text), result, targets, written.json)


def _builds_many(options: Options, generator: str | None) -> bool:
    return generator is not None and (options.rank or options.refine_s is not None)


def _workers(once: bool) -> int:
    """How many workers save time: one takes as long to start as twenty builds, so one ranking uses half the cores."""
    return max(1, min(MAX_WORKERS, (os.cpu_count() or 1) // (2 if once else 1)))


def _targets(images: Sequence[Path], written: Written, preview: Path | None) -> dict[Path, Targets]:
    """The files of each picture, all of which can be written; raises ValueError."""
    from dipcg.cli.batch import distinct_stems

    if not images:
        raise ValueError("Give at least one picture.")
    _check_outputs(written, preview)
    files = Targets(written.output, written.params_out, preview)
    # The files of a single picture keep the names that were given.
    names = distinct_stems(images) if len(images) > 1 else [None]
    targets = {image: _named(name, files) if name else files for image, name in zip(images, names, strict=True)}
    check_outputs([path for image in images for path in targets[image]], images)
    return targets


def _named(stem: str, files: Targets) -> Targets:
    """The files with another name."""
    output, *others = files
    return Targets(output.with_stem(stem), *(file and file.with_stem(stem) for file in others))


def _open_batch(images: Sequence[Path], written: Written, preview: Path | None) -> Batch | None:
    """The folder of pictures that was given, None for single pictures; raises ValueError."""
    from dipcg.cli.batch import open_batch

    if len(images) != 1 or not images[0].is_dir():
        return None
    if preview is not None or written.params_out is not None:
        raise ValueError("A folder's parameters and previews are always written; leave --params-out and --preview out.")
    output = written.output
    return open_batch(images[0], output.parent if output.suffix else output, output.suffix or ".glb")


def _batch_targets(batch: Batch, written: Written) -> dict[Path, Targets]:
    """The files of the pictures that wait, all of which can be written; raises ValueError."""
    every = list(batch.files.values())
    replace(written, output=every[0].asset).check()
    check_outputs([path for files in every for path in (files.asset, files.params, files.preview)], batch.files)
    page = batch.write_page({})
    print(f"{len(batch.waiting)} of {len(batch.files)} pictures wait; see {page}.", file=sys.stderr)
    if batch.others:
        names = ", ".join(path.name for path in batch.others)
        print(f"Left out, because they do not end as pictures do: {names}.", file=sys.stderr)
    waiting = {picture: batch.files[picture] for picture in batch.waiting}
    return {picture: Targets(files.asset, files.params, files.preview) for picture, files in waiting.items()}


def _check_outputs(written: Written, preview: Path | None) -> None:
    """Raise ExportError for a file that could not be written."""
    from dipcg.export.asset import check_target

    written.check()
    if preview is not None:
        check_target(preview, (".png",))


def _write(result: Result, inverter: Inverter, targets: Targets, written: Written) -> None:
    from dipcg.inference.preview import side_by_side

    asset = written.finish(inverter.build(result.estimate.params, written.built), result.estimate)
    written.write(asset, targets.output)
    if targets.params:
        asset.save_params(targets.params)
    if targets.preview:
        side_by_side(result.estimate, asset, targets.preview)


def _print(image: Path, result: Result, targets: Targets, json: bool) -> None:
    """Print on stdout what was written, and on stderr what is doubtful about it."""
    from dipcg.inference.serialise import to_dict

    if json:
        print(jsons.dumps({"image": str(image), "output": str(targets.output)} | to_dict(result)))
    else:
        likeliest = next(iter(result.probabilities.items()), None)
        sure = f" ({likeliest[0]}, {100 * likeliest[1]:.0f} % sure)" if likeliest else ""
        print(f"{image} -> {targets.output}" + (f", {targets.params}" if targets.params else "") + sure)
    for sentence in (*result.notes, result.doubt):
        _warn(image, sentence)


def _warn(image: Path, doubt: str | None) -> None:
    if doubt:
        print(f"{image}: {doubt}", file=sys.stderr)
