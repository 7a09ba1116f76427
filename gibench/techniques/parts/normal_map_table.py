"""A scene's normal maps on a device, for the techniques that read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, reads
from gibench.device.build import Define
from gibench.scene.model import Scene


@dataclass(frozen=True)
class NormalMapTable:
    """What ``mapped_normal`` of kernels_cl/common/normal_map.cl reads.

    Attributes:
        words: uint32, or None where the scene has no normal maps.
    """

    words: Buffer | None

    @staticmethod
    def upload(device: Device, scene: Scene) -> NormalMapTable:
        """Upload the normal maps of ``scene``; nothing where it has none.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        specs = NormalMapTable.buffers(scene)
        if scene.normal_maps is None:
            return NormalMapTable(None)
        packed = scene.normal_maps.packed(len(scene.triangles))
        return NormalMapTable(device.create(specs[0], packed))

    @staticmethod
    def buffers(scene: Scene) -> list[BufferSpec]:
        """The buffer of the normal maps of ``scene``, where it has any."""
        if scene.normal_maps is None:
            return []
        words = scene.normal_maps.packed_words(len(scene.triangles))
        return [BufferSpec.of("normal_maps", words, np.uint32)]

    @property
    def args(self) -> tuple[Argument, ...]:
        """NORMAL_MAP_PARAM of kernels_cl/common/normal_map.cl."""
        return () if self.words is None else (reads("normal_maps", self.words),)

    @property
    def defines(self) -> dict[str, Define]:
        """The macros of programs that read them."""
        return {} if self.words is None else {"NORMAL_MAPS": 1}


NO_NORMAL_MAPS = NormalMapTable(None)
"""Of what is shaded with the interpolated normal."""
