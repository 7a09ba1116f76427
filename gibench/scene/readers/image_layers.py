"""Images that are kept beside a scene for what reads them: normal maps, roughness and metalness;
and what there is in place of an image without texture coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Array, Floats
from gibench.scene.readers.content import Content, Maps, Part, counted, vec3
from gibench.scene.readers.material_variants import Variants, material_numbers


def has_coordinates(uvs: Array | None) -> bool:
    """Whether there is anywhere to look an image up."""
    return uvs is not None and len(uvs) > 0


def plain_without_coordinates(parts: list[Part], table: Variants, notes: list[str]) -> list[Part]:
    """The parts with their colour's image at its mean where they have no coordinates in it."""
    result, bare = [], []
    for part in parts:
        result.append(part)
        if has_coordinates(part.uvs) or not len(part.triangles):
            continue
        numbers = material_numbers(part)
        for number in np.unique(numbers).tolist():
            material = table.materials[number]
            if material.texture < 0:
                continue
            pixels = table.textures[material.texture].pixels.reshape(-1, 3)
            color = np.multiply(material.base_color, pixels.mean(axis=0, dtype=np.float64))
            plain = replace(material, base_color=vec3(np.clip(color, 0.0, 1.0)), texture=-1)
            numbers = np.where(numbers == number, table.number(number, plain), numbers)
            if np.ptp(pixels, axis=0).max() > 0:
                bare.append(material.name)
        result[-1] = replace(part, materials=numbers)
    say_bare("images of colour", bare, notes)
    return result


def remark_unsound_coordinates(parts: list[Part], content: Content, notes: list[str]) -> None:
    """Note coordinates of images that are NaN or infinite."""
    count = 0
    for part in parts:
        has_image = content.materials[part.material].texture >= 0
        if part.uvs is None or not (has_image or any_image(content.map_of(part.material))):
            continue
        count += int((~np.isfinite(part.uvs).all(axis=1)).sum())
    if count:
        notes.append(f"{counted(count, 'texture coordinate')} not finite: 0 used")


def any_image(maps: Maps) -> bool:
    """Whether a material has an image beside that of its colour."""
    images = maps.emission, maps.opacity, maps.normal, maps.gloss, maps.transmission
    return any(image is not None for image in images)


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
    say_bare("normal maps", bare, notes, "not used")
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
    say_bare("images of roughness", bare, notes)
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


def say_bare(
    what: str, names: list[str], notes: list[str], instead: str = "their mean used"
) -> None:
    """Note the materials whose images have no coordinates, and what there is instead."""
    if names:
        told = list(dict.fromkeys(names))
        materials = counted(len(told), "material")
        names_told = ", ".join(told[:3])
        notes.append(f"{what} of {materials} without coordinates ({names_told}): {instead}")
