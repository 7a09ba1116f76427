"""What materials say beyond a constant emission and an opaque colour, turned into that.

Kernels and the path-traced truth know surfaces of one emission and one albedo (times an image).
The rules, each applied to all meshes at load, and said in a warning where light may differ from
what the file's author saw:

- *Emission from an image*: a triangle emits what the image has at each point (``scene/glow.py``);
  its material has the mean over the texels that it covers.
- *Colours of vertices*: interpolated over the triangle through an image of four texels a triangle;
  where the material has an image already, the triangle's mean colour tints it.
- *Images of colour and emission without coordinates*: their mean.
- *Opacity* (glTF's BLEND, MTL's d and Tr; times its image and its vertices' alpha) *and
  transmission* (times its image): a part (the triangles of one object
  with one material) that lets more light through than it stops is left out; any other is opaque.
  What glows is never left out.
- *Cut-outs* (glTF's MASK, MTL's map_d): a triangle is there where opacity, times its image's texel,
  is at least the cutoff (``scene/cutouts.py``). Triangles with nothing left are left out.
- *Normal maps*: kept beside (``scene/normal_maps.py``), for what reads them.
- *Roughness and metalness*: of the material, times an image kept beside (``scene/gloss.py``).
- *Unlit*: lit as any other surface.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gibench.arrays import Array, Floats, Vec3
from gibench.scene.lightmap.albedo import covered_mean, mean_texture
from gibench.scene.model import Material, Texture
from gibench.scene.readers.content import Content, Part, counted, of_corners, vec3
from gibench.scene.readers.cut_out import cut_out
from gibench.scene.readers.image_layers import (
    bumpy,
    glossy,
    has_coordinates,
    plain_without_coordinates,
    remark_unsound_coordinates,
    say_bare,
)
from gibench.scene.readers.material_variants import Variants, material_numbers, numbers_of

# Emissions and tints that differ by less than this share are one material.
TINT_STEP = 1.0 / 1024
# Triangles are cut along each side into so many equal parts before images are averaged over them.
PIECES = 4


def realised(content: Content) -> Content:
    """The content with only what kernels know: see the module's rules."""
    table = Variants(content)
    notes: list[str] = []
    remark_unsound_coordinates(list(content.parts), content, notes)
    parts = _without_the_see_through(content, notes)
    parts, cutouts = cut_out(parts, content, notes)
    parts = [replace(part, alphas=None, transmission_uvs=None) for part in parts]
    glows = _Glows()
    parts = [_glowing(part, content, table, glows) for part in parts]
    say_bare("images of emission", glows.bare, notes)
    parts, normal_maps = bumpy(parts, content, notes)
    parts, gloss_maps = glossy(parts, content, table, notes)
    parts = plain_without_coordinates(parts, table, notes)
    parts = table.in_place(_coloured(parts, table, notes))
    used = {number for part in parts for number in numbers_of(part)}
    notes += _remarks([table.materials[number] for number in sorted(used)])
    return replace(
        content,
        parts=tuple(parts),
        materials=tuple(table.materials),
        textures=tuple(table.textures),
        warnings=(*content.warnings, *notes),
        maps=(),
        cutouts=cutouts,
        glows=tuple(glows.images),
        normal_maps=normal_maps,
        gloss_maps=gloss_maps,
    )


class _Glows:
    """The images of emitted radiance, growing."""

    def __init__(self) -> None:
        self.images: list[Floats] = []
        self.bare: list[str] = []  # materials whose image has no coordinates
        self._numbers: dict[tuple[int, Vec3], int] = {}

    def number(self, image: Texture, emission: Vec3) -> int:
        """The number of ``image`` times ``emission``."""
        key = id(image), emission
        if key not in self._numbers:
            self._numbers[key] = len(self.images)
            self.images.append(image.pixels * np.asarray(emission, np.float32))
        return self._numbers[key]


def _means(part: Part, image: Texture, uvs: Array | None) -> Array:
    """Mean (t, 3) of an image over each triangle; over all of it without coordinates."""
    if uvs is None or not len(uvs):
        whole = image.pixels.reshape(-1, 3).mean(axis=0, dtype=np.float64)
        return np.tile(whole, (len(part.triangles), 1))
    corners = of_corners(part, uvs)
    pieces = [mean_texture(image.pixels, piece) for piece in _pieces(corners)]
    return np.asarray(sum(pieces) / len(pieces))


def _pieces(corners: Array) -> Iterator[Array]:
    """The equal parts of triangles (t, 3, 2), each (t, 3, 2)."""
    for i in range(PIECES):
        for j in range(PIECES - i):
            low = np.array([(i, j), (i + 1, j), (i, j + 1)]) / PIECES
            yield _placed(corners, low)
            if i + j < PIECES - 1:
                yield _placed(corners, np.array([(i + 1, j + 1), (i, j + 1), (i + 1, j)]) / PIECES)


