"""The scene and the receivers as the flat arrays that the reference kernels read."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gibench.arrays import Floats, Ints
from gibench.errors import BadInput
from gibench.rays.offset import ray_scale
from gibench.reference.lights import (
    LIGHT_FLOATS,
    EmitterTable,
    EnvironmentTable,
    delta_lights,
    emitter_table,
    environment_table,
)
from gibench.scene.image_rows import Words
from gibench.scene.lightmap import Fragments
from gibench.scene.model import Scene

TRIANGLE_FLOATS, MATERIAL_FLOATS = 28, 8
"""Of a record (kernels_cl/reference/surface.cl)."""
RECORD_MACROS = {
    "TRIANGLE_FLOATS": TRIANGLE_FLOATS,
    "MATERIAL_FLOATS": MATERIAL_FLOATS,
    "LIGHT_FLOATS": LIGHT_FLOATS,
}
"""Of every program that reads them."""


@dataclass(frozen=True)
class PackedScene:
    """A scene in one frame, packed for the kernels; layouts are documented there.

    Attributes:
        triangles: (t, 28) float32.
        materials: (m, 8) float32.
        texture_pixels: (p, 3) float32, all textures one after the other.
        images: (n, 3) int32 first pixel, width, height of each texture.
        lights: (l, 12) float32 delta lights.
        emitters: emissive triangles.
        environment: (h, w, 3) float32.
        environment_table: how to sample it.
        cutouts: uint32, as kernels_cl/common/cutout.cl has it, or None where nothing is cut away.
        scale: of the distance by which rays leave surfaces near the origin; 1 but for tiny scenes.
        normal_maps: uint32, as kernels_cl/common/normal_map.cl has it, or None for no use of them.
    """

    triangles: Floats = field(repr=False)
    materials: Floats = field(repr=False)
    texture_pixels: Floats = field(repr=False)
    images: Ints = field(repr=False)
    lights: Floats = field(repr=False)
    emitters: EmitterTable
    environment: Floats = field(repr=False)
    environment_table: EnvironmentTable
    cutouts: Words | None = field(default=None, repr=False)
    normal_maps: Words | None = field(default=None, repr=False)
    scale: float = 1.0

    @property
    def has_area_light(self) -> bool:
        """Whether a ray can find light by itself: an emissive surface or the environment."""
        return len(self.emitters.triangle) > 0 or not self.environment_table.black


@dataclass(frozen=True)
class PackedFragments:
    """The receivers' covered surface, packed for the kernels.

    Attributes:
        start: (n + 1,) int32 first fragment of each receiver.
        table: (m,) float32 cumulative share of its receiver's area.
        corners: (m, 3, 3) float32, m.
        triangle: (m,) int32.
    """

    start: Ints = field(repr=False)
    table: Floats = field(repr=False)
    corners: Floats = field(repr=False)
    triangle: Ints = field(repr=False)


def pack_scene(scene: Scene, frame: int, normal_maps: bool = False) -> PackedScene:
    """Pack ``scene`` with its lights at ``frame``, and its normal maps where they are asked for.

    Raises:
        BadInput: the scene has no triangles, or holds a colour that is negative or not finite.
    """
    if not len(scene.triangles):
        raise BadInput("the scene has no triangles", where=scene.name)
    emitters = emitter_table(scene)
    triangles = np.zeros((len(scene.triangles), TRIANGLE_FLOATS), np.float32)
    triangles[:, 0:9] = scene.positions[scene.triangles].reshape(-1, 9)
    triangles[:, 9:18] = scene.normals[scene.triangles].reshape(-1, 9)
    triangles[:, 18:24] = scene.uvs[scene.triangles].reshape(-1, 6)
    triangles[:, 24] = np.ascontiguousarray(scene.material_ids, np.int32).view(np.float32)
    materials = np.zeros((len(scene.materials), MATERIAL_FLOATS), np.float32)
    materials[:, 0:3] = [m.base_color for m in scene.materials]
    materials[:, 3:6] = [m.emission for m in scene.materials]
    texture = np.array([m.texture for m in scene.materials], np.int32)
    materials[:, 6] = texture.view(np.float32)
    materials[:, 7] = emitters.density
    sizes = np.array([t.pixels.shape[:2] for t in scene.textures], np.int64).reshape(-1, 2)
    first = np.concatenate(([0], np.cumsum(sizes[:, 0] * sizes[:, 1])))
    images = np.stack((first[:-1], sizes[:, 1], sizes[:, 0]), axis=1).astype(np.int32)
    pixels = [np.asarray(t.pixels, np.float32).reshape(-1, 3) for t in scene.textures]
    lights = delta_lights(scene.lights_at(frame))
    colours = {
        "material": materials[:, :6],
        "light": lights[:, 6:9],
        "environment": scene.environment.pixels,
    }
    for name, values in colours.items():
        if not np.isfinite(values).all() or (values < 0).any():
            raise BadInput(
                f"a {name} colour is negative or not finite",
                where=scene.name,
                mend="a path-traced reference needs colours of 0 or more",
            )
    return PackedScene(
        triangles,
        materials,
        np.concatenate(pixels) if pixels else np.zeros((1, 3), np.float32),
        images if len(images) else np.zeros((1, 3), np.int32),
        lights if len(lights) else np.zeros((0, LIGHT_FLOATS), np.float32),
        emitters,
        np.ascontiguousarray(scene.environment.pixels, np.float32),
        environment_table(scene.environment.pixels),
        None if scene.cutouts is None else scene.cutouts.packed(len(scene.triangles)),
        scene.normal_maps.packed(len(scene.triangles))
        if normal_maps and scene.normal_maps is not None
        else None,
        ray_scale(scene),
    )


def pack_fragments(fragments: Fragments) -> PackedFragments:
    """Pack the receivers' covered surface.

    Raises:
        BadInput: a receiver covers no surface.
    """
    start = np.asarray(fragments.start, np.int64)
    counts = np.diff(start)
    if len(counts) == 0 or counts.min() == 0:
        raise BadInput("the lightmap has no receivers, or a receiver that covers no surface")
    area = fragments.area.astype(np.float64)
    total = np.cumsum(area)
    before = np.repeat(np.concatenate(([0.0], total))[start[:-1]], counts)
    own = np.repeat(np.add.reduceat(area, start[:-1]), counts)
    # Fragments of no area at all share their receiver evenly.
    even = (np.arange(len(area)) - np.repeat(start[:-1], counts) + 1) / np.repeat(counts, counts)
    table = np.where(own > 0, (total - before) / np.where(own > 0, own, 1.0), even)
    return PackedFragments(
        start.astype(np.int32),
        table.astype(np.float32),
        np.ascontiguousarray(fragments.corners, np.float32),
        np.ascontiguousarray(fragments.triangle, np.int32),
    )
