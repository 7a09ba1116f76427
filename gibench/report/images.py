"""Linear images to PNG: one exposure for all images of a scene, so that they can be compared."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.measure.runfolder.folder import write_atomically

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Rec. 709 luminance weights of linear RGB."""

METHOD = (
    "exposure: the 99th percentile of the first frame's luminance maps to 1, the same for every "
    "image of a scene; tone curve: ACES filmic (fit of Narkowicz 2015); sRGB encoding"
)


@dataclass
class ImageWriter:
    """Writes the images of a run beneath a folder.

    Attributes:
        folder: ``images`` of the run's folder.
        exposures: chosen so far, by scene name.
    """

    folder: Path
    exposures: dict[str, float] = field(default_factory=dict)

    def write(self, scene: str, configuration: str, images: dict[str, npt.NDArray[Any]]) -> None:
        """Write ``images`` (linear radiance (h, w, 3), by title) of one configuration.

        Raises:
            GibenchError: the disk refuses.
        """
        for title, image in images.items():
            exposure = self.exposures.setdefault(scene, exposure_of(image))
            path = self.folder / file_name(configuration) / f"{file_name(title)}.png"
            write_atomically(path, png(tone_map(image, exposure)))


def exposure_of(image: npt.NDArray[Any]) -> float:
    """The factor that maps the 99th percentile of the luminance to 1; 1 for a black image."""
    luminance = np.nan_to_num(np.asarray(image, np.float64)) @ LUMINANCE
    bright = float(np.percentile(luminance, 99))
    return 1.0 / bright if bright > 0 else 1.0


def tone_map(image: npt.NDArray[Any], exposure: float) -> npt.NDArray[np.uint8]:
    """(h, w, 3) linear radiance to 8-bit sRGB; what is not finite becomes magenta, to be seen."""
    linear = np.asarray(image, np.float64) * exposure
    broken = ~np.isfinite(linear).all(axis=-1)
    x = np.clip(np.nan_to_num(linear), 0.0, 1e4)
    # Narkowicz 2015, "ACES Filmic Tone Mapping Curve".
    x = np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0)
    # IEC 61966-2-1.
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    out = np.round(encoded * 255).astype(np.uint8)
    out[broken] = (255, 0, 255)
    return out


def png(pixels: npt.NDArray[np.uint8]) -> bytes:
    """8-bit sRGB pixels (h, w, 3) as a PNG file."""
    from PIL import Image

    file = BytesIO()
    Image.fromarray(pixels, "RGB").save(file, format="PNG")
    return file.getvalue()


def file_name(title: str) -> str:
    """``title`` as a file name: letters, digits, dots and dashes."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", title).strip("-.") or "unnamed"
