"""Equirectangular environment images: Radiance .hdr, OpenEXR .exr, and what Pillow reads."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.errors import BadInput
from gibench.scene.files import read_bytes
from gibench.scene.model import Environment
from gibench.scene.readers.textures import UnreadableImage, texture_from_bytes


def load_environment(path: Path, scale: float = 1.0) -> Environment:
    """Read an equirectangular image as radiance in W/m2/sr, times ``scale``.

    ``.hdr`` and ``.exr`` hold radiance; other images are decoded from sRGB.

    Raises:
        BadInput: it cannot be read, or holds negative or non-finite radiance.
    """
    data = read_bytes(path)
    if data.startswith((b"#?RADIANCE", b"#?RGBE")):
        pixels = _decode_hdr(data, path)
    elif data.startswith(b"\x76\x2f\x31\x01"):  # OpenEXR's magic number
        pixels = _read_exr(path)
    else:
        try:
            pixels = texture_from_bytes(path.name, data).pixels
        except UnreadableImage as error:
            raise BadInput(f"not an image that can be read ({error})", where=path) from error
    pixels = pixels * np.float32(scale)
    if not np.isfinite(pixels).all() or (pixels < 0).any():
        raise BadInput("the image holds negative, infinite or NaN radiance", where=path)
    return Environment(np.ascontiguousarray(pixels, np.float32))


def _read_exr(path: Path) -> Floats:
    try:
        import OpenEXR
    except ImportError as error:
        raise BadInput(
            "OpenEXR images need another package",
            where=path,
            mend="pip install 'gibench[exr]', or convert the image to .hdr",
        ) from error
    try:
        with OpenEXR.File(str(path)) as file:
            channels = file.channels()
            for name in ("RGB", "RGBA"):
                if name in channels:
                    return np.asarray(channels[name].pixels[..., :3], np.float32)
    except (RuntimeError, OSError, ValueError) as error:
        raise BadInput(f"not a sound OpenEXR file ({error})", where=path) from error
    raise BadInput("the OpenEXR file has no R, G and B channels", where=path)


def _decode_hdr(data: bytes, path: Path) -> Floats:
    """Radiance RGBE (Ward 1991, "Real Pixels", Graphics Gems II), flat or run-length coded.

    No package that we depend on reads this format.
    """
    match = re.search(rb"\n\s*\n-Y (\d+) \+X (\d+)\n", data[:65536])
    if match is None or b"FORMAT=32-bit_rle_rgbe" not in data[: match.start()]:
        raise BadInput("an .hdr file of a kind that is not read (RGBE, -Y +X is)", where=path)
    height, width = int(match[1]), int(match[2])
    body = np.frombuffer(data, np.uint8, offset=match.end())
    try:
        rgbe = _hdr_rows(body, height, width)
    except (IndexError, ValueError) as error:
        raise BadInput("the .hdr file is cut short or damaged", where=path) from error
    exponent = rgbe[..., 3:].astype(np.int32)
    scale = np.where(exponent == 0, 0.0, np.ldexp(1.0, exponent - 136))
    mantissa = rgbe[..., :3].astype(np.float64) + 0.5
    return (mantissa * scale).astype(np.float32)


def _hdr_rows(body: npt.NDArray[np.uint8], height: int, width: int) -> npt.NDArray[np.uint8]:
    """(height, width, 4) uint8."""
    run_length = 8 <= width < 32768 and bytes(body[:2]) == b"\x02\x02"
    if not run_length:
        return body[: height * width * 4].reshape(height, width, 4)
    rows = np.empty((height, 4, width), np.uint8)
    at = 0
    for row in rows:
        if bytes(body[at : at + 2]) != b"\x02\x02":
            raise ValueError("a row does not start with its marker")
        at += 4
        for channel in row:
            x = 0
            while x < width:
                count = int(body[at])
                same = count > 128  # a run of one value
                count -= 128 if same else 0
                length = 2 if same else 1 + count
                if count == 0 or x + count > width or at + length > len(body):
                    raise ValueError("a run leaves its row or the file")
                channel[x : x + count] = body[at + 1 : at + length]
                at += length
                x += count
    return rows.transpose(0, 2, 1)
