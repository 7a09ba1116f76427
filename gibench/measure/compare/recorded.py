"""Comparing recorded runs: ratios with confidence from processes and samples. No output here.

The interval comes from a hierarchical bootstrap (Kalibera and Jones, "Rigorous benchmarking in
reasonable time", ISMM 2013: resample the levels of the experiment from the outermost in): processes
are drawn with replacement, then within each of them its samples, in blocks because neighbouring
frames are alike (moving blocks: Künsch, Annals of Statistics 1989). Percentile intervals of few
processes are too narrow, so deviations are widened by sqrt(n / (n - 1)) and by Student's t over the
normal quantile (Hesterberg, "What teachers should know about the bootstrap", The American
Statistician 2015, section 4).

Samples of one process say nothing of the next process. Where a side has fewer than
``FEW_PROCESSES``, the spread of processes is not measured but assumed: ``PROCESS_SPREAD``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.measure.compare.paired import CONFIDENCE, Judged, verdict_of

FEW_PROCESSES = 3
PROCESS_SPREAD = 0.08
"""Standard deviation of the log of a process's median time, assumed where it is not measured.

From one kernel in 24 processes on a shared two-core machine: 15 of 69 couples of medians differed
by more than 5 % one way (22 %), so the log ratio's standard deviation is 0.05 / 0.78 = 0.064 and
a process's 0.045; nearly doubled, for machines that are worse and tails that are not normal."""
DRAWS = 2000
BLOCK = 8

RowKey = tuple[str, str]
"""A configuration in words and the name of a pass (or of the frame)."""


@dataclass
class Timings:
    """What one side of a comparison has.

    Attributes:
        name: of the side, for messages.
        identity: what must be equal on both sides, by what it is called.
        rows: by row the times of every process, ms, in the order they were taken.
        failed: rows that did not run, with the reason.
        versions: of the software, by its name; what one side's processes disagree on is joined.
    """

    name: str
    identity: dict[str, Any] = field(default_factory=dict)
    rows: dict[RowKey, list[npt.NDArray[np.float64]]] = field(default_factory=dict)
    failed: dict[RowKey, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)

    def add_versions(self, versions: Mapping[str, str]) -> None:
        """Those of one more process."""
        for name, version in versions.items():
            known = self.versions.get(name)
            if known is None:
                self.versions[name] = version
            elif version not in known.split(" and "):
                self.versions[name] = f"{known} and {version}"


@dataclass(frozen=True)
class ComparedRow:
    """One row compared.

    Attributes:
        key: the row.
        old_ms: the baseline's median over processes of their medians.
        new_ms: the other's.
        processes: of the baseline and of the other.
        assumed: whether the spread of processes had to be assumed.
    """

    key: RowKey
    old_ms: float
    new_ms: float
    judged: Judged
    processes: tuple[int, int]
    assumed: bool


def differences(base: Timings, new: Timings) -> list[str]:
    """What keeps the two from being compared, each in words; empty where nothing does."""
    found = []
    for name in dict.fromkeys([*base.identity, *new.identity]):
        a, b = base.identity.get(name), new.identity.get(name)
        if a != b:
            if isinstance(a, Mapping) and isinstance(b, Mapping):
                a, b = _only_in(a, b), _only_in(b, a)
            found.append(f"{name} ({_short(a)} against {_short(b)})")
    return found


def other_versions(base: Timings, new: Timings) -> dict[str, tuple[str, str]]:
    """Software that is not the same on both sides: its version in the baseline and in the other."""
    names = dict.fromkeys([*base.versions, *new.versions])
    pairs = {
        name: (base.versions.get(name, "none"), new.versions.get(name, "none")) for name in names
    }
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _only_in(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, Any]:
    """What of ``a`` is not the same in ``b``."""
    return {name: value for name, value in a.items() if name not in b or b[name] != value}


def compare_recorded(
    base: Timings, new: Timings, threshold: float, seed: int = 0
) -> list[ComparedRow]:
    """Every row that both sides have times of, in the baseline's order."""
    rng = np.random.default_rng(seed)
    return [
        compare_row(key, base.rows[key], new.rows[key], threshold, rng)
        for key in base.rows
        if key in new.rows
    ]


def compare_row(
    key: RowKey,
    base: Sequence[npt.NDArray[np.float64]],
    new: Sequence[npt.NDArray[np.float64]],
    threshold: float,
    rng: np.random.Generator,
) -> ComparedRow:
    """One row: times of every process of both sides, ms."""
    from scipy.stats import norm, t  # slow to load

    old_ms, new_ms = _level(base), _level(new)
    ratio = math.log(new_ms / old_ms) if old_ms > 0 and new_ms > 0 else math.nan
    counts = len(base), len(new)
    assumed = min(counts) < FEW_PROCESSES
    if math.isnan(ratio):
        judged = Judged(ratio, 0.0, math.inf, "ambiguous", min(counts))
        return ComparedRow(key, old_ms, new_ms, judged, counts, assumed)
    drawn = np.log(_draws(new, rng)) - np.log(_draws(base, rng))
    off = drawn - ratio
    if assumed:
        spread = PROCESS_SPREAD * math.sqrt(1 / counts[0] + 1 / counts[1])
        off = off + rng.normal(0.0, spread, len(off))
    else:
        freedom = sum(counts) - 2
        tail = (1 - CONFIDENCE) / 2
        few = min(counts)
        off = off * math.sqrt(few / (few - 1)) * float(t.isf(tail, freedom) / norm.isf(tail))
    low, high = ratio + np.quantile(off, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    judged = Judged(
        math.exp(ratio),
        math.exp(low),
        math.exp(high),
        verdict_of(float(low), float(high), threshold),
        min(counts),
    )
    return ComparedRow(key, old_ms, new_ms, judged, counts, assumed)


def _level(processes: Sequence[npt.NDArray[np.float64]]) -> float:
    return float(np.median([np.median(times) for times in processes]))


def _draws(
    processes: Sequence[npt.NDArray[np.float64]], rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """The level of ``DRAWS`` resampled experiments."""
    medians = np.stack([_resampled_medians(times, rng) for times in processes])
    chosen = rng.integers(0, len(processes), (len(processes), DRAWS))
    # A process drawn twice brings other samples each time.
    turn = rng.integers(0, DRAWS, (len(processes), DRAWS))
    out: npt.NDArray[np.float64] = np.median(medians[chosen, turn], axis=0)
    return out


def _resampled_medians(
    times: npt.NDArray[np.float64], rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """The median of ``DRAWS`` resamples of one process's samples, drawn in blocks."""
    n = len(times)
    block = min(BLOCK, max(1, n // 4))
    starts = rng.integers(0, n - block + 1, (DRAWS, -(-n // block)))
    index = (starts[:, :, None] + np.arange(block)).reshape(DRAWS, -1)[:, :n]
    out: npt.NDArray[np.float64] = np.median(times[index], axis=1)
    return out


def _short(value: Any) -> str:
    if isinstance(value, Mapping):
        value = ", ".join(f"{name}={item}" for name, item in value.items()) or None
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
