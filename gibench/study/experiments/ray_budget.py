"""GIBS against DDGI at equal ray budgets, at rest and after a flight (Ekberg 2022, chapter 5)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pandas as pd

from gibench.measure.session.rest import warm_up
from gibench.measure.session.session import Session
from gibench.profiles import DeviceProfile
from gibench.progress import progress
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
from gibench.study.experiments.kept import Found, Images, Kept, of_key
from gibench.techniques.camera_path import FLIGHT, FlightOptions
from gibench.techniques.gibs import Gibs
from gibench.techniques.job import Job
from gibench.techniques.registry import Wakes
from gibench.techniques.technique import Technique
from gibench.work import Worker

_IMAGE = (1920, 1080)
_RAYS_PER_PROBE = (25, 50, 100)
AT_REST, MOVED = "at rest", "after the flight"

RAYS, APPLICATION, REST, CAMERA = "ray_casting_ms", "application_ms", "rest_ms", "camera_ms"
TOTAL, FRAME = "total_ms", "frame_ms"
_FRAME: Final = "(frame)"  # the host's time, among the samples of passes
# Ekberg's columns. What is not named is 'rest'; the camera's own image is in none of them.
_COLUMN_OF: Mapping[str, Mapping[str, str]] = {
    "ddgi": {
        "probe_trace": RAYS,
        "probe_shade": RAYS,
        "application": APPLICATION,
        "camera": CAMERA,
        _FRAME: FRAME,
    },
    "gibs": {"irradiance": RAYS, "application": APPLICATION, "camera": CAMERA, _FRAME: FRAME},
}
_TIMES = (RAYS, APPLICATION, REST, TOTAL, CAMERA, FRAME)
_SAMPLE = (
    "when",
    "frame",
    "pass",
    "time_ms",
    "surfels",
    "covered",
    "probes",
    "rays",
    "memory_bytes",
    "rest",
)
_KEYS = ("scene", "technique", "budget", "profile")


@dataclass(frozen=True)
class _Sizes:
    """Of Ekberg 2022 (section 5.1), or small ones.

    Attributes:
        counts: DDGI's probes along x, y and z.
        surfels: room for GIBS's.
        settle: frames at rest before any is timed.
        flight: frames of the flight.
        timed: frames timed at rest, and again after the flight.
    """

    counts: tuple[int, int, int] = (20, 10, 10)
    surfels: int = 50_000
    settle: int = 120
    flight: int = 240
    timed: int = 30

    @property
    def probes(self) -> int:
        """DDGI's probes."""
        x, y, z = self.counts
        return x * y * z

    @property
    def flown(self) -> FlightOptions:
        """The camera's flight, which begins when the frames at rest have been timed."""
        return FlightOptions(FLIGHT, self.settle + self.timed, self.flight)


def _sizes(context: Context) -> _Sizes:
    if context.quick:
        return _Sizes((4, 3, 3), 900, settle=3, flight=5, timed=3)
    return _Sizes(settle=4 * context.frames, flight=8 * context.frames, timed=context.frames)


