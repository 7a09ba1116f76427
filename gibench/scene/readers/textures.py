"""Images as linear textures."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable

import numpy as np
from PIL import Image

from gibench.arrays import Floats
from gibench.scene.model import Texture
from gibench.scene.readers.content import Array

# Textures only colour diffuse light here, so nothing is gained by more texels than this per side,
# and a 4096-square float image would take 200 MB.
MAX_SIDE = 1024


class UnreadableImage(Exception):
    """An image that Pillow cannot read; the message says why."""


def srgb_to_linear(encoded: Array) -> Floats:
    """Decode sRGB values in [0, 1] (IEC 61966-2-1, the piecewise curve)."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


_PILLOW_ERRORS = (
    OSError, ValueError, SyntaxError, EOFError, KeyError, IndexError, TypeError, OverflowError,
    NotImplementedError, AttributeError, MemoryError, Image.DecompressionBombError,
)  # fmt: skip
_LINEAR_OF_BYTE = srgb_to_linear(np.arange(256) / 255.0)
# Pillow's modes of 16 bits a channel; it opens 16-bit PNGs as one of them, or as I.
_SIXTEEN_BITS = ("I;16", "I;16L", "I;16B", "I;16N", "I")


def texture_from_bytes(name: str, data: bytes) -> Texture:
    """Decode a PNG, JPEG, BMP, TGA, TIFF, ... into a texture of at most ``MAX_SIDE`` texels per
    side, without alpha.

    Whole numbers are sRGB, 16 bits as 8 bits; floats are linear.

    Raises:
        UnreadableImage: Pillow cannot read it.
    """
    return Texture(name, _shrunk(_read(data, _linear)))


def alpha_from_bytes(name: str, data: bytes) -> Texture | None:
    """The alpha of an image in three equal channels, or None where it has none.

    Raises:
        UnreadableImage: Pillow cannot read it.
    """
    alpha = _read(data, _alpha)
    return None if not alpha.size else Texture(name, _shrunk(_grey(alpha)))


def opacity_from_bytes(name: str, data: bytes) -> Texture:
    """An image of opacities (MTL's ``map_d``) in three equal channels: its alpha, else its grey as
    it stands.

    Raises:
        UnreadableImage: Pillow cannot read it.
    """
    alpha = alpha_from_bytes(name, data)
    if alpha is not None:
        return alpha
    return Texture(name, _shrunk(_grey(_read(data, _encoded_grey))))


def _read(data: bytes, use: Callable[[Image.Image], Floats]) -> Floats:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's remarks on palettes and large images
            with Image.open(io.BytesIO(data)) as image:
                return np.asarray(use(image))
    except _PILLOW_ERRORS as error:
        raise UnreadableImage(" ".join(str(error).split())) from error


def _linear(image: Image.Image) -> Floats:
    if image.mode == "F":
        pixels = np.nan_to_num(np.asarray(image, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
        return _grey(np.clip(pixels, 0, None))
    if image.mode in _SIXTEEN_BITS:
        pixels = np.asarray(image).astype(np.float64)
        return _grey(srgb_to_linear(np.clip(pixels / 65535, 0, 1)))
    return np.asarray(_LINEAR_OF_BYTE[np.asarray(image.convert("RGB"))])


def _alpha(image: Image.Image) -> Floats:
    if "A" not in image.getbands() and "transparency" not in image.info:
        return np.empty(0, np.float32)
    return np.asarray(image.convert("RGBA").getchannel("A"), np.float32) / np.float32(255)


def _encoded_grey(image: Image.Image) -> Floats:
    return np.asarray(image.convert("L"), np.float32) / np.float32(255)


def _grey(pixels: Floats) -> Floats:
    return np.repeat(np.asarray(pixels, np.float32)[:, :, None], 3, axis=2)


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
