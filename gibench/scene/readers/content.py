"""What every mesh reader hands on: parts of meshes before they are cleaned and joined.

A reader (gltf.py, obj.py, shapes.py) yields one ``Content``; clean.py turns the parts of one or
many contents into the arrays of a ``Scene``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Array, Floats, Vec3
from gibench.errors import BadInput
from gibench.scene.model import (
    Camera,
    DirectionalLight,
    Light,
    Material,
    PointLight,
    SpotLight,
    Texture,
)


@dataclass(frozen=True)
class Part:
    """Triangles of one object with one material, as found in a file.

    Attributes:
        positions: (v, 3) float, m; may hold NaN or infinity.
        triangles: (t, 3) int64 into the part's vertices; may be out of range.
        material: index into ``Content.materials``.
        object_id: number of the node or group.
        normals: (v, 3) float or None.
        uvs: (v, 2) float, v upwards, or None.
        lightmap_uvs: (v, 2) float or None.
        emission_uvs: (v, 2) float, of the emission's image, v upwards; None for ``uvs``.
        opacity_uvs: (v, 2) float, of the opacity's image; None for ``uvs``.
        colors: (v, 3) float, linear, times the material's colour, or None.
        alphas: (v,) float, 0 to 1, times the material's opacity where it has one, or None.
        transmission_uvs: (v, 2) float, of the transmission's image; None for ``uvs``.
        materials: (t,) int64 material of every triangle, in place of ``material``, or None.
        cutouts: (t,) int64 image of every triangle in ``Content.cutouts``, looked up at
            ``opacity_uvs``, -1 for a whole one; or None.
        glow: (t,) int64 image of every triangle in ``Content.glows``, looked up at
            ``emission_uvs``, -1 for none; or None.
        bump: (t,) int64 normal map of every triangle in ``Content.normal_maps``, looked up at
            ``normal_uvs``, -1 for none; or None.
        normal_uvs: (v, 2) float, of the normal map, v upwards; None for ``uvs``.
        gloss: (t,) int64 image of every triangle in ``Content.gloss_maps``, looked up at
            ``gloss_uvs``, -1 for none; or None.
        gloss_uvs: (v, 2) float, of roughness and metalness, v upwards; None for ``uvs``.
        tangents: (v, 4) float, as glTF has them: tangent and the bitangent's sign; or None.
        mirrored: whether a mirroring transform has turned its winding.
    """

    positions: Array
    triangles: Array
    material: int = 0
    object_id: int = 0
    normals: Array | None = None
    uvs: Array | None = None
    lightmap_uvs: Array | None = None
    emission_uvs: Array | None = None
    opacity_uvs: Array | None = None
    colors: Array | None = None
    alphas: Array | None = None
    transmission_uvs: Array | None = None
    materials: Array | None = None
    cutouts: Array | None = None
    glow: Array | None = None
    bump: Array | None = None
    normal_uvs: Array | None = None
    gloss: Array | None = None
    gloss_uvs: Array | None = None
    tangents: Array | None = None
    mirrored: bool = False


@dataclass(frozen=True)
class Maps:
    """Images of a material that loading turns into something simpler.

    Attributes:
        emission: the material's emission is to be multiplied with it.
        opacity: the material's opacity is to be multiplied with it; three equal channels.
        normal: unit vectors in tangent space.
        normal_scale: that their x and y are to be multiplied with.
        gloss: (0, roughness, metalness), the channels that glTF has them in.
        transmission: the material's transmission is to be multiplied with it; three equal channels.
    """

    emission: Texture | None = None
    opacity: Texture | None = None
    normal: Texture | None = None
    normal_scale: float = 1.0
    gloss: Texture | None = None
    transmission: Texture | None = None


@dataclass(frozen=True)
class Content:
    """Everything read from one mesh file.

    Attributes:
        parts: its triangles.
        materials: at least one.
        textures: what the materials refer to.
        lights: the file's lights, in the file's world space.
        cameras: the file's cameras, in the file's world space.
        object_names: by ``Part.object_id``; "" where an object has none.
        warnings: what was ignored, one line each, with counts.
        maps: of each material; empty for none.
        cutouts: (h, w) bool images of where there is surface, made at load.
        glows: (h, w, 3) float32 images of emitted radiance, W/m2/sr, made at load.
        normal_maps: (h, w, 3) float32 images of unit vectors and their scale, made at load.
        gloss_maps: (h, w, 2) float32 images of roughness and metalness, made at load.
    """

    parts: tuple[Part, ...]
    materials: tuple[Material, ...] = (Material("default"),)
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    cameras: tuple[Camera, ...] = ()
    object_names: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    maps: tuple[Maps, ...] = ()
    cutouts: tuple[npt.NDArray[np.bool_], ...] = ()
    glows: tuple[Floats, ...] = ()
    normal_maps: tuple[tuple[Floats, float], ...] = ()
    gloss_maps: tuple[Floats, ...] = ()

    def map_of(self, material: int) -> Maps:
        """The images of a material."""
        return self.maps[material] if self.maps else Maps()

    def transformed(self, matrix: Array) -> Content:
        """The content moved by a (4, 4) affine ``matrix`` acting on column vectors."""
        return replace(
            self,
            parts=tuple(transform_part(part, matrix) for part in self.parts),
            lights=tuple(transform_light(light, matrix) for light in self.lights),
            cameras=tuple(_transform_camera(camera, matrix) for camera in self.cameras),
        )


def of_corners(part: Part, values: Array) -> Array:
    """Rows of ``values`` (v, k) at the corners, (t, 3, k); indices out of range count as 0."""
    outside = (part.triangles < 0) | (part.triangles >= len(part.positions))
    found = values[np.where(outside, 0, part.triangles)].astype(np.float64)
    return np.asarray(np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0))


def vec3(values: Iterable[Any]) -> Vec3:
    """Three Python floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def unit(vector: Array) -> Vec3:
    """The vector at length 1; (0, 0, -1) when it has no direction."""
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0:
        return 0.0, 0.0, -1.0
    return vec3(np.asarray(vector, np.float64) / length)


