"""What visibility in a probe buys and costs (Anonymous 2022, chapter 5)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.errors import CannotRun
from gibench.profiles import DeviceProfile
from gibench.report.plots import Axes, Series, plot
from gibench.study.experiments.common import (
    Context,
    Experiment,
    Measuring,
    Point,
    markdown,
    published,
    published_section,
)
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import COLUMNS, compared, trace_truth, truth_of
from gibench.study.quality_rows import Group
from gibench.techniques.job import Job
from gibench.techniques.parts.captured_probes.held import probe_bytes
from gibench.techniques.parts.captured_probes.settings import CapturedProbeSettings
from gibench.work import Worker

# The scenes of Anonymous 2022: a wall between two rooms, whole and with a gap at one side.
_SCENES = ("two-rooms", "two-rooms-gap")
_PROBES = (16, 64, 256, 2000)
_SIDES = (8, 32, 128)
_IRRADIANCE, _LIGHT_FIELD = "irradiance-probes", "light-field-probes"
_IMAGE = (480, 270)
_RECEIVERS = 4000
# Lighting all bounces of more texels in the bake takes hours and gigabytes.
_MOST_TEXELS = 2_200_000
_KEYS = ("scene", "technique", "probes", "map_texels", "bounces")
_FORMATS = {
    "dark_share": ".3%",
    "true_share": ".3%",
    "bias": ".1%",
    "rel_l2": ".1%",
    "flip": ".4f",
    "time_ms": ".1f",
    "kb_per_probe": ".2f",
}


def _job(context: Context, scene: str, technique: str, probes: int, side: int, bounces: str) -> Job:
    settings: dict[str, Any] = {"update": "static", "map_texels": side, "bounces": bounces}
    if context.quick:
        settings["capture_texels"] = 16
    return _of(context, scene, technique, probes=probes, **settings)


def _of(context: Context, scene: str, technique: str, **settings: Any) -> Job:
    profile: DeviceProfile = context.profiles[0]
    receivers = 400 if context.quick else _RECEIVERS
    return context.of(technique, scene, profile, receivers, **settings)


def _points(context: Context) -> Iterator[Point]:
    """Small ones of every scene first: whoever breaks off has those."""
    sizes = [(4, 8)] if context.quick else [(p, s) for p in _PROBES for s in _SIDES]
    names = context.scene_or(*_SCENES)
    scenes = {name: context.site.standing().scene(name).name for name in names}

    def point(job: Job, *key: Any) -> Point:
        return Point(dict(zip(_KEYS, key, strict=True)), job)

    for name, scene in scenes.items():
        probes, side = (4, 8) if context.quick else (16, 128)
        job = _job(context, name, _IRRADIANCE, probes, side, "1")
        yield point(job, scene, _IRRADIANCE, probes, side, "1")
        yield point(_of(context, name, "ddgi"), scene, "ddgi", 0, 0, "any")
    for probes, side in sizes:
        for name, scene in scenes.items():
            for technique in (_IRRADIANCE, _LIGHT_FIELD):
                job = _job(context, name, technique, probes, side, "any")
                yield point(job, scene, technique, probes, side, "any")


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job, key = unit.point.job, unit.point.key
    if key["probes"] * key["map_texels"] ** 2 > _MOST_TEXELS:
        raise CannotRun(
            f"{key['probes']} probes of {key['map_texels']} x {key['map_texels']} texels take "
            "hours to light in the bake"
        )
    label = ", ".join(str(value) for value in key.values())
    found = compared(context, job, worker, _IMAGE, label)
    group = truth_of(context, job, _IMAGE)
    shares = {
        "dark_share": dark_share(group, found.arrays[label]),
        "true_share": dark_share(group, group.truth.value),
    }
    settings = job.settings
    kb = probe_bytes(settings) / 1024 if isinstance(settings, CapturedProbeSettings) else None
    rows = [{**row, **shares, "kb_per_probe": kb} for row in found.rows]
    return Found(rows, arrays=found.arrays)


def dark_share(group: Group, irradiance: Doubles) -> float:
    """Light in the darker half of the scene over light in the lighter half.

    The halves lie on both sides of the middle along x; what of the surface lies within a hundredth
    of the middle is in neither. Means over the surface; which half is the darker the truth says.

    Args:
        group: the receivers and their truth.
        irradiance: (n, 3) W/m2.
    """
    receivers = group.lightmap.receivers
    low, high = group.scene.bounds
    along = (receivers.position[:, 0] - (low[0] + high[0]) / 2) / (high[0] - low[0])
    area = receivers.area.astype(np.float64)

    def mean(values: Doubles, side: int) -> float:
        own = side * along > 0.01
        return float((values.mean(axis=1)[own] * area[own]).sum() / area[own].sum())

    lit = 1 if mean(group.truth.value, 1) > mean(group.truth.value, -1) else -1
    return mean(irradiance, -lit) / mean(irradiance, lit)


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[(table["status"] == "ok") & (table["region"] == "whole")]
    axes = []
    for scene, rows in ok.groupby("scene", sort=False):
        grid = rows[(rows["technique"] != "ddgi") & (rows["bounces"] == "any")]
        series = [
            Series(
                f"{technique}, {probes}",
                own["map_texels"].tolist(),
                (100 * own["dark_share"]).clip(lower=1e-4).tolist(),
            )
            for (technique, probes), own in grid.groupby(["technique", "probes"], sort=False)
        ]
        true = 100 * float(rows["true_share"].iloc[0])
        axes.append(
            Axes(
                f"{scene}: the dark half",
                "texels of a map's side",
                "share of the lit half's light, %",
                series,
                log_x=True,
                log_y=True,
                level=(true, "path-traced") if true > 0 else None,
            )
        )
    plot(
        kept.path / "light-field",
        axes,
        "Technique and number of probes; any number of bounces. Shares below 0.0001 % are drawn "
        "there.",
    )
    shown = [*_KEYS, "dark_share", "true_share", "bias", "rel_l2", "flip", "time_ms"]
    return "\n\n".join(
        (
            "*dark_share*: indirect light in the darker half of the scene over that in the lighter "
            "one; *true_share*: the same, path-traced. Probes are lit once (update=static). "
            "*time_ms*: a whole frame, the camera's rays among it.",
            markdown(ok[[*shown, "kb_per_probe"]], _FORMATS),
            "![leaks](light-field.png)",
            published_section(published("probe_costs")),
        )
    )


EXPERIMENT = Experiment(
    name="light-field",
    title="What visibility in a probe buys and costs",
    source="chapter 5 and table 6.1 of Anonymous 2022",
    profiles=("iphone7",),
    keys=_KEYS,
    columns=("dark_share", "true_share", "kb_per_probe", *COLUMNS),
    points=_points,
    measure=_measure,
    present=_present,
    truth=trace_truth,
)
