"""Surfels on the device: preallocated, structure of arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gibench.device import Buffer, BufferSpec

SURFEL_WORDS = 7
"""What kernels_cl/parts/surfels.cl reads of a frame; a technique may keep more behind them."""


def surfel_words(
    alive: int, camera: Sequence[float], angle: float, least: float, most: float
) -> npt.NDArray[np.uint32]:
    """What kernels_cl/parts/surfels.cl reads of a frame, (SURFEL_WORDS,).

    Args:
        alive: surfels alive as it begins.
        camera: where it is (3,), m.
        angle: a surfel's radius per metre from the camera.
        least: radius, m; with ``most`` equal to it all surfels have it.
        most: radius, m.
    """
    floats = np.array([*camera, angle, least, most], np.float32)
    return np.concatenate([np.array([alive], np.uint32), floats.view(np.uint32)])


@dataclass(frozen=True)
class SurfelGeometry:
    """The surfels' buffers that sorting reads and writes (kernels_cl/parts/surfel_sort.cl).

    Attributes:
        frame: (SURFEL_WORDS or more,) uint32 what changes with the frame.
        alive_ids: (capacity,) uint32.
        object_ids: (capacity,) int32, from 1; 0 is a surfel that is not placed.
        transforms: (objects, 12) float32, object to world, 3 x 4 row-major.
        local_position: (3, capacity) float32 in object space, m.
        local_normal: (3, capacity) float32 in object space, unit.
        world_position: (3, capacity) float32, m.
        world_normal: (3, capacity) float32, unit.
        radii: (capacity,) float32, m.
        mean: (3 or more, capacity) float32; rows 0-2 are the irradiance, W/m2.
        nearest: (capacity,) float32 least mean depth, m.
    """

    frame: Buffer
    alive_ids: Buffer
    object_ids: Buffer
    transforms: Buffer
    local_position: Buffer
    local_normal: Buffer
    world_position: Buffer
    world_normal: Buffer
    radii: Buffer
    mean: Buffer
    nearest: Buffer

    @property
    def capacity(self) -> int:
        """Number of surfels there is room for."""
        return self.alive_ids.shape[0]

    @staticmethod
    def buffers(capacity: int, frame_words: int = SURFEL_WORDS) -> list[BufferSpec]:
        """The buffers of so many surfels: all but ``transforms`` and ``mean``.

        Args:
            capacity: number of surfels.
            frame_words: length of ``frame``.
        """

        def floats(name: str, *shape: int) -> BufferSpec:
            return BufferSpec.of(f"surfel_{name}", shape, np.float32)

        return [
            BufferSpec.of("surfel_frame", frame_words, np.uint32),
            BufferSpec.of("surfel_alive_ids", capacity, np.uint32),
            BufferSpec.of("surfel_object_ids", capacity, np.int32),
            floats("local_position", 3, capacity),
            floats("local_normal", 3, capacity),
            floats("world_position", 3, capacity),
            floats("world_normal", 3, capacity),
            floats("radii", capacity),
            floats("nearest", capacity),
        ]

    @staticmethod
    def of(held: Mapping[str, Buffer], transforms: Buffer, mean: Buffer) -> SurfelGeometry:
        """The surfels whose buffers are among ``held``."""
        return SurfelGeometry(
            frame=held["surfel_frame"],
            alive_ids=held["surfel_alive_ids"],
            object_ids=held["surfel_object_ids"],
            transforms=transforms,
            local_position=held["surfel_local_position"],
            local_normal=held["surfel_local_normal"],
            world_position=held["surfel_world_position"],
            world_normal=held["surfel_world_normal"],
            radii=held["surfel_radii"],
            mean=mean,
            nearest=held["surfel_nearest"],
        )
