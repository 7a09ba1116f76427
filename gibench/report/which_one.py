"""Which technique fits: the table a run ends with, and the sentence that answers it.

Figures of a run's own frames and record, and errors where they were measured. Nothing here is of
the modelled device: the sentence says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from gibench.measure.runfolder.results import OK
from gibench.measure.statistics.summary import REAL_TIME_MS
from gibench.report.projected import WHOLE_GI, range_text
from gibench.techniques.registry import axis_title

GI_BUDGET_MS = 3.0
"""Of a frame at 30 frames per second, what a game gives to global illumination (Bennett 2019,
chapter 7)."""
ERROR_COLUMNS = (
    "configuration",
    "rel_l2",
    "rel_l2_noise",
    "bias",
    "bias_noise",
    "leak",
    "dark_area",
    "uncovered",
    "change",
    "unsettled",
)
"""Of ``errors.csv``: shares; ``leak`` of the truth's mean, where there is any ``dark_area`` (share
of the surface) to leak to; ``uncovered`` of the receivers that a technique says nothing of;
``change`` of the mean irradiance while the frames doubled last;
``unsettled`` says after how many frames it was not, and is empty where it was."""


A_HUNDRED = 100
"""Frames without which nothing is known of one in a hundred: the longest is told instead."""


@dataclass(frozen=True)
class Budgets:
    """What a frame may take, ms: in all, and for global illumination."""

    frame_ms: float = REAL_TIME_MS
    gi_ms: float = GI_BUDGET_MS


@dataclass(frozen=True)
class Answer:
    """Which technique fits on one scene and profile.

    Attributes:
        scene: its name.
        profile: its name.
        table: a row per configuration: name, gi_ms, frame_ms, frames, worst_ms (the time that 1 %
            of frames exceed; the longest of fewer than ``A_HUNDRED``), memory_mib, bake_seconds,
            rel_l2, bias, leak, dark_area, uncovered, projected (GI on devices that are not here, in
            words), error (in words, where there is no figure), status (why it does not compete;
            empty where it does).
        sentence: the answer.
        projected: what projected ranges alone say of the modelled devices; empty where there are
            none.
    """

    scene: str
    profile: str
    table: pd.DataFrame
    sentence: str
    projected: str = ""


def answers(
    frames: pd.DataFrame,
    record: Mapping[str, Any],
    errors: pd.DataFrame | None,
    budgets: Budgets,
    projected: pd.DataFrame | None = None,
) -> list[Answer]:
    """One for each scene and profile of a run.

    Args:
        frames: see :func:`gibench.report.tables.frames_table`.
        record: the content of ``run.json``.
        errors: of :data:`ERROR_COLUMNS`; None where none were measured.
        budgets: to be kept.
        projected: of ``projected.csv``; None where nothing was projected.
    """
    gi = None if projected is None else projected[projected["pass"] == WHOLE_GI]
    titles = {one["name"]: one.get("title", one["name"]) for one in record["profiles"]}
    found = []
    for (scene, profile), group in frames.groupby(["scene", "profile"], sort=False):
        rows = list(_rows(group, record, errors, gi))
        words = _sentence(rows, budgets, record["environment"]["cpu"], str(titles[profile]))
        told = "" if gi is None else _projected_sentence(rows, gi, budgets)
        found.append(Answer(str(scene), str(profile), pd.DataFrame(rows), words, told))
    return found


def _rows(
    group: pd.DataFrame,
    record: Mapping[str, Any],
    errors: pd.DataFrame | None,
    gi: pd.DataFrame | None,
) -> Iterator[dict[str, Any]]:
    entries = {entry["configuration"]: entry for entry in record["configurations"]}
    measured: dict[Any, Any] = {}
    if errors is not None:
        measured = errors.set_index("configuration").to_dict("index")
    for _, row in group.iterrows():
        number = row["configuration"]
        error = measured.get(number, {})
        unsettled = _unsettled(row, error)
        yield {
            "configuration": number,
            "name": _name(row, group, record),
            "gi_ms": row["gi_ms"],
            "frame_ms": row["median_ms"],
            "frames": row["frames"],
            "worst_ms": row["p99_ms"] if row["frames"] >= A_HUNDRED else row["longest_ms"],
            "memory_mib": row["memory_bytes"] / 2**20,
            "bake_seconds": entries[number].get("bake_seconds"),
            "rel_l2": float("nan") if unsettled else error.get("rel_l2", float("nan")),
            "bias": float("nan") if unsettled else error.get("bias", float("nan")),
            "leak": float("nan") if unsettled else error.get("leak", float("nan")),
            "dark_area": error.get("dark_area", float("nan")),
            "uncovered": error.get("uncovered", float("nan")),
            "projected": "" if gi is None or row["gi_ms"] == 0 else _projected_text(gi, number),
            "error": unsettled,
            "status": _status(row, unsettled),
        }


def _unsettled(row: pd.Series, error: Mapping[str, Any]) -> str:
    """That it did not settle, in words: when its error was measured, or else when it was timed.
    Empty where it did, and where things move so that it never could.
    """
    told = error.get("unsettled")
    if isinstance(told, str) and told:
        return told
    rest = row.get("rest")
    if error or not isinstance(rest, str) or not rest.startswith("not at rest"):
        return ""
    return rest.replace("not at rest", "not settled", 1)


def _status(row: pd.Series, unsettled: str) -> str:
    if row["status"] != OK or pd.isna(row["median_ms"]):
        return str(row["reason"] or row["status"])
    if not row["gi_ms"] > 0:
        return "no global illumination"
    return unsettled


def _name(row: pd.Series, group: pd.DataFrame, record: Mapping[str, Any]) -> str:
    """The technique, with what of it differs from others of the same technique."""
    mine = group[group["technique"] == row["technique"]]
    parts = [str(row["technique"])]
    if _varies(mine["variant"]):
        parts.append(str(row["variant"]))
    if _varies(mine["layout"]) and not pd.isna(row["layout"]):
        parts.append(str(row["layout"]))
    for axis in record.get("axes", ()):
        if _varies(mine[axis]):
            parts.append(f"{axis_title(axis)} {row[axis]}")
    for column, title in (("receivers", "receivers"), ("workgroup_size", "work-group")):
        if _varies(mine[column]):
            parts.append(f"{row[column]:,} {title}")
    return ", ".join(parts)


def _varies(column: pd.Series) -> bool:
    return len(set(column.astype(str))) > 1


def _sentence(rows: Sequence[Mapping[str, Any]], budgets: Budgets, cpu: str, profile: str) -> str:
    where = f"On this machine ({cpu}), at the limits of {profile}"
    within = (
        f"within {budgets.gi_ms:g} ms of global illumination and {budgets.frame_ms:g} ms a frame"
    )
    competing = [row for row in rows if not row["status"]]
    if not competing:
        return f"{where}, nothing can be said: nothing with global illumination ran and settled."
    fits = [row for row in competing if _over(row, budgets) <= 1]
    if not fits:
        nearest = min(competing, key=lambda row: _over(row, budgets))
        return (
            f"{where}, none fits {within}; nearest comes {_told(nearest)}, "
            f"{_over(nearest, budgets):.2f} times over."
        )
    cheapest = min(fits, key=lambda row: float(row["gi_ms"]))
    known = [row for row in fits if not pd.isna(row["rel_l2"])]
    if not known:
        return f"{where}, the cheapest {within} is {_told(cheapest)}; errors were not measured."
    truest = min(known, key=lambda row: float(row["rel_l2"]))
    if truest is cheapest:
        return f"{where}, the cheapest and the truest {within} is {_told(cheapest)}."
    return f"{where}, the cheapest {within} is {_told(cheapest)}, the truest {_told(truest)}."


def _over(row: Mapping[str, Any], budgets: Budgets) -> float:
    """The larger share of a budget that it takes."""
    return max(float(row["gi_ms"]) / budgets.gi_ms, float(row["frame_ms"]) / budgets.frame_ms)


def _told(row: Mapping[str, Any]) -> str:
    off = "" if pd.isna(row["rel_l2"]) else f", {100 * row['rel_l2']:.0f} % off the truth"
    return f"{row['name']} ({row['gi_ms']:.1f} ms of {row['frame_ms']:.1f}{off})"


def _projected_text(gi: pd.DataFrame, number: Any) -> str:
    """The projected ranges of a configuration's GI, in words."""
    mine = gi[gi["configuration"] == number]
    many = len(set(gi["device"])) > 1
    return "; ".join(
        f"{row['device']}: {range_text(row)}" if many else range_text(row)
        for _, row in mine.iterrows()
    )