def _placed(corners: Array, places: Array) -> Array:
    sides = corners[:, 1:] - corners[:, :1]
    return np.asarray(corners[:, :1] + np.einsum("ps,tsx->tpx", places, sides))


def _without_the_see_through(content: Content, notes: list[str]) -> list[Part]:
    stays = [_opacity(part, content) >= 0.5 for part in content.parts]
    bare = [
        content.materials[part.material].name
        for part in content.parts
        if content.map_of(part.material).transmission is not None
        and not has_coordinates(
            part.uvs if part.transmission_uvs is None else part.transmission_uvs
        )
    ]
    say_bare("images of transmission", bare, notes)
    if all(stays):
        return list(content.parts)
    out = [part for part, stay in zip(content.parts, stays, strict=True) if not stay]
    names = list(dict.fromkeys(content.materials[part.material].name for part in out))
    told = ", ".join(names[:3])
    kept = [part for part, stay in zip(content.parts, stays, strict=True) if stay]
    if not any(len(part.triangles) for part in kept):
        notes.append(f"everything is see-through ({told}): drawn opaque")
        return list(content.parts)
    count = sum(len(part.triangles) for part in out)
    notes.append(
        f"{counted(count, 'triangle')} of surfaces that let more light through than they stop left "
        f"out ({told})"
    )
    return kept


def _opacity(part: Part, content: Content) -> float:
    """The share of light that a part stops, the mean over its area."""
    material, image = content.materials[part.material], content.map_of(part.material).opacity
    if any(material.emission) or not len(part.triangles):
        return 1.0
    opacity = np.ones(len(part.triangles))
    if material.alpha_mode == "blend":
        opacity *= material.opacity
        if image is not None:
            uvs = part.uvs if part.opacity_uvs is None else part.opacity_uvs
            opacity *= _means(part, image, uvs)[:, 0]
        if part.alphas is not None:
            opacity *= of_corners(part, part.alphas[:, None])[:, :, 0].mean(axis=1)
    passing = np.full(len(opacity), material.transmission)
    if glass := content.map_of(part.material).transmission:
        uvs = part.uvs if part.transmission_uvs is None else part.transmission_uvs
        passing *= _means(part, glass, uvs)[:, 0]
    stopped = opacity * (1.0 - passing)
    if np.ptp(stopped) == 0:
        return float(stopped[0])
    areas = _areas(part)
    return float(np.average(stopped, weights=areas)) if areas.sum() > 0 else float(stopped.mean())


