"""Builds that hang, fail or crash cost the visitor who asked for them, and nobody else."""

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from serving import Quick, box_checkpoint, serving

from dipcg.app.client import ApiError, Client
from dipcg.registry import allow_code

GENERATOR = '''
"""A triangle that misbehaves on request, and writes down each build."""
import os, time
from pathlib import Path
import numpy as np
from dipcg.space import Choice, ParameterSpace, Real

space = ParameterSpace(Real("size", 1.0, 2.0), Choice("mode", ("good", "fail", "hang", "crash")))

def build(params):
    with open(Path(__file__).parent / "builds.txt", "a") as file:
        file.write(f"{params['mode']} {params['size']:g}\\n")
    if params["mode"] == "fail": raise RuntimeError("no such triangle")
    if params["mode"] == "hang": time.sleep(600)
    if params["mode"] == "crash": os._exit(3)
    return np.array([[0, 0, 0], [1, 0, 0], [0, params["size"], 0]], float), [[0, 1, 2]]
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("triangle")
    (folder / "triangle.py").write_text(GENERATOR)
    allow_code(folder / "triangle.py")
    return folder


@pytest.fixture
def server(folder) -> Iterator[tuple[Client, Quick]]:
    (folder / "builds.txt").write_text("")
    served = folder / "served"
    served.mkdir(exist_ok=True)
    checkpoint = box_checkpoint(folder / "checkpoint", str(folder / "triangle.py"))
    with Quick([checkpoint], workers=1) as studio, serving(studio, served) as address:
        yield Client(address), studio


def params(mode: str, size: float = 1.5) -> dict:
    return {"size": size, "mode": mode}


def builds(folder: Path) -> list[str]:
    return (folder / "builds.txt").read_text().split("\n")[:-1]


# Of a build that hangs, in the test of who waits for it.
LIMIT_S = 60.0


@pytest.mark.parametrize(
    ("mode", "times", "said"), [("hang", 1, "took longer"), ("fail", 2, "no such"), ("crash", 4, "died")]
)
def test_only_a_crash_is_tried_again(server, folder, mode, times, said):
    client, studio = server
    studio.inverters["triangle"].pool.timeout_s = 1.0
    for _ in range(2):
        with pytest.raises(ApiError, match=said):
            client.preview("triangle", params(mode))
    assert len(builds(folder)) == times, "a build that took too long is not even begun a second time"


def test_no_visitor_waits_for_the_hanging_build_of_another(server, picture):
    client, studio = server
    studio.inverters["triangle"].pool.timeout_s = LIMIT_S
    hanging = [
        threading.Thread(target=_swallow, args=(client, params("hang", size)), daemon=True) for size in (1.1, 1.9)
    ]
    name = client.upload(picture)
    begun = time.monotonic()
    for thread in hanging:
        thread.start()
    stuck = client.start_estimate(name, generator="triangle", candidates=4, fixed={"mode": "hang"})
    assert len(client.preview("triangle", params("good"))) > 500
    found = client.finish(client.start_estimate(name, generator="triangle", candidates=4, fixed={"mode": "good"}))
    assert found["ranked"]
    assert time.monotonic() - begun < LIMIT_S, "it did not wait for the limit of the others"
    assert client.job(stuck)["result"]["ranked"] is False, "the estimate itself is there"
    client.cancel(stuck)


def test_candidates_that_hang_or_fail_are_left_out(server, picture):
    client, studio = server
    studio.inverters["triangle"].pool.timeout_s = 1.0
    for mode in ("hang", "fail"):
        with pytest.raises(ApiError, match="None of the candidates could be built"):
            client.estimate(picture, generator="triangle", candidates=2, fixed={"mode": mode})
    assert client.estimate(picture, generator="triangle", candidates=2, fixed={"mode": "good"})["ranked"]


def _swallow(client: Client, wanted: dict) -> None:
    with contextlib.suppress(ApiError):
        client.preview("triangle", wanted)
