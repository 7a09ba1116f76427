"""Settled results against the reference, and their pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gibench.reference.luminance import luminance
from gibench.report.images import tone_map
from gibench.report.plots import Picture, panel
from gibench.study.errors import METRICS, Truth
from gibench.study.experiments.common import Context
from gibench.study.experiments.kept import Found, Kept
from gibench.study.pictures import SCALE
from gibench.study.quality import group_of
from gibench.study.quality_rows import Group, rows_of
from gibench.study.settle import settle
from gibench.techniques.job import Job
from gibench.work import Worker

COLUMNS = (
    "region",
    *METRICS,
    *(f"{name}_noise" for name in METRICS),
    *("time_ms", "memory_bytes", "frames", "settled", "receivers", "reference_error"),
)
FORMATS = {
    "bias": ".2%",
    "rel_l2": ".2%",
    "rel_mse": ".4g",
    "lab_l_mse": ".4g",
    "flip": ".4f",
    "ssim": ".4f",
}
SHOWN = tuple(FORMATS)


def compared(
    context: Context, job: Job, worker: Worker, image: tuple[int, int], label: str
) -> Found:
    """Settle: a row per region, and the irradiance under ``label``.

    Raises:
        GibenchError: it cannot run.
    """
    options, site, job = context.quality(), context.site, replace(job, shot=context.shot(image))
    group = group_of(job, options, site)
    settled = settle(job, options.settle, site.standing(), site.cl_device, worker)
    rows = [
        {name: row[name] for name in (*COLUMNS, "reason")}
        for row in rows_of(settled, group, options, label)
    ]
    return Found(rows, arrays={label: settled.irradiance})


def truth_of(context: Context, job: Job, image: tuple[int, int]) -> Group:
    """The receivers and the reference that ``job`` is compared with."""
    return group_of(replace(job, shot=context.shot(image)), context.quality(), context.site)


def trace_truth(context: Context, job: Job) -> str:
    """Trace what ``job`` is compared with, where that is not in the cache yet; its key there."""
    return group_of(job, context.quality(), context.site).reference_key


def result_panel(
    kept: Kept,
    name: str,
    truth: Truth,
    labels: Sequence[str],
    more: Sequence[Sequence[Picture | None]] = (),
) -> str:
    """A panel: the reference and the results above, their signed differences below.

    Returns:
        The Markdown that shows it.
    """
    above: list[Picture | None] = [Picture("reference", tone_map(truth.seen, truth.exposure))]
    limit = SCALE / truth.exposure
    below: list[Picture | None] = [None]
    for label in labels:
        values = kept.array(label)
        if values is None or len(values) != len(truth.value):
            continue
        image = truth.view.of(values)
        above.append(Picture(label, tone_map(image, truth.exposure)))
        signed = luminance(image - truth.seen)
        title = f"{label}, minus reference"
        below.append(Picture(title, signed, "RdBu_r", (-limit, limit), "W/m²"))
    panel(
        kept.path / name,
        [above, below, *more],
        "Indirect irradiance without albedo, through the lightmap; one exposure, one scale.",
    )
    return f"![{name}]({name}.png)"
