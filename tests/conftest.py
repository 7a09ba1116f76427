"""Fresh random inputs that can be had again: a failure names its seed, ``--seed`` repeats it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

_SEED = pytest.StashKey[int]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, help="seed of every np.random.default_rng() in a test")


@pytest.fixture(autouse=True)
def fresh_but_known_seed(request: pytest.FixtureRequest) -> Iterator[None]:
    """Generators that a test makes without a seed come from one new seed, kept for the report."""
    given = request.config.getoption("--seed")
    seed = int(np.random.SeedSequence().generate_state(1)[0]) if given is None else given
    request.node.stash[_SEED] = seed
    children, plain = np.random.SeedSequence(seed), np.random.default_rng

    def default_rng(wanted: Any = None) -> np.random.Generator:
        return plain(children.spawn(1)[0] if wanted is None else wanted)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.random, "default_rng", default_rng)
        yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report: Any = yield
    if report.failed and _SEED in item.stash:
        report.sections.append(
            ("seed", f"repeat with: pytest '{item.nodeid}' --seed {item.stash[_SEED]}")
        )
    return report
