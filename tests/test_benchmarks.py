"""The list of benchmarks is complete, and listing runs none of them."""

from pathlib import Path

import pytest
from benchmarks import __main__ as benchmarks

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