def _projected_sentence(
    rows: Sequence[Mapping[str, Any]], gi: pd.DataFrame, budgets: Budgets
) -> str:
    """What projected ranges say of the budget for GI on each device; empty where there are none."""
    names = {row["configuration"]: str(row["name"]) for row in rows if row["gi_ms"] != 0}
    told = []
    for device, group in gi[gi["configuration"].isin(names)].groupby("device", sort=False):
        verdicts: dict[str, list[str]] = {}
        for _, row in group.iterrows():
            verdict = _fits_projected(row, budgets.gi_ms)
            verdicts.setdefault(verdict, []).append(names[row["configuration"]])
        words = [f"{one}: {', '.join(verdicts[one])}" for one in _VERDICTS if one in verdicts]
        told.append(
            f"Projected, not measured: within {budgets.gi_ms:g} ms of global illumination on "
            f"{device}, {'; '.join(words)}."
        )
    return " ".join(told)


_VERDICTS = _FITS, _MISSES, _UNKNOWN = ("fits", "does not fit", "cannot tell")


def _fits_projected(row: pd.Series, budget: float) -> str:
    low, high = row["projected_low_ms"], row["projected_high_ms"]
    if pd.isna(low) or row["verdict"] == _UNKNOWN or low <= budget < high:
        return _UNKNOWN
    return _FITS if high <= budget else _MISSES


