"""What a choice may cost, in any combination, and how near what was measured comes to it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.errors import BadInput
from gibench.measure.statistics.summary import REAL_TIME_MS


@dataclass(frozen=True)
class Metric:
    """What can be limited.

    Attributes:
        name: on the command line.
        column: of ``quality.csv``.
        title: in tables.
        unit: behind a figure in a sentence.
        scale: one of the metric's own unit in that of the column.
        form: of a figure, in the metric's own unit.
    """

    name: str
    column: str
    title: str
    unit: str
    scale: float = 1.0
    form: str = ".1f"

    def of(self, table: pd.DataFrame) -> Doubles:
        """The figures of ``table`` (n,), in the metric's own unit; nan where there is none."""
        if self.column not in table:
            return np.full(len(table), np.nan)
        values = pd.to_numeric(table[self.column]).to_numpy(np.float64)
        return np.asarray(np.abs(values) / self.scale)

    def told(self, value: float) -> str:
        """A figure with its unit."""
        return f"{value:{self.form}} {self.unit}".replace("% ", " % ").strip()

    def told_up(self, value: float) -> str:
        """A figure with its unit, rounded up: as a limit it lets ``value`` in."""
        steps = 10.0 ** (int(self.form[1]) + 2 * self.form.endswith("%"))
        return self.told(math.ceil(value * steps * (1 - 1e-12)) / steps)


METRICS = {
    one.name: one
    for one in (
        Metric("frame_ms", "time_ms", "frame ms", "ms a frame"),
        Metric("gi_ms", "gi_ms", "GI ms", "ms of global illumination", form=".2f"),
        Metric("memory_mib", "memory_bytes", "MiB", "MiB", 2**20),
        Metric("bake_s", "bake_seconds", "bake s", "s of baking", form=".0f"),
        Metric("error", "rel_l2", "rel. L2", "off the truth", form=".1%"),
        Metric("bias", "bias", "bias", "bias", form=".1%"),
        Metric("leak", "leak", "leak", "of the light leaked", form=".1%"),
        Metric("blotches", "blotches", "blotches", "of blotches", form=".1%"),
        Metric("missing", "missing", "missing", "of the receivers missing", form=".1%"),
    )
}
FRAME, LEAK, ERROR, MEMORY = "frame_ms", "leak", "error", "memory_mib"


@dataclass(frozen=True)
class Limit:
    """A most of a metric, in its own unit: shares for errors and faults."""

    metric: Metric
    most: float

    def told(self) -> str:
        """In words, with as many digits as were given."""
        if self.metric.form.endswith("%"):
            return f"{100 * self.most:g} % {self.metric.unit}"
        return f"{self.most:g} {self.metric.unit}"


def read_limits(
    frame_ms: float | None, gi_ms: float | None, given: Sequence[str]
) -> tuple[Limit, ...]:
    """The limits asked for; a frame of 33.3 ms where there is none.

    Args:
        frame_ms: of a frame, or None.
        gi_ms: of global illumination, or None.
        given: others, ``NAME=VALUE``; the last of a name wins.

    Raises:
        BadInput: a metric that is not known, or a limit of 0 or less.
    """
    found: dict[str, Limit] = {}
    for option, name, value in (
        ("--budget-ms", FRAME, frame_ms),
        ("--gi-budget-ms", "gi_ms", gi_ms),
    ):
        if value is not None:
            if not (math.isfinite(value) and value > 0):
                raise BadInput(f"{option} {value:g} is no time", mend="give more than 0 ms")
            found[name] = Limit(METRICS[name], value)
    for text in given:
        limit = _read(text)
        found[limit.metric.name] = limit
    return tuple(found.values()) or (Limit(METRICS[FRAME], REAL_TIME_MS),)


def _read(text: str) -> Limit:
    name, sign, value = text.partition("=")
    known = ", ".join(METRICS)
    if not sign:
        raise BadInput(
            f"'{text}' is no budget",
            where="--budget",
            mend=f"write NAME=VALUE; NAME is one of {known}",
        )
    if name.strip() not in METRICS:
        raise BadInput(
            f"no metric called '{name.strip()}'",
            where=f"--budget {text}",
            mend=f"it is one of {known}",
        )
    try:
        most = float(value)
    except ValueError:
        raise BadInput(f"'{value}' is not a number", where=f"--budget {text}") from None
    if not (math.isfinite(most) and most > 0):
        raise BadInput(
            f"{most:g} is no budget",
            where=f"--budget {text}",
            mend="give more than 0",
        )
    return Limit(METRICS[name.strip()], most)


def in_limits(limits: Sequence[Limit]) -> str:
    """The limits in words."""
    words = [limit.told() for limit in limits]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def over(table: pd.DataFrame, limits: Sequence[Limit]) -> Doubles:
    """The largest share (n,) of a limit that each row takes; 1 and less meets them all, inf where a
    figure is not known.
    """
    shares = [limit.metric.of(table) / limit.most for limit in limits]
    return np.asarray(np.nan_to_num(np.max(shares, axis=0), nan=np.inf), np.float64)


def front_of(limits: Sequence[Limit]) -> list[Metric]:
    """What the front is of: what is limited, and a time, the memory and the error in any case."""
    asked = [limit.metric for limit in limits]
    if not any(one.name in (FRAME, "gi_ms") for one in asked):
        asked.insert(0, METRICS[FRAME])
    return list(dict.fromkeys((*asked, METRICS[MEMORY], METRICS[ERROR])))


def lifted(table: pd.DataFrame, limits: Sequence[Limit]) -> pd.DataFrame:
    """What would fit, or come nearer to the truth than what fits, if one limit were lifted.

    Args:
        table: of what ran; ``fits`` says what meets all limits.
        limits: all of them.

    Returns:
        A row per limit that alone stands in the way of anything: limit, most, needed (the least
        that the limit would have to be), by (share to be added), and of the truest that then fits
        technique, settings, receivers, rel_l2.
    """
    best = float(table.loc[table["fits"], "rel_l2"].min()) if table["fits"].any() else np.inf
    found = []
    for limit in limits:
        others = [one for one in limits if one is not limit]
        meets = over(table, others) <= 1 if others else np.ones(len(table), np.bool_)
        need = limit.metric.of(table)
        better = table["rel_l2"].to_numpy(np.float64) < best
        chosen = np.flatnonzero(meets & (need > limit.most) & better & np.isfinite(need))
        if not len(chosen):
            continue
        at = table.index[chosen[np.argmin(need[chosen])]]
        row, needed = table.loc[at], float(need[chosen].min())
        found.append(
            {
                "limit": limit.metric.name,
                "most": limit.most,
                "needed": needed,
                "by": needed / limit.most - 1,
                **{name: row[name] for name in ("technique", "settings", "receivers", "rel_l2")},
            }
        )
    names = ("limit", "most", "needed", "by", "technique", "settings", "receivers", "rel_l2")
    return pd.DataFrame(found, columns=list(names))


def lifted_in_words(row: Mapping[str, Any] | pd.Series) -> str:
    """A row of :func:`lifted` as a sentence."""
    metric = METRICS[str(row["limit"])]
    most, needed = (Limit(metric, row["most"]).told(), metric.told_up(float(row["needed"])))
    by = max(1, round(100 * row["by"]))
    return (
        f"with {needed} instead of {most} (+{by} %) {row['technique']} "
        f"({row['settings']}) at {int(row['receivers']):,} receivers would fit, "
        f"{100 * row['rel_l2']:.1f} % off the truth"
    )
