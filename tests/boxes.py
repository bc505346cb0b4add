"""What tests of ranking and refining share: pictures of one box, and an estimator that knows nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from dipcg.camera import View
from dipcg.config import ModelConfig
from dipcg.generators import load_generator
from dipcg.images import MARGIN
from dipcg.inference.compare import SIDE
from dipcg.model.estimators import Estimator
from dipcg.pipeline import Candidate, Estimate, Inverter
from dipcg.registry import allow_code
from dipcg.render import Renderer, sample_look
from dipcg.space import Params, Real

BOX = load_generator("box").space
TINY = ModelConfig(width=16, depth=1, heads=2, summary=16)
TRUTH: Params = {"width": 0.5, "depth": 0.8, "height": 0.4, "top": "pyramid", "lid_height": 0.3, "overhang": 0.1}
TRUTH |= {"has_legs": True, "leg_height": 0.3}
VIEW = View(30.0, 20.0, 2.5)
BALL = """
import trimesh

from dipcg.space import ParameterSpace, Real

space = ParameterSpace(Real("radius", 0.9, 1.1, unit="m", doc="of the ball"), Real("hole", 0.0, 1.0, doc="some fail"))


def build(params):
    if params["hole"] > MOST:
        raise ValueError("no holes")
    return trimesh.creation.icosphere(3, params["radius"])
"""


def untrained(generator: str, config: ModelConfig = TINY) -> Inverter:
    torch.manual_seed(0)
    found = load_generator(generator)
    return Inverter(Estimator(found.space, config), found)


def picture(inverter: Inverter, params: Params = TRUTH, seed: int = 0) -> np.ndarray:
    """A picture with random colours and lights, as in training."""
    mesh, renderer = inverter.pool.build(params), Renderer(SIDE)
    image = renderer.render(mesh, VIEW, sample_look(np.random.default_rng(seed), len(mesh.part_names)), MARGIN)
    renderer.close()
    return np.ascontiguousarray(image)


def among(inverter: Inverter, image: np.ndarray, *candidates: Params, view: View = VIEW) -> Estimate:
    """An estimate with these candidates in place of its own, and reals known to a tenth of their range."""
    chosen = [Candidate(params, view) for params in candidates]
    spread = {p.name: (p.high - p.low) / 10 for p in inverter.generator.space if isinstance(p, Real)}
    estimate = inverter.estimate(image, candidates=1, steps=1)
    return replace(estimate, candidates=chosen, expected=chosen[0], spread=spread)


def write_ball(folder: Path, most: float) -> str:
    """The file of a generator of balls, which fails where `hole` is more than that."""
    (folder / "ball.py").write_text(BALL.replace("MOST", str(most)))
    allow_code(folder / "ball.py")
    return str(folder / "ball.py")


def with_changes(**changes: object) -> Params:
    return BOX.replace(TRUTH, changes)
