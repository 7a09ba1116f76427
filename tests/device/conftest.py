"""One process under Oclgrind for all simulator tests of a worker."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.oclgrind_runner import Simulator, simulator


@pytest.fixture(scope="session")
def oclgrind() -> Iterator[Simulator]:
    with simulator() as running:
        yield running
