"""Frame time against SH order, probes and receivers (Bennett 2019, figure 6.8)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from gibench.profiles import DeviceProfile
from gibench.report.plots import Axes, Series, plot
from gibench.study.experiments.common import (
    RESTS,
    TIMES,
    Context,
    Experiment,
    Measuring,
    Point,
    markdown,
    published,
    published_section,
    timed,
)
from gibench.study.experiments.kept import Found, Kept
from gibench.study.slope import fit_line
from gibench.techniques.job import Job
from gibench.techniques.srp.bake.data import sh_count
from gibench.work import Worker

_IMAGE = (1334, 750)
# Section 6.5: one parameter at a time, the others at these.
_PROBES, _RECEIVERS, _ORDER = 20, 50_784, 2
_ORDERS = tuple(range(8))
_PROBE_COUNTS = (20, 40, 60, 80, 100, 120, 140, 160, 180, 200)
_RECEIVER_COUNTS = (50_784, 100_000, 200_000, 400_000, 600_000, 800_000, 1_000_000)
# The frame does not read the rays' noise: fewer than Bennett's 4096 make a million receivers
# bearable to bake.
_RAYS = "256"
_X = {
    "order": ("SH coefficients per probe", "coefficient", 1.0),
    "probes": ("probes", "probe", 1.0),
    "receivers": ("receivers, thousands", "thousand receivers", 1e-3),
}


def _job(context: Context, profile: DeviceProfile, axis: str, value: int) -> Job:
    scene = context.scene_or("blue-orange-box")[0]
    base = 1000 if context.quick else _RECEIVERS
    chosen: dict[str, int] = {"sh_order": _ORDER, "probes": _PROBES, "receivers": base}
    chosen["sh_order" if axis == "order" else axis] = value
    rays = {} if context.quick else {"transport_rays": _RAYS}
    return context.srp(
        scene,
        profile,
        sh_order=chosen["sh_order"],
        probes=chosen["probes"],
        receivers=chosen["receivers"],
        **rays,
    )


def _values(context: Context) -> dict[str, tuple[int, ...]]:
    if context.quick:
        return {"order": (0, 2, 4), "probes": (4, 8, 12), "receivers": (500, 1000, 2000)}
    return {"order": _ORDERS, "probes": _PROBE_COUNTS, "receivers": _RECEIVER_COUNTS}


def _points(context: Context) -> Iterator[Point]:
    for axis, values in _values(context).items():
        for value in values:
            for profile in context.profiles:
                job = _job(context, profile, axis, value)
                yield Point({"axis": axis, "value": value, "profile": profile.name}, job)


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    return Found([timed(context, unit.point.job, worker, _IMAGE)])


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    axes, fits = [], []
    for axis, (title, per, scale) in _X.items():
        series = []
        for profile, group in ok[ok["axis"] == axis].groupby("profile", sort=False):
            values = group["value"].to_numpy(np.float64)
            x = (values + 1) ** 2 if axis == "order" else values * scale
            y = group["time_ms"].to_numpy(np.float64)
            line = fit_line(x.tolist(), y.tolist())
            drawn = None if line is None else (line.slope, line.intercept)
            series.append(Series(str(profile), x.tolist(), y.tolist(), drawn))
            if line is not None:
                fits.append(
                    {
                        "against": title,
                        "profile": profile,
                        "ms per unit": line.slope,
                        "95 % from": line.low,
                        "to": line.high,
                        "unit": per,
                        "at 0, ms": line.intercept,
                        "R2": line.r2,
                    }
                )
        if series:
            axes.append(Axes(f"against {title}", title, "median frame, ms", series))
    plot(
        kept.path / "scaling",
        axes,
        "Times of this machine under the profiles' limits, not of the devices they model.",
    )
    order = f"{sh_count(0)} to {sh_count(7)}"
    return "\n\n".join(
        (
            f"One parameter at a time, the others at order {_ORDER}, {_PROBES} probes and "
            f"{_RECEIVERS:,} receivers. Time is fitted against the {order} coefficients of the "
            f"orders, which is what they cost. Transport is baked with {_RAYS} rays per receiver, "
            "which no frame time depends on but through the number of vectors kept.",
            "## Slopes",
            markdown(pd.DataFrame(fits)) if fits else "Too few points for slopes.",
            "![scaling](scaling.png)",
            markdown(ok[["axis", "value", "profile", *TIMES]]),
            published_section(published("srp_scaling")),
        )
    )


EXPERIMENT = Experiment(
    name="scaling",
    title="Frame time against SH order, probes and receivers",
    source="figure 6.8 and section 6.5 of Bennett 2019",
    profiles=("iphone7", "radeon560", "vega56"),
    keys=("axis", "value", "profile"),
    columns=(*TIMES, *RESTS),
    points=_points,
    measure=_measure,
    present=_present,
)
