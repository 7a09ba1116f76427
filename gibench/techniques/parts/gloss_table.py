"""A scene's images of roughness and metalness on a device, for the techniques that read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, reads
from gibench.device.build import Define
from gibench.scene.model import Scene


@dataclass(frozen=True)
class GlossTable:
    """What ``gloss_at`` of kernels_cl/common/gloss.cl reads besides the table of materials.

    Attributes:
        words: uint32, or None where the scene has no such images.
    """

    words: Buffer | None

    @staticmethod
    def upload(device: Device, scene: Scene) -> GlossTable:
        """Upload the images of ``scene``; nothing where it has none.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        specs = GlossTable.buffers(scene)
        if scene.gloss_maps is None:
            return GlossTable(None)
        packed = scene.gloss_maps.packed(len(scene.triangles))
        return GlossTable(device.create(specs[0], packed))

    @staticmethod
    def buffers(scene: Scene) -> list[BufferSpec]:
        """The buffer of the images of ``scene``, where it has any."""
        if scene.gloss_maps is None:
            return []
        words = scene.gloss_maps.packed_words(len(scene.triangles))
        return [BufferSpec.of("gloss_maps", words, np.uint32)]

    @property
    def args(self) -> tuple[Argument, ...]:
        """GLOSS_PARAM of kernels_cl/common/gloss.cl."""
        return () if self.words is None else (reads("gloss_maps", self.words),)

    @property
    def defines(self) -> dict[str, Define]:
        """The macros of programs that read them."""
        return {} if self.words is None else {"GLOSS_MAPS": 1}
