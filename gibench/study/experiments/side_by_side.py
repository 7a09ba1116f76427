"""Settled results against the reference, kept on disk so that pictures survive an interruption."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Doubles
from gibench.measure.runfolder.folder import write_atomically
from gibench.reference.lights import luminance
from gibench.report.images import tone_map
from gibench.report.plots import Picture, panel
from gibench.study.errors import METRICS, Truth
from gibench.study.experiments.common import Context
from gibench.study.frozen import FrozenShared
from gibench.study.pictures import SCALE
from gibench.study.quality import Group, group_of, rows_of
from gibench.study.settle import settle
from gibench.techniques.job import Job

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
    context: Context,
    job: Job,
    shared: FrozenShared,
    image: tuple[int, int],
    label: str,
) -> list[dict[str, Any]]:
    """Settle, keep the irradiance under ``label`` and return a row per region.

    Raises:
        GibenchError: it cannot run, or the disk refuses.
    """
    options, job = context.quality(), replace(job, shot=context.shot(image))
    group = group_of(job, options, shared)
    settled = settle(job, options.settle, shared, context.cl_device)
    keep(context, label, settled.irradiance)
    return [
        {name: row[name] for name in (*COLUMNS, "reason")}
        for row in rows_of(settled, group, options, shared, label)
    ]


def truth_of(context: Context, job: Job, shared: FrozenShared, image: tuple[int, int]) -> Group:
    """The receivers and the reference that ``job`` is compared with."""
    return group_of(replace(job, shot=context.shot(image)), context.quality(), shared)


def keep(context: Context, label: str, values: Doubles) -> None:
    """Keep ``values`` under ``label`` in the folder."""
    import io

    content = io.BytesIO()
    np.save(content, values.astype(np.float32))
    write_atomically(_file(context, label), content.getvalue())


def kept(context: Context, label: str) -> Doubles | None:
    """What was kept under ``label``, or None."""
    try:
        return np.asarray(np.load(_file(context, label), allow_pickle=False), np.float64)
    except (OSError, ValueError):
        return None


def result_panel(
    context: Context,
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
        values = kept(context, label)
        if values is None or len(values) != len(truth.value):
            continue
        image = truth.view.of(values)
        above.append(Picture(label, tone_map(image, truth.exposure)))
        signed = luminance(image - truth.seen)
        title = f"{label}, minus reference"
        below.append(Picture(title, signed, "RdBu_r", (-limit, limit), "W/m²"))
    panel(
        context.folder.path / name,
        [above, below, *more],
        "Indirect irradiance without albedo, through the lightmap; one exposure, one scale.",
    )
    return f"![{name}]({name}.png)"


def _file(context: Context, label: str) -> Path:
    from gibench.report.images import file_name

    return context.folder.path / "irradiance" / f"{file_name(label)}.npy"
