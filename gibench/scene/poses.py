"""How an object moves: rigidly, as a function of the frame's number.

A pose is always applied to the object as it lies in the scene's files, its object space, never to
where it was in the frame before: rounding does not add up.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from gibench.arrays import Doubles, Vec3
from gibench.errors import BadInput

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

Matrix3 = tuple[Vec3, Vec3, Vec3]

IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
RIGID_TOLERANCE = 1e-5
"""How far a rotation's rows may be from orthonormal: a few roundings of float32."""


@dataclass(frozen=True)
class Turn:
    """An object turns about an axis, round and round or to and fro.

    Attributes:
        name: of the object; all objects of that name move as one.
        axis: it turns about, counter-clockwise seen from its tip; any length but 0.
        through: a point of the axis, m; None for the middle of the object's bounds.
        period_frames: frames for one turn, or for one swing there and back.
        swing_degrees: it swings by this angle to each side; 0 to turn round.

    Raises:
        BadInput: there is no such axis or period.
    """

    name: str
    axis: Vec3
    through: Vec3 | None = None
    period_frames: int = 240
    swing_degrees: float = 0.0

    def __post_init__(self) -> None:
        _finite(self.name, self.axis, self.through or (), (self.swing_degrees,))
        if not any(self.axis):
            raise BadInput(f"the axis of '{self.name}' is 0, 0, 0", mend="give it a direction")
        if self.period_frames < 1:
            raise BadInput(
                f"'{self.name}' has a period of {self.period_frames} frames", mend="give 1 or more"
            )

    def pose(self, frame: int) -> tuple[Doubles, Doubles]:
        """Rotation (3, 3) about ``through`` and then translation (3,) m in ``frame``."""
        phase = 2.0 * math.pi * (frame % self.period_frames) / self.period_frames
        angle = math.radians(self.swing_degrees) * math.sin(phase) if self.swing_degrees else phase
        axis = np.asarray(self.axis, np.float64)
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        return turn.as_matrix(), np.zeros(3)


@dataclass(frozen=True)
class Keyframes:
    """An object moves through poses: translations joined by monotone cubics (PCHIP), which never
    overshoot, rotations by the shorter way round (spherical linear interpolation).

    It rests in its first pose before them, and in its last one after them unless they repeat.

    Attributes:
        name: of the object; all objects of that name move as one.
        frames: the frames of the poses, ascending, at least two.
        positions: translations from where the object lies in the scene, m, one per frame.
        rotations: row-major rotations about ``through``, one per frame.
        through: what the object turns about, m; None for the middle of its bounds.
        repeat: begin anew after the last pose, which should be the first one then.

    Raises:
        BadInput: they make no motion, or one that is not rigid.
    """

    name: str
    frames: tuple[int, ...]
    positions: tuple[Vec3, ...]
    rotations: tuple[Matrix3, ...]
    through: Vec3 | None = None
    repeat: bool = False

    def __post_init__(self) -> None:
        who, count = f"the motion of '{self.name}'", len(self.frames)
        if count < 2:
            raise BadInput(f"{who} has {count} keyframe(s)", mend="give at least two")
        if self.frames[0] < 0 or any(b <= a for a, b in pairwise(self.frames)):
            raise BadInput(
                f"the keyframes of '{self.name}' are at {', '.join(map(str, self.frames))}",
                mend="give frames from 0 up in ascending order",
            )
        for what, values in (("positions", self.positions), ("rotations", self.rotations)):
            if len(values) != count:
                raise BadInput(
                    f"{who} has {count} frames and {len(values)} {what}",
                    mend="give one for every frame",
                )
        _finite(self.name, self.through or (), *self.positions, *(sum(self.rotations, ())))
        for number, rotation in enumerate(self.rotations, 1):
            if not is_rotation(np.array(rotation)):
                raise BadInput(
                    f"keyframe {number} of '{self.name}' is not rigid",
                    mend="give a rotation and a translation, without scale, shear or mirroring",
                )

    def pose(self, frame: int) -> tuple[Doubles, Doubles]:
        """Rotation (3, 3) about ``through`` and then translation (3,) m in ``frame``."""
        first, last = self.frames[0], self.frames[-1]
        if self.repeat and frame > last:
            frame = first + (frame - first) % (last - first)
        at = min(max(frame, first), last)
        curve, turns, onwards = self._between
        key = min(bisect_right(self.frames, at), len(self.frames) - 1) - 1
        share = (at - self.frames[key]) / (self.frames[key + 1] - self.frames[key])
        turn = turns[key] @ Rotation.from_rotvec(share * onwards[key]).as_matrix()
        return turn, np.asarray(curve(at), np.float64)

    @cached_property
    def _between(self) -> tuple[PchipInterpolator, Doubles, Doubles]:
        """The positions' curve, the rotations (k, 3, 3), and from each to the next one, by the
        shorter way, a rotation vector (k - 1, 3).
        """
        from scipy.interpolate import PchipInterpolator  # slow to load

        turns = Rotation.from_matrix(np.array(self.rotations))
        curve = PchipInterpolator(self.frames, np.array(self.positions))
        return curve, turns.as_matrix(), (turns[:-1].inv() * turns[1:]).as_rotvec()


Motion = Turn | Keyframes


def is_rotation(matrix: Doubles) -> bool:
    """Whether ``matrix`` is 3 x 3, orthonormal and does not mirror."""
    return (
        matrix.shape == (3, 3)
        and bool(np.allclose(matrix @ matrix.T, np.eye(3), rtol=0, atol=RIGID_TOLERANCE))
        and bool(np.linalg.det(matrix) > 0)
    )


def _finite(name: str, *groups: tuple[float, ...]) -> None:
    if not all(math.isfinite(value) for group in groups for value in group):
        raise BadInput(f"the motion of '{name}' has a number that is not finite")


def turn_about(axis: int, degrees: float) -> Doubles:
    """The rotation (3, 3) about axis number ``axis``."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix
