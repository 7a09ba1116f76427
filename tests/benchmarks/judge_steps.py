"""How soon 'gibench history check' finds a step, and how often it sees one where there is none.

    python tests/benchmarks/judge_steps.py [RECORDING] [--every N]

Recorded noise of a shared machine (ab_recording.csv, 200 pairs of processes of the same kernels)
is taken as 200 runs of a history: as ratios to the other side of their pair (what 'ab --json'
gives) and as plain times. Steps are planted at known runs; each method sees the series grow run by
run. A step counts as found when one is reported within 5 runs of its place. Beside it:
pytest-benchmark's rule (--benchmark-compare-fail=median:5%, each run against the one before), a
fixed threshold of 5 % against the median of the first ten runs, and Apache Otava where installed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd

from gibench.measure.statistics.steps import find_steps

Finder = Callable[[np.ndarray], list[int]]
PLACES, NEAR, FIRST = (60, 100, 140), 5, 12


def history_check(logs: np.ndarray) -> list[int]:
    return [step.at for step in find_steps(logs, 0.05)]


def run_before(logs: np.ndarray) -> list[int]:
    return [i for i in range(1, len(logs)) if logs[i] - logs[i - 1] > np.log(1.05)]


def fixed_threshold(logs: np.ndarray) -> list[int]:
    over = logs > np.median(logs[:10]) + np.log(1.05)
    return [i for i in range(10, len(logs)) if over[i] and not over[i - 1]]


def apache_otava(logs: np.ndarray) -> list[int]:
    from otava.analysis import compute_change_points

    found, _ = compute_change_points(list(np.exp(logs)), max_pvalue=0.001, min_magnitude=0.05)
    return [each.index for each in found]


def methods() -> dict[str, Finder]:
    found: dict[str, Finder] = {
        "history check": history_check,
        "pytest-benchmark's": run_before,
        "fixed threshold": fixed_threshold,
    }
    if find_spec("otava") is None:
        return found
    return found | {"Apache Otava": apache_otava}


def false_alarms(series: list[np.ndarray], find: Finder, every: int) -> float:
    """Per 1000 runs; a step that was seen before and is seen again is one."""
    alarms = 0
    for logs in series:
        seen: list[int] = []
        for length in range(FIRST, len(logs) + 1, every):
            for at in find(logs[:length]):
                if all(abs(at - other) > NEAR for other in seen):
                    seen.append(at)
        alarms += len(seen)
    return 1000 * alarms / sum(map(len, series))


def runs_until_found(
    series: list[np.ndarray], find: Finder, ratio: float, every: int
) -> tuple[int, int, float]:
    """How many of how many were found, and the median number of runs it took (inf: most never)."""
    took = []
    for logs in series:
        for place in PLACES:
            planted = logs.copy()
            planted[place:] += np.log(ratio)
            lengths = range(place + 1, len(logs) + 1, every)
            hits = (
                n - place
                for n in lengths
                if any(abs(at - place) <= NEAR for at in find(planted[:n]))
            )
            took.append(next(hits, np.inf))
    return sum(map(np.isfinite, took)), len(took), float(np.median(took))


def main() -> None:
    parser = argparse.ArgumentParser()
    recorded = Path(__file__).with_name("ab_recording.csv")
    parser.add_argument("recording", nargs="?", type=Path, default=recorded)
    parser.add_argument("--every", type=int, default=2, help="look after every N runs")
    asked = parser.parse_args()
    table = pd.read_csv(asked.recording)
    same = table[table["case"] == "same"]
    kinds: dict[str, list[np.ndarray]] = {"ratios (ab)": [], "times": []}
    for _, row in same.groupby("row"):
        kinds["ratios (ab)"].append(row["log_ratio"].to_numpy())
        kinds["times"].append(np.log(row["old_ms"].to_numpy()))
    print("| series | method | false alarms per 1000 runs | 5 % | 10 % | 25 % |")
    print("|---|---|---:|---:|---:|---:|")
    for kind, series in kinds.items():
        for name, find in methods().items():
            cells = [f"{false_alarms(series, find, asked.every):.1f}"]
            for ratio in (1.05, 1.10, 1.25):
                found, of, took = runs_until_found(series, find, ratio, asked.every)
                after = f", after {took:.0f}" if np.isfinite(took) else ""
                cells.append(f"{found} of {of}{after}")
            print(f"| {kind} | {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
