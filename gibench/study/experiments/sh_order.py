"""Error against SH order on the Blue-Orange Box (Bennett 2019, figure 6.7)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from gibench.report.plots import Axes, Series, plot
from gibench.study.errors import METRICS, Truth, errors
from gibench.study.experiments.common import Context, Experiment, Point, markdown
from gibench.study.experiments.side_by_side import (
    COLUMNS,
    FORMATS,
    SHOWN,
    compared,
    kept,
    result_panel,
    truth_of,
)
from gibench.techniques.job import Job

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
    for order in sorted(orders, reverse=True):  # the highest first: the others are held against it
        yield Point({"sh_order": order}, _job(context, order))


def _measure(context: Context, point: Point) -> list[dict[str, Any]]:
    order, shared = point.key["sh_order"], context.standing()
    rows = compared(context, point.job, shared, _IMAGE, _label(order))
    rows = [{**row, "against": "reference"} for row in rows]
    highest, mine = kept(context, _label(_HIGHEST)), kept(context, _label(order))
    if order == _HIGHEST or highest is None or mine is None:
        return rows
    group = truth_of(context, point.job, shared, _IMAGE)
    truth = Truth.of(
        highest, np.zeros_like(highest), group.lightmap.receivers.area, group.truth.view
    )
    for region, found in errors(truth, mine, group.regions).items():
        values = {name: found[name].value for name in METRICS}
        noises = {f"{name}_noise": found[name].noise for name in METRICS}
        rows.append({"region": region, "against": _label(_HIGHEST), **values, **noises})
    return rows


def _present(context: Context, table: pd.DataFrame) -> str:
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
    plot(context.folder.path / "sh-order", axes, "Indirect irradiance through the camera.")
    shown = ["sh_order", "against", "region", *SHOWN]
    group = truth_of(context, _job(context, _HIGHEST), context.standing(), _IMAGE)
    labels = [_label(order) for order in sorted(set(ok["sh_order"]))]
    return "\n\n".join(
        (
            "L* is on its scale of 0 to 100; Bennett 2019 has figures below 0.01 in places, which "
            "suggests a scale of 0 to 1 (ten thousand times less). Its curves carry no figures to "
            "set beside these.",
            markdown(ok[shown], FORMATS),
            "![errors](sh-order.png)",
            result_panel(context, "sh-order-pictures", group.truth, labels),
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
)
