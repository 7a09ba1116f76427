"""Order of spherical harmonics by number of probes at equal bytes: the study that Silvennoinen and
Lehtinen 2017 leave open (section 5.2)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.report.plots import Axes, Series, plot
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import COLUMNS, FORMATS, compared, trace_truth
from gibench.study.regions import WHOLE
from gibench.techniques.job import Job
from gibench.techniques.registry import find_technique
from gibench.techniques.srp.storage import storage_bytes
from gibench.work import Worker

_IMAGE = (480, 270)
_PROBES, _ORDERS = (9, 18, 27, 54, 109, 218), (7, 6, 5, 4, 3, 2, 1)
_RECEIVERS = 8000


def _sizes(context: Context) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return ((4, 8), (3, 1)) if context.quick else (_PROBES, _ORDERS)


def _job(context: Context, probes: int, order: int) -> Job:
    scene = context.scene_or("cornell-box")[0]
    receivers = 400 if context.quick else _RECEIVERS
    return context.srp(
        scene, context.profiles[0], sh_order=order, probes=probes, receivers=receivers
    )


def _points(context: Context) -> Iterator[Point]:
    """All orders of a number of probes one after another: they share a bake."""
    counts, orders = _sizes(context)
    for probes in counts:
        for order in orders:
            yield Point({"probes": probes, "sh_order": order}, _job(context, probes, order))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job, shared = unit.point.job, context.site.standing()
    key = unit.point.key
    found = compared(context, job, worker, _IMAGE, f"{key['probes']} probes, {key['sh_order']}")
    receivers = job.receivers or shared.scene(job.scene).receivers
    spec = find_technique(job.technique)
    lightmap, bake = shared.baked(spec, job.settings, job.scene, receivers)
    stored = bake.transport_bytes(storage_bytes(job.settings.storage))
    rows = [{**row, "bytes_per_receiver": stored / len(lightmap.receivers)} for row in found.rows]
    return Found(rows, arrays=found.arrays)


def at_equal_bytes(table: pd.DataFrame, level: float) -> pd.DataFrame:
    """What each order reaches with so many bytes of matrices a receiver.

    Args:
        table: ``probes``, ``sh_order``, ``bytes_per_receiver``, ``rel_l2`` and ``bias``.
        level: bytes a receiver.

    Returns:
        A row per order that has fewer and more bytes among its points: the number of probes and
        the error there, along straight lines in logarithms between its points, the bias along
        straight ones.
    """
    rows = []
    for order, own in table.groupby("sh_order", sort=False):
        own = own.sort_values("bytes_per_receiver")
        size = own["bytes_per_receiver"].to_numpy(np.float64)
        if not size[0] <= level <= size[-1]:
            continue

        def between(values: Doubles, size: Doubles = size) -> float:
            return float(np.interp(np.log(level), np.log(size), values))

        rows.append(
            {
                "bytes_per_receiver": level,
                "sh_order": order,
                "probes": float(np.exp(between(np.log(own["probes"].to_numpy(np.float64))))),
                "rel_l2": float(np.exp(between(np.log(own["rel_l2"].to_numpy(np.float64))))),
                "bias": between(own["bias"].to_numpy(np.float64)),
            }
        )
    return pd.DataFrame(rows)


def levels(sizes: pd.Series[float]) -> Doubles:
    """The powers of two among bytes a receiver; where there is none, the middle of them."""
    low, high = np.log2(sizes.min()), np.log2(sizes.max())
    found = np.arange(np.ceil(low), np.floor(high) + 1)
    return np.asarray(2.0 ** (found if len(found) else np.array([(low + high) / 2])))


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[(table["status"] == "ok") & (table["region"] == WHOLE)]
    series = [
        Series(f"order {order}", own["bytes_per_receiver"].tolist(), (100 * own["rel_l2"]).tolist())
        for order, own in ok.sort_values("bytes_per_receiver").groupby("sh_order")
    ]
    axes = Axes(
        "error by size",
        "bytes of matrices a receiver",
        "relative L2 error, %",
        series,
        log_x=True,
        log_y=True,
    )
    plot(kept.path / "order-density", [axes], "Each line: one order, more and more probes.")
    equal = pd.concat([at_equal_bytes(ok, level) for level in levels(ok["bytes_per_receiver"])])
    formats = {**FORMATS, "bytes_per_receiver": ".0f", "probes": ".0f"}
    measured = ["probes", "sh_order", "bytes_per_receiver", "memory_bytes", "bias", "rel_l2"]
    return "\n\n".join(
        (
            "At equal bytes of stored matrices a receiver, each time twice as many; between an "
            "order's points along straight lines in logarithms, no order beyond its own points.",
            markdown(equal, formats),
            "![errors](order-density.png)",
            "## Measured",
            markdown(ok[measured], formats),
        )
    )


EXPERIMENT = Experiment(
    name="order-density",
    title="Order of spherical harmonics by number of probes at equal bytes",
    source="section 5.2 of Silvennoinen and Lehtinen 2017, which leaves it to others",
    profiles=("vega56",),
    keys=("probes", "sh_order"),
    columns=("bytes_per_receiver", *COLUMNS),
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
    truth=trace_truth,
)
