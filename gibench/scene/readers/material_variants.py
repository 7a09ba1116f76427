"""Materials that become several while images and colours are turned into what kernels know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Array
from gibench.scene.model import Material
from gibench.scene.readers.content import Content, Part


class Variants:
    """The materials and textures, growing."""

    def __init__(self, content: Content) -> None:
        self.materials = list(content.materials)
        self.textures = list(content.textures)
        self._numbers: dict[tuple[int, Material], int] = {}

    def number(self, original: int, material: Material) -> int:
        """The number of a variant of material ``original``."""
        key = original, material
        if key not in self._numbers:
            self._numbers[key] = len(self.materials)
            self.materials.append(material)
        return self._numbers[key]

    def in_place(self, parts: list[Part]) -> list[Part]:
        """The parts with every material that has become one other one in its old place."""
        variants: dict[int, list[int]] = {}
        for (original, _), number in self._numbers.items():
            variants.setdefault(original, []).append(number)
        used = {number for part in parts for number in numbers_of(part)}
        place = np.arange(len(self.materials))
        for original, numbers in variants.items():
            living = [number for number in numbers if number in used]
            if original not in used and len(living) == 1:
                place[living[0]] = original
                self.materials[original] = self.materials[living[0]]
        return [
            part if part.materials is None else replace(part, materials=place[part.materials])
            for part in parts
        ]


def numbers_of(part: Part) -> list[int]:
    """The materials of a part's triangles."""
    if not len(part.triangles):
        return []
    return [part.material] if part.materials is None else np.unique(part.materials).tolist()


def material_numbers(part: Part) -> Array:
    """The material (t,) of each triangle of a part."""
    if part.materials is None:
        return np.full(len(part.triangles), part.material, np.int64)
    return part.materials
