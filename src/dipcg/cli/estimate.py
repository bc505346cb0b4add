"""The command that turns pictures into assets: estimate."""

from __future__ import annotations

import json as jsons
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from dipcg.cli.assets import Options, Settings, Written, parse_settings

if TYPE_CHECKING:
    from dipcg.cli.batch import Batch
    from dipcg.pipeline import Estimate, Inverter

MOST_WORKERS = 4


def estimate(
    images: Positional[tuple[Path, ...]] = (),
    /,
    *,
    written: Options,
    text: str | None = None,
    views: bool = False,
    generator: Annotated[str | None, arg(aliases=["-g"], metavar="NAME")] = None,  # `Name | None` would lose the alias
    candidates: int = 16,
    steps: int | None = None,
    seed: int = 0,
    keep: Settings = (),
    rank: bool = True,
    refine: Annotated[float | None, arg(metavar="SECONDS")] = None,
    preview: Path | None = None,
) -> None:
    """Turn pictures into editable assets.

    With several pictures, files are named after them in the folder of the output: chair.glb becomes PICTURE.glb.
    A folder of pictures (`estimate FOLDER -o OUT/`) becomes a folder of assets, parameters and previews with a page,
    index.html, that shows all; what is there already is skipped, so run it again after it was stopped.

    Args:
        images: photographs, drawings or masks, or one folder of them
        written: files and their detail
        text: what the object is like, in English, instead of pictures; for a checkpoint that was trained on sentences
        views: all pictures show one object, each from its own side; the first one's camera is estimated
        generator: what they show, or a folder with a checkpoint, or a generator's file whose checkpoint is in runs/;
            when left out, it is recognised among those that ship
        candidates: how many to choose from: the expected one, and samples
        steps: of the sampler; as many as the checkpoint was made for when left out
        seed: of the samples
        keep: parameters to hold, as name=value; the rest is estimated around them
        rank: build all candidates and take the one that matches the picture best, instead of the expected one
        refine: seconds to search on from the best candidate
        preview: PNG file for the photo beside the result
    """
    if refine is not None and not refine > 0:
        raise ValueError(f"A search (--refine) takes more than 0 seconds, got {refine:g}.")
    if text is not None:
        return _estimate_text(text, images, generator, written, candidates, steps, seed, parse_settings(keep), preview)
    images, others = (images[:1], images[1:]) if views else (images, ())
    batch, kept = _batch(images, written, preview), parse_settings(keep)
    targets = _targets(images, written, preview) if batch is None else _batch_targets(batch, written)
    if not targets:
        return
    problems: dict[Path, str] = {}
    with ExitStack() as stack:
        once = len(targets) == 1 and refine is None
        workers = _workers(once) if (rank and candidates > 1) or refine is not None else 1
        inverters = _inverters(stack, generator, workers)
        work = _Work(inverters, generator is None, candidates, steps, seed, kept, rank, refine, others)
        work.check()
        for image in targets:
            problems |= _try_estimate(work, image, targets[image], written)
            if batch is not None:
                batch.write_page(problems)
    if problems:
        raise SystemExit(1)
    return None


@dataclass(frozen=True)
class _Work:
    """What is done to each picture."""

    inverters: Mapping[str, Inverter]
    recognised: bool
    candidates: int
    steps: int | None
    seed: int
    kept: Mapping[str, str]
    ranked: bool
    refine: float | None
    others: tuple[Path, ...] = ()
    """pictures of the same object, besides the one that is estimated"""

    def check(self) -> None:
        """Raise ValueError for values that cannot be held, before any work is done."""
        from dipcg.model.constraints import check_kept

        if not self.recognised:
            for inverter in self.inverters.values():
                check_kept(inverter.generator.space, self.kept)
                inverter.pool.warm()

    def __call__(self, image: Path) -> tuple[Estimate, dict[str, float]]:
        """The estimate, and the chance of each generator when it was left open."""
        chances = self._recognise(image) if self.recognised else {}
        inverter = self.inverters[next(iter(chances or self.inverters))]
        options = (self.candidates, self.steps, self.seed, self.kept)
        found = self._search(inverter.estimate_views([image, *self.others], *options))
        self._warn_of_others(found)
        return found, chances

    def _warn_of_others(self, found: Estimate) -> None:
        """Say which of the other pictures does not show what was found: its camera is estimated, and it is compared."""
        from dipcg.inference.rank import rank
        from dipcg.inference.recognise import doubt

        for other in self.others:
            space, params = found.inverter.generator.space, found.params
            held = {name: params[name] for name in space.names if space.is_active(name, params)}
            _warn(other, doubt(rank(found.inverter.estimate(other, 2, self.steps, self.seed, held))))

    def _recognise(self, image: Path) -> dict[str, float]:
        from dipcg.inference.recognise import recognise

        return dict(recognise(image, self.inverters))

    def _search(self, found: Estimate) -> Estimate:
        from dipcg.cli.terminal import bar
        from dipcg.inference.rank import rank
        from dipcg.inference.refine import refine

        if self.refine is None:
            return rank(found) if self.ranked and len(found.candidates) > 1 else found
        with bar("searching", 1000) as update:
            per_second = 1000 / self.refine
            return refine(found, self.refine, lambda s: update(int(s.seconds * per_second), f"misfit {s.misfit:.3f}"))


