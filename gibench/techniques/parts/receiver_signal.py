"""What a technique computes at the receivers: a signal of one component or more.

One component is irradiance. A signal of more (four for light of first order in direction) has it in
its first; what the others are is the technique's own. Every component is an RGB value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Floats, Ints
from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Launch,
    ProgramSpec,
    integer,
    reads,
    updates,
)
from gibench.scene.lightmap import Lightmap
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.technique import Pass, Work


@dataclass(frozen=True)
class ReceiverSignal:
    """A signal's map over the atlas, what kernels read of it, and its dilation.

    Attributes:
        receivers: the atlas on the device.
        components: of the signal.
        map: (texels * components, 4) float32, a texel's components side by side: RGB, and 1 where
            the texel is a receiver.
    """

    receivers: FrameLightmap
    components: int
    map: Buffer

    @staticmethod
    def create(receivers: FrameLightmap, name: str, components: int = 1) -> ReceiverSignal:
        """A black signal, called ``name`` in the ledger.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        data = np.zeros((receivers.texels, components, 4), np.float32)
        data[receivers.lightmap.receivers.texel, :, 3] = 1.0
        spec = ReceiverSignal.spec(name, receivers.texels, components)
        buffer = receivers.device.create(spec, data.reshape(-1, 4))
        return ReceiverSignal(receivers, components, buffer)

    @staticmethod
    def spec(name: str, texels: int, components: int = 1) -> BufferSpec:
        """The map of one over ``texels`` texels."""
        return FrameLightmap.map_buffer(name, texels * components)

    @property
    def macros(self) -> dict[str, int]:
        """Of every program that reads or writes the map (kernels_cl/common/lightmap.cl)."""
        return {"COMPONENTS": self.components}

    @property
    def entries(self) -> Ints:
        """The map's entry of each receiver's components, (receivers * components,) int32."""
        texel = self.receivers.lightmap.receivers.texel.astype(np.int32)
        entry = texel[:, None] * self.components + np.arange(self.components, dtype=np.int32)
        return np.asarray(entry, np.int32).ravel()

    @property
    def lookup_args(self) -> tuple[Argument, ...]:
        """LIGHTMAP_PARAMS of kernels_cl/common/lightmap.cl."""
        return (
            reads("lightmap_uvs", self.receivers.uvs),
            reads("irradiance_map", self.map),
            integer("lightmap_width", self.receivers.lightmap.width),
            integer("lightmap_height", self.receivers.lightmap.height),
        )

    def at_receivers(self) -> Floats:
        """The signal at the receivers, (n, components, 3) float32."""
        values = self.receivers.device.read(self.map).reshape(-1, self.components, 4)
        return np.ascontiguousarray(values[self.receivers.lightmap.receivers.texel, :, :3])

    def irradiance(self) -> Floats:
        """Its first component at the receivers, (n, 3) float32, W/m2."""
        return np.ascontiguousarray(self.at_receivers()[:, 0])

    def dilate(self, border: Buffer | None = None) -> Pass:
        """The pass that extends the valid texels by one, in place.

        Args:
            border: the texels to fill (``border_texels``, uploaded), or None to look at all of
                them, as published.
        """
        lightmap = self.receivers.lightmap
        shown = (
            updates("map", self.map),
            integer("width", lightmap.width),
            integer("height", lightmap.height),
        )

        def launches() -> Sequence[Launch]:
            program = ProgramSpec("parts/dilate.cl", self.macros)
            if border is None:
                return [Launch(program, "dilate", shown, items=self.receivers.texels)]
            count = border.shape[0]
            args = (*shown, reads("border", border), integer("count", count))
            return [Launch(program, "dilate_border", args, items=count)]

        filled, read, pairs = dilated_texels(lightmap)
        values = 3 * self.components
        work = Work(
            flops=values * (pairs + filled),
            bytes_read=4 * values * read,
            bytes_written=4 * values * filled,
        )
        return Pass("dilate", launches, work)


def dilated_texels(lightmap: Lightmap) -> tuple[int, int, int]:
    """Texels that dilation fills, valid texels that it reads, and pairs of the two."""
    valid = np.zeros((lightmap.height + 2, lightmap.width + 2), np.bool_)
    filled = np.zeros_like(valid)
    across = lightmap.width
    for map_, texels in ((valid, lightmap.receivers.texel), (filled, border_texels(lightmap))):
        map_[texels // across + 1, texels % across + 1] = True
    read, pairs = np.zeros_like(valid), 0
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            met = valid & np.roll(filled, (dy, dx), (0, 1))
            read |= met
            pairs += int(np.count_nonzero(met))
    return int(np.count_nonzero(filled)), int(np.count_nonzero(read)), pairs
