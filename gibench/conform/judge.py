"""Cases in processes of their own, and what they say of each kernel."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gibench.conform.worker import MARK
from gibench.progress import progress
from gibench.techniques.parts.conformance.case import Case

RIGHT, WRONG, CANNOT_RUN, NO_ORACLE = "right", "wrong", "cannot run", "no oracle"


@dataclass(frozen=True)
class Judged:
    """What a case, or all cases of a kernel, have shown.

    Attributes:
        status: ``right``, ``wrong``, ``cannot run`` or ``no oracle``.
        sizes: work-group sizes that ran.
        off: the largest deviation as a share of what is allowed.
        why: where it is not right.
        failed: whether that is a fault: a device that is too small is none.
    """

    status: str
    sizes: tuple[int, ...] = ()
    off: float = 0.0
    why: str = ""
    failed: bool = False


def judge_cases(
    cases: Mapping[str, Case],
    device: int,
    seed: int,
    limit_s: float,
    kernel_root: Path | None = None,
    workers: int | None = None,
) -> dict[str, Judged]:
    """Run each case in a process of its own; none stops another.

    Args:
        cases: by name.
        device: number of the OpenCL device.
        seed: of every random input.
        limit_s: after which a process is ended.
        kernel_root: another kernel tree than the installed one.
        workers: processes at a time; by default as many as there are processors, at most four.
    """
    root = [] if kernel_root is None else [str(kernel_root)]
    at_once = workers or min(4, os.cpu_count() or 1)

    def judged(name: str) -> tuple[str, Judged]:
        command = [sys.executable, "-m", "gibench.conform.worker", str(device), str(seed), name]
        found = name, _judged([*command, *root], limit_s, cases[name].sizes)
        advance(1)
        return found

    with (
        progress("Kernels against their oracles", len(cases)) as advance,
        ThreadPoolExecutor(at_once) as pool,
    ):
        return dict(pool.map(judged, cases))


def _judged(command: Sequence[str], limit_s: float, sizes: Sequence[int]) -> Judged:
    try:
        ran = subprocess.run(command, capture_output=True, text=True, timeout=limit_s)
        out, end = ran.stdout, _end(ran)
    except subprocess.TimeoutExpired as error:
        raw = error.stdout or b""
        out = raw.decode(errors="replace") if isinstance(raw, bytes) else raw
        end = f"no answer within {limit_s:g} s"
    return _of_sizes(_said(out), end, sizes)


def _said(out: str) -> list[dict[str, Any]]:
    """The worker's lines; one that a driver wrote into says nothing."""
    found = []
    for line in out.splitlines():
        with contextlib.suppress(json.JSONDecodeError):
            if line.startswith(MARK):
                found.append(json.loads(line[len(MARK) :]))
    return found


def _end(ran: subprocess.CompletedProcess[str]) -> str:
    """How a process that did not end well has ended, or nothing."""
    if ran.returncode == 0:
        return ""
    if ran.returncode < 0:
        return f"the process was ended by {signal.Signals(-ran.returncode).name}"
    last = ran.stderr.strip().splitlines()[-1:] or ["no word"]
    return f"the process ended with {ran.returncode}: {last[0]}"


def _of_sizes(said: Sequence[Mapping[str, Any]], end: str, asked: Sequence[int]) -> Judged:
    """What a case's sizes come down to; a size that nothing was said of is not right."""
    ran = [one for one in said if "off" in one]
    sizes = tuple(int(one["size"]) for one in ran)
    worst = max((float(one["off"]) for one in ran), default=0.0)
    if worst > 1:
        wrong = ", ".join(str(one["size"]) for one in ran if one["off"] > 1)
        why = f"off by {worst:.3g} times what is allowed at work-group size {wrong}"
        return Judged(WRONG, sizes, worst, why, True)
    broken = next((str(one["broken"]) for one in said if "broken" in one), None)
    if broken is not None:
        return Judged(CANNOT_RUN, sizes, worst, " ".join(broken.split())[:300], True)
    if end:
        return Judged(WRONG, sizes, worst, end, True)
    answered = {int(one["size"]) for one in said}
    if silent := ", ".join(str(size) for size in asked if size not in answered):
        return Judged(WRONG, sizes, worst, f"no result at work-group size {silent}", True)
    cannot = next((str(one["cannot"]) for one in said if "cannot" in one), None)
    if cannot is not None and not ran:
        return Judged(CANNOT_RUN, sizes, worst, cannot)
    return Judged(RIGHT, sizes, worst)


_ORDER = {WRONG: 0, CANNOT_RUN: 1, RIGHT: 2}


def _badness(one: Judged) -> tuple[int, bool, float]:
    """The worst first: one that does not build hides behind none that the device is too small
    for.
    """
    return _ORDER[one.status], not one.failed, -one.off


def judge_kernels(
    kernels: Sequence[str], cases: Mapping[str, Case], found: Mapping[str, Judged]
) -> dict[str, Judged]:
    """Each kernel by the worst of its cases; ``no oracle`` where it has none."""
    result = {}
    for kernel in kernels:
        own = [name for name, case in cases.items() if kernel in case.kernels]
        if not own:
            result[kernel] = Judged(NO_ORACLE)
            continue
        worst = min(own, key=lambda name: _badness(found[name]))
        one = found[worst]
        why = f"{worst}: {one.why}" if one.why else ""
        sizes = tuple(sorted({size for name in own for size in found[name].sizes}))
        result[kernel] = Judged(one.status, sizes, one.off, why, one.failed)
    return result
