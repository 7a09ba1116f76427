"""The scene's surfaces on a device: geometry, materials, textures."""

from __future__ import annotations

from dataclasses import dataclass

from gibench.device import Argument, Buffer, Device, reads
from gibench.scene.model import Scene
from gibench.techniques.parts.material_table import (
    material_bytes,
    material_table,
    pack_textures,
    srgb_to_linear,
)


@dataclass(frozen=True)
class Surfaces:
    """What ``surface_at`` of kernels_cl/common/material.cl reads.

    Attributes:
        positions: (v, 3) float32 of the vertices, m.
        normals: (v, 3) float32 of the vertices.
        uvs: (v, 2) float32 of the vertices.
        triangles: (t, 3) int32 vertex numbers.
        material_ids: (t,) int32.
        materials: (m, MATERIAL_FLOATS) float32, see material_table.py.
        material_textures: (m, slots, 3) int32.
        texels: (n, 4) uint8 of all textures, sRGB.
        srgb_to_linear: (256,) float32.
    """

    positions: Buffer
    normals: Buffer
    uvs: Buffer
    triangles: Buffer
    material_ids: Buffer
    materials: Buffer
    material_textures: Buffer
    texels: Buffer
    srgb_to_linear: Buffer

    @staticmethod
    def upload(device: Device, scene: Scene) -> Surfaces:
        """Upload the surfaces of ``scene``.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        textures, texels = pack_textures(scene)
        return Surfaces(
            positions=device.upload("positions", scene.positions),
            normals=device.upload("normals", scene.normals),
            uvs=device.upload("uvs", scene.uvs),
            triangles=device.upload("triangles", scene.triangles),
            material_ids=device.upload("material_ids", scene.material_ids),
            materials=device.upload("materials", material_table(scene.materials)),
            material_textures=device.upload("material_textures", textures),
            texels=device.upload("texels", texels),
            srgb_to_linear=device.upload("srgb_to_linear", srgb_to_linear()),
        )

    @staticmethod
    def bytes_of(scene: Scene) -> int:
        """Bytes they take, in closed form."""
        texels = sum(t.pixels.shape[0] * t.pixels.shape[1] for t in scene.textures)
        geometry = 4 * (8 * len(scene.positions) + 4 * len(scene.triangles))
        return int(geometry + material_bytes(len(scene.materials)) + 4 * texels + 4 * 256)

    @property
    def shape_args(self) -> tuple[Argument, ...]:
        """SHAPE_PARAMS of kernels_cl/common/material.cl."""
        return (
            reads("positions", self.positions),
            reads("normals", self.normals),
            reads("triangles", self.triangles),
        )

    @property
    def args(self) -> tuple[Argument, ...]:
        """SURFACE_PARAMS of kernels_cl/common/material.cl."""
        return (
            reads("positions", self.positions),
            reads("normals", self.normals),
            reads("uvs", self.uvs),
            reads("triangles", self.triangles),
            reads("material_ids", self.material_ids),
            reads("materials", self.materials),
            reads("material_textures", self.material_textures),
            reads("texels", self.texels),
            reads("srgb_to_linear", self.srgb_to_linear),
        )