def transform_part(part: Part, matrix: Array) -> Part:
    """The part in another space, by ``matrix`` (4, 4); a mirroring matrix turns the winding so that
    fronts stay fronts.

    Positions are left bit for bit as they are under the identity.
    """
    m = np.asarray(matrix, np.float64)
    if np.array_equal(m, np.eye(4)):
        return part
    linear = m[:3, :3]
    determinant = float(np.linalg.det(linear))
    with np.errstate(all="ignore"):  # NaN and infinity are dealt with in clean.py
        positions = part.positions.astype(np.float64) @ linear.T + m[:3, 3]
        normals = part.normals
        if normals is not None:
            # Normals go by the inverse transpose, here the cofactor matrix up to its sign, which
            # exists for singular matrices too.
            normals = normals.astype(np.float64) @ _cofactors(linear).T
            normals = normals * (-1.0 if determinant < 0 else 1.0)
        tangents = part.tangents
        if tangents is not None:
            moved = tangents[:, :3].astype(np.float64) @ linear.T
            sign = tangents[:, 3:] * (-1.0 if determinant < 0 else 1.0)
            tangents = np.concatenate((moved, sign), axis=1)
    triangles = part.triangles
    if determinant < 0:
        triangles = triangles[:, ::-1]
    return replace(
        part,
        positions=positions,
        normals=normals,
        tangents=tangents,
        triangles=triangles,
        mirrored=part.mirrored != (determinant < 0),
    )


def transform_light(light: Light, matrix: Array) -> Light:
    """The light in another space, by ``matrix`` (4, 4); intensities and radii stay as they are."""
    if isinstance(light, DirectionalLight):
        return replace(light, direction=unit(matrix[:3, :3] @ np.asarray(light.direction)))
    position = vec3(matrix[:3, :3] @ np.asarray(light.position) + matrix[:3, 3])
    if isinstance(light, PointLight):
        return replace(light, position=position)
    assert isinstance(light, SpotLight)
    direction = unit(matrix[:3, :3] @ np.asarray(light.direction))
    return replace(light, position=position, direction=direction)


def _transform_camera(camera: Camera, matrix: Array) -> Camera:
    linear, shift = matrix[:3, :3], matrix[:3, 3]
    return replace(
        camera,
        position=vec3(linear @ np.asarray(camera.position) + shift),
        target=vec3(linear @ np.asarray(camera.target) + shift),
        up=unit(linear @ np.asarray(camera.up)),
    )


def _cofactors(linear: Array) -> Array:
    a, b, c = linear.T
    return np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)), axis=1)


def join_contents(contents: Iterable[Content]) -> Content:
    """One content out of many: materials, textures and objects are renumbered."""
    parts: list[Part] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    lights: list[Light] = []
    cameras: list[Camera] = []
    names: list[str] = []
    warnings: list[str] = []
    maps: list[Maps] = []
    next_object = 0
    for content in contents:
        for part in content.parts:
            parts.append(
                replace(
                    part,
                    material=part.material + len(materials),
                    object_id=part.object_id + next_object,
                )
            )
        first, next_object = next_object, max([next_object, *(p.object_id + 1 for p in parts)])
        names += content.object_names[: next_object - first]
        names += [""] * (next_object - len(names))
        # One image read for several meshes is one texture.
        places: list[int] = []
        for image in content.textures:
            same = [i for i, other in enumerate(textures) if other is image]
            places.append(same[0] if same else len(textures))
            if not same:
                textures.append(image)
        for material in content.materials:
            texture = places[material.texture] if material.texture >= 0 else -1
            materials.append(replace(material, texture=texture))
        maps += content.maps or (Maps(),) * len(content.materials)
        lights += content.lights
        cameras += content.cameras
        warnings += content.warnings
    if not materials:
        raise BadInput("there is no mesh")
    return Content(
        tuple(parts),
        tuple(materials),
        tuple(textures),
        tuple(lights),
        tuple(cameras),
        tuple(names),
        tuple(warnings),
        tuple(maps),
    )


def counted(count: int, one: str, many: str | None = None) -> str:
    """``3 triangles``, ``1 triangle``: a count with its noun."""
    return f"{count} {one if count == 1 else many or one + 's'}"
