"""Every kernel runs under Oclgrind without a finding: memory, data races, uninitialised values."""

from __future__ import annotations

from pathlib import Path

import pytest
from oclgrind_runner import needs_oclgrind, under_oclgrind

from gibench.techniques.registry import techniques

pytestmark = [pytest.mark.oclgrind, needs_oclgrind]

CASES = [
    (spec.name, variant, size, width)
    for spec in techniques().values()
    for variant in spec.variants
    for size, width in ((16, 16), (7, 4), (64, 1))
]


@pytest.mark.parametrize("fault", ["bounds", "race", "uninitialised"])
def test_a_fault_is_found(tmp_path: Path, fault: str) -> None:
    assert under_oclgrind(tmp_path, "unsound.py", fault)[1]


def test_a_sound_kernel_leaves_an_empty_log(tmp_path: Path) -> None:
    assert under_oclgrind(tmp_path, "unsound.py", "none")[1] == ""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("baked")


# In the order of CASES: the frames below load what this has baked.
@pytest.mark.parametrize("technique", sorted({name for name, *_ in CASES}))
def test_bake_of_a_technique(tmp_path: Path, cache: Path, technique: str) -> None:
    arguments = ("bake", technique, "tuned", "16", "16", str(cache))
    # The bake's kernels are among those that Oclgrind segfaults on with --uninitialized.
    printed, log = under_oclgrind(
        tmp_path, "frame_under_oclgrind.py", *arguments, uninitialised=False
    )
    assert log == ""
    assert technique != "srp" or "transport_accumulate" in printed


@pytest.mark.parametrize(("technique", "variant", "size", "width"), CASES)
def test_frames_of_a_technique(
    tmp_path: Path, cache: Path, technique: str, variant: str, size: int, width: int
) -> None:
    arguments = ("frames", technique, variant, str(size), str(width), str(cache))
    printed, log = under_oclgrind(tmp_path, "frame_under_oclgrind.py", *arguments)
    assert log == ""
    assert printed
