"""How long a technique takes to follow a switched light (Ekberg 2022, sections 5.1 and 6)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.measure.session.rest import warm_up
from gibench.measure.session.session import Session
from gibench.profiles import DeviceProfile
from gibench.progress import progress
from gibench.reference.luminance import luminance
from gibench.report.plots import Axes, Series, plot
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept, of_key
from gibench.study.switched import LightSwitch, SwitchedShared
from gibench.study.through_camera import view
from gibench.techniques.job import Job
from gibench.techniques.registry import Wakes
from gibench.work import Worker

_IMAGE = (640, 360)
_COMPARED = (160, 90)  # pixels of the images that are compared; all after a switch are held at once
_RECEIVERS = 20_000
# No frame's time depends on them but through the vectors kept, and no speed of convergence at all.
_TRANSPORT_RAYS = "256"

NEAR = 0.05
"""Of the settled image: what counts as arrived."""
_DRIFT = 0.01  # of the settled mean: what the last two quarters may differ by

_SWITCHES = {"off to on": (0.0, 1.0), "on to a quarter": (1.0, 0.25)}
_SETTINGS: tuple[tuple[str, str, Mapping[str, str]], ...] = (
    ("srp", "all probes every frame", {}),
    ("srp", "a quarter of the probes every frame", {"probe_update": "quarter"}),
    # Averages and placement are the papers'.
    ("ddgi", "hysteresis 0.97", {"average": "encoded"}),
    ("ddgi", "hysteresis 0.90", {"average": "encoded", "hysteresis": "0.9"}),
    ("gibs", "1 ray a surfel", {"placement": "camera"}),
    ("gibs", "4 rays a surfel", {"placement": "camera", "rays_per_surfel": "4"}),
)
_KEYS = ("scene", "switch", "technique", "setting", "profile")
_SAMPLE = ("frame", "time_ms", "distance", "mean_distance", "rest")
_COLUMNS = (
    "frames",
    "ms",
    "mean_frames",
    "mean_ms",
    "frame_ms",
    "noise",
    "settled",
    "rest",
)


@dataclass(frozen=True)
class _Lengths:
    """Frames before the switch, in which the old light settles, and after it."""

    before: int
    after: int


def _lengths(context: Context) -> _Lengths:
    return _Lengths(6, 16) if context.quick else _Lengths(4 * context.frames, 8 * context.frames)


def _job(
    context: Context,
    scene: str,
    profile: DeviceProfile,
    technique: str,
    settings: Mapping[str, str],
) -> Job:
    receivers = 500 if context.quick else _RECEIVERS
    if technique == "srp":
        settings = {"transport_rays": _TRANSPORT_RAYS, **context.transport, **settings}
    return context.of(technique, scene, profile, receivers, **settings)


def _points(context: Context) -> Iterator[Point]:
    for name in context.scene_or("cornell-box" if context.quick else "atrium"):
        for switch in _SWITCHES:
            scene = _shared(context, switch).scene(name).name
            for profile in context.profiles:
                for technique, setting, settings in _SETTINGS:
                    values = (scene, switch, technique, setting, profile.name)
                    key = dict(zip(_KEYS, values, strict=True))
                    yield Point(key, _job(context, name, profile, technique, settings))


def _shared(context: Context, switch: str) -> SwitchedShared:
    """Scenes whose lights change once as ``switch`` says."""
    before, after = _SWITCHES[switch]
    return context.site.switched(LightSwitch(_lengths(context).before, before, after))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    """Every frame after the switch: its time, and how far its image is from the settled one.

    Raises:
        CannotRun: the profile or budget forbids it.
        GibenchError: a pass failed.
    """
    lengths, key = _lengths(context), unit.point.key
    job = replace(unit.point.job, shot=context.shot(_IMAGE))
    shared, title = _shared(context, key["switch"]), " ".join(key.values())
    images, times = [], []
    with (
        Session.open(job, shared, context.site.cl_device) as session,
        progress(title, lengths.before + lengths.after) as advance,
        worker.alone(),
    ):
        world = session.world
        seen = view(world.scene, world.lightmap, world.camera, *_COMPARED)
        session.prepare(whole=True)
        session.compile()
        # Under the old light, which those frames before the switch have.
        rest = warm_up(
            session,
            0,
            context.waits,
            number_of=lambda frame: frame % lengths.before,
            aside=frozenset({Wakes.LIGHTS}),
        )
        for frame in range(lengths.before + lengths.after):
            wall_ms = session.frame(frame).wall_ms
            if frame >= lengths.before:
                image = seen.of(session.technique.indirect_irradiance())
                images.append(image[seen.seen].astype(np.float32))
                times.append(wall_ms)
            advance(1)
    distance, mean = distances(np.array(images))
    samples = [
        {
            "frame": number,
            "time_ms": ms,
            "distance": float(distance[number - 1]),
            "mean_distance": float(mean[number - 1]),
            "rest": rest.in_words(),
        }
        for number, ms in enumerate(times, 1)
    ]
    return Found(samples=samples)


def _summarize(samples: pd.DataFrame, key: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The row of ``key``."""
    return [row_of(of_key(samples, key))]


