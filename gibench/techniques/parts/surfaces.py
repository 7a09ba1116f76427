"""The scene's surfaces on a device: geometry, materials, textures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import Argument, Buffer, BufferSpec, Device, reads
from gibench.device.build import Define
from gibench.scene.model import Scene
from gibench.techniques.parts.material_table import (
    MATERIAL_FLOATS,
    SLOT_INTS,
    SLOTS,
    SRGB_CODES,
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
        glow: uint32, what triangles emit by images (kernels_cl/common/glow.cl), or None.
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
    glow: Buffer | None = None

    @staticmethod
    def upload(device: Device, scene: Scene) -> Surfaces:
        """Upload the surfaces of ``scene``.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        textures, texels = pack_textures(scene)
        data: dict[str, npt.NDArray[Any]] = {
            "positions": scene.positions,
            "normals": scene.normals,
            "uvs": scene.uvs,
            "triangles": scene.triangles,
            "material_ids": scene.material_ids,
            "materials": material_table(scene.materials),
            "material_textures": textures,
            "texels": texels,
            "srgb_to_linear": srgb_to_linear(),
        }
        if scene.glow is not None:
            data["glow"] = scene.glow.packed(len(scene.triangles))
        return Surfaces(**device.allocate(Surfaces.buffers(scene), data))

    @staticmethod
    def buffers(scene: Scene) -> list[BufferSpec]:
        """The buffers of the surfaces of ``scene``, named as the attributes are."""
        like, of, materials = BufferSpec.like, BufferSpec.of, len(scene.materials)
        texels = sum(t.pixels.shape[0] * t.pixels.shape[1] for t in scene.textures)
        glow = []
        if scene.glow is not None:
            glow = [of("glow", scene.glow.packed_words(len(scene.triangles)), np.uint32)]
        return [
            like("positions", scene.positions),
            like("normals", scene.normals),
            like("uvs", scene.uvs),
            like("triangles", scene.triangles),
            like("material_ids", scene.material_ids),
            of("materials", (materials, MATERIAL_FLOATS), np.float32),
            of("material_textures", (materials, len(SLOTS), SLOT_INTS), np.int32),
            of("texels", (texels, 4), np.uint8),
            of("srgb_to_linear", SRGB_CODES, np.float32),
            *glow,
        ]

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
            *(() if self.glow is None else (reads("glow", self.glow),)),
        )

    @property
    def defines(self) -> dict[str, Define]:
        """The macros of programs that read them."""
        return {} if self.glow is None else {"GLOW": 1}
