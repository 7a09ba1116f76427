"""Images as linear textures."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable

import numpy as np
from PIL import Image

from gibench.arrays import Array, Floats
from gibench.scene.model import Texture
from gibench.scene.normal_maps import normals_of_heights, unit_normals
from gibench.scene.readers.float_images import UnreadableImage, floats_from_bytes

# Textures only colour diffuse light here, so nothing is gained by more texels than this per side,
# and a 4096-square float image would take 200 MB.
MAX_SIDE = 1024


def srgb_to_linear(encoded: Array) -> Floats:
    """Decode sRGB values in [0, 1] (IEC 61966-2-1, the piecewise curve)."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


_PILLOW_ERRORS = (
    OSError, ValueError, SyntaxError, EOFError, KeyError, IndexError, TypeError, OverflowError,
    NotImplementedError, AttributeError, MemoryError, Image.DecompressionBombError,
)  # fmt: skip
_LINEAR_OF_BYTE = srgb_to_linear(np.arange(256) / 255.0)
# Rec. 601, as Pillow turns colours to grey.
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
# Pillow's modes of 16 bits a channel; it opens 16-bit PNGs as one of them, or as I.
_SIXTEEN_BITS = ("I;16", "I;16L", "I;16B", "I;16N", "I")


def texture_from_bytes(name: str, data: bytes) -> Texture:
    """Decode a PNG, JPEG, BMP, TGA, TIFF, HDR, EXR, ... into a texture of colours, at most
    ``MAX_SIDE`` texels per side, without alpha.

    Whole numbers are sRGB, 16 bits as 8 bits; floats are linear, kept from 0 to 1.

    Raises:
        UnreadableImage: it cannot be read.
    """
    return Texture(name, np.clip(radiance_from_bytes(name, data).pixels, 0.0, 1.0))


def radiance_from_bytes(name: str, data: bytes) -> Texture:
    """The same of what an image emits, which may be over 1 where its numbers are floats.

    Raises:
        UnreadableImage: it cannot be read.
    """
    pixels = floats_from_bytes(data)
    if pixels is None:
        pixels = _read(data, _linear)
    sound = np.nan_to_num(pixels, nan=0.0, posinf=0.0, neginf=0.0)
    return Texture(name, _shrunk(np.maximum(sound, np.float32(0))))


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


def channel_from_bytes(name: str, data: bytes, channel: str) -> Texture:
    """One channel of an image as it stands in three equal ones: ``r``, ``g``, ``b``, ``l`` for its
    grey or ``m`` for its alpha (MTL's ``-imfchan``).

    Raises:
        UnreadableImage: it cannot be read, or has no such channel.
    """
    if channel == "m":
        alpha = alpha_from_bytes(name, data)
        if alpha is None:
            raise UnreadableImage("has no alpha")
        return alpha
    codes = _codes(data).astype(np.float32)
    if channel not in ("r", "g", "b", "l"):
        raise UnreadableImage(f"has no channel '{channel}'")
    if channel == "l":
        grey = codes @ _LUMA if codes.shape[2] == 3 else codes[:, :, 0]
    else:
        grey = codes[:, :, min("rgb".index(channel), codes.shape[2] - 1)]
    return Texture(name, _shrunk(_grey(grey)))


def normals_from_bytes(name: str, data: bytes) -> Texture:
    """An image of tangent space normals (glTF 2.0, 3.9.3), as unit vectors.

    Raises:
        UnreadableImage: it cannot be read, or has one channel.
    """
    codes = _codes(data)
    if codes.shape[2] == 1:
        raise UnreadableImage("has one channel, as images of heights have")
    vectors = _shrunk((2.0 * codes - 1.0).astype(np.float32))
    return Texture(name, unit_normals(vectors))


