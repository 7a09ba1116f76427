"""The atlas and its receivers on the device, and the pass that says what they send out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.arrays import Floats, Ints
from gibench.device import Buffer, BufferSpec, Device
from gibench.scene.lightmap import Lightmap


def border_texels(lightmap: Lightmap) -> Ints:
    """Flat indices (k,) of invalid texels with a valid one among their 8 neighbours, ascending."""
    valid = np.zeros((lightmap.height + 2, lightmap.width + 2), np.bool_)
    inner = valid[1:-1, 1:-1]
    rows, columns = np.divmod(lightmap.receivers.texel, lightmap.width)
    valid[rows + 1, columns + 1] = True
    near = np.zeros_like(inner)
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            near |= valid[dy : dy + lightmap.height, dx : dx + lightmap.width]
    return np.flatnonzero(near & ~inner).astype(np.int32)


@dataclass(frozen=True)
class FrameLightmap:
    """The atlas and its receivers on a device.

    Attributes:
        device: where it lies.
        lightmap: what was uploaded.
        uvs: (t, 6) float32 the triangles' corners in texels, negative without a place.
        position: (n, 3) float32 of the receivers, m.
        normal: (n, 3) float32.
        albedo: (n, 3) float32.
        emission: (n, 3) float32, W/m2/sr.
        texel: (n,) int32.
    """

    device: Device
    lightmap: Lightmap
    uvs: Buffer
    position: Buffer
    normal: Buffer
    albedo: Buffer
    emission: Buffer
    texel: Buffer

    @staticmethod
    def upload(device: Device, lightmap: Lightmap) -> FrameLightmap:
        """Upload ``lightmap``.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        uvs = np.nan_to_num(lightmap.triangle_uvs, nan=-1.0).astype(np.float32)
        receivers = lightmap.receivers
        held = device.allocate(
            FrameLightmap.buffers(len(lightmap.triangle_uvs), len(receivers)),
            {
                "lightmap_uvs": uvs.reshape(-1, 6),
                "receiver_position": receivers.position,
                "receiver_normal": receivers.normal,
                "receiver_albedo": receivers.albedo,
                "receiver_emission": receivers.emission,
                "receiver_texel": receivers.texel,
            },
        )
        return FrameLightmap(
            device=device,
            lightmap=lightmap,
            uvs=held["lightmap_uvs"],
            position=held["receiver_position"],
            normal=held["receiver_normal"],
            albedo=held["receiver_albedo"],
            emission=held["receiver_emission"],
            texel=held["receiver_texel"],
        )

    @staticmethod
    def buffers(triangles: int, receivers: int) -> list[BufferSpec]:
        """The buffers of an atlas of this size, maps not included."""
        of, f32 = BufferSpec.of, np.float32
        return [
            of("lightmap_uvs", (triangles, 6), f32),
            of("receiver_position", (receivers, 3), f32),
            of("receiver_normal", (receivers, 3), f32),
            of("receiver_albedo", (receivers, 3), f32),
            of("receiver_emission", (receivers, 3), f32),
            of("receiver_texel", receivers, np.int32),
        ]

    @staticmethod
    def map_buffer(name: str, entries: int) -> BufferSpec:
        """A map of ``entries`` texels and what stands behind them."""
        return BufferSpec.of(name, (entries, 4), np.float32)

    @property
    def texels(self) -> int:
        """Texels of a map."""
        return self.lightmap.width * self.lightmap.height

    def new_map(self, name: str, extra: int = 0) -> Buffer:
        """A black map (texels + extra, 4) float32 whose fourth component marks the receivers.

        Args:
            name: in the ledger.
            extra: further black entries behind the texels.
        """
        return self.device.create(self.map_buffer(name, self.texels + extra), self.black(extra))

    def black(self, extra: int = 0) -> Floats:
        """What :meth:`new_map` holds at first, (texels + extra, 4)."""
        data = np.zeros((self.texels + extra, 4), np.float32)
        data[self.lightmap.receivers.texel, 3] = 1.0
        return data
