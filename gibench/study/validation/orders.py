"""A run's measured passes beside their projection onto the device that ran them: orders only."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from gibench.project.ranges import UNKNOWN
from gibench.report.projected import WHOLE_FRAME, WHOLE_GI

ROWS = (
    *("runtime", "device", "technique", "variant", "layout", "scene", "pass", "median_ms"),
    *("projected_low_ms", "projected_high_ms", "bound_by", "verdict", "inside", "over_middle"),
)
_ORDER = 10.0
_APART = 1.1
"""Pairs whose measured times differ by less are not asked for: which is faster is noise."""


def held_against(passes: pd.DataFrame, projected: pd.DataFrame, runtime: str) -> pd.DataFrame:
    """Measured passes with their projected ranges, a row each with columns ``ROWS``; whole GI too.

    Args:
        passes: of a run (``passes.csv``).
        projected: of the same run (``projected.csv``).
        runtime: what ran it.
    """
    key = ["configuration", "pass"]
    measured = passes[passes["median_ms"].notna()]
    # On the technique's own passes: what a flight or moving objects add has its own rows.
    gi = measured[measured["stage"] == "gi"].groupby("configuration")["median_ms"].sum()
    whole = pd.DataFrame({"configuration": gi.index, "pass": WHOLE_GI, "median_ms": gi.to_numpy()})
    times = pd.concat([measured[[*key, "median_ms"]], whole])
    table = projected[projected["pass"] != WHOLE_FRAME].merge(times, on=key)
    table = table[table["projected_low_ms"].notna()].assign(runtime=runtime)
    low, high, ms = (table[c] for c in ("projected_low_ms", "projected_high_ms", "median_ms"))
    table["inside"] = (low <= ms) & (ms <= high)
    table["over_middle"] = ms / np.sqrt(low * high)
    if "layout" not in table:
        table["layout"] = ""
    table["layout"] = table["layout"].fillna("")
    return table[list(ROWS)]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each runtime and projected device: how many passes, over how many orders of
    magnitude, how many lie inside and within 10 times of the middle of their range, rank
    correlation, and of pairs of measured times over 1.1 apart how many come out right: variants of
    a pass, and techniques of a scene by their GI.
    """
    return pd.DataFrame(
        [
            {"runtime": runtime, "device": device, **_figures(each)}
            for (runtime, device), each in rows.groupby(["runtime", "device"], sort=False)
        ]
    )


def _figures(rows: pd.DataFrame) -> dict[str, Any]:
    from scipy.stats import spearmanr  # slow to load

    alone, whole = rows[rows["pass"] != WHOLE_GI], rows[rows["pass"] == WHOLE_GI]
    ms, off = alone["median_ms"], np.abs(np.log10(alone["over_middle"]))
    middle = np.sqrt(alone["projected_low_ms"] * alone["projected_high_ms"])
    variants = _pairs(alone, ["technique", "scene", "pass"])
    techniques = _pairs(whole, ["variant", "layout", "scene"])
    return {
        "passes": len(alone),
        "orders": float(np.log10(ms.max() / ms.min())),
        "told": float((alone["verdict"] != UNKNOWN).mean()),
        "inside": float(alone["inside"].mean()),
        "within_10": float((off <= np.log10(_ORDER)).mean()),
        "rank": float(spearmanr(middle, ms).statistic),
        "variant_pairs": variants[0],
        "variants_right": variants[1],
        "technique_pairs": techniques[0],
        "techniques_right": techniques[1],
    }


def _pairs(rows: pd.DataFrame, alike: list[str]) -> tuple[int, float]:
    """Pairs among rows that are alike and measured apart, and the share that comes out right."""
    right = []
    for _, group in rows.groupby(alike, sort=False):
        low, high = (group[c].to_numpy() for c in ("projected_low_ms", "projected_high_ms"))
        middle = np.sqrt(low * high)
        ms = group["median_ms"].to_numpy()
        for one, other in combinations(range(len(group)), 2):
            if max(ms[one] / ms[other], ms[other] / ms[one]) > _APART:
                right.append((ms[one] > ms[other]) == (middle[one] > middle[other]))
    return len(right), float(np.mean(right)) if right else float("nan")
