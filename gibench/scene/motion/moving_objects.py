"""A scene's motions bound to its objects: what moves, and where it is in a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Ints
from gibench.errors import BadInput
from gibench.scene.model import Scene
from gibench.scene.poses import Motion

_NAMES_TOLD = 8


@dataclass(frozen=True)
class MovingObjects:
    """The objects of a scene that move.

    Objects are numbered as :meth:`Scene.object_numbers` does; the others rest where they are.

    Attributes:
        motions: what they do.
        numbers: the objects of every motion.
        pivots: (m, 3) what every motion turns about, m.
        objects: objects in the scene, moving or not.
        triangles: (t,) which of the scene's triangles move.
    """

    motions: tuple[Motion, ...]
    numbers: tuple[Ints, ...] = field(repr=False)
    pivots: Doubles = field(repr=False)
    objects: int
    triangles: npt.NDArray[np.bool_] = field(repr=False)

    @staticmethod
    def of(scene: Scene, motions: Sequence[Motion]) -> MovingObjects:
        """Bind ``motions`` to the objects of ``scene``.

        Raises:
            BadInput: there is no such object, it has two motions, or it shares a vertex with
                another object.
        """
        ids = np.unique(scene.object_ids)
        names = scene.object_names
        name_of = np.array([names[i] if i < len(names) else "" for i in ids.tolist()], object)
        triangle_objects = scene.object_numbers()
        mover = np.full(len(ids), -1)  # the motion of every object
        pivots = []
        for number, motion in enumerate(motions):
            mine = name_of == motion.name
            if not mine.any():
                raise _unknown(motion.name, scene, name_of.tolist())
            if (mover[mine] >= 0).any():
                raise BadInput(f"object '{motion.name}' has two motions", mend="give it one")
            mover[mine] = number
            if motion.through is None:
                used = scene.positions[scene.triangles[mine[triangle_objects]]].astype(np.float64)
                pivots.append((used.min(axis=(0, 1)) + used.max(axis=(0, 1))) / 2)
            else:
                pivots.append(np.asarray(motion.through, np.float64))
        of_triangle = mover[triangle_objects]
        _refuse_shared_vertices(scene, of_triangle, motions)
        return MovingObjects(
            tuple(motions),
            tuple(np.flatnonzero(mover == n).astype(np.int32) for n in range(len(motions))),
            np.array(pivots, np.float64).reshape(-1, 3),
            len(ids),
            of_triangle >= 0,
        )

    def transforms_in(self, frame: int) -> Doubles:
        """Every object's transform from object space to the world in ``frame``, (objects, 3, 4)."""
        transforms = np.tile(np.eye(3, 4), (self.objects, 1, 1))
        for motion, numbers, pivot in zip(self.motions, self.numbers, self.pivots, strict=True):
            turn, shift = motion.pose(frame)
            transforms[numbers, :, :3] = turn
            transforms[numbers, :, 3] = pivot - turn @ pivot + shift
        return transforms

    def note(self) -> str:
        """What moves, for a report."""
        moved = sum(len(numbers) for numbers in self.numbers)
        return (
            f"{moved} of {self.objects} objects move, with "
            f"{int(np.count_nonzero(self.triangles)):,} triangles; the tree is refitted to them "
            "every frame and never built anew, so that rays may take longer the further they have "
            "moved"
        )

    def vertices(self, scene: Scene) -> tuple[Ints, Ints]:
        """The vertices that move, ascending, and the object of each, (n,) int32."""
        triangles = scene.triangles[self.triangles]
        found, first = np.unique(triangles, return_index=True)
        objects = np.repeat(scene.object_numbers()[self.triangles], 3)[first]
        return found.astype(np.int32), objects.astype(np.int32)


def _unknown(name: str, scene: Scene, names: list[str]) -> BadInput:
    there = list(dict.fromkeys(filter(None, names)))
    if not there:
        return BadInput(
            f"no object called '{name}' in scene '{scene.name}'", mend="its objects have no names"
        )
    told = get_close_matches(name, there, _NAMES_TOLD) or there[:_NAMES_TOLD]
    more = f" and {len(there) - len(told)} more" if len(there) > len(told) else ""
    return BadInput(
        f"no object called '{name}' in scene '{scene.name}'",
        mend=f"it has {', '.join(told)}{more}",
    )


def _refuse_shared_vertices(scene: Scene, of_triangle: Ints, motions: Sequence[Motion]) -> None:
    least = np.full(len(scene.positions), len(motions))
    most = np.full(len(scene.positions), -2)
    for corner in scene.triangles.T:
        np.minimum.at(least, corner, of_triangle)
        np.maximum.at(most, corner, of_triangle)
    if len(torn := np.flatnonzero(least < most)):
        name = motions[most[torn[0]]].name
        raise BadInput(
            f"object '{name}' shares {len(torn)} vertices with another one",
            mend="give every object its own vertices",
        )
