"""Pictures of a comparison: reference, result, signed difference on one scale, error heat map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.measure.runfolder.folder import write_atomically
from gibench.reference.luminance import luminance
from gibench.report.images import file_name, png, tone_map
from gibench.report.plots import Picture, panel
from gibench.study.errors import Truth

# The ends of the scale, as a share of the reference's 99th percentile of luminance: the same for
# every result, so that pictures can be compared.
SCALE = 0.25


def write_pictures(folder: Path, truth: Truth, name: str, result: Doubles) -> None:
    """Write ``reference.png`` and, beneath a folder of its name, a result's pictures.

    Args:
        folder: ``images``.
        truth: the reference and its view.
        name: the result's.
        result: (n, 3) irradiance, W/m2.

    Raises:
        GibenchError: the disk refuses.
    """
    mine = folder / file_name(name)
    seen, image = tone_map(truth.seen, truth.exposure), truth.view.of(result)
    write_atomically(folder / "reference.png", png(seen))
    write_atomically(mine / "result.png", png(tone_map(image, truth.exposure)))
    limit = SCALE / truth.exposure
    signed = luminance(image - truth.seen)
    error = np.sqrt(((image - truth.seen) ** 2).mean(axis=-1))
    write_atomically(mine / "difference.png", png(colored(signed, "RdBu_r", -limit, limit)))
    write_atomically(mine / "error.png", png(colored(error, "inferno", 0.0, limit)))
    unit = "W/m²"
    panel(
        mine / "panel",
        [
            [
                Picture("reference: indirect irradiance", seen),
                Picture(name, tone_map(image, truth.exposure)),
            ],
            [
                Picture("result minus reference", signed, "RdBu_r", (-limit, limit), unit),
                Picture("error (r.m.s. of channels)", error, "inferno", (0.0, limit), unit),
            ],
        ],
        "The same exposure and scales for every result of these receivers.",
    )


def colored(values: npt.NDArray[Any], colors: str, low: float, high: float) -> npt.NDArray[Any]:
    """Values (h, w) through a colour map, 8-bit sRGB (h, w, 3)."""
    from matplotlib import colormaps

    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(colormaps[colors](share)[..., :3] * 255 + 0.5, np.uint8)
