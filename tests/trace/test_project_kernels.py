"""Traced kernels of the project leave what the device leaves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "simulator"))
import cases
from cases import BAKES, MOVING, OF_SIMT, OTHER_SETTINGS, WITH_A_LAYOUT, Case, distinct
from recording import all_kernels

from gibench.device import SIMT
from gibench.techniques.registry import TUNED, techniques
from gibench.trace.analysis import analyse
from gibench.trace.instrument import ATOMIC
from gibench.trace.request import Sampling, TraceRequest, read_request
from gibench.trace.trace import trace_launch

ROOT = Path(__file__).parents[1]
WHOLE = Sampling(whole=True, timeout=300.0)

PUBLISHED = Case("frames", 16, 4, "ddgi", "published")
CACHE = Case("frames", 16, 8, "surfel-cache", "tuned")
# One a folder of kernels_cl that holds kernels of its own.
ONE_A_FOLDER = {
    "srp": ("srp/tuned_projection.cl:cluster_projection", Case("frames", 16, 8, "srp", "tuned")),
    "parts": ("parts/lightmap_update.cl:lightmap_update", Case("frames", 16, 8, "srp", "tuned")),
    "ddgi": ("ddgi/published_blend.cl:blend_irradiance", PUBLISHED),
    "gibs": ("gibs/life.cl:coverage", Case("frames", 16, 8, "gibs", "tuned")),
    "surfel_cache": ("surfel_cache/pull.cl:pull_subtrees", CACHE),
    "rays": ("rays/trace.cl:trace_closest", Case("rays", 16, 8)),
    "measure": ("measure/roofs.cl:roof_triad", Case("roofs", 16, 8)),
    "reference": ("reference/path.cl:shade", Case("reference", 16, 8)),
}  # fmt: skip
UNTRACED = {"ddgi/application.cl:probe_view": "for pictures of probes, not for frames"}
"""Kernels that no launch below has, each with the reason."""
OTHERS = "others"
EVERY = [
    (name, size, width)
    for size, width in ((16, 8), (64, 4))
    for name in (*(spec.name for spec in techniques().values()), OTHERS)
]


def cases_of(name: str, size: int, width: int) -> list[Case]:
    """Everything of a technique, or what belongs to none, at one work-group size."""
    if name == OTHERS:
        found = [replace(each, size=size, width=width) for each in (*MOVING, *cases.OTHERS)]
        # PoCL's compiler for processors without AVX-512 makes no programs of 16 lanes.
        bakes = [replace(each, width=min(each.width, width)) for each in BAKES]
        return distinct(found) + bakes
    choices = [{}, *OTHER_SETTINGS.get(name, [])]
    variants = techniques()[name].variants
    found = [Case("frames", size, width, name, v, c) for v in variants for c in choices]
    if name in WITH_A_LAYOUT:
        more = OF_SIMT.get(name, {})
        found += [Case("frames", size, 1, name, TUNED, c | more, SIMT) for c in choices]
    return found


def captured(
    folder: Path, cache: Path, kernels: Sequence[str], cases: Sequence[Case]
) -> list[Path]:
    folder.mkdir()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT.parent), str(ROOT)])}
    command = [sys.executable, str(ROOT / "support" / "launch_capture.py"), str(folder), str(cache)]
    command += [",".join(kernels), *(json.dumps(asdict(case)) for case in cases)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return sorted(folder.iterdir(), key=lambda path: int(path.name))


def differences(folder: Path) -> Iterator[str]:
    """What a traced launch leaves otherwise than the device did."""
    request, _ = read_request(folder)
    trace = trace_launch(request, WHOLE)
    facts = analyse(trace)
    if facts.outside:
        yield f"{request.label}: {facts.outside} accesses outside every buffer"
    for number, argument in enumerate(request.args):
        file = folder / f"after{number}.npy"
        if file.is_file():
            found, expected = trace.outputs[argument.name], np.load(file)
            if not alike(found, expected, order_free=ATOMIC in trace.tables.kind):
                yield f"{request.label}: {argument.name} {_worst(found, expected)}"


def alike(found: np.ndarray, expected: np.ndarray, *, order_free: bool) -> bool:
    """Within rounding; words that hold floats are read so, and lists that atomics fill may come in
    another order.
    """
    if found.dtype.kind == "f":
        if near(found, expected):
            return True
        return order_free and near(np.sort(found, axis=None), np.sort(expected, axis=None))
    if np.array_equal(found, expected):
        return True
    if order_free and np.array_equal(np.sort(found, axis=None), np.sort(expected, axis=None)):
        return True
    kinds = [
        kind for kind in (np.float32, np.float16) if found.nbytes % np.dtype(kind).itemsize == 0
    ]
    return any(near(_as(found, kind), _as(expected, kind)) for kind in kinds)


def near(found: np.ndarray, expected: np.ndarray) -> bool:
    found, expected = found.astype(np.float64), expected.astype(np.float64)
    largest = float(np.abs(expected[np.isfinite(expected)]).max(initial=0.0))
    return np.allclose(found, expected, rtol=1e-3, atol=1e-4 * largest, equal_nan=True)


def _as(values: np.ndarray, kind: type) -> np.ndarray:
    return np.ascontiguousarray(values).reshape(-1).view(np.uint8).view(kind)


def _worst(found: np.ndarray, expected: np.ndarray) -> str:
    wrong = np.nonzero(np.ravel(found) != np.ravel(expected))[0]
    at = int(wrong[0])
    return (
        f"differs in {len(wrong)} of {found.size} ({found.dtype}): "
        f"{np.ravel(found)[at]!r} for {np.ravel(expected)[at]!r}"
    )


def test_one_kernel_of_each_folder_leaves_what_the_device_leaves(tmp_path: Path) -> None:
    wanted = [kernel for kernel, _ in ONE_A_FOLDER.values()]
    few = distinct([case for _, case in ONE_A_FOLDER.values()])
    folders = captured(tmp_path / "launches", tmp_path, wanted, few)
    assert {read_request(folder)[0].label for folder in folders} == set(wanted)
    assert [line for folder in folders for line in differences(folder)] == []


def test_a_kernel_of_each_folder_is_among_the_few() -> None:
    folders = {kernel.partition("/")[0] for kernel in all_kernels()}
    assert folders == set(ONE_A_FOLDER)
    assert all(kernel.startswith(f"{name}/") for name, (kernel, _) in ONE_A_FOLDER.items())


@pytest.mark.slow
def test_no_kernel_is_left_out(tmp_path: Path) -> None:
    every = [case for each in EVERY[: len(EVERY) // 2] for case in cases_of(*each)]
    folders = captured(tmp_path / "launches", tmp_path, ["all"], every)
    assert {read_request(folder)[0].label for folder in folders} == all_kernels() - set(UNTRACED)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size", "width"), EVERY)
def test_every_kernel_leaves_what_the_device_leaves(
    name: str, size: int, width: int, tmp_path: Path
) -> None:
    folders = captured(tmp_path / "launches", tmp_path, ["all"], cases_of(name, size, width))
    assert folders
    assert [line for folder in folders for line in differences(folder)] == []


def test_a_request_comes_back_from_its_folder(tmp_path: Path) -> None:
    from gibench.trace.request import TracedArgument, write_request

    args = [
        TracedArgument("a", np.arange(3, dtype=np.float32), 0, True),
        TracedArgument("n", np.int32(7)),
        TracedArgument("l", None, 64),
    ]
    request = TraceRequest("source", {"WIDTH": 8}, "k", args, 32, (4, 2), "k")
    write_request(tmp_path, request, Sampling(runs=2))
    found, sampling = read_request(tmp_path)
    assert (found.defines, found.groups, found.items) == ({"WIDTH": 8}, (4, 2), 32)
    np.testing.assert_array_equal(found.args[0].data, args[0].data)
    assert (found.args[1].data, found.args[2].nbytes, sampling.runs) == (7, 64, 2)
