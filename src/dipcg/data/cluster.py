"""Shards built on a Ray cluster: Ray schedules, restarts what dies, and brings each shard's bytes to who writes it.

Nothing but the bytes of finished shards crosses the network, no node needs a shared folder, and a shard that is built
again after a node died has the same rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from dipcg.data.draws import Draws
from dipcg.data.shards import build as build_shard
from dipcg.data.store import Counts
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

AHEAD = 2  # shards waiting or being built for each processor of the cluster


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
        build = ray.remote(num_cpus=1, max_retries=-1)(_build)
        waiting, running = list(reversed(todo)), {}
        while waiting or running:
            while waiting and len(running) < AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1))):
                job = waiting.pop()
                running[build.remote(draws, job, self.timeout_s)] = job
            ready, _ = ray.wait(list(running), num_returns=1)
            job, (content, failed) = running.pop(ready[0]), _fetched(ray, ready[0])
            yield job, content
            counts.add(len(job), failed)


def _build(draws: Draws, job: range, timeout_s: float) -> tuple[bytes, int] | str:
    """On a node: one shard with one worker, which is kept for the next one. A string says why none could start."""
    try:
        outcomes = list(_pool(draws.ref, timeout_s).timed(draws.params(job), "light"))
        content = build_shard(draws.generator, draws, job, outcomes)
    except BuildError as error:
        return f"{error} {error.hint}"
    return content, sum(isinstance(mesh, BuildError) for mesh, _ in outcomes)


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


def _fetched(ray: Any, reference: Any) -> tuple[bytes, int]:
    found = ray.get(reference)
    if isinstance(found, str):
        raise BuildError("start", found)
    return found