def distances(images: Any) -> tuple[Doubles, Doubles]:
    """How far every image is from the settled one, the mean of the last quarter.

    Args:
        images: (frames, pixels, 3) indirect irradiance, W/m2.

    Returns:
        Relative L2 distance (frames,), and the mean luminance's signed relative difference
        (frames,); nan where the settled image is black.
    """
    settled = images[-(len(images) // 4) :].mean(axis=0, dtype=np.float64)
    size, mean = np.sqrt((settled**2).sum()), luminance(settled).mean()
    if not size > 0:
        return np.full(len(images), np.nan), np.full(len(images), np.nan)
    off = np.array([np.sqrt(((image - settled) ** 2).sum()) for image in images])
    return off / size, np.array([luminance(image).mean() for image in images]) / mean - 1


def arrival(distance: Any) -> int | None:
    """Frames until ``distance`` is at most ``NEAR`` and stays so to the end; 1 is at once, None is
    never.
    """
    far = np.flatnonzero(~(np.asarray(distance) <= NEAR))
    frames = 1 if not far.size else int(far[-1]) + 2
    return frames if frames <= len(distance) else None


def row_of(samples: pd.DataFrame) -> dict[str, Any]:
    """What the frames after one switch come down to (rows of ``convergence-samples.csv``)."""
    samples = samples.sort_values("frame")
    times, distance = samples["time_ms"].to_numpy(), samples["distance"].to_numpy()
    mean = samples["mean_distance"].to_numpy()
    quarter = len(samples) // 4
    noise = float(np.median(distance[-quarter:]))
    drift = float(np.median(mean[-2 * quarter : -quarter]))
    settled = abs(drift) <= _DRIFT
    frames = arrival(distance) if settled else None
    mean_frames = arrival(np.abs(mean)) if settled else None
    said = "yes" if settled else f"no: still moving by {abs(drift):.1%}"
    if settled and frames is None:
        said = f"but for noise of {noise:.1%}"
    elapsed = np.cumsum(times)
    return {
        "frames": frames,
        "ms": None if frames is None else float(elapsed[frames - 1]),
        "mean_frames": mean_frames,
        "mean_ms": None if mean_frames is None else float(elapsed[mean_frames - 1]),
        "frame_ms": float(np.median(times)),
        "noise": noise,
        "settled": said,
        "rest": samples["rest"].iloc[0] if "rest" in samples else "",
    }


def _axes(samples: pd.DataFrame, against_time: bool) -> Sequence[Axes]:
    found = []
    for (scene, switch), group in samples.groupby(["scene", "switch"], sort=False):
        series = []
        for (technique, setting, profile), one in group.groupby(list(_KEYS[2:]), sort=False):
            ordered = one.sort_values("frame")
            x = ordered["time_ms"].cumsum() if against_time else ordered["frame"]
            several = len(group["profile"].unique()) > 1
            label = f"{technique}, {setting}" + (f", {profile}" if several else "")
            series.append(Series(label, x.tolist(), ordered["distance"].tolist()))
        unit = "ms after the switch" if against_time else "frames after the switch"
        level = (NEAR, f"{NEAR:.0%}")
        title = f"{scene}: {switch}"
        found.append(Axes(title, unit, "distance, share", series, log_y=True, level=level))
    return found


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    path, (width, height) = kept.path, _COMPARED
    samples = pd.read_csv(path / "convergence-samples.csv")
    image, lengths = context.shot(_IMAGE), _lengths(context)
    caption = f"Image {image.width} x {image.height}. Times of this machine."
    plot(path / "convergence", _axes(samples, against_time=False), caption)
    plot(path / "convergence-ms", _axes(samples, against_time=True), caption)
    formats = dict.fromkeys(("ms", "mean_ms", "frame_ms"), ".1f")
    formats |= {"noise": ".2%"}
    formats |= dict.fromkeys(("frames", "mean_frames"), ".0f")
    return "\n\n".join(
        (
            f"All lights but what glows and the environment change at once after {lengths.before} "
            "frames, before which each technique came to rest under the old light (*rest* says "
            f"whether it did); {lengths.after} frames follow. *distance* is the relative L2 "
            f"distance of the camera's image of indirect irradiance ({width} x {height}, through "
            "the lightmap, so that it is the same pixels for every technique) from the settled "
            "image, the mean of the last quarter. *frames* and *ms* count until it is within "
            f"{NEAR:.0%} and stays there, 1 frame being at once; *mean frames* and *mean ms* do "
            "so for the image's mean "
            "luminance, which a technique's own noise hardly moves. *noise* is the median distance "
            "of the last quarter itself. Times are sums of the frames' times by the host's clock.",
            markdown(ok[[*_KEYS, *_COLUMNS]].rename(columns=lambda n: n.replace("_", " ")),
                     {name.replace("_", " "): form for name, form in formats.items()}),
            "![against frames](convergence.png)",
            "![against time](convergence-ms.png)",
            "Each technique is judged by its own settled image: this says how soon it gets there, "
            "not how right it is (`gibench quality` does). "
            f"SRP's transport is baked with {_TRANSPORT_RAYS} rays per receiver, "
            f"{_RECEIVERS:,} receivers.",
            "The paper calls both techniques' convergence similar by the eye and prints no figures "
            "for it.",
        )
    )  # fmt: skip


EXPERIMENT = Experiment(
    name="convergence",
    title="Frames and milliseconds until a switched light has settled",
    source="sections 5.1 and 6 of Ekberg 2022, which have it in words only",
    profiles=("vega56",),
    keys=_KEYS,
    columns=_COLUMNS,
    points=_points,
    measure=_measure,
    present=_present,
    samples=_SAMPLE,
    summarize=_summarize,
)
