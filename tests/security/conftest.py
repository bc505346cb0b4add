"""A server in a process of its own, for all tests of this folder."""

from collections.abc import Iterator

import pytest
from attacking import Process, started


@pytest.fixture(scope="session")
def process(tmp_path_factory) -> Iterator[Process]:
    with started(tmp_path_factory.mktemp("process"), "--allow-host", "dipcg.example") as process:
        yield process
