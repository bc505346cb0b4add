"""What several tests of inference share."""

from collections.abc import Iterator

import pytest
from boxes import untrained

from dipcg.pipeline import Inverter


@pytest.fixture(scope="module")
def inverter() -> Iterator[Inverter]:
    with untrained("box") as inverter:
        yield inverter
