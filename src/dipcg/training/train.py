"""Training: pictures rendered on the fly, the guess first, then the denoiser along with it, until the time is up.

`state.safetensors` and `state.json` beside the checkpoint let a killed run go on; the checkpoint holds the averaged
weights that were best on the validation split.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.shapes import Shapes, load_shapes
from dipcg.generators import Generator
from dipcg.model.checkpoint import load_matching, save_checkpoint
from dipcg.model.estimators import AnyEstimator, PaperEstimator, build_estimator
from dipcg.model.flow import denoising_loss, guess_loss, with_view
from dipcg.model.zoo import find_checkpoint
from dipcg.training.distributed import Team
from dipcg.training.pictures import Batch, Pictures, encoder_input, loader
from dipcg.training.recipes import published_views
from dipcg.training.sentences import Sentences
from dipcg.training.validate import Validation, validate

VALIDATE_EVERY_S = 120.0
VALIDATION_PICTURES = 256


@dataclass(frozen=True)
class Status:
    """Where a run stands, for a progress bar and for the log."""

    share: float
    pictures: int
    loss: float
    pictures_per_s: float
    waiting: float
    """share of the time spent waiting for pictures"""
    validation: Validation | None


def train(
    data: str | Path,
    out: str | Path,
    config: TrainConfig,
    model_config: ModelConfig,
    report: Callable[[Status], None] = lambda status: None,
) -> AnyEstimator:
    """Train on a data set until `config.minutes` are over and write the best weights to `out`; resumes a killed run.

    Raises ValueError when the data set is unusable or `out` holds another run.
    """
    torch.manual_seed(config.seed)
    generator, shapes = load_shapes(data, "train")
    shapes = shapes.first(config.shapes or len(shapes.x))
    run = Run(build_estimator(generator.space, model_config), config, Path(out), generator)
    if _compiles(config, run.device):
        torch._dynamo.config.suppress_errors = True  # what cannot be compiled runs as it is
        run.model.encoder.compile()
        run.model.denoiser.compile()
    run.about |= {"shapes": len(shapes.x), "machine": _machine(run.device, run.team.size)}
    checks = _validation_batch(data, run.model, config.seed)
    own = replace(config, seed=config.seed + 1000 * run.team.rank)  # every process sees other pictures and other noise
    torch.manual_seed(own.seed)
    batches = iter(loader(_input(generator, shapes, run.model, own), config.workers))
    with _processors_left_by(config.workers):
        for status in run.steps(batches, checks):
            if run.team.leads:
                report(status)
    return run.averaged


@contextlib.contextmanager
def _processors_left_by(workers: int) -> Iterator[None]:
    """Compute on the processors that no worker renders on: a thread that shares one makes all the others wait."""
    before = torch.get_num_threads()
    torch.set_num_threads(max(1, before - workers))
    try:
        yield
    finally:
        torch.set_num_threads(before)


class Run:
    """The state of one training: weights, their average, the optimiser, the clock."""

    def __init__(self, model: AnyEstimator, config: TrainConfig, out: Path, generator: Generator) -> None:
        self.config, self.out, self.generator = config, out, generator
        self.team = Team(config.device)
        self.device = self.team.device or choose_device(config.device)
        self.about: dict[str, Any] = {}  # what a card says besides
        if config.start:
            seen = load_matching(model, find_checkpoint(config.start))
            self.about["started_from"] = {"checkpoint": Path(config.start).name, "pictures": seen}
        self.model = model.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.averaged = build_estimator(generator.space, model.config).to(self.device)
        self.averaged.load_state_dict(self.model.state_dict())
        self.optimiser = torch.optim.AdamW(
            self.model.parameters(), 1e-3, (0.9, 0.98), weight_decay=config.weight_decay, fused=True
        )
        self.elapsed_s, self.pictures, self.step, self.best = 0.0, 0, 0, math.inf
        self._resume()

    @property
    def share(self) -> float:
        return min(1.0, self.elapsed_s / (60 * self.config.minutes))

    def steps(self, batches: Iterator[Batch], checks: Batch) -> Iterator[Status]:
        """Step until the time is up; validates and saves every two minutes and at the end."""
        started, before, waited, checked = time.monotonic(), self.elapsed_s, 0.0, self.elapsed_s
        while self.share < 1:
            asked = time.monotonic()
            batch = next(batches)
            waited += time.monotonic() - asked
            loss = self.learn(batch)
            self.elapsed_s = self.team.agree(before + time.monotonic() - started)
            found = None
            if self.elapsed_s - checked > VALIDATE_EVERY_S or self.share >= 1:
                found, checked = self.check(checks) if self.team.leads else None, self.elapsed_s
            if found or self.step % 20 == 0:
                busy = time.monotonic() - started
                rate = self.pictures / max(self.elapsed_s, 1e-6)
                yield Status(self.share, self.pictures, loss, rate, waited / max(busy, 1e-6), found)

    def learn(self, batch: Batch) -> float:
        """One step on one batch."""
        self._set_rate()
        loss = self._loss(Batch(*(part.to(self.device, non_blocking=True) for part in batch)))
        self.optimiser.zero_grad()
        loss.backward()
        self.team.average(self.model.parameters())
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        self.optimiser.step()
        self._average()
        self.step, self.pictures = self.step + 1, self.pictures + self.team.size * len(batch.x)
        return float(loss.detach())

    def check(self, checks: Batch) -> Validation:
        """Validate the averaged weights, keep them if they are the best, and save the state."""
        found = validate(self.averaged, Batch(*(part.to(self.device) for part in checks)))
        if found.loss <= self.best:
            self.best = found.loss
            config = replace(self.config, start=Path(self.config.start).name)  # a card names no folder of one machine
            about = {"train": asdict(config), "pictures": self.pictures, "seconds": round(self.elapsed_s)}
            save_checkpoint(self.out, self.averaged, self.generator, self.about | about | {"validation": asdict(found)})
        self._save_state()
        return found

    def _loss(self, batch: Batch) -> Tensor:
        images, active = encoder_input(batch.images), with_view(batch.active)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=has_bfloat16(self.device)):
            if images.ndim == 4:
                images = images.contiguous(memory_format=torch.channels_last)
            features = self.model.encoder(images)
            if isinstance(self.model, PaperEstimator):
                return self.model.loss(features, batch.x)
            guess = self.model.first_guess(features)
            loss = guess_loss(self.model, guess, batch.x, active)
            if self.share < self.config.denoiser_from:
                return loss
            draws = self.config.draws
            condition = self.model.condition(features).repeat(draws)
            x, active = batch.x.repeat_interleave(draws, 0), active.repeat_interleave(draws, 0)
            return loss + denoising_loss(self.model, condition, x, active, self.config.lock, self.config.first)

    def _set_rate(self) -> None:
        warm = min(1.0, self.share / 0.02)
        rate = self.config.learning_rate * warm * (0.01 + 0.99 * (1 + math.cos(math.pi * self.share)) / 2)
        if self.config.schedule == "constant":
            rate = self.config.learning_rate
        for group in self.optimiser.param_groups:
            group["lr"] = rate

    @torch.no_grad()
    def _average(self) -> None:
        decay = min(self.config.ema, (1 + self.step) / (10 + self.step))
        ours, theirs = self.averaged.state_dict(), self.model.state_dict()
        floats = [key for key, value in ours.items() if value.is_floating_point()]
        torch._foreach_lerp_([ours[key] for key in floats], [theirs[key] for key in floats], 1 - decay)

    def _save_state(self) -> None:
        tensors = {f"model.{k}": v for k, v in self.model.state_dict().items()}
        tensors |= {f"averaged.{k}": v for k, v in self.averaged.state_dict().items()}
        for index, entry in self.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{k}": torch.as_tensor(v) for k, v in entry.items()}
        clock = {"elapsed_s": self.elapsed_s, "pictures": self.pictures, "step": self.step, "best": self.best}
        for path in (self.out / "state.safetensors", self.out / "state.json"):  # the clock last: it says all is written
            unfinished = path.with_suffix(".tmp")
            if path.suffix == ".json":
                unfinished.write_text(json.dumps(clock | {"model": asdict(self.model.config)}))
            else:
                save_file({k: v.contiguous() for k, v in tensors.items()}, unfinished)
            unfinished.replace(path)

    def _resume(self) -> None:
        if not (self.out / "state.json").is_file():
            return
        clock = json.loads((self.out / "state.json").read_text())
        if ModelConfig(**clock.pop("model")) != self.model.config:
            raise ValueError(f"{self.out} holds a run of another model; choose another folder or delete it.")
        tensors = load_file(self.out / "state.safetensors", device=str(self.device))
        self.model.load_state_dict(_under("model.", tensors))
        self.averaged.load_state_dict(_under("averaged.", tensors))
        _load_optimiser(self.optimiser, _under("optimiser.", tensors))
        self.__dict__.update(clock)


def choose_device(name: str) -> torch.device:
    """The named device, or with `auto` the GPU when there is one."""
    return torch.device(("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name)


def has_bfloat16(device: torch.device) -> bool:
    """Whether the device computes in bfloat16 rather than emulating it."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    return torch.cpu._is_avx512_bf16_supported()


