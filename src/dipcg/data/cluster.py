"""Shards built on a Ray cluster: Ray schedules, restarts what dies, and brings each shard's bytes to who writes it.

Nothing but the bytes of finished shards crosses the network, no node needs a shared folder, and a shard that is built
again after a node died has the same rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from dipcg.data.draws import Drawing, Draws
from dipcg.data.shards import pack_built
from dipcg.data.store import Counts
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

# Shards that are waiting or being built for each processor of the cluster.
AHEAD = 2


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
        waiting, running = list(reversed(todo)), {}
        while waiting or running:
            while waiting and len(running) < AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1))):
                job = waiting.pop()
                running[build.remote(generator, draws.seed, draws.drawing, job, self.timeout_s)] = job
            ready, _ = ray.wait(list(running), num_returns=1)
            job, (content, failed) = running.pop(ready[0]), _fetch(ray, ready[0])
            yield job, content
            counts.add(len(job), failed)


def _build(ref: str, seed: int, drawing: Drawing, job: range, timeout_s: float) -> tuple[bytes, int] | str:
    """On a node: one shard from one worker, which stays for the next shard. A string says why no worker could start."""
    pool = _pool(ref, timeout_s)
    try:
        builds = list(pool.timed(Draws(pool.generator, seed, drawing).params(job), "light"))
        content = pack_built(pool.generator, seed, job, builds)
    except BuildError as error:
        return f"{error} {error.hint}"
    return content, sum(isinstance(built.mesh, BuildError) for built in builds)


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
