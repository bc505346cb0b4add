"""Training: the encoder by its direct guess first, then the denoiser on the finished encoder, within a budget.

The state beside the checkpoint lets a killed run go on; the checkpoint holds the averaged weights that were best on the
validation split.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Mapping
from collections.abc import Generator as Iteration
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.shapes import Shapes, load_shapes
from dipcg.data.store import Store
from dipcg.files import locked
from dipcg.generators import Generator
from dipcg.model.checkpoint import load_matching, write_checkpoint
from dipcg.model.estimators import AnyEstimator, build_estimator
from dipcg.model.zoo import find_checkpoint
from dipcg.training.averaging import average
from dipcg.training.device import choose_device, compile_networks, has_bfloat16, machine
from dipcg.training.distributed import Processes
from dipcg.training.muon import make_optimisers
from dipcg.training.pictures import SLOTS, USES, Batch, BatchSource, Pictures
from dipcg.training.recipes import published_views
from dipcg.training.schedule import Schedule
from dipcg.training.sentences import Sentences
from dipcg.training.state import allow_lower_rates, load_state, save_state
from dipcg.training.threads import Threads
from dipcg.training.validate import Validation, resized, validate

# Seconds between two validations, after each of which the state is saved.
VALIDATE_EVERY_S = 120.0
VALIDATION_PICTURES = 512
# Steps between two reports.
REPORT_EVERY = 20


class TrainingError(RuntimeError):
    """A run that cannot go on, with a sentence that says why and what to do."""


@dataclass(frozen=True)
class Status:
    """Where a run stands, for a progress bar and for the log."""

    share: float
    pictures: int
    loss: float
    pictures_per_s: float
    """since the run was started or resumed"""
    waiting: float
    """share of the time spent on making pictures"""
    validation: Validation | None


def train(
    data: str | Path,
    out: str | Path,
    config: TrainConfig,
    model_config: ModelConfig,
    report: Callable[[Status], None] = lambda status: None,
) -> AnyEstimator:
    """Train on a data set until the budget is spent and write the best weights to `out`; resumes a killed run.

    Raises ValueError when the data set is unusable, and when `out` holds another run, a finished one, or one that
    another process trains; TrainingError when the loss is no longer a number.
    """
    is_main = os.environ.get("RANK", "0") == "0"
    with locked(Path(out), "trains") if is_main else contextlib.nullcontext():
        return _train(data, Path(out), config, model_config, report)


def _train(
    data: str | Path, out: Path, config: TrainConfig, model_config: ModelConfig, report: Callable[[Status], None]
) -> AnyEstimator:
    torch.manual_seed(config.seed)
    generator, shapes = load_shapes(data, "train")
    shapes = shapes.first(config.shapes or len(shapes.x))
    run = Run(build_estimator(generator.space, model_config), config, out, generator, Store(data).info)
    run.about |= {"shapes": len(shapes.x), "machine": machine(run.device, run.processes.size)}
    checks = _validation_batch(data, run)
    # Every process sees other pictures and draws other noise.
    own = replace(config, seed=config.seed + 1000 * run.processes.rank)
    source = _source(generator, shapes, run, own)
    try:
        # An interrupt of a report is raised in the steps too, which then save the state.
        with Threads() as threads, contextlib.closing(run.steps(source, checks, threads.adapt)) as steps:
            for status in steps:
                if run.processes.is_main:
                    report(status)
    finally:
        source.close()
    return run.averaged


Statuses = Iteration[Status, None, None]


class Run:
    """The state of one training: weights, their average, the optimiser, the counters; `data` names the data set."""

    def __init__(
        self,
        model: AnyEstimator,
        config: TrainConfig,
        out: Path,
        generator: Generator,
        data: Mapping[str, Any] | None = None,
    ) -> None:
        self.config, self.out, self.generator = config, out, generator
        self.settings = {"model": asdict(model.config), "train": asdict(config)}
        self.settings |= {"data": {"data": dict(data)}} if data else {}
        self.processes = Processes(config.device)
        self.device = self.processes.device or choose_device(config.device)
        # What a card says besides.
        self.about: dict[str, Any] = {}
        if config.start:
            seen = load_matching(model, find_checkpoint(config.start))
            self.about["started_from"] = {"checkpoint": Path(config.start).name, "pictures": seen}
        self.model = model.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.averaged = build_estimator(generator.space, model.config).to(self.device)
        self.averaged.load_state_dict(self.model.state_dict())
        self.optimisers = make_optimisers(self.model, config)
        self.schedule = Schedule(config, _image_size(model), model.makes_guess, _grows(config, model))
        self.counters: dict[str, Any] = {
            "elapsed_s": 0.0,
            "pictures": 0,
            "step": 0,
            "stage": "",
            "averaged": 0,
            "best": {},
        }
        self.counters |= load_state(out, self._networks, self.optimisers, self.settings)
        compile_networks(config, self.model, self.device)
        if self.share >= 1:
            raise ValueError(f"The run in {out} is finished; give a larger budget (--pictures) or another folder (-o).")

    @property
    def share(self) -> float:
        """How much of the budget is spent."""
        return self.schedule.share(self.counters["pictures"], self.counters["elapsed_s"])

    def steps(
        self, source: BatchSource, checks: Batch, adapt: Callable[[], None] = lambda: None
    ) -> Iteration[Status, None, None]:
        """Step until the budget is spent; validates and saves every two minutes, at the end, and when interrupted."""
        started, before, waited = time.monotonic(), dict(self.counters), 0.0
        checked = started
        try:
            while self.share < 1:
                adapt()
                asked = time.monotonic()
                batch = source.batch(self.counters["step"], self.schedule.size(self.share))
                waited += time.monotonic() - asked
                loss = self.learn(batch)
                now = time.monotonic()
                self.counters["elapsed_s"] = self.processes.broadcast(before["elapsed_s"] + now - started)
                found = None
                if now - checked > VALIDATE_EVERY_S or self.share >= 1:
                    found, checked = self.check(checks) if self.processes.is_main else None, now
                if found or self.counters["step"] % REPORT_EVERY == 0:
                    rate = (self.counters["pictures"] - before["pictures"]) / (now - started)
                    yield Status(self.share, self.counters["pictures"], loss, rate, waited / (now - started), found)
        # The second is raised here when whoever takes the reports is interrupted.
        except (KeyboardInterrupt, GeneratorExit):
            if self.processes.is_main:
                self.save()
            raise

    def learn(self, batch: Batch) -> float:
        """One step on one batch; raises TrainingError when the loss or its gradient is not a number."""
        share = self.share
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = optimiser.defaults["lr"] * self.schedule.rate(share)
        self._set_stage(self.schedule.trains_denoiser(share))
        torch.manual_seed(self.config.seed + 1000 * self.processes.rank + self.counters["step"])
        loss = self._loss(Batch(*(part.to(self.device, non_blocking=True) for part in batch)))
        self._check_number("loss", loss)
        self.model.zero_grad()
        loss.backward()
        self.processes.average_gradients(self.model.parameters())
        self._check_number("gradient", torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0))
        for optimiser in self.optimisers.values():
            optimiser.step()
        average(self.averaged, self.model, self.config.ema, self.counters["averaged"])
        self.counters["averaged"] += 1
        self.counters["step"] += 1
        self.counters["pictures"] += self.processes.size * len(batch.x)
        return float(loss.detach())

    def check(self, checks: Batch) -> Validation:
        """Validate the averaged weights, write a checkpoint if they are the best of their stage, and save the state."""
        denoiser, size = self.schedule.trains_denoiser(self.share), self.schedule.size(self.share)
        checks = Batch(*(part.to(self.device) for part in checks))
        found = validate(self.averaged, checks._replace(images=resized(checks.images, size)), denoiser)
        self._check_number("loss of the validation", torch.tensor(found.loss))
        stage = "denoiser" if denoiser else "guess"
        if found.loss <= self.counters["best"].get(stage, float("inf")):
            self.counters["best"][stage] = found.loss
            # A card names no folder of one machine.
            config = replace(self.config, start=Path(self.config.start).name)
            about = {"train": asdict(config), "pictures": self.counters["pictures"]}
            about |= {"seconds": round(self.counters["elapsed_s"]), "validation": asdict(found)}
            # An unfinished network knows pictures of the present size only, so its checkpoint asks for that size.
            model = replace(self.averaged.config, image_size=size) if self.schedule.grows else self.averaged.config
            write_checkpoint(self.out, self.averaged.state_dict(), model, self.generator, self.about | about)
        self.save()
        return found

    def _check_number(self, name: str, value: Tensor) -> None:
        """Raise TrainingError for a value that is not finite; the folder then allows other rates."""
        if not torch.isfinite(value):
            what = f"The {name} is {float(value.detach())} after {self.counters['pictures']} pictures."
            raise TrainingError(allow_lower_rates(self.out, what, self.config))

    def save(self) -> None:
        """Write what a killed run goes on from, unless the last step has made a weight that is no number."""
        if not all(torch.isfinite(weight).all() for weight in self.model.parameters()):
            return
        self.out.mkdir(parents=True, exist_ok=True)
        save_state(self.out, self._networks, self.optimisers, self.counters, self.settings)

    @property
    def _networks(self) -> dict[str, torch.nn.Module]:
        return {"model": self.model, "averaged": self.averaged}

    def _set_stage(self, denoiser: bool) -> None:
        """Train the encoder and its guess, or the denoiser on the averaged encoder, which then stays as it is."""
        stage = "denoiser" if denoiser else "guess"
        if self.counters["stage"] != stage:
            # What was averaged before would hold the new weights back for longer than a short stage lasts.
            self.counters |= {"stage": stage, "averaged": 0}
        self.model.train()
        if not (self.model.makes_guess and denoiser):
            return
        for ours, averaged in ((self.model.encoder, self.averaged.encoder), (self.model.guess, self.averaged.guess)):
            if any(p.requires_grad for p in ours.parameters()):
                ours.load_state_dict(averaged.state_dict())
                ours.requires_grad_(False)
            ours.eval()

    def _loss(self, batch: Batch) -> Tensor:
        images, active = batch.images.float(), batch.active
        with torch.autocast(self.device.type, torch.bfloat16, enabled=has_bfloat16(self.device)):
            if images.ndim == 4:
                images = images.contiguous(memory_format=torch.channels_last)
            features = self.model.encoder(images)
            if self.model.makes_guess and not self.schedule.trains_denoiser(self.share):
                return self.model.guess_loss(features, batch.x, active)
            return self.model.denoising_loss(features, batch.x, active, self.config)


def _image_size(model: AnyEstimator) -> int:
    return int(model.encoder.image_size)  # type: ignore[arg-type]


def _grows(config: TrainConfig, model: AnyEstimator) -> bool:
    return config.grow and bool(getattr(model.encoder, "any_size", False))


def _source(generator: Generator, shapes: Shapes, run: Run, config: TrainConfig) -> BatchSource:
    """Pictures, or sentences for an encoder that sees none."""
    if not _image_size(run.model):
        return Sentences(generator, shapes, config.batch, config.repeats, config.seed)
    slots = max(config.batch, min(SLOTS, config.pictures // USES))
    return Pictures(_seen(generator, config), shapes, config.batch, config.seed, config.augment, slots, run.device)


def _seen(generator: Generator, config: TrainConfig) -> Generator:
    if config.views == "grid":
        return replace(generator, views=published_views(generator.name), views_of=None)
    return generator


def _validation_batch(data: str | Path, run: Run) -> Batch:
    """The same pictures of unseen shapes for every run, under the conditions of training."""
    generator, shapes = load_shapes(data, "validation")
    config = replace(run.config, batch=VALIDATION_PICTURES, repeats=1, seed=run.config.seed + 1, pictures=1)
    source = _source(generator, shapes, run, config)
    batch = source.batch(0, _image_size(run.model))
    source.close()
    return batch
