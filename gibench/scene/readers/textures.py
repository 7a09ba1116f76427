"""Images as linear textures."""

from __future__ import annotations

import io
import warnings

import numpy as np
from PIL import Image

from gibench.arrays import Floats, Vec3
from gibench.scene.model import Texture
from gibench.scene.readers.content import Array, vec3

# Textures only colour diffuse light here, so nothing is gained by more texels than this per side,
# and a 4096-square float image would take 200 MB.
MAX_SIDE = 1024


class UnreadableImage(Exception):
    """An image that Pillow cannot read; the message says why."""


def srgb_to_linear(encoded: Array) -> Floats:
    """Decode sRGB values in [0, 1] (IEC 61966-2-1, the piecewise curve)."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


_PILLOW_ERRORS = (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError)
_LINEAR_OF_BYTE = srgb_to_linear(np.arange(256) / 255.0)


def texture_from_image(name: str, image: Image.Image) -> Texture:
    """Turn an sRGB image into a texture of at most ``MAX_SIDE`` texels per side, without alpha.

    Raises:
        UnreadableImage: Pillow cannot read its pixels.
    """
    try:
        encoded = np.asarray(image.convert("RGB"))
    except _PILLOW_ERRORS as error:
        raise UnreadableImage(" ".join(str(error).split())) from error
    return Texture(name, _shrunk(_LINEAR_OF_BYTE[encoded]))


def texture_from_bytes(name: str, data: bytes) -> Texture:
    """Decode a PNG, JPEG, BMP, TGA, ... into a texture as ``texture_from_image`` does.

    Raises:
        UnreadableImage: Pillow cannot read it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's remarks on palettes and large images
            with Image.open(io.BytesIO(data)) as image:
                return texture_from_image(name, image)
    except _PILLOW_ERRORS as error:
        raise UnreadableImage(" ".join(str(error).split())) from error


def _shrunk(pixels: Floats) -> Floats:
    """Halve by box filter, in linear space, until no side is over ``MAX_SIDE``."""
    while max(pixels.shape[:2]) > MAX_SIDE:
        height, width = pixels.shape[:2]
        rows = 2 if height > 1 else 1
        columns = 2 if width > 1 else 1
        even = pixels[: height // rows * rows, : width // columns * columns]
        blocks = even.reshape(height // rows, rows, width // columns, columns, 3)
        pixels = blocks.mean(axis=(1, 3), dtype=np.float32)
    return pixels


def average(texture: Texture) -> Vec3:
    """Mean linear colour."""
    return vec3(texture.pixels.reshape(-1, 3).mean(axis=0, dtype=np.float64))
