"""A scene's motions bound to it: what moves or changes, and where and what it is in a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.errors import BadInput
from gibench.scene.colours import Change, Colours
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.scene.motion.changing_materials import ChangingMaterials, unknown
from gibench.scene.poses import Motion


@dataclass(frozen=True)
class MovingObjects:
    """The objects of a scene that move, and its materials that change.

    Objects are numbered as :meth:`Scene.object_numbers` does; the others rest where they are.

    Attributes:
        motions: what they do.
        numbers: the objects of every motion.
        pivots: (m, 3) what every motion turns about, m.
        objects: objects in the scene, moving or not.
        triangles: (t,) which of the scene's triangles move.
        materials: those that change, or None.
        held: the frame in which all of it stands still, whatever frame is asked for, or None.
    """

    motions: tuple[Motion, ...]
    numbers: tuple[Ints, ...] = field(repr=False)
    pivots: Doubles = field(repr=False)
    objects: int
    triangles: npt.NDArray[np.bool_] = field(repr=False)
    materials: ChangingMaterials | None = field(default=None, repr=False)
    held: int | None = None

    @staticmethod
    def of(scene: Scene, changes: Sequence[Change], held: int | None = None) -> MovingObjects:
        """Bind ``changes`` to the objects and materials of ``scene``.

        Raises:
            BadInput: there is no such object or material, an object has two motions or shares a
                vertex with another one, or a surface's albedo or emission is keyed twice.
        """
        motions = [one for one in changes if not isinstance(one, Colours)]
        colours = [one for one in changes if isinstance(one, Colours)]
        ids = np.unique(scene.object_ids)
        names = scene.object_names
        name_of = np.array([names[i] if i < len(names) else "" for i in ids.tolist()], object)
        triangle_objects = scene.object_numbers()
        mover = np.full(len(ids), -1)  # the motion of every object
        pivots = []
        for number, motion in enumerate(motions):
            mine = name_of == motion.name
            if not mine.any():
                raise unknown("object", motion.name, scene, name_of.tolist())
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
            ChangingMaterials.of(scene, colours) if colours else None,
            held,
        )

    @property
    def moves(self) -> bool:
        """Whether any triangle moves."""
        return bool(self.triangles.any())

    def frame_of(self, frame: int) -> int:
        """The frame in which things are as they shall be in ``frame``."""
        return frame if self.held is None else self.held

    def transforms_in(self, frame: int) -> Doubles:
        """Every object's transform from object space to the world in ``frame``, (objects, 3, 4)."""
        frame = self.frame_of(frame)
        transforms = np.tile(np.eye(3, 4), (self.objects, 1, 1))
        for motion, numbers, pivot in zip(self.motions, self.numbers, self.pivots, strict=True):
            turn, shift = motion.pose(frame)
            transforms[numbers, :, :3] = turn
            transforms[numbers, :, 3] = pivot - turn @ pivot + shift
        return transforms

    def scene_in(self, scene: Scene, frame: int) -> Scene:
        """``scene`` as it lies in ``frame``, at rest there; its lights as they are."""
        frame = self.frame_of(frame)
        if self.materials is not None:
            scene = self.materials.scene_in(scene, frame)
        if not self.moves:
            return scene
        vertices, objects = self.vertices(scene)
        m = self.transforms_in(frame)[objects]
        positions, normals = scene.positions.copy(), scene.normals.copy()
        positions[vertices] = _moved_points(m, scene.positions[vertices])
        normals[vertices] = _turned(m, scene.normals[vertices])
        return replace(scene, positions=positions, normals=normals)

    def lightmap_in(self, scene: Scene, lightmap: Lightmap, frame: int) -> Lightmap:
        """``lightmap`` with its receivers where they are in ``frame``, and what they cover."""
        if not self.moves:
            return lightmap
        transforms, objects = self.transforms_in(frame), scene.object_numbers()
        receivers, fragments = lightmap.receivers, lightmap.fragments
        mine = np.flatnonzero(self.receivers(lightmap))
        position, normal = receivers.position.copy(), receivers.normal.copy()
        if len(mine):
            m = transforms[objects[receiver_triangles(lightmap)[mine]]]
            position[mine] = _moved_points(m, receivers.position[mine])
            normal[mine] = _turned(m, receivers.normal[mine])
        pieces = np.flatnonzero(self.triangles[fragments.triangle])
        corners = fragments.corners.copy()
        m = transforms[objects[fragments.triangle[pieces]]]
        for corner in range(3):
            corners[pieces, corner] = _moved_points(m, fragments.corners[pieces, corner])
        return replace(
            lightmap,
            receivers=replace(receivers, position=position, normal=normal),
            fragments=replace(fragments, corners=corners),
        )

    def receivers(self, lightmap: Lightmap) -> npt.NDArray[np.bool_]:
        """Which receivers (n,) lie on what moves, by the largest piece of surface of each."""
        triangle = receiver_triangles(lightmap)
        return np.asarray((triangle >= 0) & self.triangles[np.maximum(triangle, 0)])

    def note(self) -> str:
        """What moves and changes, for a report."""
        told = [] if self.materials is None else [self.materials.note()]
        if self.moves:
            told.insert(0, self._moves_note())
        return "; ".join(told)

    def _moves_note(self) -> str:
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


def receiver_triangles(lightmap: Lightmap) -> Ints:
    """The triangle on which the largest piece of each receiver's surface lies, (n,) int32; -1 where
    it covers none.
    """
    fragments = lightmap.fragments
    found = np.full(len(lightmap.receivers), -1, np.int32)
    counts = np.diff(fragments.start)
    has = np.flatnonzero(counts)
    owner = np.repeat(np.arange(len(found)), counts)
    order = np.lexsort((fragments.area, owner))
    found[has] = fragments.triangle[order[fragments.start[has + 1] - 1]]
    return found


def _moved_points(transforms: Doubles, points: npt.NDArray[np.floating[Any]]) -> Floats:
    """Points (n, 3) by transforms (n, 3, 4), computed in float64."""
    found = np.einsum("nij,nj->ni", transforms[:, :, :3], points.astype(np.float64))
    return np.asarray(found + transforms[:, :, 3], np.float32)


def _turned(transforms: Doubles, directions: npt.NDArray[np.floating[Any]]) -> Floats:
    """Directions (n, 3) by transforms (n, 3, 4), computed in float64."""
    found = np.einsum("nij,nj->ni", transforms[:, :, :3], directions.astype(np.float64))
    return np.asarray(found, np.float32)


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