def _compiles(config: TrainConfig, device: torch.device) -> bool:
    """Whether fused operations will save more time than making them takes."""
    if config.compile != "auto":
        return config.compile == "yes"
    return device.type == "cuda" or (config.minutes > 5 and shutil.which("c++") is not None)


def _machine(device: torch.device, processes: int) -> str:
    if device.type == "cuda":
        return f"{processes} × {torch.cuda.get_device_name(device)}"
    return f"{os.cpu_count()} cores, {platform.machine()}"


def _input(generator: Generator, shapes: Shapes, model: AnyEstimator, config: TrainConfig) -> Pictures | Sentences:
    """Pictures, or sentences for an encoder that sees none."""
    size = int(model.encoder.image_size)  # type: ignore[arg-type]
    if not size:
        return Sentences(generator, shapes, config.batch, config.repeats, config.seed)
    if config.views == "grid":
        generator = replace(generator, views=published_views(generator.name), views_of=None)
    return Pictures(generator, shapes, size, config.batch, config.repeats, config.seed, config.augment)


def _validation_batch(data: str | Path, model: AnyEstimator, seed: int) -> Batch:
    """The same pictures of unseen shapes for every run, under the conditions of training."""
    generator, shapes = load_shapes(data, "validation")
    config = replace(TrainConfig(), batch=VALIDATION_PICTURES, repeats=1, seed=seed + 1)
    return next(iter(loader(_input(generator, shapes, model, config), 1)))


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}


def _load_optimiser(optimiser: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        index, name = key.split(".", 1)
        state.setdefault(int(index), {})[name] = value
    optimiser.load_state_dict(optimiser.state_dict() | {"state": state})
