"""Keyed albedo and emission bound to a scene: which surfaces, and what they are in a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Ints
from gibench.errors import BadInput
from gibench.scene.colours import Colours
from gibench.scene.glow import Glow
from gibench.scene.model import Material, Scene

NAMES_TOLD = 8
_RESTS = -1


@dataclass(frozen=True)
class ChangingMaterials:
    """A scene's materials with a row of its own for each that changes.

    Where an object of several, or only some objects of a material change, what changes and what
    rests are told apart by further rows, behind the scene's own.

    Attributes:
        colours: what changes.
        material: (r,) int32 the scene's material that each row is of.
        albedo_by: (r,) int32 which of ``colours`` says its albedo; -1 for none.
        emission_by: (r,) int32 likewise.
        material_ids: (t,) int32 the triangles' rows.
    """

    colours: tuple[Colours, ...]
    material: Ints = field(repr=False)
    albedo_by: Ints = field(repr=False)
    emission_by: Ints = field(repr=False)
    material_ids: Ints = field(repr=False)

    @staticmethod
    def of(scene: Scene, colours: Sequence[Colours]) -> ChangingMaterials:
        """Bind ``colours`` to the objects and materials of ``scene``.

        Raises:
            BadInput: there is no such object or material, or the same is said twice of one surface.
        """
        by = np.full((2, len(scene.triangles)), _RESTS)
        for number, one in enumerate(colours):
            mine = _surfaces(scene, one)
            for what, keys, said in zip(
                ("albedo", "emission"), (one.albedo, one.emission), by, strict=True
            ):
                if not keys:
                    continue
                if (said[mine] != _RESTS).any():
                    raise BadInput(f"the {what} of '{one.name}' is keyed twice", mend="key it once")
                said[mine] = number
        own = np.stack([scene.material_ids.astype(np.int64), *by], axis=1)
        changed = (by != _RESTS).any(axis=0)
        further, place = np.unique(own[changed], axis=0, return_inverse=True)
        count = len(scene.materials)
        rests = np.stack([np.arange(count), *np.full((2, count), _RESTS)], axis=1)
        rows = np.concatenate([rests, further.reshape(-1, 3)]).astype(np.int32)
        ids = scene.material_ids.astype(np.int32).copy()
        ids[changed] = count + place.reshape(-1)
        return ChangingMaterials(tuple(colours), rows[:, 0], rows[:, 1], rows[:, 2], ids)

    @property
    def changing(self) -> npt.NDArray[np.bool_]:
        """Which rows change, (r,)."""
        return np.asarray((self.albedo_by != _RESTS) | (self.emission_by != _RESTS))

    @property
    def triangles(self) -> npt.NDArray[np.bool_]:
        """Which of the scene's triangles change, (t,)."""
        return np.asarray(self.changing[self.material_ids])

    def materials_in(self, scene: Scene, frame: int) -> tuple[Material, ...]:
        """The rows' materials in ``frame``."""
        now = [one.at(frame) for one in self.colours]
        found = []
        for material, albedo_by, emission_by in zip(
            self.material.tolist(), self.albedo_by.tolist(), self.emission_by.tolist(), strict=True
        ):
            made = scene.materials[material]
            albedo = now[albedo_by][0] if albedo_by != _RESTS else None
            emission = now[emission_by][1] if emission_by != _RESTS else None
            if albedo is not None:
                made = replace(made, base_color=albedo)
            if emission is not None:
                made = replace(made, emission=emission)
            found.append(made)
        return tuple(found)

    def scene_in(self, scene: Scene, frame: int) -> Scene:
        """``scene`` with its materials as they are in ``frame``."""
        return replace(
            scene,
            materials=self.materials_in(scene, frame),
            material_ids=self.material_ids,
            glow=self._glow(scene.glow),
        )

    def brightest(self) -> Doubles:
        """The most that each row ever sends out, (r, 3) W/m2/sr; 0 where nothing is keyed."""
        keyed = np.array([one.brightest for one in self.colours], np.float64).reshape(-1, 3)
        return np.where((self.emission_by != _RESTS)[:, None], keyed[self.emission_by], 0.0)

    def note(self) -> str:
        """What changes, for a report."""
        return (
            f"albedo or emission of {int(np.count_nonzero(self.triangles)):,} triangles changes "
            f"over frames ({', '.join(dict.fromkeys(one.name for one in self.colours))})"
        )

    def _glow(self, glow: Glow | None) -> Glow | None:
        """Without the triangles whose emission is keyed."""
        if glow is None:
            return None
        keeps = (self.emission_by == _RESTS)[self.material_ids[glow.triangle]]
        if keeps.all():
            return glow
        if not keeps.any():
            return None
        return Glow(glow.images, glow.triangle[keeps], glow.image[keeps], glow.uvs[keeps])


def _surfaces(scene: Scene, one: Colours) -> npt.NDArray[np.bool_]:
    """The triangles (t,) that ``one`` is of.

    Raises:
        BadInput: there is none of its name.
    """
    if one.of_material:
        names = [material.name for material in scene.materials]
        mine = np.array([name == one.name for name in names], np.bool_)
        found = mine[scene.material_ids]
        if not mine.any():
            raise unknown("material", one.name, scene, names)
    else:
        ids = np.unique(scene.object_ids)
        listed = scene.object_names
        names = [listed[i] if i < len(listed) else "" for i in ids.tolist()]
        mine = np.array([name == one.name for name in names], np.bool_)
        found = mine[scene.object_numbers()]
        if not mine.any():
            raise unknown("object", one.name, scene, names)
    return np.asarray(found, np.bool_)


def unknown(kind: str, name: str, scene: Scene, names: Sequence[str]) -> BadInput:
    """That a scene has no ``kind`` of this name, with those it has."""
    there = list(dict.fromkeys(filter(None, names)))
    if not there:
        return BadInput(
            f"no {kind} called '{name}' in scene '{scene.name}'",
            mend=f"its {kind}s have no names",
        )
    told = get_close_matches(name, there, NAMES_TOLD) or there[:NAMES_TOLD]
    more = f" and {len(there) - len(told)} more" if len(there) > len(told) else ""
    return BadInput(
        f"no {kind} called '{name}' in scene '{scene.name}'",
        mend=f"it has {', '.join(told)}{more}",
    )
