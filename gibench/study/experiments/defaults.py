"""Whether the defaults fit scenes that nobody tuned, and whether a run says where they do not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pandas as pd

from gibench.errors import BadInput
from gibench.measure.plan.view import choose_camera
from gibench.measure.session.shared import Shared
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import trace_truth
from gibench.study.quality import group_of
from gibench.study.quality_rows import rows_of
from gibench.study.settle import settle
from gibench.techniques.job import Job
from gibench.techniques.registry import find_technique
from gibench.work import Worker

_IMAGE = (320, 180)
_RECEIVERS = 4000
_EFFECTIVE = 1000
"""As many of one area as the receivers weigh, at least (``Receivers.effective``): where charts
outnumber them a few stand for whole walls, and more are asked for."""
_MOST_RECEIVERS = 64_000
_TECHNIQUES = ("ddgi", "gibs", "srp")
_SCENES = (
    *("church", "maze", "street", "thin-house", "big-hall", "vase"),
    *("cornell-box", "blue-orange-box", "two-rooms", "hall", "atrium"),
)
_FRAMES = 1024
"""At most: twice those of other studies, as surfels fill a large scene in hundreds of frames."""
_NEAR = 0.1
"""Of the truth's mean: what a default must come within, or a remark must say that it does not."""
_COLUMNS = (
    *("bias", "bias_noise", "rel_l2", "time_ms", "memory_bytes", "frames", "settled"),
    *("frames_to_rest", "receivers", "probes", "surfels", "uncovered", "remarks", "verdict"),
)


def _points(context: Context) -> Iterator[Point]:
    for scene in context.scene_or(*_SCENES):
        name = context.site.standing().scene(scene).name
        receivers = 500 if context.quick else _receivers(context, scene)
        for technique in _TECHNIQUES:
            settings = context.transport if technique == "srp" else {}
            job = context.of(technique, scene, context.profiles[0], receivers, **settings)
            yield Point({"scene": name, "technique": technique}, job)


def _receivers(context: Context, scene: str) -> int:
    """How many to ask for, so that no few stand for most of the surface."""
    asked = _RECEIVERS
    while asked < _MOST_RECEIVERS and not _enough(context, scene, asked):
        asked *= 2
    return asked


def _enough(context: Context, scene: str, receivers: int) -> bool:
    try:
        lightmap = context.site.standing().lightmap(scene, receivers)
    except BadInput:  # more charts than twice as many
        return False
    return lightmap.receivers.effective >= _EFFECTIVE


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job: Job = replace(unit.point.job, shot=context.shot(_IMAGE))
    options, site = replace(context.quality(), flip=False), context.site
    remarks = remarks_on(job, site.standing())
    group = group_of(job, options, site)
    longer = options.settle if context.quick else replace(options.settle, frames=_FRAMES)
    settled = settle(job, longer, site.standing(), site.cl_device, worker)
    row = rows_of(settled, group, options, job.technique)[0]
    return Found(
        [
            {
                **{name: row.get(name) for name in _COLUMNS},
                "frames_to_rest": settled.frames_to_rest,
                "probes": settled.counts.get("probes"),
                "surfels": settled.counts.get("surfels"),
                "remarks": "; ".join(remarks),
                "verdict": _verdict(float(row["bias"]), bool(remarks)),
            }
        ]
    )


def remarks_on(job: Job, shared: Shared) -> list[str]:
    """What the technique says before a run, of the scene and of the beginning of its bake."""
    spec, scene = find_technique(job.technique), shared.scene(job.scene)
    lightmap = shared.lightmap(job.scene, job.receivers or scene.receivers)
    return [
        *spec.remarks(job, scene, choose_camera(scene, job.shot.camera)),
        *spec.bake_remarks(job, shared.context(job.settings, scene, lightmap)),
    ]


def _verdict(bias: float, remarked: bool) -> str:
    if abs(bias) <= _NEAR:
        return "remark is false" if remarked else "near"
    return "far, as remarked" if remarked else "remark is missing"


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"].copy()
    ok["MiB"] = ok["memory_bytes"] / 2**20
    shown = ["scene", "technique", "bias", "rel_l2", "MiB", "time_ms", "frames", "settled"]
    shown += ["frames_to_rest"]
    formats = {"bias": "+.1%", "rel_l2": ".1%", "MiB": ".1f", "time_ms": ".2f"}
    said = ok[ok["remarks"].fillna("") != ""]
    lines = [f"- **{r.technique} on {r.scene}**: {r.remarks}" for r in said.itertuples()]
    counts = ok["verdict"].value_counts()
    found = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    return "\n\n".join(
        (
            f"All techniques as they are where nothing is set, {len(ok)} in all: {found}. Near is "
            f"within {_NEAR:.0%} of the truth's mean indirect irradiance.",
            markdown(ok[[*shown, "verdict"]], formats),
            "## Remarks before the run",
            "\n".join(lines) or "None.",
        )
    )


EXPERIMENT = Experiment(
    name="defaults",
    title="Defaults on scenes that nobody tuned",
    source="nobody: a check of this suite",
    profiles=("vega56",),
    keys=("scene", "technique"),
    columns=_COLUMNS,
    points=_points,
    measure=_measure,
    present=_present,
    truth=trace_truth,
)
