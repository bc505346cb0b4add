"""Data sets on disk: packing keeps the shape, a build goes on wherever it was killed, other folders are refused."""

import json
import signal
import subprocess
import sys
import time
from collections import Counter
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import dipcg
from dipcg.cli import main
from dipcg.data import store
from dipcg.data.store import SPLITS, Local, Progress, Store, build_dataset, in_split
from dipcg.generators import load_generator
from dipcg.parameter_file import params_from_json
from dipcg.registry import allow_code
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

pytestmark = pytest.mark.slow

SHARD = 4


@pytest.fixture(autouse=True)
def small_shards(monkeypatch) -> None:
    monkeypatch.setattr(store, "SHARD", SHARD)


def rows(folder: Path) -> pa.Table:
    return Store(folder).table().drop_columns(["_build_s"])


def shards_of(folder: Path) -> list[Path]:
    return sorted(folder.glob("shard-*.parquet"))


def write_generator(folder: Path, body: str, low: float = 1.0) -> str:
    """A generator file with one parameter `size`, whose build is a triangle of that size after running `body`."""
    path = folder / "triangle.py"
    path.write_text(
        "import time\nfrom dipcg.space import ParameterSpace, Real\n"
        f"space = ParameterSpace(Real('size', {low}, 2.0))\n"
        f"def build(params):\n    size = params['size']\n    {body}\n"
        "    return [[0, 0, 0], [size, 0, 0], [0, size, 0]], [[0, 1, 2]]\n"
    )
    allow_code(path)
    return str(path)


# Building

KILLED = """
import sys, dipcg, dipcg.data.store as store
dipcg.allow_code(sys.argv[1])
store.SHARD = int(sys.argv[3])
store.build_dataset(sys.argv[1], sys.argv[2], 20)
"""


def test_a_killed_build_goes_on_with_the_same_rows(tmp_path):
    slow = write_generator(tmp_path, "time.sleep(0.05)")
    command = [sys.executable, "-c", KILLED, slow, str(tmp_path / "killed"), str(SHARD)]
    child = subprocess.Popen(command)
    while not (tmp_path / "killed" / "shard-00001.parquet").exists():
        time.sleep(0.01)
    # Long enough to be in the next shard.
    time.sleep(0.05)
    child.send_signal(signal.SIGKILL)
    child.wait()
    left = shards_of(tmp_path / "killed")
    assert 2 <= len(left) < 5
    written = [path.stat().st_mtime_ns for path in left]
    build_dataset(slow, tmp_path / "killed", 20)
    build_dataset(slow, tmp_path / "whole", 20)
    assert rows(tmp_path / "killed").equals(rows(tmp_path / "whole"))
    assert [path.stat().st_mtime_ns for path in left] == written, "finished shards are not built again"


def test_what_a_killed_build_left_unfinished_is_not_read(tmp_path):
    build_dataset("box", tmp_path, 2 * SHARD)
    (tmp_path / "shard-00002.123.tmp").write_bytes(b"PAR1 and then the power went")
    assert rows(tmp_path).num_rows == 2 * SHARD


def test_a_grown_data_set_keeps_its_rows_and_splits(tmp_path):
    build_dataset("box", tmp_path / "grown", 10)
    before = rows(tmp_path / "grown")
    splits = {split: numbers(tmp_path / "grown", split) for split in SPLITS}
    build_dataset("box", tmp_path / "grown", 24)
    build_dataset("box", tmp_path / "whole", 24)
    assert rows(tmp_path / "grown").slice(0, 10).equals(before.combine_chunks())
    assert rows(tmp_path / "grown").equals(rows(tmp_path / "whole"))
    assert all(numbers(tmp_path / "grown", split)[: len(old)] == old for split, old in splits.items())


def numbers(folder: Path, split: str) -> list[int]:
    return [sample.number for sample in Store(folder).samples(split)]


def test_rows_depend_on_the_seed_and_not_on_the_workers(tmp_path):
    build_dataset("box", tmp_path / "one", 6, seed=1)
    build_dataset("box", tmp_path / "two", 6, seed=1, executor=Local(workers=2))
    build_dataset("box", tmp_path / "other", 6, seed=2)
    assert rows(tmp_path / "one").equals(rows(tmp_path / "two"))
    assert not rows(tmp_path / "one").equals(rows(tmp_path / "other"))


def test_samples_are_what_the_generator_builds_from_their_parameters(tmp_path):
    box = load_generator("box")
    build_dataset("box", tmp_path, 6)
    samples = list(Store(tmp_path).samples())
    with BuildPool("box") as pool:
        built = list(pool.map([sample.params for sample in samples], "light"))
    for sample, mesh in zip(samples, built, strict=True):
        assert box.space.validate(sample.params) == sample.params
        np.testing.assert_allclose(sample.mesh.bounds, mesh.bounds, atol=1e-3)