def bumps_from_bytes(name: str, data: bytes, strength: float) -> Texture:
    """An image of heights (MTL's ``bump``) as unit vectors; one in the colours of normals, which
    people name so too, is taken as normals.

    Raises:
        UnreadableImage: it cannot be read.
    """
    codes = _codes(data)
    if codes.shape[2] == 3 and _are_normals(codes):
        return Texture(name, unit_normals(_shrunk((2.0 * codes - 1.0).astype(np.float32))))
    heights = _shrunk(_grey(codes.mean(axis=2).astype(np.float32)))[:, :, 0]
    return Texture(name, normals_of_heights(heights, strength))


def gloss_from_bytes(name: str, data: bytes) -> Texture:
    """An image of roughness (green) and metalness (blue; glTF 2.0, 3.9.2), its numbers as they
    stand; one of greys is both.

    Raises:
        UnreadableImage: it cannot be read.
    """
    codes = _codes(data)
    channels = [np.zeros_like(codes[:, :, -1]), codes[:, :, codes.shape[2] // 2], codes[:, :, -1]]
    return Texture(name, _shrunk(np.stack(channels, axis=2).astype(np.float32)))


def grey_from_bytes(name: str, data: bytes) -> Texture:
    """An image of one number (MTL's ``map_Pr`` and ``map_Pm``) as it stands, the mean of its
    channels, in three equal ones.

    Raises:
        UnreadableImage: it cannot be read.
    """
    return Texture(name, _shrunk(_grey(_codes(data).mean(axis=2).astype(np.float32))))


def resampled(pixels: Array, height: int, width: int) -> Floats:
    """An image (h, w, k) looked up bilinearly, with repeat, at the texels of another size."""
    at = []
    for size, own in ((height, pixels.shape[0]), (width, pixels.shape[1])):
        place = (np.arange(size) + 0.5) / size * own - 0.5
        low = np.floor(place).astype(np.int64)
        at.append((low % own, (low + 1) % own, place - low))
    (top, bottom, down), (left, right, across) = at
    across, down = across[None, :, None], down[:, None, None]
    upper = pixels[top][:, left] * (1 - across) + pixels[top][:, right] * across
    lower = pixels[bottom][:, left] * (1 - across) + pixels[bottom][:, right] * across
    return np.asarray(upper * (1 - down) + lower * down, np.float32)


def gloss_of(roughness: Texture | None, metalness: Texture | None) -> Texture | None:
    """Grey images of both as one in green and blue, at the larger's size; 1 where one is missing,
    None where both are.
    """
    given = [image for image in (roughness, metalness) if image is not None]
    if not given:
        return None
    height, width = (max(image.pixels.shape[axis] for image in given) for axis in (0, 1))
    pixels = np.ones((height, width, 3), np.float32)
    pixels[:, :, 0] = 0.0
    for channel, layer in enumerate((roughness, metalness), 1):
        if layer is not None:
            pixels[:, :, channel] = resampled(layer.pixels[:, :, :1], height, width)[:, :, 0]
    return Texture(given[0].name, pixels)


def _are_normals(codes: Array) -> bool:
    """Whether colours (h, w, 3) are those of normals: no greys, and of length 1 by and large."""
    length = np.linalg.norm(2 * codes - 1, axis=2)
    return bool(np.ptp(codes, axis=2).mean() > 0.1 and np.abs(length - 1).mean() < 0.2)


def _codes(data: bytes) -> Array:
    """The numbers of an image as they stand, 0 to 1, (h, w, 1 or 3)."""
    pixels = floats_from_bytes(data)
    if pixels is None:
        pixels = _read(data, _plain)
    return np.clip(np.nan_to_num(pixels.astype(np.float64)), 0.0, 1.0)


def _plain(image: Image.Image) -> Floats:
    if image.mode == "F":
        return np.asarray(image, np.float32)[:, :, None]
    if image.mode in _SIXTEEN_BITS:
        return (np.asarray(image).astype(np.float32) / np.float32(65535))[:, :, None]
    grey = image.mode in ("1", "L", "LA")
    codes = np.asarray(image.convert("L" if grey else "RGB"), np.float32) / np.float32(255)
    return codes[:, :, None] if grey else codes


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
