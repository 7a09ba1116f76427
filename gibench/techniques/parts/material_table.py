"""The materials as kernels read them, declared once.

A material is a row of numbers and a row of texture slots. To add to it, add a line to ``FIELDS`` or
``SLOTS``: sizes, bytes and the macros of ``kernels_cl/common/material.cl`` follow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.scene.model import Material, Scene


@dataclass(frozen=True)
class Field:
    """Numbers of a material.

    Attributes:
        name: kernels know it as ``MATERIAL_<name>``.
        floats: how many.
        of: finds them.
    """

    name: str
    floats: int
    of: Callable[[Material], Sequence[float]]


@dataclass(frozen=True)
class Slot:
    """A texture of a material.

    Attributes:
        name: kernels know it as ``MATERIAL_<name>``.
        of: finds its index into ``Scene.textures``, -1 without.
    """

    name: str
    of: Callable[[Material], int]


FIELDS = (
    Field("BASE_COLOR", 3, lambda material: material.base_color),
    Field("EMISSION", 3, lambda material: material.emission),
    Field("ROUGHNESS", 1, lambda material: (material.roughness,)),
    Field("METALNESS", 1, lambda material: (material.metalness,)),
)
SLOTS = (Slot("BASE_COLOR_TEXTURE", lambda material: material.texture),)

MATERIAL_FLOATS = sum(field.floats for field in FIELDS)
SLOT_INTS = 3
"""First texel, width and height of a slot's image."""
SRGB_CODES = 256


def material_macros() -> dict[str, int]:
    """The layout as macros: a field's first number, a slot's place, and the sizes of both rows."""
    macros = {"MATERIAL_FLOATS": MATERIAL_FLOATS, "MATERIAL_SLOTS": len(SLOTS)}
    first = 0
    for field in FIELDS:
        macros[f"MATERIAL_{field.name}"] = first
        first += field.floats
    return macros | {f"MATERIAL_{slot.name}": place for place, slot in enumerate(SLOTS)}


def material_table(materials: Sequence[Material]) -> Floats:
    """The numbers of ``materials``, (m, MATERIAL_FLOATS) float32."""
    rows = [[x for field in FIELDS for x in field.of(material)] for material in materials]
    return np.array(rows, np.float32).reshape(len(materials), MATERIAL_FLOATS)


def pack_textures(scene: Scene) -> tuple[Ints, npt.NDArray[np.uint8]]:
    """Where each material's textures lie, (m, slots, 3) int32: first texel, width and height, -1
    without texture; and all texels, (n, 4) uint8, sRGB.
    """
    sizes = [texture.pixels.shape[0] * texture.pixels.shape[1] for texture in scene.textures]
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    texels = np.zeros((int(first[-1]), 4), np.uint8)
    for texture, start, size in zip(scene.textures, first, sizes, strict=False):
        texels[start : start + size, :3] = srgb_codes(texture.pixels.reshape(-1, 3))
    table = np.full((len(scene.materials), len(SLOTS), SLOT_INTS), -1, np.int32)
    for row, material in zip(table, scene.materials, strict=True):
        for entry, slot in zip(row, SLOTS, strict=True):
            if (index := slot.of(material)) >= 0:
                height, width = scene.textures[index].pixels.shape[:2]
                entry[:] = first[index], width, height
    return table, texels


def srgb_to_linear() -> Floats:
    """What each of the sRGB codes means (IEC 61966-2-1), (SRGB_CODES,) float32."""
    code = np.arange(SRGB_CODES) / 255.0
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def srgb_codes(linear: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """The nearest sRGB codes of ``linear`` values, any shape; values outside [0, 1] are clamped."""
    x = np.clip(np.asarray(linear, np.float32), 0.0, 1.0)
    code = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055)
    return np.rint(code * 255.0).astype(np.uint8)
