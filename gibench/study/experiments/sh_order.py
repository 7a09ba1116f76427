"""Error against SH order on the Blue-Orange Box (Bennett 2019, figure 6.7)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from gibench.report.plots import Axes, Series, plot
from gibench.study.errors import METRICS, Truth, errors
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept, as_kept
from gibench.study.experiments.side_by_side import (
    COLUMNS,
    FORMATS,
    SHOWN,
    compared,
    result_panel,
    trace_truth,
    truth_of,
)
from gibench.techniques.job import Job
from gibench.work import Worker

_IMAGE = (640, 360)
_ORDERS = tuple(range(8))
_HIGHEST = 7


def _label(order: int) -> str:
    return f"order {order}"


def _job(context: Context, order: int) -> Job:
    scene = context.scene_or("blue-orange-box")[0]
    receivers = 1500 if context.quick else None
    return context.srp(scene, context.profiles[0], sh_order=order, receivers=receivers)


def _points(context: Context) -> Iterator[Point]:
    orders = (0, 2, _HIGHEST) if context.quick else _ORDERS
    for order in sorted(orders, reverse=True):  # the others are held against the highest
        needs = () if order == _HIGHEST else (_label(_HIGHEST),)
        yield Point({"sh_order": order}, _job(context, order), needs)


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    order, job = unit.point.key["sh_order"], unit.point.job
    found = compared(context, job, worker, _IMAGE, _label(order))
    rows: list[dict[str, Any]] = [{**row, "against": "reference"} for row in found.rows]
    highest, mine = unit.needed.get(_label(_HIGHEST)), as_kept(found.arrays[_label(order)])
    if highest is None:
        return replace(found, rows=rows)
    group = truth_of(context, job, _IMAGE)
    truth = Truth.of(
        highest, np.zeros_like(highest), group.lightmap.receivers.area, group.truth.view
    )
    for region, measured in errors(truth, mine, group.regions).items():
        values = {name: measured[name].value for name in METRICS}
        noises = {f"{name}_noise": measured[name].noise for name in METRICS}
        rows.append({"region": region, "against": _label(_HIGHEST), **values, **noises})
    return replace(found, rows=rows)


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"].sort_values(["against", "region", "sh_order"])
    axes = []
    for against, title in (
        (_label(_HIGHEST), "against order 7 (as Bennett 2019)"),
        ("reference", "against the path-traced reference"),
    ):
        mine = ok[ok["against"] == against]
        series = [
            Series(str(region), group["sh_order"].tolist(), group["lab_l_mse"].tolist())
            for region, group in mine.groupby("region", sort=False)
        ]
        if series:
            axes.append(
                Axes(title, "order of spherical harmonics", "MSE of L*", series, log_y=True)
            )
    plot(kept.path / "sh-order", axes, "Indirect irradiance through the camera.")
    shown = ["sh_order", "against", "region", *SHOWN]
    group = truth_of(context, _job(context, _HIGHEST), _IMAGE)
    labels = [_label(order) for order in sorted(set(ok["sh_order"]))]
    return "\n\n".join(
        (
            "L* is on its scale of 0 to 100; Bennett 2019 has figures below 0.01 in places, which "
            "suggests a scale of 0 to 1 (ten thousand times less). Its curves carry no figures to "
            "set beside these.",
            markdown(ok[shown], FORMATS),
            "![errors](sh-order.png)",
            result_panel(kept, "sh-order-pictures", group.truth, labels),
        )
    )


EXPERIMENT = Experiment(
    name="sh-order",
    title="Error against the order of spherical harmonics",
    source="figure 6.7 and section 6.4 of Bennett 2019",
    profiles=("iphone7",),
    keys=("sh_order",),
    columns=("against", *COLUMNS),
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
    truth=trace_truth,
)