def _estimate_text(
    text: str,
    images: Sequence[Path],
    generator: str | None,
    written: Written,
    candidates: int,
    steps: int | None,
    seed: int,
    kept: Mapping[str, str],
    preview: Path | None,
) -> None:
    """Turn a sentence into an asset; raises ValueError when pictures are given too."""
    from dipcg.export.asset import check_target
    from dipcg.inference.recognise_text import recognise_text
    from dipcg.model.zoo import find_checkpoint
    from dipcg.pipeline import Inverter

    if images:
        raise ValueError("Give pictures or --text, not both: dipcg estimate --text 'a tall bar chair' -o OUT.glb")
    written.check()
    if preview is not None:
        check_target(preview, (".png",))
    chances = {} if generator else dict(recognise_text(text))
    generator = generator or next(iter(chances))
    with Inverter.load(str(find_checkpoint(generator, "text"))) as inverter:
        found = inverter.describe(text, candidates, steps, seed, kept)
        targets = (written.output, written.params_out, preview)
        _write(found, targets, written)
        _tell(Path(text), found, chances, targets, written.json)


def _workers(once: bool) -> int:
    """How many pay: one takes as long to start as twenty builds, so for one ranking every other core has one."""
    return max(1, min(MOST_WORKERS, (os.cpu_count() or 1) // (2 if once else 1)))


def _inverters(stack: ExitStack, generator: str | None, workers: int) -> dict[str, Inverter]:
    from dipcg.inference.recognise import recognisable
    from dipcg.pipeline import Inverter

    names = recognisable() if generator is None else [generator]
    return {name: stack.enter_context(Inverter.load(name, workers if generator else 1)) for name in names}


Targets = tuple[Path | None, ...]  # of the mesh, the parameters and the preview


def _targets(images: Sequence[Path], written: Written, preview: Path | None) -> dict[Path, Targets]:
    """The files of each picture, all of which can be written; raises ValueError."""
    from dipcg.export.asset import check_target

    if not images:
        raise ValueError("Give at least one picture.")
    written.check()
    if preview is not None:
        check_target(preview, (".png",))
    asked = (written.output, written.params_out, preview)
    targets = {image: tuple(_named_after(path, image, len(images) > 1) for path in asked) for image in images}
    _check_distinct(images, [path for image in images for path in targets[image] if path])
    return targets


def _batch(images: Sequence[Path], written: Written, preview: Path | None) -> Batch | None:
    """What is to be done when a folder was given; raises ValueError."""
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
    _check_distinct(list(batch.files), [path for files in every for path in (files.asset, files.params, files.preview)])
    page = batch.write_page({})
    print(f"{len(batch.waiting)} of {len(batch.files)} pictures wait; see {page}.", file=sys.stderr)
    found = {picture: batch.files[picture] for picture in batch.waiting}
    return {picture: (files.asset, files.params, files.preview) for picture, files in found.items()}


def _try_estimate(work: _Work, image: Path, targets: Targets, written: Written) -> dict[Path, str]:
    """Estimate one picture and write its files; an error is printed and returned, so that the others go on."""
    from dipcg.cli.terminal import error_text

    try:
        found, chances = work(image)
        _write(found, targets, written)
        _tell(image, found, chances, targets, written.json)
    except (ValueError, RuntimeError) as error:
        text = error_text(error)
        print(text if str(image) in text else f"{image}: {text}", file=sys.stderr)
        return {image: text}
    return {}


def _check_distinct(images: Sequence[Path], targets: Sequence[Path]) -> None:
    """Raise ValueError where a file would be written twice, or over a picture that is read."""
    taken = {image.absolute() for image in images}
    for target in targets:
        if target.absolute() in taken:
            raise ValueError(f"{target} would be overwritten; choose another name or folder.")
        taken.add(target.absolute())


def _write(found: Estimate, targets: Targets, written: Written) -> None:
    from dipcg.inference.preview import side_by_side

    output, params_out, preview = targets
    assert output is not None
    asset = written.finish(found.build(detail=written.detail))
    asset.export(output)
    if params_out:
        asset.save_params(params_out)
    if preview:
        side_by_side(found, asset.mesh, preview)


def _tell(image: Path, found: Estimate, chances: dict[str, float], targets: Targets, json: bool) -> None:
    """Say on the first stream what was written, and on the other what is doubtful about it."""
    from dipcg.inference.recognise import doubt
    from dipcg.inference.serialise import answer

    output, params_out, _ = targets
    doubtful = doubt(found)
    if json:
        print(jsons.dumps({"image": str(image), "output": str(output)} | answer(found, chances, doubtful)))
    else:
        sure = f" ({next(iter(chances))}, {100 * max(chances.values()):.0f} % sure)" if chances else ""
        print(f"{image} -> {output}" + (f", {params_out}" if params_out else "") + sure)
    _warn(image, doubtful)


def _warn(image: Path, doubt: str | None) -> None:
    if doubt:
        print(f"{image}: {doubt}", file=sys.stderr)


def _named_after(path: Path | None, image: Path, many: bool) -> Path | None:
    return path.with_stem(image.stem) if path and many else path