def test_each_sample_is_in_one_split_and_a_twentieth_is_for_the_test():
    found = {split: [number for number in range(200) if in_split(number, split)] for split in SPLITS}
    assert sorted(chain(*found.values())) == list(range(200))
    assert {split: len(members) for split, members in found.items()} == {"train": 180, "validation": 10, "test": 10}


def test_failures_are_rows_with_a_reason(tmp_path):
    ref = write_generator(tmp_path, "assert size < 1.5, 'too large'")
    progress: list[Progress] = []
    failed = build_dataset(ref, tmp_path / "data", 20, report=progress.append)
    samples = list(Store(tmp_path / "data").samples())
    assert [sample.number for sample in samples] == list(range(20))
    assert [sample.mesh is None for sample in samples] == [sample.params["size"] >= 1.5 for sample in samples]
    assert [sample.failure for sample in samples] == [None if sample.mesh else "raised" for sample in samples]
    assert 0 < failed < 20
    assert progress[-1] == Progress(20, 20, failed, new=20)
    assert Store(tmp_path / "data").summary()["failed"] == {"raised": failed}


WAYS_TO_FAIL = (
    "import os\n    if size < 1.2: raise RuntimeError('no leg')\n    if size < 1.4: return [[size] * 3], [[0, 1, 2]]\n"
    "    if size < 1.6: os._exit(3)\n    if size < 1.7: time.sleep(60)\n    if size < 1.8: return [], []"
)


def test_a_build_stops_early_and_exits_with_1_when_nothing_can_be_built(tmp_path, capsys):
    (tmp_path / "broken.py").write_text(
        "from dipcg.space import ParameterSpace, Real\n"
        "space = ParameterSpace(Real('size', 1.0, 2.0))\ndef build(params):\n    return no_such_name\n"
    )
    with pytest.raises(SystemExit) as end:
        main(["dataset", "build", str(tmp_path / "broken.py"), "-o", str(tmp_path / "data"), "--count", "5000"])
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert "All of the first 20 builds failed. The first: The generator raised NameError" in said
    assert "(broken.py, line 4)" in said


def test_every_kind_of_failure_is_counted_and_can_be_built_again(tmp_path):
    ref = write_generator(tmp_path, WAYS_TO_FAIL)
    build_dataset(ref, tmp_path / "data", 24, executor=Local(timeout_s=1.0))
    summary = Store(tmp_path / "data").summary()
    samples = list(Store(tmp_path / "data").samples())
    expected = [why_it_fails(sample.params["size"]) for sample in samples]
    assert [sample.failure for sample in samples] == expected
    assert summary["failed"] == {reason: expected.count(reason) for reason in sorted({*expected} - {None})}
    assert set(summary["failed"]) == {"raised", "unusable", "crashed", "timeout"}
    for reason, sentence in summary["first_failed"].items():
        first = samples[expected.index(reason)]
        assert sentence == first.sentence
        assert params_from_json(sentence[sentence.index("{") :]) == (ref, first.params)


def why_it_fails(size: float) -> str | None:
    limits = {1.2: "raised", 1.4: "unusable", 1.6: "crashed", 1.7: "timeout", 1.8: "unusable"}
    return next((reason for limit, reason in limits.items() if size < limit), None)


def test_a_generator_that_cannot_start_ends_the_build(tmp_path):
    ref = write_generator(tmp_path, "pass")
    with Path(ref).open("a") as file:
        file.write("def prepare():\n    raise ImportError('no Blender here')\n")
    with pytest.raises(BuildError, match="no Blender here"):
        build_dataset(ref, tmp_path / "data", 2)
    assert shards_of(tmp_path / "data") == []


def test_the_summary_counts_what_is_there(tmp_path):
    build_dataset("box", tmp_path, 40, seed=5)
    summary = Store(tmp_path).summary()
    assert summary["bytes"] == sum(path.stat().st_size for path in tmp_path.glob("*.parquet"))
    histograms = summary.pop("parameters")
    del summary["bytes"]
    expected = {"generator": "box", "seed": 5, "drawing": "uniform", "samples": 40, "failed": {}, "first_failed": {}}
    assert summary == expected | {"splits": {"train": 36, "validation": 2, "test": 2}}
    table = Store(tmp_path).table()
    assert histograms.keys() == set(load_generator("box").space.names)
    assert sum(histograms["width"]) == 40
    assert histograms["top"] == dict(Counter(table["top"].to_pylist()))
    assert sum(histograms["lid_height"]) == histograms["top"]["pyramid"], "counted where it means something"