def _job(context: Context, scene: str, profile: DeviceProfile, technique: str, budget: int) -> Job:
    sizes = _sizes(context)
    if technique == "ddgi":
        # Every ray is blended, as 25 a probe leave none to spare: nothing moves the probes. The
        # average is the public SDK's.
        settings = {
            "counts": "x".join(str(n) for n in sizes.counts),
            "rays": str(budget // sizes.probes),
            "relocation": "false",
            "classification": "false",
            "average": "encoded",
        }
    else:
        # As small as that many to cover Sponza; none is taken back, as in Ekberg 2022 (chapter 4).
        settings = {
            "surfels": str(sizes.surfels),
            "radius_share": "0.02",
            "recycle_chance": "0",
            "placement": "camera",
            "ray_budget": str(budget),
            "rays_per_surfel": str(budget / sizes.surfels),
        }
    receivers = 1000 if context.quick else None
    return context.of(technique, scene, profile, receivers, **settings)


def _points(context: Context) -> Iterator[Point]:
    shared, sizes = context.site.standing(), _sizes(context)
    for name in context.scene_or("cornell-box" if context.quick else "atrium"):
        scene = shared.scene(name).name
        for profile in context.profiles:
            for rays in _RAYS_PER_PROBE:
                budget = rays * sizes.probes
                for technique in ("ddgi", "gibs"):
                    key = dict(zip(_KEYS, (scene, technique, budget, profile.name), strict=True))
                    yield Point(key, _job(context, name, profile, technique, budget))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    """Samples and images at rest and after the flight.

    Raises:
        CannotRun: the profile or budget forbids it.
        GibenchError: a pass failed.
    """
    sizes, site, key = _sizes(context), context.site, unit.point.key
    job = replace(unit.point.job, shot=replace(context.shot(_IMAGE), flight=sizes.flown))
    samples: list[dict[str, Any]] = []
    pictures: list[Images] = []
    frames = sizes.flown.frames + sizes.timed
    label = f"{key['technique']} {key['budget']}"
    with (
        Session.open(job, site.standing(), site.cl_device) as session,
        progress(f"{label} rays a frame", frames) as advance,
        worker.alone(),
    ):
        session.prepare(whole=True)
        session.compile()
        # After its flight the camera is where it was before.
        rest = warm_up(
            session,
            0,
            context.waits,
            number_of=lambda frame: frames + frame,
            aside=frozenset({Wakes.CAMERA}),
        )
        for frame in range(frames):
            times = session.frame(frame)
            when = _when(frame, sizes)
            if when is not None:
                passes = {**times.pass_ms, _FRAME: times.wall_ms}
                facts = {
                    "when": when,
                    "frame": frame,
                    "rest": rest.in_words(),
                    **_sizes_now(session.technique),
                    "memory_bytes": session.memory_bytes,
                }
                samples += [{**facts, "pass": n, "time_ms": ms} for n, ms in passes.items()]
                if when != _when(frame + 1, sizes):
                    images = session.images()
                    shown = {title: images[title] for title in ("frame", "indirect only")}
                    pictures.append(Images(str(key["scene"]), f"{label} {when}", shown))
            advance(1)
    return Found(samples=samples, images=pictures)


def _when(frame: int, sizes: _Sizes) -> str | None:
    """What ``frame`` is timed for, if anything."""
    if sizes.settle <= frame < sizes.settle + sizes.timed:
        return AT_REST
    return MOVED if sizes.flown.frames <= frame < sizes.flown.frames + sizes.timed else None


def _sizes_now(technique: Technique) -> dict[str, float]:
    """Surfels, the share of the visible pixels that any covers, probes and rays of the frame just
    run.
    """
    counts = technique.counts()
    if isinstance(technique, Gibs):
        (irradiance,) = [item for item in technique.passes() if item.name == "irradiance"]
        coverage = technique.coverage()
        covered = int((coverage > 0).sum()) / max(int(np.isfinite(coverage).sum()), 1)
        rays = int(irradiance.work.rays)
        return {"surfels": counts["surfels"], "covered": covered, "rays": rays}
    return {"probes": counts["probes"], "rays": counts["rays"]}


def rows_of(samples: pd.DataFrame, key: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The medians of the samples of ``key``: a row at rest and one after the flight.

    Args:
        samples: one pass, one frame, one time (``ray-budget-samples.csv``).
        key: values of the key columns.
    """
    mine = of_key(samples, key)
    columns = _COLUMN_OF[str(key["technique"])]
    mine = mine.assign(column=[columns.get(name, REST) for name in mine["pass"]])
    rows = []
    for when, group in mine.groupby("when", sort=False):
        frames = group.pivot_table(index="frame", columns="column", values="time_ms", aggfunc="sum")
        frames[TOTAL] = frames[RAYS] + frames[APPLICATION] + frames[REST]
        last = group.iloc[-1]
        rows.append(
            {
                "when": when,
                **{name: last[name] for name in ("surfels", "covered", "probes")},
                "rays": float(group.groupby("frame")["rays"].first().median()),
                **{name: float(frames[name].median()) for name in _TIMES},
                "frames": len(frames),
                "memory_bytes": int(last["memory_bytes"]),
                "rest": last.get("rest", ""),
            }
        )
    return rows


def theirs() -> pd.DataFrame:
    """Ekberg's table in its columns; blank where the figure was not available to us."""
    table = published("frame_times")
    table = table[table["source"] == "Ekberg 2022"]
    wide = table.pivot_table(
        index=["source", "where", "technique", "scene", "device"],
        columns="pass",
        values="time_ms",
        sort=False,
    ).reset_index()
    wide = wide.rename(columns={"frame": "total"})
    wide.columns.name = None
    return wide[[name for name in wide.columns if name != "total"] + ["total"]]


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    sizes = _sizes(context)
    width, height = context.shot(_IMAGE).width, context.shot(_IMAGE).height
    plot(
        kept.path / "ray-budget",
        [Axes(_heading(name), "thousand rays a frame at most", "median, ms", _series(ok, name))
         for name in _TIMES[:4]],
        f"Image {width} x {height}. Times of this machine, not of Ekberg's.",
    )  # fmt: skip
    whole = ["surfels", "probes", "rays", "frames", "memory_bytes"]
    shown = ok[[*_KEYS, "when", "covered", *whole[:3], *_TIMES, *whole[3:], "rest"]]
    formats = {**dict.fromkeys(_TIMES, ".2f"), **dict.fromkeys(whole, ",.0f"), "covered": ".1%"}
    return "\n\n".join(
        (
            f"DDGI with {'x'.join(str(n) for n in sizes.counts)} probes casts the whole budget in "
            f"every frame, no probe being moved or switched off. GIBS has room for "
            f"{sizes.surfels:,} surfels and casts budget / {sizes.surfels:,} rays for each that is "
            "alive, so that it stays below the budget until the camera has been everywhere; once "
            "placed they stay, as in Ekberg 2022, but grow with their distance from the camera, "
            "where Ekberg's are of one size. Lights "
            f"stand still; the image is {width} x {height}; {sizes.settle} frames at rest before "
            f"the first that is timed, and a flight of {sizes.flight} between the two times.",
            "*covered* is the share of the visible pixels that a surfel reaches: where it is below "
            "100 %, GIBS had not come to rest (too few frames, or too few tiles in a small image) "
            "and its times are of a part of its work.",
            "*ray casting* is `probe_trace` and `probe_shade`, or `irradiance` (with the surfels' "
            "estimator, which Ekberg's kernel holds too); *application* is the light on every "
            "pixel; *rest* is every other pass but *camera*: primary rays and direct light, which "
            "Ekberg does not count either. *frame* is all of it by the host's clock. Each column "
            "is a median of its own over the frames in `ray-budget-samples.csv`, so they add up "
            "only nearly.",
            markdown(shown.rename(columns=_heading), {_heading(n): f for n, f in formats.items()}),
            "![ray budget](ray-budget.png)",
            "The last timed frame of each is beneath `images/`.",
            published_section(theirs()),
            "A blank was not available to us. Their device traces rays in hardware, ours does "
            "not: compare the shares of a row, not its times.",
        )
    )


def _series(table: pd.DataFrame, column: str) -> list[Series]:
    """A line for each technique at rest and after the flight."""
    several = len(table[["scene", "profile"]].drop_duplicates()) > 1
    lines = []
    groups = table.groupby(["technique", "when", "scene", "profile"], sort=False)
    for (technique, when, scene, profile), group in groups:
        where = f", {scene}, {profile}" if several else ""
        lines.append(
            Series(
                f"{technique} {when}{where}",
                (group["budget"] / 1000).tolist(),
                group[column].tolist(),
            )
        )
    return lines


def _heading(name: str) -> str:
    return name[:-3].replace("_", " ") + ", ms" if name in _TIMES else name.replace("_", " ")


EXPERIMENT = Experiment(
    name="ray-budget",
    title="DDGI and GIBS at equal ray budgets, at rest and after a flight",
    source="section 5.2 of Ekberg 2022",
    profiles=("vega56",),
    keys=_KEYS,
    columns=(
        *("when", "surfels", "covered", "probes", "rays", *_TIMES, "frames", "memory_bytes"),
        "rest",
    ),
    points=_points,
    measure=_measure,
    present=_present,
    samples=_SAMPLE,
    summarize=rows_of,
)
