"""The atlas and its receivers on the device, and the pass that says what they send out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.arrays import Ints
from gibench.device import Buffer, Device
from gibench.scene.lightmap import Lightmap


def border_texels(lightmap: Lightmap) -> Ints:
    """Flat indices of the invalid texels with a valid one among their 8 neighbours, ascending."""
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
        return FrameLightmap(
            device,
            lightmap,
            device.upload("lightmap_uvs", uvs.reshape(-1, 6)),
            device.upload("receiver_position", receivers.position),
            device.upload("receiver_normal", receivers.normal),
            device.upload("receiver_albedo", receivers.albedo),
            device.upload("receiver_emission", receivers.emission),
            device.upload("receiver_texel", receivers.texel),
        )

    @staticmethod
    def bytes_of(triangles: int, receivers: int) -> int:
        """Bytes that one of this size takes, maps not included."""
        return 4 * (6 * triangles + 13 * receivers)

    @staticmethod
    def map_bytes(texels: int) -> int:
        """Bytes of one map of ``texels`` texels."""
        return 16 * texels

    @property
    def nbytes(self) -> int:
        """Bytes it takes on the device, in closed form; maps not included."""
        return self.bytes_of(len(self.lightmap.triangle_uvs), len(self.lightmap.receivers))

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
        data = np.zeros((self.texels + extra, 4), np.float32)
        data[self.lightmap.receivers.texel, 3] = 1.0
        return self.device.upload(name, data)
