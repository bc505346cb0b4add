"""A server in a process of its own for all tests of this folder, and one that learns for each."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from attacking import Process, started
from serving import serving

from dipcg.app import training_queue
from dipcg.app.client import Client


@pytest.fixture(scope="session")
def process(tmp_path_factory) -> Iterator[Process]:
    with started(tmp_path_factory.mktemp("process"), "--allow-host", "dipcg.example") as process:
        yield process


@pytest.fixture
def folder(tmp_path) -> Path:
    return tmp_path / "learned"


@pytest.fixture
def learning(studio, folder, tmp_path, monkeypatch) -> Iterator[Client]:
    """A client of a server that learns, whose process never begins."""
    monkeypatch.setattr(training_queue, "PROGRAM", "this")
    with serving(studio, tmp_path / "served", learn=folder) as address:
        yield Client(address)
