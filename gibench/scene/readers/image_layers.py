"""Images that are kept beside a scene for what reads them: normal maps, roughness and metalness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Floats
from gibench.scene.readers.content import Array, Content, Part, counted
from gibench.scene.readers.material_variants import Variants, material_numbers


def bumpy(
    parts: list[Part], content: Content, notes: list[str]
) -> tuple[list[Part], tuple[tuple[Floats, float], ...]]:
    """The parts with their normal maps, and the maps with their scales."""
    numbers: dict[tuple[int, float], int] = {}
    found: list[tuple[Floats, float]] = []
    result, bare = [], []
    for part in parts:
        maps = content.map_of(part.material)
        uvs = part.uvs if part.normal_uvs is None else part.normal_uvs
        if maps.normal is None or not len(part.triangles):
            result.append(replace(part, normal_uvs=None, tangents=None))
        elif uvs is None or not len(uvs):
            bare.append(content.materials[part.material].name)
            result.append(replace(part, normal_uvs=None, tangents=None))
        else:
            key = id(maps.normal), maps.normal_scale
            if key not in numbers:
                numbers[key] = len(found)
                found.append((maps.normal.pixels, maps.normal_scale))
            own = np.full(len(part.triangles), numbers[key])
            result.append(replace(part, bump=own, normal_uvs=uvs))
    _say_bare("normal maps", bare, notes)
    return result, tuple(found)


def glossy(
    parts: list[Part], content: Content, table: Variants, notes: list[str]
) -> tuple[list[Part], tuple[Floats, ...]]:
    """The parts with their images of roughness and metalness, and the images. Where a part has no
    coordinates, and where an image is of one colour, its mean goes into the material.
    """
    numbers: dict[int, int] = {}
    found: list[Floats] = []
    result, bare = [], []
    for part in parts:
        image = content.map_of(part.material).gloss
        uvs = part.uvs if part.gloss_uvs is None else part.gloss_uvs
        if image is None or not len(part.triangles):
            result.append(replace(part, gloss_uvs=None))
            continue
        pixels = image.pixels[:, :, 1:]
        is_plain = np.ptp(pixels.reshape(-1, 2), axis=0).max() == 0
        has_none = uvs is None or not len(uvs)
        if has_none or is_plain:
            if has_none and not is_plain:
                bare.append(content.materials[part.material].name)
            mean = pixels.reshape(-1, 2).mean(axis=0, dtype=np.float64).tolist()
            materials = _scaled(part, table, mean[0], mean[1])
            result.append(replace(part, materials=materials, gloss_uvs=None))
            continue
        if id(image) not in numbers:
            numbers[id(image)] = len(found)
            found.append(pixels)
        own = np.full(len(part.triangles), numbers[id(image)])
        result.append(replace(part, gloss=own, gloss_uvs=uvs))
    _say_bare("images of roughness", bare, notes)
    return result, tuple(found)


def _scaled(part: Part, table: Variants, roughness: float, metalness: float) -> Array:
    """The materials (t,) of the part's triangles with theirs times these."""
    numbers = material_numbers(part)
    result = numbers.copy()
    for number in np.unique(numbers).tolist():
        material = table.materials[number]
        plain = replace(
            material,
            roughness=material.roughness * roughness,
            metalness=material.metalness * metalness,
        )
        result[numbers == number] = table.number(number, plain)
    return result


def _say_bare(what: str, names: list[str], notes: list[str]) -> None:
    """Note the materials whose images have no coordinates."""
    if names:
        told = list(dict.fromkeys(names))
        materials = counted(len(told), "material")
        notes.append(f"{what} of {materials} without coordinates ({', '.join(told[:3])})")
