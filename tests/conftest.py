"""Random inputs that can be had again.

Inputs are new in every commit and the same wherever that commit is tested, so that a red CI can be
repeated: a test's seed comes from git's tree and the test's name. ``--fresh`` takes seeds of its
own in every run (to hunt), and so does a tree without git. A failure names its seed, ``--seed``
repeats it.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import hypothesis
import numpy as np
import pytest
from support.shared_builds import share_builds

from gibench.measure.machine import roofs

share_builds()
# An example is never too slow: on a busy machine every one is.
hypothesis.settings.register_profile("suite", deadline=None)
hypothesis.settings.load_profile("suite")

_SEED = pytest.StashKey[int]()
_LOADED = pytest.StashKey[int]()
_MANY = 50  # modules
_TREE = pytest.StashKey[tuple[int, ...]]()
_SHORT_ROOFS = {"_STREAM_BYTES": 8 << 20, "_FMA_TURNS": 2000, "_RAYS": 1 << 14, "_REPEATS": 3}
_PICTURE = {
    "png": bytes.fromhex(  # one black pixel
        "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b550000000a49444154789c63"
        "6000000002000148afa4710000000049454e44ae426082"
    ),
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg"/>',
}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, help="seed of the tests' rng")
    parser.addoption("--fresh", action="store_true", help="new seeds in this run")


def _tree() -> tuple[int, ...]:
    """The words of git's hash of the committed tree; random ones where there is no git."""
    try:
        told = subprocess.run(
            ["git", "rev-parse", "HEAD^{tree}"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return tuple(int(word) for word in np.random.SeedSequence().generate_state(5))
    return tuple(int(told[at : at + 8], 16) for at in range(0, len(told), 8))


def pytest_configure(config: pytest.Config) -> None:
    random = [int(word) for word in np.random.SeedSequence().generate_state(5)]
    config.stash[_TREE] = tuple(random) if config.getoption("--fresh") else _tree()


def pytest_collection_finish(session: pytest.Session) -> None:
    _freeze(session.config)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    if len(sys.modules) > item.config.stash[_LOADED] + _MANY:
        _freeze(item.config)


def _freeze(config: pytest.Config) -> None:
    """What is loaded stays loaded: no later collection, and a run asks for some, looks at it."""
    gc.collect()
    gc.freeze()
    config.stash[_LOADED] = len(sys.modules)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator of a seed of each test's own, kept for the report."""
    seed = request.config.getoption("--seed")
    if seed is None:
        words = (*request.config.stash[_TREE], zlib.crc32(request.node.nodeid.encode()))
        seed = int(np.random.SeedSequence(words).generate_state(1)[0])
    request.node.stash[_SEED] = seed
    return np.random.default_rng(seed)


@pytest.fixture(autouse=True)
def undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plots are made and written, but matplotlib draws none unless a test is marked ``drawn``: half
    the time of a small run, of no use to a test that looks at no plot.
    """
    if request.node.get_closest_marker("drawn"):
        return

    def save(figure: object, file: BinaryIO, *, format: str, **options: object) -> None:  # noqa: A002
        file.write(_PICTURE[format])

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save)


@pytest.fixture(autouse=True)
def short_roofs(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs measure the machine's roofs in a tenth of the time, less exactly, but for tests marked
    ``roofs``.
    """
    if not request.node.get_closest_marker("roofs"):
        for name, value in _SHORT_ROOFS.items():
            monkeypatch.setattr(roofs, name, value)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report: Any = yield
    if report.failed and _SEED in item.stash:
        report.sections.append(
            ("seed", f"repeat with: pytest '{item.nodeid}' --seed {item.stash[_SEED]}")
        )
    return report
