"""What GIBS keeps of what the camera sees, and the tiles of its image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Device,
    reads,
    writes,
)
from gibench.scene.model import Scene
from gibench.techniques.gibs.macros import PLACEMENT_TILE
from gibench.techniques.parts.macros import GBUFFER_SURFACE


@dataclass(frozen=True)
class CameraView:
    """What the camera sees, per pixel; see kernels_cl/gibs/application.cl.

    Attributes:
        position: (h * w, 4) float32 position, m, and the object's number.
        normal: (h * w, 4) float32.
        albedo: (h * w, 4) float32.
        direct: (h * w, 3) float32 emission, direct light and environment, W/m2/sr.
        indirect: (h * w, 4) float32 indirect irradiance, W/m2, and coverage.
        least: (tiles,) uint32 least coverage and its pixel.
        object_of: (triangles,) int32 object numbers.
    """

    position: Buffer
    normal: Buffer
    albedo: Buffer
    direct: Buffer
    indirect: Buffer
    least: Buffer
    object_of: Buffer

    @staticmethod
    def create(device: Device, scene: Scene, width: int, height: int) -> CameraView:
        """Black images.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        specs = CameraView.buffers(len(scene.triangles), width, height)
        held = device.allocate(specs, {"triangle_objects": scene.object_numbers()})
        return CameraView(
            position=held["gbuffer_position"],
            normal=held["gbuffer_normal"],
            albedo=held["gbuffer_albedo"],
            direct=held["gbuffer_direct"],
            indirect=held["gbuffer_indirect"],
            least=held["tile_least"],
            object_of=held["triangle_objects"],
        )

    @property
    def layout(self) -> int:
        """The value of the macro GBUFFER."""
        return GBUFFER_SURFACE

    @property
    def args(self) -> tuple[Argument, ...]:
        """KEPT_PARAMS of kernels_cl/parts/gbuffer.cl."""
        return (
            reads("object_of", self.object_of),
            writes("g_position", self.position),
            writes("g_normal", self.normal),
            writes("g_albedo", self.albedo),
        )

    def bytes_written(self) -> float:
        """What the camera pass writes of it."""
        return float(self.position.nbytes + self.normal.nbytes + self.albedo.nbytes)

    @staticmethod
    def buffers(triangles: int, width: int, height: int) -> list[BufferSpec]:
        """The buffers of an image of a scene."""
        pixels, of = width * height, BufferSpec.of
        return [
            of("gbuffer_position", (pixels, 4), np.float32),
            of("gbuffer_normal", (pixels, 4), np.float32),
            of("gbuffer_albedo", (pixels, 4), np.float32),
            of("gbuffer_direct", (pixels, 3), np.float32),
            of("gbuffer_indirect", (pixels, 4), np.float32),
            of("tile_least", tiles_of(width, height), np.uint32),
            of("triangle_objects", triangles, np.int32),
        ]


def tiles_of(width: int, height: int) -> int:
    """Placement tiles of an image."""
    return -(-width // PLACEMENT_TILE) * -(-height // PLACEMENT_TILE)
