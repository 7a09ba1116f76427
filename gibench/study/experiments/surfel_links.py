"""Surfels by links, bands, and both set-ups (Jendersie et al. 2016, figure 8, tables 2 and 3)."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from gibench.report.plots import Axes, Series, plot
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import FORMATS, trace_truth
from gibench.study.experiments.surfel_caches import (
    ERROR_COLUMNS,
    ERRORS,
    HIGH,
    MODERATE,
    PASS_TIMES,
    errors_of,
    pass_times,
    quickly,
    surfel_job,
    theirs,
)
from gibench.work import Worker

_COLUMNS = (
    *PASS_TIMES,
    *("frames", "memory_bytes", "caches"),
    *ERROR_COLUMNS,
)
_TIMES_OF = "Times of this machine under the profile's limits, not of the device it models."


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    times = pass_times(context, unit.point.job, worker)
    return Found([{**times, **errors_of(context, unit, worker)}])


# -- surfels by links -------------------------------------------------------------------------


def _links_points(context: Context) -> Iterator[Point]:
    for surfels in quickly(context, (16_384, 32_768, 65_536, 131_072), (256, 512)):
        for links in quickly(context, (32, 64, 128, 254), (8, 16)):
            job = surfel_job(context, **{**HIGH, "surfels": surfels, "links": links})
            yield Point({"surfels": surfels, "links": links}, job)


def _links_present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"].sort_values(["links", "surfels"])
    by_links = [(str(links), group.sort_values("surfels")) for links, group in ok.groupby("links")]
    axes = [
        Axes(
            title,
            "surfels",
            unit,
            [
                Series(
                    f"{links} links", group["surfels"].tolist(), (scale * group[column]).tolist()
                )
                for links, group in by_links
            ],
        )
        for title, column, unit, scale in (
            ("cache lighting", "cache_lighting_ms", "median, ms", 1),
            ("surfel lighting", "surfel_lighting_ms", "median, ms", 1),
            ("pull", "pull_ms", "median, ms", 1),
            ("error against the path-traced truth", "rel_l2", "relative L2 error, %", 100),
        )
    ]
    plot(kept.path / "surfel-links", axes, _TIMES_OF)
    shown = ["surfels", "links", *PASS_TIMES[:3], *ERRORS, "memory_bytes"]
    return "\n\n".join(
        (
            markdown(ok[shown], FORMATS),
            "![times and errors](surfel-links.png)",
            theirs("figure 8"),
        )
    )


LINKS = Experiment(
    name="surfel-links",
    title="Surfel caches: surfels by links",
    source="figure 8 of Jendersie et al. 2016",
    profiles=("iphone7",),
    keys=("surfels", "links"),
    columns=_COLUMNS,
    points=_links_points,
    measure=_measure,
    present=_links_present,
    truth=trace_truth,
    errors=ERROR_COLUMNS,
)


# -- bands ------------------------------------------------------------------------------------


def _bands_points(context: Context) -> Iterator[Point]:
    for projection in ("stored", "runtime"):
        for bands in (2, 3, 4):
            job = surfel_job(context, **{**HIGH, "sh_bands": bands}, projection=projection)
            yield Point({"projection": projection, "bands": bands}, job)


def _bands_present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    shown = ["projection", "bands", "cache_lighting_ms", "forward_render_ms", *ERRORS]
    return "\n\n".join(
        (
            "Diffuse light has nothing of the fourth band: a cosine's projection is 0 there. It is "
            "for gloss.",
            markdown(ok[[*shown, "memory_bytes"]], FORMATS),
            theirs("table 3"),
        )
    )


BANDS = Experiment(
    name="surfel-bands",
    title="Surfel caches: bands of spherical harmonics",
    source="table 3 and section 4.6 of Jendersie et al. 2016",
    profiles=("iphone7",),
    keys=("projection", "bands"),
    columns=_COLUMNS,
    points=_bands_points,
    measure=_measure,
    present=_bands_present,
    truth=trace_truth,
    errors=ERROR_COLUMNS,
)


# -- frames -----------------------------------------------------------------------------------

_SIZES = {"960x540": (960, 540), "1920x1080": (1920, 1080), "3840x2160": (3840, 2160)}


def _frame_points(context: Context) -> Iterator[Point]:
    for setup, settings in (("high", HIGH), ("moderate", MODERATE)):
        for projection in ("stored", "runtime"):
            for size in _SIZES:
                if setup == "moderate" and size != "1920x1080":
                    continue
                job = surfel_job(context, **settings, projection=projection)
                yield Point({"setup": setup, "projection": projection, "image": size}, job)


def _frame_measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    image = _SIZES[unit.point.key["image"]]
    return Found([pass_times(context, unit.point.job, worker, image)])


def _frame_present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    return "\n\n".join(
        (
            "`camera` is the image without indirect light, traced; `forward_render` adds the "
            "caches'. Theirs is rasterised and their shadow maps are a pass of their own. Of "
            "table 2 itself our copy shows no columns; what sections 5.3 and 5.3.1 say of it is "
            "below.",
            markdown(ok[["setup", "projection", "image", *PASS_TIMES, "memory_bytes"]]),
            theirs("section 5.3"),
        )
    )


FRAME = Experiment(
    name="surfel-frame",
    title="Surfel caches: every pass of both set-ups",
    source="table 2 and section 5.3 of Jendersie et al. 2016",
    profiles=("iphone7",),
    keys=("setup", "projection", "image"),
    columns=(*PASS_TIMES, "frames", "memory_bytes", "caches"),
    points=_frame_points,
    measure=_frame_measure,
    present=_frame_present,
)
