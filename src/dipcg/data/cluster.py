"""Shards built on a Ray cluster: Ray schedules, restarts what dies, and brings each shard's bytes to who writes it.

Nothing but the bytes of finished shards crosses the network, no node needs a shared folder, and a shard that is built
again after a node died has the same rows. A node with other versions or another file of the generator is refused.
"""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import dipcg
from dipcg.data.draws import Drawing, Draws
from dipcg.data.shards import pack_built
from dipcg.data.store import Counts
from dipcg.registry import allow_code, is_path
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

# Shards that are waiting or being built for each processor of the cluster.
AHEAD = 2
# Packages that decide what a generator builds, besides those that it needs.
PACKAGES = ("dipcg", "numpy", "meshoptimizer")


@dataclass(frozen=True)
class Ray:
    """Builds on a cluster: the one at `address`, else the one RAY_ADDRESS names, else one started on this machine."""

    address: str | None = None
    timeout_s: float = 60.0

    def shards(self, draws: Draws, todo: list[range], counts: Counts) -> Iterator[tuple[range, bytes]]:
        """Build shards, as many at once as the cluster has processors.

        Raises ModuleNotFoundError without Ray, RuntimeError when the cluster cannot be reached, and BuildError when a
        node cannot start its workers.
        """
        if not todo:
            return
        ray = _connected(self.address)
        build, generator = ray.remote(num_cpus=1, max_retries=-1)(_build), draws.generator.ref
        ours = origin(generator, PACKAGES + draws.generator.needs)
        waiting, running = list(reversed(todo)), {}
        while waiting or running:
            while waiting and len(running) < AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1))):
                job = waiting.pop()
                running[build.remote(generator, ours, draws.seed, draws.drawing, job, self.timeout_s)] = job
            ready, _ = ray.wait(list(running), num_returns=1)
            job, (content, failed) = running.pop(ready[0]), _fetch(ray, ready[0])
            yield job, content
            counts.add(len(job), failed)


def origin(ref: str, packages: Iterable[str]) -> dict[str, str]:
    """What decides how a generator builds here: versions of packages, digests of this package and of its own file."""
    found = {package: _version(package) for package in packages}
    found["dipcg's code"] = _digest(*sorted(Path(dipcg.__file__).parent.rglob("*.py")))
    return found | ({ref: _digest(Path(ref))} if is_path(ref) else {})


def _build(
    ref: str, expected: dict[str, str], seed: int, drawing: Drawing, job: range, timeout_s: float
) -> tuple[bytes, int] | str:
    """On a node: one shard from one worker, which stays for the next shard. A string says why nothing can be built."""
    if different := _different(ref, expected):
        return different
    # The file is the one that the machine with the command has loaded.
    allow_code(ref)
    pool = _pool(ref, timeout_s)
    try:
        builds = list(pool.timed(Draws(pool.generator, seed, drawing).params(job), "light"))
        content = pack_built(pool.generator, seed, job, builds)
    except BuildError as error:
        return f"{error} {error.hint}"
    return content, sum(isinstance(built.mesh, BuildError) for built in builds)


def _different(ref: str, expected: dict[str, str]) -> str:
    """A sentence that says in what this node differs from the machine with the command; empty where it does not."""
    here = origin(ref, [name for name in expected if name not in ("dipcg's code", ref)])
    words = [f"{name} is {here[name]} and not {value}" for name, value in expected.items() if here[name] != value]
    if not words:
        return ""
    node = socket.gethostname()
    return f"The node {node} would build other shapes: {', '.join(words)}. Install the same there as on this machine."


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _digest(*files: Path) -> str:
    """The first digits of a hash of the files' contents."""
    sha = hashlib.sha256()
    for file in files:
        sha.update(file.read_bytes() if file.is_file() else b"missing")
    return sha.hexdigest()[:12]


@cache
def _pool(ref: str, timeout_s: float) -> BuildPool:
    return BuildPool(ref, 1, timeout_s)


def _connected(address: str | None) -> Any:
    try:
        import ray
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "Building on a cluster needs Ray: run `pip install 'dipcg[cluster]'` on this machine and on every node.",
            name="ray",
        ) from None
    try:
        ray.init(
            address, ignore_reinit_error=True, log_to_driver=False, include_dashboard=False if not address else None
        )
    except (ConnectionError, ValueError) as error:
        raise RuntimeError(
            f"No Ray cluster answers at {address!r} ({error}); start one with `ray start --head`."
        ) from None
    return ray


def _fetch(ray: Any, reference: Any) -> tuple[bytes, int]:
    shard = ray.get(reference)
    if isinstance(shard, str):
        raise BuildError("start", shard)
    return shard
