"""Random inputs that can be had again: a failure names its seed, ``--seed`` repeats it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from support.shared_builds import share_builds

share_builds()

_SEED = pytest.StashKey[int]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, help="seed of the tests' rng")


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator of a new seed in every test, kept for the report."""
    given = request.config.getoption("--seed")
    seed = int(np.random.SeedSequence().generate_state(1)[0]) if given is None else given
    request.node.stash[_SEED] = seed
    return np.random.default_rng(seed)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report: Any = yield
    if report.failed and _SEED in item.stash:
        report.sections.append(
            ("seed", f"repeat with: pytest '{item.nodeid}' --seed {item.stash[_SEED]}")
        )
    return report
