"""Regions of a camera's image: from the scene's settings or the command line, a box or a mask."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gibench.arrays import Bools
from gibench.errors import BadInput
from gibench.scene.model import Camera, Scene

WHOLE = "whole"


def read_regions(
    scene: Scene, camera: Camera, given: Sequence[str], width: int, height: int
) -> dict[str, Bools]:
    """The masks (h, w) by name: the scene's for this camera, then those ``given``.

    Args:
        scene: its own regions are taken too.
        camera: what is looked through.
        given: ``name=left,top,right,bottom`` as shares of the image, or ``name=mask.png``, an
            image of its size whose bright pixels (128 of 255 or more) belong to it.
        width: of the image, pixels.
        height: of the image, pixels.

    Raises:
        BadInput: one cannot be read, leaves the image or holds no pixel.
    """
    found: dict[str, Bools] = {}
    for region in scene.regions:
        if region.camera in ("", camera.name):
            found[region.name] = _box(region.box, f"region {region.name}", width, height)
    for text in given:
        name, mask = _given(text, width, height)
        found[name] = mask
    return found


def _given(text: str, width: int, height: int) -> tuple[str, Bools]:
    name, _, value = text.partition("=")
    name, value = name.strip(), value.strip()
    option = f"--region {text}"
    if not name or not value or name == WHOLE:
        raise BadInput(
            f"'{text}' is no region",
            where="--region",
            mend="write name=left,top,right,bottom in shares of the image, or name=mask.png",
        )
    parts = value.split(",")
    if len(parts) == 4:
        try:
            left, top, right, bottom = (float(part) for part in parts)
        except ValueError:
            pass
        else:
            return name, _box((left, top, right, bottom), option, width, height)
    return name, _mask_file(Path(value), option, width, height)


def _box(box: tuple[float, float, float, float], where: str, width: int, height: int) -> Bools:
    left, top, right, bottom = box
    if not all(math.isfinite(x) for x in box) or min(box) < 0 or max(box) > 1:
        raise BadInput(
            f"the box {left:g},{top:g},{right:g},{bottom:g} leaves the image",
            where=where,
            mend="give left, top, right and bottom as shares of the image, from 0 to 1",
        )
    mask = np.zeros((height, width), np.bool_)
    mask[
        round(top * height) : round(bottom * height), round(left * width) : round(right * width)
    ] = 1
    if not mask.any():
        raise BadInput(
            f"the box {left:g},{top:g},{right:g},{bottom:g} holds no pixel",
            where=where,
            mend="give left before right and top before bottom, further apart",
        )
    return mask


def _mask_file(path: Path, where: str, width: int, height: int) -> Bools:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("L"))
    except (OSError, UnidentifiedImageError) as error:
        raise BadInput(
            f"'{path.name}' is neither four numbers nor an image that can be read", where=where
        ) from error
    if pixels.shape != (height, width):
        raise BadInput(
            f"the mask is {pixels.shape[1]} x {pixels.shape[0]} pixels, not {width} x {height}",
            where=where,
            mend="scale one of them (--resolution)",
        )
    mask = pixels >= 128
    if not mask.any():
        raise BadInput("no pixel of the mask is bright", where=where)
    return mask
