"""Equirectangular environment images: Radiance .hdr, OpenEXR .exr, and what Pillow reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gibench.arrays import Floats
from gibench.errors import BadInput
from gibench.scene.environment import Environment
from gibench.scene.files import read_bytes
from gibench.scene.readers.float_images import UnreadableImage, floats_from_bytes
from gibench.scene.readers.textures import texture_from_bytes


def load_environment(path: Path, scale: float = 1.0) -> Environment:
    """Read an equirectangular image as radiance in W/m2/sr, times ``scale``.

    ``.hdr`` and ``.exr`` hold radiance; other images are decoded from sRGB.

    Raises:
        BadInput: it cannot be read, or holds negative or non-finite radiance.
    """
    data = read_bytes(path)
    try:
        pixels = floats_from_bytes(data)
        if pixels is None:
            pixels = _of_other_kind(path, data)
    except UnreadableImage as error:
        raise BadInput(str(error), where=path, mend=error.mend) from error
    pixels = pixels * np.float32(scale)
    if not np.isfinite(pixels).all() or (pixels < 0).any():
        raise BadInput("the image holds negative, infinite or NaN radiance", where=path)
    return Environment(np.ascontiguousarray(pixels, np.float32))


def _of_other_kind(path: Path, data: bytes) -> Floats:
    try:
        return texture_from_bytes(path.name, data).pixels
    except UnreadableImage as error:
        raise UnreadableImage(f"not an image that can be read ({error})") from error