# Drawing


# What others read


def test_columns_have_the_names_of_the_parameters_and_say_what_made_them(tmp_path):
    build_dataset("box", tmp_path, 6)
    table = pq.read_table(tmp_path / "shard-00000.parquet")
    assert set(load_generator("box").space.names) <= set(table.column_names)
    assert min(table["_build_s"].to_pylist()) > 0
    about = json.loads(table.schema.metadata[b"dipcg"])
    assert about["versions"]["dipcg"] == dipcg.__version__
    assert about["fingerprint"] == load_generator("box").space.fingerprint


# A disk that is full, a folder that cannot be

FULL = """
import resource, signal, sys, dipcg.data.store as store
from dipcg.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
store.SHARD = 4
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
main(["dataset", "build", "box", "--count", "8", "-o", sys.argv[1]])
"""


def test_a_full_disk_is_a_sentence_and_keeps_what_is_written(tmp_path):
    build_dataset("box", tmp_path / "data", 4)
    kept = rows(tmp_path / "data")
    told = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path / "data"), "1000"], capture_output=True, text=True, check=False
    )
    assert told.returncode == 1
    assert "shard-00001.parquet cannot be used (File too large)." in told.stderr
    names = [path.name for path in sorted((tmp_path / "data").iterdir())]
    assert names == [".lock", "dataset.json", "shard-00000.parquet"]
    assert rows(tmp_path / "data").equals(kept)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        build_dataset("box", tmp_path / "file" / "data", 4)


# Folders that are no data set, or another's


def test_a_folder_of_another_seed_or_generator_is_refused(tmp_path):
    build_dataset("box", tmp_path / "data", 2)
    with pytest.raises(ValueError, match=r"already holds another data set \(different seed\)"):
        build_dataset("box", tmp_path / "data", 2, seed=1)
    with pytest.raises(ValueError, match=r"already holds another data set \(different generator.*\)"):
        build_dataset(write_generator(tmp_path, "pass"), tmp_path / "data", 2)
    assert rows(tmp_path / "data").num_rows == 2


def test_changed_parameters_are_refused(tmp_path):
    ref = write_generator(tmp_path, "pass")
    build_dataset(ref, tmp_path / "data", 2)
    write_generator(tmp_path, "pass", low=0.5)
    with pytest.raises(ValueError, match="other parameters of 'triangle' than are installed"):
        Store(tmp_path / "data")
    with pytest.raises(ValueError, match="different fingerprint"):
        build_dataset(ref, tmp_path / "data", 2)


@pytest.mark.parametrize("count", [0, -3])
def test_a_count_below_one_is_refused(tmp_path, count):
    with pytest.raises(ValueError, match=f"at least 1, got {count}"):
        build_dataset("box", tmp_path / "data", count)
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("keep", [0, 4, 0.5], ids=["empty", "four bytes", "half"])
def test_a_damaged_shard_is_named(tmp_path, keep):
    build_dataset("box", tmp_path, 2 * SHARD)
    shard = shards_of(tmp_path)[1]
    data = shard.read_bytes()
    shard.write_bytes(data[: int(keep * len(data)) if isinstance(keep, float) else keep])
    for use in (lambda: Store(tmp_path).table(), lambda: build_dataset("box", tmp_path, 2 * SHARD)):
        with pytest.raises(ValueError, match=r"shard-00001\.parquet is damaged"):
            use()


@pytest.mark.parametrize("text", [None, "", "{", "[]", "{}", '"box"'], ids=repr)
def test_a_folder_without_a_readable_description_is_no_data_set(tmp_path, text):
    build_dataset("box", tmp_path, 2)
    (tmp_path / "dataset.json").unlink()
    if text is not None:
        (tmp_path / "dataset.json").write_text(text)
    with pytest.raises(ValueError, match=r"is not a data set: it has no readable dataset.json"):
        Store(tmp_path)


def test_a_folder_that_does_not_exist_is_no_data_set(tmp_path):
    with pytest.raises(ValueError, match="is not a data set"):
        Store(tmp_path / "nowhere")


def test_a_data_set_without_a_finished_shard_says_so(tmp_path):
    build_dataset("box", tmp_path, 2)
    shards_of(tmp_path)[0].unlink()
    with pytest.raises(ValueError, match="has no finished shard yet"):
        Store(tmp_path).table()


def test_the_description_of_a_data_set_is_plain_json(tmp_path):
    build_dataset("box", tmp_path, 2, seed=4)
    info = json.loads((tmp_path / "dataset.json").read_text())
    fingerprint = load_generator("box").space.fingerprint
    assert info == {"generator": "box", "ref": "box", "fingerprint": fingerprint, "seed": 4, "drawing": "uniform"}
