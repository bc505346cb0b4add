"""The command that searches instead of estimating: MCMC, random search and CMA-ES over renders."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from dipcg.cli.assets import Name
from dipcg.cli.outputs import check_outputs

if TYPE_CHECKING:
    import numpy as np

    from dipcg.inference.search import Objective, Point, Score
    from dipcg.inference.trace import Trace

Folder = Annotated[Path, arg(aliases=["-o"], metavar="FOLDER")]
# The files that a search writes.
WRITTEN = ("trace.jsonl", "search.json", "trace.png", "best.json", "best.png")
# Side of the pictures that are shown.
SIDE = 256


def mcmc(
    image: Positional[Path],
    /,
    *,
    generator: Name,
    output: Folder,
    iterations: int = 10_000,
    method: Literal["mcmc", "random", "cma"] = "mcmc",
    score: str = "both",
    encoder_weights: str = "",
    start: Literal["random", "estimate"] = "random",
    chains: int = 4,
    temperature: float = 0.01,
    workers: int = 2,
    seed: int = 0,
) -> None:
    """Search for what a picture shows by building and comparing, as the paper's baseline; a killed search continues.

    Writes trace.jsonl, trace.png, best.json for `dipcg edit`, and best.png with the best so far after 100, 500, 1,000,
    2,000, 5,000 and 10,000 calls of the generator.

    Args:
        image: photograph, drawing or mask
        generator: name of the generator of what it shows
        output: folder for the results
        iterations: number of calls of the generator, by all chains together
        method: Metropolis-Hastings, random search or CMA-ES
        score: what is compared: silhouette, edges, both, or the features of an encoder (dinov2, clip, or conv of the
            checkpoint)
        encoder_weights: hub name or folder of a pretrained encoder's weights
        start: random for random parameters and cameras, or estimate for the estimate of the checkpoint
        chains: number of searches side by side
        temperature: temperature of the acceptance: the difference in score that is accepted once in e times
        workers: number of processes that build
        seed: random seed of the search
    """
    import numpy as np

    from dipcg.cli.terminal import bar
    from dipcg.inference.search import Objective, make_searcher, search
    from dipcg.inference.trace import Trace
    from dipcg.workers.pool import BuildPool

    if min(iterations, chains, workers) < 1 or not temperature > 0:
        raise ValueError("iterations, chains and workers must be at least 1, and the temperature above 0.")
    check_outputs([output / name for name in WRITTEN], (image, generator))
    compare, size = _score(image, generator, score, encoder_weights)
    settings = {"generator": generator, "method": method, "score": score, "start": start, "chains": chains}
    settings |= {"temperature": temperature, "seed": seed, "encoder_weights": encoder_weights}
    settings |= _contents(image, generator, uses_checkpoint=start == "estimate" or score == "conv")
    with (
        Trace(output, settings) as trace,
        BuildPool(generator, workers) as pool,
        bar("searching", iterations) as update,
    ):
        objective = Objective(pool, compare, size)
        first = _estimated(image, generator, objective) if start == "estimate" else None
        searcher = make_searcher(method, objective, np.random.default_rng(seed), chains, temperature, first)
        before, begun, best = trace.seconds, time.perf_counter(), {}
        past = trace.scores[:iterations]
        for tried in search(searcher, objective, iterations, past):
            if tried.call > len(past):
                trace.add(before + time.perf_counter() - begun, tried.score)
            best[tried.call] = tried.best_point
            update(tried.call, f"best {tried.best:.3f}")
        _write(output, image, trace, objective, best)


def _contents(image: Path, generator: str, uses_checkpoint: bool) -> dict[str, str]:
    """Digests of the files on which every score depends, whatever they are called."""
    from dipcg.blender.declaration import digest
    from dipcg.model.zoo import WEIGHTS, find_checkpoint
    from dipcg.registry import is_path

    files = {"image": image}
    files |= {"generator's file": Path(generator)} if is_path(generator) else {}
    files |= {"checkpoint": find_checkpoint(generator) / WEIGHTS} if uses_checkpoint else {}
    return {name: digest(file) for name, file in files.items()}


def _score(image: Path, generator: str, name: str, weights: str) -> tuple[Score, int]:
    """A distance between the picture and a render, and the side of the renders that it takes."""
    from dipcg.images import prepare
    from dipcg.inference.compare import SIDE, Match, Picture

    rules: dict[str, Callable[[Match], float]] = {
        "silhouette": lambda match: 1 - (match.silhouette or 0.0),
        "edges": lambda match: 1 - match.lines,
        "both": lambda match: 1 - match.agreement,
    }
    if name not in rules:
        return _feature_score(image, generator, name, weights)
    picture = Picture(*prepare(image, SIDE))
    if name == "silhouette" and not picture.has_silhouette:
        raise ValueError(f"{image} has no silhouette to trust; use --score edges.")
    return lambda render: rules[name](picture.match(render)), SIDE


def _feature_score(image: Path, generator: str, name: str, weights: str) -> tuple[Score, int]:
    from dipcg.config import ModelConfig
    from dipcg.encoders import build_encoder, feature_distance
    from dipcg.images import prepare
    from dipcg.model.checkpoint import load_checkpoint
    from dipcg.model.zoo import find_checkpoint

    if name == "conv":
        # The features of an untrained encoder mean nothing.
        encoder = load_checkpoint(find_checkpoint(generator))[0].encoder
    else:
        encoder = build_encoder(ModelConfig(encoder=name, encoder_weights=weights, summary=0))
    size = int(encoder.image_size)  # type: ignore[arg-type]
    return feature_distance(encoder, prepare(image, size)[0]), size


def _estimated(image: Path, generator: str, objective: Objective) -> Point:
    from dipcg.pipeline import Inverter

    with Inverter.load(generator) as inverter:
        estimate = inverter.estimate(image)
        return objective.point(estimate.params, estimate.view)


def _write(output: Path, image: Path, trace: Trace, objective: Objective, best: dict[int, Point]) -> None:
    import numpy as np

    from dipcg.files import write_file
    from dipcg.images import over_white, prepare, save_image
    from dipcg.inference.trace import labelled, marks, plot_traces
    from dipcg.parameter_file import params_to_json

    tiles = [labelled(over_white(prepare(image, SIDE)[0]), "picture")]
    for mark in marks(len(best)):
        line = trace.lines[mark - 1]
        tiles.append(labelled(_drawn(objective, best[mark]), f"{mark:,} calls, {line.seconds:.0f} s"))
        print(f"{mark:6d} calls {line.seconds:8.1f} s   best {line.best:.4f}")
    save_image(np.concatenate(tiles, 1), output / "best.png")
    plot_traces({"best so far": trace.lines[: len(best)]}, output / "trace.png")
    params = objective.params(best[len(best)])
    write_file(output / "best.json", params_to_json(params, objective.generator.ref))
    print(f"Wrote best.json, best.png and trace.png to {output}. Try: dipcg edit {output / 'best.json'} -o best.glb")


def _drawn(objective: Objective, point: Point) -> np.ndarray:
    """The render of a point, or a blank picture for one that could not be built."""
    import numpy as np

    from dipcg.images import MARGIN, over_white
    from dipcg.render import Renderer
    from dipcg.workers.process import BuildError

    try:
        mesh = objective.pool.build(objective.params(point), "light")
    except BuildError:
        return np.full((SIDE, SIDE, 3), 255, np.uint8)
    renderer = Renderer(SIDE)
    drawn = over_white(renderer.render(mesh, objective.camera(point), margin=MARGIN))
    renderer.close()
    return drawn
