"""Frame times of four scenes under three profiles (Bennett 2019, figure 6.6)."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from gibench.report.plots import bars
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
from gibench.work import Worker

# Bennett's four are the Cornell Box, the Blue-Orange Box, the Modern Hall and Crytek Sponza; the
# built-in hall and atrium stand for the last two, which do not come with gibench.
_SCENES = ("cornell-box", "blue-orange-box", "hall", "atrium")
_IMAGE = (1334, 750)
_KINDS = {"SRP order 7": 7, "SRP order 2": 2, "direct only": None}


def _points(context: Context) -> Iterator[Point]:
    shared = context.site.moving()
    for name in context.scene_or(*_SCENES):
        scene = shared.scene(name).name
        receivers = 1000 if context.quick else None
        for kind, order in _KINDS.items():
            for profile in context.profiles:
                if order is None:
                    job = context.direct(name, profile, receivers)
                else:
                    job = context.srp(name, profile, sh_order=order, receivers=receivers)
                yield Point({"scene": scene, "kind": kind, "profile": profile.name}, job)


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    return Found([timed(context, unit.point.job, worker, _IMAGE)])


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    groups = {
        f"{scene}\n{profile}": dict(zip(group["kind"], group["time_ms"], strict=True))
        for (scene, profile), group in ok.groupby(["scene", "profile"], sort=False)
    }
    bars(
        kept.path / "frame-times",
        groups,
        "median frame, ms",
        "Times of this machine under the profiles' limits, not of the devices they model.",
    )
    wide = ok.pivot_table(
        index=["scene", "profile"], columns="kind", values="time_ms", sort=False
    ).reset_index()
    theirs = published("frame_times")
    theirs = theirs[(theirs["source"] == "Bennett 2019") & (theirs["pass"] == "frame")]
    return "\n\n".join(
        (
            "Median frame time, ms.",
            markdown(wide, dict.fromkeys(_KINDS, ".2f")),
            "![frame times](frame-times.png)",
            published_section(theirs.drop(columns=["technique", "pass"])),
        )
    )


EXPERIMENT = Experiment(
    name="frame-times",
    title="Frame times of four scenes under three profiles",
    source="figure 6.6 and section 6.3 of Bennett 2019",
    profiles=("iphone7", "radeon560", "vega56"),
    keys=("scene", "kind", "profile"),
    columns=(*TIMES, *RESTS),
    points=_points,
    measure=_measure,
    present=_present,
)
