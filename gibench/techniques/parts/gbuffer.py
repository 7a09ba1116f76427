"""What the camera pass keeps of a pixel for the passes after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, writes
from gibench.techniques.parts.macros import GBUFFER_FLOATS, GBUFFER_HIT, tiled_pixels


class Kept(Protocol):
    """What is kept, and where it lies (kernels_cl/parts/gbuffer.cl)."""

    @property
    def layout(self) -> int:
        """The value of the macro GBUFFER."""
        ...

    @property
    def args(self) -> tuple[Argument, ...]:
        """KEPT_PARAMS."""
        ...

    def bytes_written(self) -> float:
        """The least that the camera pass writes of it, in the frame last run."""
        ...


@dataclass(frozen=True)
class HitBuffer:
    """Where each pixel's ray hits a surface's front, and the albedo there: all that a lookup needs.

    Attributes:
        device: where it lies.
        pixels: of the image.
        buffer: (work-items, 6) float32 in tiled order: triangle (an int, -1 for none), barycentrics
            u and v, albedo.
    """

    device: Device
    pixels: int
    buffer: Buffer

    @staticmethod
    def create(device: Device, width: int, height: int) -> HitBuffer:
        """One of an image that shows nothing yet.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        spec = HitBuffer.spec(width, height)
        nothing = np.full(spec.shape, -1, np.int32)
        buffer = device.create(spec, nothing.view(np.float32))
        return HitBuffer(device, width * height, buffer)

    @staticmethod
    def spec(width: int, height: int) -> BufferSpec:
        """The buffer of an image of this size."""
        shape = (tiled_pixels(width, height), GBUFFER_FLOATS)
        return BufferSpec.of("gbuffer_hits", shape, np.float32)

    @property
    def layout(self) -> int:
        """The value of the macro GBUFFER."""
        return GBUFFER_HIT

    @property
    def args(self) -> tuple[Argument, ...]:
        """KEPT_PARAMS of kernels_cl/parts/gbuffer.cl."""
        return (writes("gbuffer", self.buffer),)

    def surfaces(self) -> int:
        """Pixels that show a surface's front in the frame last run."""
        triangle = self.device.read(self.buffer)[:, 0].view(np.int32)
        return int(np.count_nonzero(triangle >= 0))

    def bytes_written(self) -> float:
        """The least that the camera pass writes of it: of a pixel without a surface, that."""
        return 4.0 * (self.pixels + (GBUFFER_FLOATS - 1) * self.surfaces())
