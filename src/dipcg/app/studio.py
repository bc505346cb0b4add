"""What all visitors share: the estimators and the processes that build. Nothing of a visitor is kept here."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from importlib.util import find_spec
from typing import Any

from dipcg.app.limits import BUILD_S, PATIENCE_S
from dipcg.generators import Detail, Generator
from dipcg.inference.inverters import Inverters, recognisable
from dipcg.mesh import Mesh
from dipcg.model.zoo import shipped
from dipcg.parameter_file import params_to_json
from dipcg.pipeline import Inverter
from dipcg.workers.process import BuildError

# The most workers of each generator.
MOST_WORKERS = 2
# The number of builds that are remembered because they took too long.
MOST_REMEMBERED = 10_000


class Studio:
    """The estimators of several generators, behind functions that any thread may call; a context manager.

    `names` are generators or folders with checkpoints; without names all that ship and can be built here.
    Raises LookupError for an unknown name and zoo.CheckpointError with a sentence.
    """

    def __init__(self, names: Sequence[str] = (), workers: int | None = None) -> None:
        names = list(names) or recognisable()
        count = workers or max(1, min(MOST_WORKERS, (os.cpu_count() or 1) // len(names)))
        self.inverters = Inverters(names, count)
        self.text_inverters = Inverters(self.names, reads="text")
        # What was asked for in a build that took too long, with the error. It is not built again.
        self._too_costly: dict[str, BuildError] = {}
        self._lock = threading.Lock()
        for inverter in self.inverters.values():
            _limit(inverter)

    @property
    def names(self) -> list[str]:
        """The generators, in the order in which they were named."""
        return list(self.inverters)

    def learn(self, folder: str) -> None:
        """Serve the checkpoint in a folder, in place of an earlier one for its generator; raises as `__init__` does."""
        _limit(self.inverters.replace(folder))

    def forget(self, name: str) -> None:
        """Serve a generator no more."""
        self.inverters.remove(name)

    def find(self, name: str) -> Inverter:
        """The estimator of a generator; raises ValueError with the nearest name."""
        return self.inverters.find(name)

    def generator(self, name: str) -> Generator:
        """A generator that is served; raises ValueError with the nearest name."""
        return self.find(name).generator

    def reads_text(self, name: str) -> bool:
        """Whether sentences can be read for this generator here."""
        return name in shipped("text") and find_spec("transformers") is not None

    def submit(self, name: str, params: Mapping[str, Any], detail: Detail, priority: int = 0) -> Future[Mesh]:
        """Start a build; the future's result is the mesh, or a BuildError. Lower priorities are built first.

        Only a build whose worker died is tried again. Raises ValueError with a sentence.
        """
        inverter = self.find(name)
        checked = inverter.generator.space.validate(params)
        key = detail + params_to_json(checked, inverter.generator.ref)
        if known := self._too_costly.get(key):
            failed: Future[Mesh] = Future()
            failed.set_exception(known)
            return failed
        build = inverter.pool.submit(checked, detail, priority, tries=2)
        build.add_done_callback(lambda build: self._remember(key, build))
        return build

    def close(self) -> None:
        """Stop the workers."""
        self.inverters.close()
        self.text_inverters.close()

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _remember(self, key: str, build: Future[Mesh]) -> None:
        error = None if build.cancelled() else build.exception()
        if not isinstance(error, BuildError) or error.reason not in ("timeout", "memory"):
            return
        with self._lock:
            self._too_costly[key] = error
            if len(self._too_costly) > MOST_REMEMBERED:
                del self._too_costly[next(iter(self._too_costly))]


def _limit(inverter: Inverter) -> None:
    inverter.pool.timeout_s = BUILD_S
    inverter.pool.share(PATIENCE_S)
    inverter.pool.warm()
