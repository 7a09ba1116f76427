"""Images of linear floats: Radiance .hdr and OpenEXR."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats


class UnreadableImage(Exception):
    """An image that cannot be read; the message says why.

    Attributes:
        mend: what to do about it, or None.
    """

    def __init__(self, what: str, mend: str | None = None) -> None:
        super().__init__(what)
        self.mend = mend


def floats_from_bytes(data: bytes) -> Floats | None:
    """The pixels (h, w, 3) of an .hdr or .exr file, as they stand; None of any other.

    Raises:
        UnreadableImage: it is damaged, of a kind that is not read, or needs a package.
    """
    if data.startswith((b"#?RADIANCE", b"#?RGBE")):
        return _decode_hdr(data)
    if data.startswith(b"\x76\x2f\x31\x01"):  # OpenEXR's magic number
        return _decode_exr(data)
    return None


def _decode_exr(data: bytes) -> Floats:
    try:
        import OpenEXR
    except ImportError as error:
        raise UnreadableImage(
            "OpenEXR images need another package",
            "pip install 'gibench[exr]', or convert the image to .hdr",
        ) from error
    try:
        with tempfile.TemporaryDirectory() as folder:  # the package reads files only
            path = Path(folder) / "image.exr"
            path.write_bytes(data)
            with OpenEXR.File(str(path)) as file:
                channels = file.channels()
                for name in ("RGB", "RGBA"):
                    if name in channels:
                        return np.array(channels[name].pixels[..., :3], np.float32)
    except (RuntimeError, OSError, ValueError) as error:
        raise UnreadableImage(f"not a sound OpenEXR file ({error})") from error
    raise UnreadableImage("the OpenEXR file has no R, G and B channels")


def _decode_hdr(data: bytes) -> Floats:
    """Radiance RGBE (Ward 1991, "Real Pixels", Graphics Gems II), flat or run-length coded.

    No package that we depend on reads this format.
    """
    match = re.search(rb"\n\s*\n-Y (\d+) \+X (\d+)\n", data[:65536])
    if match is None or b"FORMAT=32-bit_rle_rgbe" not in data[: match.start()]:
        raise UnreadableImage("an .hdr file of a kind that is not read (RGBE, -Y +X is)")
    height, width = int(match[1]), int(match[2])
    body = np.frombuffer(data, np.uint8, offset=match.end())
    try:
        rgbe = _hdr_rows(body, height, width)
    except (IndexError, ValueError) as error:
        raise UnreadableImage("the .hdr file is cut short or damaged") from error
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
