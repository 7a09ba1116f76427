"""How the albedo and emission of an object or a material change, by the frame's number."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gibench.arrays import Vec3
from gibench.errors import BadInput
from gibench.scene.poses import Motion


@dataclass(frozen=True)
class Colours:
    """Albedo and emission between keyframes, each straight from one to the next, or held until it.

    Before the first keyframe they are the first one's, after the last one the last one's unless
    they repeat.

    Attributes:
        name: of the object, or of the material.
        frames: the frames of the keys, ascending, at least two.
        albedo: of the material's colour (its image, where it has one, is multiplied with it), one
            per frame; empty where it stays.
        emission: radiance sent out on the front, W/m2/sr, one per frame; it takes the place of an
            image of emission; empty where it stays.
        of_material: every surface of the material changes; else those of the object.
        step: a key holds until the next one.
        repeat: begin anew after the last key, which should be the first one then.

    Raises:
        BadInput: they make no sense, an albedo is outside of [0, 1] or an emission below 0.
    """

    name: str
    frames: tuple[int, ...]
    albedo: tuple[Vec3, ...] = ()
    emission: tuple[Vec3, ...] = ()
    of_material: bool = False
    step: bool = False
    repeat: bool = False

    def __post_init__(self) -> None:
        count = len(self.frames)
        if count < 2:
            raise BadInput(
                f"the colours of '{self.name}' have {count} keyframe(s)", mend="give at least two"
            )
        if self.frames[0] < 0 or any(b <= a for a, b in pairwise(self.frames)):
            raise BadInput(
                f"the keyframes of '{self.name}' are at {', '.join(map(str, self.frames))}",
                mend="give frames from 0 up in ascending order",
            )
        for what, values, most, mend in (
            ("albedo", self.albedo, 1.0, "give shares from 0 to 1"),
            ("emission", self.emission, math.inf, "give 0 or more, W/m2/sr"),
        ):
            if values and len(values) != count:
                raise BadInput(
                    f"'{self.name}' has {count} frames and {len(values)} of {what}",
                    mend="give one for every frame",
                )
            for number, value in enumerate(values, 1):
                if not all(math.isfinite(x) and 0 <= x <= most for x in value):
                    raise BadInput(
                        f"the {what} of '{self.name}' in keyframe {number} is "
                        f"{', '.join(f'{x:g}' for x in value)}",
                        mend=mend,
                    )

    def at(self, frame: int) -> tuple[Vec3 | None, Vec3 | None]:
        """Albedo and emission in ``frame``; None for what stays."""
        first, last = self.frames[0], self.frames[-1]
        if self.repeat and frame > last:
            frame = first + (frame - first) % (last - first)
        at = min(max(frame, first), last)
        key = min(bisect_right(self.frames, at), len(self.frames) - 1) - 1
        share = (at - self.frames[key]) / (self.frames[key + 1] - self.frames[key])
        if self.step:
            share = math.floor(share)

        def value(keys: tuple[Vec3, ...]) -> Vec3 | None:
            if not keys:
                return None
            x, y, z = ((1 - share) * np.array(keys[key]) + share * np.array(keys[key + 1])).tolist()
            return x, y, z

        return value(self.albedo), value(self.emission)

    @property
    def brightest(self) -> Vec3:
        """The most that it ever sends out, by channel, W/m2/sr."""
        if not self.emission:
            return 0.0, 0.0, 0.0
        r, g, b = np.max(self.emission, axis=0).tolist()
        return r, g, b


Change = Motion | Colours
"""What a motion file or a scene says of an object or a material."""