PROJECTED_GI = "PROJECTED GI"
"""Heading of what was never measured."""


def headings(table: pd.DataFrame) -> Sequence[str]:
    """Of the rows of an answer's ``table`` that :func:`cells` gives."""
    few = table["frames"][table["frames"] < A_HUNDRED]
    worst = "worst 1 % of frames ms"
    if len(few) == len(table):
        worst = f"longest of {', '.join(map(str, sorted(set(few))))} frames ms"
    elif len(few):
        worst += f" (longest of fewer than {A_HUNDRED})"
    return (
        *("technique", "GI ms", worst, "frame ms", "MiB", "bake s", "error"),
        *("bias", "leak", "not covered", PROJECTED_GI, "remark"),
    )


def shown(found: Answer) -> tuple[list[str], list[list[str]]]:
    """Headings and rows to read; without projected ranges where there are none."""
    titles = list(headings(found.table))
    rows = [cells(row) for _, row in found.table.iterrows()]
    at = titles.index(PROJECTED_GI)
    if not any(row[at] for row in rows):
        for line in (titles, *rows):
            del line[at]
    return titles, rows


def cells(row: pd.Series) -> list[str]:
    """A row of the table, to read."""
    return [
        row["name"],
        _figure(row["gi_ms"], "{:,.2f}"),
        _figure(row["worst_ms"], "{:,.2f}"),
        _figure(row["frame_ms"], "{:,.2f}"),
        _figure(row["memory_mib"], "{:,.1f}"),
        _figure(row["bake_seconds"], "{:,.0f}"),
        row["error"] or _figure(row["rel_l2"], "{:.1%}"),
        _figure(row["bias"], "{:+.1%}"),
        "-" if row["dark_area"] == 0 else _figure(row["leak"], "{:.1%}"),
        _figure(row["uncovered"], "{:.0%}") if row["uncovered"] > 0 else "",
        row["projected"],
        "" if row["status"] == row["error"] else row["status"],
    ]


NUMBERS = (
    *("gi_ms", "worst_ms", "frame_ms", "memory_mib", "bake_seconds"),
    *("rel_l2", "bias", "leak", "uncovered"),
)
"""Columns of an answer's table behind the cells from the second on; what follows is words."""


def _figure(value: Any, form: str) -> str:
    return "" if value is None or pd.isna(value) else form.format(value).replace("%", " %")
