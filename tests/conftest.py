"""Random inputs that can be had again: a failure names its seed, ``--seed`` repeats it."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
import pytest
from support.shared_builds import share_builds

share_builds()

_SEED = pytest.StashKey[int]()
_PICTURE = {
    "png": bytes.fromhex(  # one black pixel
        "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b550000000a49444154789c63"
        "6000000002000148afa4710000000049454e44ae426082"
    ),
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg"/>',
}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, help="seed of the tests' rng")


def pytest_collection_finish() -> None:
    """What is loaded stays loaded: no later collection, and a run asks for some, looks at it."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator of a new seed in every test, kept for the report."""
    given = request.config.getoption("--seed")
    seed = int(np.random.SeedSequence().generate_state(1)[0]) if given is None else given
    request.node.stash[_SEED] = seed
    return np.random.default_rng(seed)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plots are made and written, but matplotlib draws none: half the time of a small run, of no
    use to a test that looks at no plot.
    """

    def save(figure: object, file: BinaryIO, *, format: str, **options: object) -> None:  # noqa: A002
        file.write(_PICTURE[format])

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report: Any = yield
    if report.failed and _SEED in item.stash:
        report.sections.append(
            ("seed", f"repeat with: pytest '{item.nodeid}' --seed {item.stash[_SEED]}")
        )
    return report
