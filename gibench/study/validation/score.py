"""Frozen predictions against what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.project.model import LATENCY
from gibench.project.ranges import PAIR_PERCENTILES, UNKNOWN
from gibench.study.validation import convolution, opendwarfs, published
from gibench.study.validation.frozen import (
    CONVOLUTION,
    DWARFS,
    PUBLISHED,
    Predictions,
    convolution_name,
)

_APART = 1.5
"""Pairs whose measured times differ by more should be called sure."""
_NEAR = 1.02
"""Pairs that differ by less are not scored: which is faster is noise."""


def measured() -> dict[tuple[str, str, str], float]:
    """Measured times, ms, by set, profile and name; what failed there is left out."""
    found: dict[tuple[str, str, str], float] = {}
    for row in published.rows():
        found[PUBLISHED, row.profile, row.name] = row.ms
    table = convolution.measured()
    names = [convolution_name(row) for _, row in table.iterrows()]
    for profile, column in convolution.MEASURED.items():
        found |= {(CONVOLUTION, profile, n): t for n, t in zip(names, table[column], strict=True)}
    dwarfs = opendwarfs.measured()
    names = [" ".join(str(row[key]) for key in opendwarfs.KEYS) for _, row in dwarfs.iterrows()]
    for profile, column in opendwarfs.MEASURED.items():
        times = dwarfs[column] * 1e-3
        found |= {(DWARFS, profile, n): t for n, t in zip(names, times, strict=True)}
    return {key: float(ms) for key, ms in found.items() if ms > 0}


def scored(predictions: Predictions, times: Mapping[tuple[str, str, str], float]) -> pd.DataFrame:
    """The predictions with ``measured_ms``, ``inside`` and ``nominal_over_measured``; rows without
    a measured time are left out. The index is that of the predictions.
    """
    table = predictions.table.copy()
    keys = zip(table["set"], table["profile"], table["name"], strict=True)
    table["measured_ms"] = [times.get(key, np.nan) for key in keys]
    table = table[table["measured_ms"].notna()].copy()
    ms = table["measured_ms"]
    table["inside"] = (table["low_ms"] <= ms) & (ms <= table["high_ms"])
    table["width"] = table["high_ms"] / table["low_ms"]
    table["nominal_over_measured"] = table["nominal_ms"] / ms
    return table


def summary(rows: pd.DataFrame, times: Doubles) -> pd.DataFrame:
    """A row for each set and device, one for each set of several, one for all.

    Args:
        rows: of :func:`scored`.
        times: of the predictions, at every point (n, p).
    """
    found = []
    for name, group in rows.groupby("set", sort=False):
        devices = list(group.groupby("profile", sort=False))
        for profile, mine in devices:
            found.append({"set": name, "device": profile, **_figures(mine, times)})
        if len(devices) > 1:
            found.append({"set": name, "device": "all", **_figures(group, times)})
    found.append({"set": "all", "device": "all", **_figures(rows, times)})
    return pd.DataFrame(found)


def _figures(rows: pd.DataFrame, times: Doubles) -> dict[str, Any]:
    told = rows[rows["verdict"] != UNKNOWN]
    error = (rows["nominal_over_measured"] - 1).abs()
    through = error[(rows["bound_by"] != LATENCY) & (rows["verdict"] != UNKNOWN)]
    pairs = [_pairs(mine, times) for _, mine in rows.groupby(["set", "profile"], sort=False)]
    counted = np.sum(pairs, axis=0)
    sure, right, apart, apart_sure = (int(number) for number in counted)
    return {
        "rows": len(rows),
        "told": len(told) / len(rows),
        "inside_told": _mean(told["inside"]),
        "inside_all": float((rows["inside"] & (rows["verdict"] != UNKNOWN)).mean()),
        "median_width": float(told["width"].median()),
        "error": float(error.mean()),
        "error_throughput": _mean(through),
        "rank": _rank(rows),
        "sure_pairs": sure,
        "sure_right": right / sure if sure else float("nan"),
        "apart_pairs": apart,
        "apart_sure": apart_sure / apart if apart else float("nan"),
    }


def _mean(values: pd.Series) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _rank(rows: pd.DataFrame) -> float:
    """Rank correlation within devices, averaged over them; NaN of too few rows."""
    from scipy.stats import spearmanr  # slow to load

    found = [
        float(spearmanr(mine["nominal_ms"], mine["measured_ms"]).statistic)
        for _, mine in rows.dropna(subset="nominal_ms").groupby(["set", "profile"], sort=False)
        if len(mine) > 3
    ]
    return float(np.mean(found)) if found else float("nan")


def _pairs(rows: pd.DataFrame, times: Doubles) -> tuple[int, int, int, int]:
    """Of a device's pairs: called sure, right among those, far apart, called sure among those."""
    logs = np.log(times[rows.index])
    ms = np.log(rows["measured_ms"].to_numpy(np.float64))
    sure = right = apart = apart_sure = 0
    for first in range(len(rows) - 1):
        ratio = logs[first] - logs[first + 1 :]
        low, high = np.percentile(ratio, PAIR_PERCENTILES, axis=1)
        truth = ms[first] - ms[first + 1 :]
        known = np.isfinite(low)
        called = known & ((low > 0) | (high < 0)) & (np.abs(truth) > np.log(_NEAR))
        sure += int(called.sum())
        right += int((called & ((low > 0) == (truth > 0))).sum())
        far = np.abs(truth) > np.log(_APART)
        apart += int(far.sum())
        apart_sure += int((far & called).sum())
    return sure, right, apart, apart_sure


def best_of_convolution(rows: pd.DataFrame) -> pd.DataFrame:
    """What the configuration that the model picks costs on every device, over the best of the
    sample and of all configurations.
    """
    table = convolution.measured()
    found = []
    mine = rows[rows["set"] == CONVOLUTION]
    for profile, each in mine.groupby("profile", sort=False):
        picked = each.sort_values("nominal_ms").iloc[0]
        every = table[convolution.MEASURED[str(profile)]].min()
        found.append(
            {
                "device": profile,
                "picked": picked["name"],
                "picked_ms": picked["measured_ms"],
                "over_best_of_sample": picked["measured_ms"] / each["measured_ms"].min(),
                "over_best_of_all": picked["measured_ms"] / every,
            }
        )
    return pd.DataFrame(found)
