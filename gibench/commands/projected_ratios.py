"""Ratios of a run's projected times to the cheapest configuration's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gibench.errors import GibenchError
from gibench.project.ranges import SHOWN_WIDTH, UNKNOWN, Total, ratio
from gibench.report.projected import RATIO_COLUMNS

Row = dict[str, Any]
_TOGETHER = ("scene", "profile", "device")


@dataclass(frozen=True)
class Whole:
    """A configuration on a device.

    Attributes:
        head: its columns: configuration, technique, variant, layout, scene, profile, device.
        totals: of its GI where it has any, and of its frame, by name of the pass; of a kernel that
            is no technique's, of its launch.
    """

    head: Mapping[str, Any]
    totals: Mapping[str, Total | GibenchError]


def ratio_table(wholes: Sequence[Whole]) -> pd.DataFrame:
    """The rows of ``ratios.csv``: of every scene, profile and device the configurations against
    the one with the lowest nominal time.
    """
    groups: dict[tuple[Any, ...], list[Whole]] = {}
    for each in wholes:
        groups.setdefault(tuple(each.head[name] for name in _TOGETHER), []).append(each)
    rows = [
        row
        for group in groups.values()
        for name in sorted({name for each in group for name in each.totals})
        for row in _rows([each for each in group if name in each.totals], name)
    ]
    return pd.DataFrame(rows, columns=list(RATIO_COLUMNS))


def _rows(group: Sequence[Whole], name: str) -> Iterable[Row]:
    known = [
        (each, total) for each in group if isinstance(total := each.totals[name], Total)
    ]  # fmt: skip
    if len(group) < 2 or not known:
        return
    cheapest, least = min(known, key=lambda pair: float(pair[1].times[0]))
    for each in group:
        if each is not cheapest:
            row = {**each.head, "pass": name}
            row["cheapest"] = cheapest.head["configuration"]
            row["cheapest_technique"] = cheapest.head["technique"]
            row["cheapest_variant"] = cheapest.head["variant"]
            yield row | ratio_columns(each.totals[name], least)


def ratio_columns(total: Total | GibenchError, least: Total) -> Row:
    """The columns of how many times longer it takes: a range, no point in it where it is wide."""
    if isinstance(total, GibenchError):
        return {"verdict": UNKNOWN, "ratio_reason": str(total)}
    found = ratio(total, least)
    width = found.high / found.low
    row: Row = {
        "ratio_low": found.low,
        "ratio_nominal": found.nominal if width <= SHOWN_WIDTH else None,
        "ratio_high": found.high,
        "verdict": found.verdict,
        "ratio_reason": total.unseen or least.unseen,
    }
    if row["ratio_reason"]:
        row["verdict"] = UNKNOWN
    elif np.median(total.times / least.times) < 1:
        row |= {"verdict": UNKNOWN, "ratio_reason": "at most points it is the cheaper one"}
    return row
