"""Building on a Ray cluster gives the rows that one machine gives, also when a node is killed in the middle."""

import threading
import time
from pathlib import Path

import pytest
from tests.data.test_store import rows, write_generator

from dipcg.data import cluster as clusters
from dipcg.data import store
from dipcg.data.cluster import Ray
from dipcg.data.store import Progress, Store, build_dataset
from dipcg.workers.process import BuildError

ray = pytest.importorskip("ray")
COUNT = 24


@pytest.fixture(scope="module")
def cluster():
    """A head that only schedules, and two nodes with a processor each."""
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [made.add_node(num_cpus=1) for _ in range(2)]
    yield made, nodes
    ray.shutdown()
    made.shutdown()


@pytest.fixture(autouse=True)
def small_shards(monkeypatch) -> None:
    monkeypatch.setattr(store, "SHARD", 3)


def test_no_row_is_lost_or_there_twice_when_a_node_is_killed(cluster, tmp_path):
    made, nodes = cluster
    slow = write_generator(tmp_path, "time.sleep(0.2); assert size < 1.9, 'too large'")
    progress: list[Progress] = []
    killer = threading.Timer(0.0, made.remove_node, (nodes[1],), {"allow_graceful": False})

    def kill_one_node(now: Progress) -> None:
        progress.append(now)
        if len(progress) == 2:
            killer.start()

    failed = build_dataset(slow, tmp_path / "many", COUNT, executor=Ray(made.address), report=kill_one_node)
    killer.join()
    until = time.monotonic() + 60
    # The head and one node are left.
    while len([node for node in ray.nodes() if node["Alive"]]) > 2:
        assert time.monotonic() < until, "the node was not killed"
        time.sleep(0.2)
    assert failed == build_dataset(slow, tmp_path / "one", COUNT)
    assert rows(tmp_path / "many").equals(rows(tmp_path / "one"))
    assert progress[-1] == Progress(COUNT, COUNT, failed, new=COUNT)


def test_a_generator_that_cannot_start_on_a_node_says_why(cluster, tmp_path):
    ref = write_generator(tmp_path, "pass")
    with Path(ref).open("a") as file:
        file.write("def prepare():\n    raise ImportError('no Blender here')\n")
    with pytest.raises(BuildError, match="no Blender here"):
        build_dataset(ref, tmp_path / "data", 3, executor=Ray(cluster[0].address))


@pytest.mark.parametrize("changed", ["dipcg", "dipcg's code", "the file"])
def test_a_node_with_another_version_or_another_file_is_refused(tmp_path, changed):
    ref = write_generator(tmp_path, "pass")
    expected = clusters.origin(ref, clusters.PACKAGES)
    changed = ref if changed == "the file" else changed
    said = clusters._build(ref, expected | {changed: "other"}, 0, "uniform", range(2), 10.0)
    assert f"would build other shapes: {changed} is {expected[changed]} and not other." in said
    assert isinstance(clusters._build(ref, expected, 0, "uniform", range(2), 10.0), tuple)


def test_a_cluster_that_does_not_answer_is_told(tmp_path, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise ConnectionError("nobody there")

    monkeypatch.setattr(ray, "init", refuse)
    with pytest.raises(RuntimeError, match=r"No Ray cluster answers at '10.0.0.9:6379' \(nobody there\)"):
        build_dataset("box", tmp_path / "data", 3, executor=Ray("10.0.0.9:6379"))
    assert Store(tmp_path / "data").info["generator"] == "box", "the folder can be filled later"
