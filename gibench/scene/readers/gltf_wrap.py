"""Images of glTF that are clamped or mirrored beyond their edges (glTF 2.0, 5.26), as images that
repeat, which is all that the truth and the kernels know.

A clamped axis gets as many copies of its outermost texels as its coordinates reach beyond the
image, a mirrored one its neighbours turned round; coordinates follow. Every look up then gives what
the sampler would.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.scene.model import Material, Texture
from gibench.scene.readers.content import Content, Maps, Part

REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
Wrap = tuple[int, int]
"""Modes along u and v."""

# Clamped images grow by so many of their own sides at each end at most.
_MOST_SIDES = 4
# Of each slot: the attribute of parts that holds its coordinates.
_COORDINATES = {
    "color": ("uvs", "opacity_uvs"),
    "emission": ("emission_uvs",),
    "normal": ("normal_uvs",),
    "gloss": ("gloss_uvs",),
    "transmission": ("transmission_uvs",),
}


@dataclass(frozen=True)
class _Grown:
    """What becomes of one axis of an image.

    Attributes:
        mode: of the sampler.
        texels: that are added at both ends.
        twice: whether the image and its mirror image stand beside each other instead.
    """

    mode: int
    texels: int = 0
    twice: bool = False

    def image(self, pixels: Array, axis: int) -> Array:
        """The image (h, w, c), grown along ``axis``."""
        if self.twice:
            both = (pixels, np.flip(pixels, axis))
            # v goes up, rows go down.
            return np.concatenate(both if axis else both[::-1], axis)
        if not self.texels:
            return pixels
        widths = [(self.texels, self.texels) if axis == at else (0, 0) for at in range(3)]
        return np.pad(pixels, widths, mode="edge" if self.mode == CLAMP else "symmetric")

    def coordinates(self, at: Array, size: int) -> Array:
        """Coordinates (v,) of an axis of ``size`` texels in the grown image."""
        if self.twice:
            return at / 2
        if not self.texels:
            return at
        within = at
        if self.mode == CLAMP:
            within = np.clip(at, -_MOST_SIDES, 1 + _MOST_SIDES)
        return np.asarray((within * size + self.texels) / (size + 2 * self.texels))


def wrapped(
    content: Content, wraps: Sequence[Mapping[str, Wrap]], ignored: Counter[str]
) -> Content:
    """The content with images that repeat alone.

    Args:
        content: as read.
        wraps: of each material, by slot; those that repeat may be left out.
        ignored: where to count clamped images whose coordinates reach too far.
    """
    table = _Table(list(content.parts), list(content.textures), ignored)
    materials, maps = list(content.materials), list(content.maps)
    for number, slots in enumerate(wraps):
        for slot, wrap in slots.items():
            if wrap != (REPEAT, REPEAT):
                made = table.grow(number, materials[number], maps[number], slot, wrap)
                materials[number], maps[number] = made
    return replace(
        content,
        parts=tuple(table.parts),
        textures=tuple(table.textures),
        materials=tuple(materials),
        maps=tuple(maps),
    )


@dataclass
class _Table:
    """Parts and textures of a content whose images are being grown."""

    parts: list[Part]
    textures: list[Texture]
    ignored: Counter[str]
    numbers: dict[tuple[int, tuple[_Grown, _Grown]], int] = field(default_factory=dict)

    def grow(
        self, number: int, material: Material, maps: Maps, slot: str, wrap: Wrap
    ) -> tuple[Material, Maps]:
        """The material and its maps with the images of ``slot`` grown; parts are changed here."""
        image: Texture | None
        if slot == "color":
            image = self.textures[material.texture] if material.texture >= 0 else maps.opacity
        else:
            image = getattr(maps, slot)
        mine = [i for i, part in enumerate(self.parts) if part.material == number]
        attribute = _COORDINATES[slot][0]
        uvs = [getattr(self.parts[i], attribute) for i in mine]
        given = [values for values in uvs if values is not None and len(values)]
        if image is None or not given:
            return material, maps
        height, width = image.pixels.shape[:2]
        axes = self._grown(np.concatenate(given), wrap, (width, height))
        for i, values in zip(mine, uvs, strict=True):
            if values is None:
                continue
            moved = [
                axis.coordinates(values[:, k].astype(np.float64), size)
                for k, (axis, size) in enumerate(zip(axes, (width, height), strict=True))
            ]
            changed: dict[str, Any] = dict.fromkeys(_COORDINATES[slot], np.stack(moved, axis=1))
            self.parts[i] = replace(self.parts[i], **changed)
        if slot != "color":
            grown: dict[str, Any] = {slot: _grown_image(image, axes)}
            return material, replace(maps, **grown)
        if maps.opacity is not None:
            maps = replace(maps, opacity=_grown_image(maps.opacity, axes))
        if material.texture >= 0:
            material = replace(material, texture=self._texture(material.texture, axes))
        return material, maps

    def _grown(self, uvs: Array, wrap: Wrap, sizes: tuple[int, int]) -> tuple[_Grown, _Grown]:
        sound = uvs[np.isfinite(uvs).all(axis=1)]
        if not len(sound):
            return _Grown(REPEAT), _Grown(REPEAT)
        found = []
        for mode, size, low, high in zip(
            wrap, sizes, sound.min(axis=0), sound.max(axis=0), strict=True
        ):
            beyond = max(0.0, -float(low), float(high) - 1)
            if mode == CLAMP and beyond > _MOST_SIDES:
                self.ignored[f"clamped images beyond {_MOST_SIDES} of their sides"] += 1
            texels = 1 + int(np.ceil(min(beyond, _MOST_SIDES) * size))
            if mode == REPEAT:
                found.append(_Grown(mode))
            elif mode == MIRROR and texels > size / 2:
                found.append(_Grown(mode, twice=True))
            else:
                found.append(_Grown(mode, texels))
        return found[0], found[1]

    def _texture(self, number: int, axes: tuple[_Grown, _Grown]) -> int:
        key = number, axes
        if key not in self.numbers:
            self.numbers[key] = len(self.textures)
            self.textures.append(_grown_image(self.textures[number], axes))
        return self.numbers[key]


def _grown_image(image: Texture, axes: tuple[_Grown, _Grown]) -> Texture:
    along_u, along_v = axes
    return replace(image, pixels=along_v.image(along_u.image(image.pixels, 1), 0))
