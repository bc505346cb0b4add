"""The list of benchmarks is complete, and listing runs none of them."""

from pathlib import Path

import pytest
from benchmarks import __main__ as benchmarks
from benchmarks.trained import run, train

from dipcg.data.store import build_dataset

FOLDER = Path(benchmarks.__file__).parent


def test_every_benchmark_that_can_be_run_is_listed():
    runnable = {path.stem for path in FOLDER.glob("*.py") if '__name__ == "__main__"' in path.read_text()}
    assert set(benchmarks.USUALLY) == runnable - {"__main__"}


@pytest.mark.parametrize("words", [(), ("--help",)])
def test_listing_names_each_with_its_time_and_runs_nothing(words, capsys, monkeypatch):
    monkeypatch.setattr(benchmarks.runpy, "run_module", None)
    benchmarks.main(*words)
    said = capsys.readouterr().out
    assert all(f"  {name} " in said for name in benchmarks.USUALLY)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(SystemExit, match=r"no benchmark 'sped'\. There are: ablation"):
        benchmarks.main("sped")


def test_a_finished_training_is_left_as_it_is_and_another_error_stops(tmp_path):
    build_dataset("box", tmp_path / "data", 40)
    flags = ("--pictures", "32", "--batch", "16", "--image-size", "32", "--depth", "1")
    weights = train(str(tmp_path / "data"), tmp_path / "runs", *flags) / "model.safetensors"
    before = weights.stat().st_mtime_ns
    train(str(tmp_path / "data"), tmp_path / "runs", *flags)
    assert weights.stat().st_mtime_ns == before
    with pytest.raises(SystemExit, match="no generator 'chiar'"):
        run("sample", "chiar", "-o", str(tmp_path / "chair.glb"))
