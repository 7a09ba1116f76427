"""Fewer probes a frame under a moving sun: what it saves, and how far light lags behind.

Bennett 2019, chapter 7, suggests it and measures nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.progress import progress
from gibench.reference import metrics
from gibench.reference.path_tracer import reference_irradiance
from gibench.report.plots import Axes, Series, plot
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.techniques.job import Job
from gibench.techniques.srp.turns import PROBE_UPDATES
from gibench.work import Worker

_IMAGE = (480, 270)
_RECEIVERS = 20_000
_PASS = "probe_update"
_COLUMNS = (
    "probes",
    "probes_a_frame",
    "mflops",
    "mbytes",
    "update_ms",
    "frame_ms",
    "rel_l2",
    "rel_l2_noise",
    "bias",
    "bias_noise",
    "lag_l2",
)
_FORMATS = {
    "rel_l2": ".2%",
    "rel_l2_noise": ".2%",
    "bias": "+.2%",
    "bias_noise": ".2%",
    "lag_l2": ".2%",
    "update_ms": ".3f",
    "frame_ms": ".2f",
    "mflops": ".2f",
    "mbytes": ".2f",
    "probes_a_frame": ".1f",
}


def _looked_at(context: Context) -> tuple[int, ...]:
    """Frames that are compared: the built-in hall's sun is fastest in the middle one."""
    return (3, 6) if context.quick else (90, 120, 150)


def _points(context: Context) -> Iterator[Point]:
    scene = context.scene_or("cornell-box" if context.quick else "hall")[0]
    for update in PROBE_UPDATES:
        receivers = 300 if context.quick else _RECEIVERS
        job = context.srp(
            scene,
            context.profiles[0],
            receivers=receivers,
            probes=6 if context.quick else None,
            probe_update=update,
        )
        yield Point({"update": update}, replace(job, shot=context.shot(_IMAGE)))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    """Run through the frames as they come, and compare some of them."""
    job, site = unit.point.job, context.site
    chosen = _looked_at(context)
    moving = site.moving()
    errors: list[dict[str, float]] = []
    counts: list[int] = []
    times: list[float] = []
    walls: list[float] = []
    title = f"a moving sun, probes: {unit.point.key['update']}"
    with (
        Session.open(job, moving, site.cl_device) as session,
        progress(title, chosen[-1] + 1) as advance,
        worker.alone(),
    ):
        session.prepare(whole=True)
        session.compile()
        technique: Any = session.technique
        (work,) = [item.work for item in session.prepared if item.name == _PASS]
        share = 1 / technique.turns.step
        for frame in range(chosen[-1] + 1):
            took = session.frame(frame)
            counts.append(technique.turns.count())
            times.append(took.pass_ms[_PASS])
            walls.append(took.wall_ms)
            if frame in chosen:
                errors.append(_errors(context, job, session, frame))
            advance(1)
        probes = session.counts()["probes"]
    done = float(np.mean(counts)) / (probes * share)
    row = {
        "probes": probes,
        "probes_a_frame": float(np.mean(counts)),
        "mflops": work.flops * done / 1e6,
        "mbytes": (work.bytes_read + work.bytes_written) * done / 1e6,
        "update_ms": float(np.median(times)),
        "frame_ms": float(np.median(walls)),
        **{name: float(np.mean([one[name] for one in errors])) for name in errors[0]},
    }
    return Found([row])


def _errors(context: Context, job: Job, session: Session, frame: int) -> dict[str, float]:
    """Of the light in ``frame`` against the truth, and against SRP's own once it has settled."""
    light, lightmap = session.irradiance(), session.world.lightmap
    options = context.quality()
    truth = reference_irradiance(
        session.world.scene,
        lightmap,
        frame=frame,
        target_error=options.target_error,
        paths=options.reference_paths,
        store_dir=context.site.cache_dir,
    )
    area = lightmap.receivers.area
    off = metrics.relative_l2(light, truth.value, truth.stderr, area)
    bias = metrics.bias(light, truth.value, truth.stderr, area)
    settled = _settled(context, job, frame)
    weight = area.astype(np.float64)[:, None]
    apart = np.sqrt((weight * (light - settled) ** 2).sum() / (weight * settled**2).sum())
    return {
        "rel_l2": off.value,
        "rel_l2_noise": off.noise,
        "bias": bias.value,
        "bias_noise": bias.noise,
        "lag_l2": float(apart),
    }


def _settled(context: Context, job: Job, frame: int) -> Doubles:
    """The irradiance (n, 3) of all probes under the light of ``frame`` for ever."""
    every = replace(job, settings=replace(job.settings, probe_update="all"))
    shared: Shared = context.site.standing(frame)
    with Session.open(every, shared, context.site.cl_device) as session:
        session.prepare(whole=True)
        for number in range(6 if context.quick else 40):
            session.frame(number)
        return session.irradiance()


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    plot(
        kept.path / "probe-update",
        [
            Axes(
                title,
                "probes updated in a frame",
                label,
                [Series("", ok["probes_a_frame"].tolist(), (100 * ok[column]).tolist())],
            )
            for title, label, column in (
                ("error against the truth", "relative L2 error, %", "rel_l2"),
                ("lag behind light that has settled", "relative L2, %", "lag_l2"),
            )
        ],
        "Order 7; 'quarter' and 'nearest' update as many.",
    )
    frames = ", ".join(str(frame) for frame in _looked_at(context))
    return "\n\n".join(
        (
            f"SRP while the light moves, frame by frame; errors are means of frames {frames} over "
            "all receivers. *lag_l2*: against the same bake with all probes, once it has settled "
            "under the light of that frame. *mflops*, *mbytes*: the least that `probe_update` does "
            "in a frame.",
            markdown(ok[["update", *_COLUMNS]], _FORMATS),
            "![error and lag](probe-update.png)",
            "The source suggests a half in turn and near probes first, and prints no figures.",
        )
    )


EXPERIMENT = Experiment(
    name="probe-update",
    title="Fewer probes a frame under a moving sun",
    source="chapter 7 of Bennett 2019",
    profiles=("iphone7",),
    keys=("update",),
    columns=_COLUMNS,
    points=_points,
    measure=_measure,
    present=_present,
)