def _areas(part: Part) -> Array:
    """Twice the area (t,) of each triangle; 0 where it is not finite."""
    corners = of_corners(part, part.positions)
    with np.errstate(all="ignore"):
        sides = corners[:, 1:] - corners[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.where(np.isfinite(areas), areas, 0.0)


def _glowing(part: Part, content: Content, table: Variants, glows: _Glows) -> Part:
    """The part with its emission's image, and each triangle's mean of it as its material's."""
    material, image = content.materials[part.material], content.map_of(part.material).emission
    if image is None or not any(material.emission) or not len(part.triangles):
        return part
    uvs = part.uvs if part.emission_uvs is None else part.emission_uvs
    is_plain = np.ptp(image.pixels.reshape(-1, 3), axis=0).max() == 0
    if not has_coordinates(uvs) and not is_plain:
        glows.bare.append(material.name)
    if uvs is None or not len(uvs) or is_plain:
        each = _means(part, image, None if is_plain else uvs)
    else:
        each = covered_mean(image.pixels, of_corners(part, uvs))
        own = np.where(each.max(axis=1) > 0, glows.number(image, material.emission), -1)
        part = replace(part, glow=own, emission_uvs=uvs)
    means, which = _grouped(each)
    emissions = [vec3(np.multiply(material.emission, mean)) for mean in means]
    numbers = [
        table.number(part.material, replace(material, emission=emission)) for emission in emissions
    ]
    return replace(part, materials=np.asarray(numbers, np.int64)[which])


def _grouped(values: Array) -> tuple[Array, Array]:
    """Means of rows that are alike up to ``TINT_STEP`` of the largest, and each row's group."""
    largest = float(values.max(initial=0.0)) or 1.0
    steps = np.round(values / (largest * TINT_STEP)).astype(np.int64)
    _, which = np.unique(steps, axis=0, return_inverse=True)
    which = which.reshape(-1)
    sums = np.zeros((int(which.max()) + 1, values.shape[1]))
    np.add.at(sums, which, values)
    return sums / np.bincount(which)[:, None], which


def _coloured(parts: list[Part], table: Variants, notes: list[str]) -> list[Part]:
    """The parts without ``colors``, which have gone into materials and one image."""
    result = list(parts)
    through_image: list[int] = []
    tinted = 0
    for place, part in enumerate(parts):
        if part.colors is None or not len(part.triangles):
            continue
        corners = of_corners(part, part.colors)
        if np.ptp(corners, axis=(0, 1)).max() == 0:
            result[place] = _tinted(part, corners[:1, 0], np.zeros(len(corners), np.int64), table)
        elif any(table.materials[number].texture >= 0 for number in numbers_of(part)):
            means, which = _grouped(corners.mean(axis=1))
            result[place] = _tinted(part, means, which, table)
            tinted += 1
        else:
            through_image.append(place)
    if tinted:
        notes.append(
            f"colours of vertices of {counted(tinted, 'part')} that have an image too: the mean of "
            "each triangle used"
        )
    if through_image:
        made = _through_image([parts[place] for place in through_image], table)
        for place, part in zip(through_image, made, strict=True):
            result[place] = part
    return result


def _tinted(part: Part, tints: Array, which: Array, table: Variants) -> Part:
    """The part with the albedo of its triangles times ``tints[which]``."""
    numbers = material_numbers(part)
    for number in np.unique(numbers).tolist():
        mine = numbers == number
        for tint in np.unique(which[mine]).tolist():
            material = table.materials[number]
            color = vec3(np.clip(np.multiply(material.base_color, tints[tint]), 0.0, 1.0))
            numbers = np.where(
                mine & (which == tint),
                table.number(number, replace(material, base_color=color)),
                numbers,
            )
    return replace(part, materials=numbers, colors=None)


def _through_image(parts: list[Part], table: Variants) -> list[Part]:
    """The parts with vertices of their own for every triangle, looked up in one image.

    A triangle has a block of two by two texels: its corners' colours a, b and c, and b + c - a,
    between which bilinear sampling is linear, but that it is kept from 0 to 1 as all albedos are.
    """
    counts = [len(part.triangles) for part in parts]
    side = int(np.ceil(np.sqrt(sum(counts))))
    corners = np.concatenate([of_corners(part, _colors(part)) for part in parts])
    pixels = np.zeros((side, 2, side, 2, 3), np.float32)
    block = np.arange(len(corners))
    row, column = block // side, block % side
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    for down, right, color in ((0, 0, a), (0, 1, b), (1, 0, c), (1, 1, np.clip(b + c - a, 0, 1))):
        pixels[row, down, column, right] = color
    texture = len(table.textures)
    table.textures.append(Texture("vertex colours", pixels.reshape(2 * side, 2 * side, 3)))
    texel = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    at = (texel + 2 * np.stack((column, row), axis=1)[:, None]) / (2 * side)
    uvs = np.stack((at[..., 0], 1.0 - at[..., 1]), axis=-1)
    result = []
    for part, mine in zip(parts, np.split(uvs, np.cumsum(counts)[:-1]), strict=True):
        numbers = material_numbers(part)
        for number in np.unique(numbers).tolist():
            own = table.number(number, replace(table.materials[number], texture=texture))
            numbers = np.where(numbers == number, own, numbers)
        result.append(replace(_split(part), uvs=mine.reshape(-1, 2), materials=numbers))
    return result


def _colors(part: Part) -> Array:
    assert part.colors is not None
    return part.colors


def _split(part: Part) -> Part:
    """The part with three vertices of its own for every triangle, without its other images."""
    outside = (part.triangles < 0) | (part.triangles >= len(part.positions))
    flat = np.where(outside, 0, part.triangles).reshape(-1)
    positions = part.positions[flat].astype(np.float64)
    positions[outside.reshape(-1)] = np.nan  # left to the cleaning of triangles
    return replace(
        part,
        positions=positions,
        triangles=np.arange(len(flat)).reshape(-1, 3),
        normals=None if part.normals is None else part.normals[flat],
        lightmap_uvs=None if part.lightmap_uvs is None else part.lightmap_uvs[flat],
        emission_uvs=None if part.emission_uvs is None else part.emission_uvs[flat],
        opacity_uvs=None if part.opacity_uvs is None else part.opacity_uvs[flat],
        normal_uvs=None if part.normal_uvs is None else part.normal_uvs[flat],
        gloss_uvs=None if part.gloss_uvs is None else part.gloss_uvs[flat],
        tangents=None if part.tangents is None else part.tangents[flat],
        colors=None,
    )


def _remarks(used: list[Material]) -> list[str]:
    """What the used materials say that is not used."""

    def say(kind: list[Material], what: str) -> list[str]:
        names = list(dict.fromkeys(material.name for material in kind))
        return (
            [f"{what.format(counted(len(names), 'material'))} ({', '.join(names[:3])})"]
            if names
            else []
        )

    blended = [m for m in used if m.alpha_mode == "blend" or m.transmission > 0]
    shiny = [m for m in used if m.roughness < 1 or m.metalness > 0 or m.roughness_map]
    return [
        *say(blended, "alpha or transmission of {}: taken as opaque where not left out"),
        *say(
            [m for m in used if m.normal_map], "normal maps of {} not used but by what is told to"
        ),
        *say(shiny, "gloss and metal of {} not used but by what reads them: surfaces are diffuse"),
        *say([m for m in used if m.unlit], "unlit {}: lit as others are"),
    ]
