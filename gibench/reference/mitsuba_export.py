"""Our scenes as Mitsuba 3 scene files, so that somebody else's renderer can check the truth.

Written are an XML file, a PLY file per material and a PFM file per image. Diffuse materials are
not two-sided in Mitsuba either, so backs are black in both. Needs no Mitsuba to write.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.errors import BadInput
from gibench.reference.camera import image_plane
from gibench.scene.cutouts import Cutouts
from gibench.scene.environment import Environment
from gibench.scene.glow import Glow
from gibench.scene.model import (
    Camera,
    DirectionalLight,
    Light,
    Material,
    PointLight,
    Scene,
    SpotLight,
    Texture,
)

# glTF's spot fades by the square of a ramp in the cosine, Mitsuba's linearly in the angle: only
# a hard edge, narrower than this, is the same in both (radians).
_HARD_EDGE = 2e-3
# Coordinates of two images are the same when they differ by less, but for whole repetitions.
_SAME_UV = 1e-4


def write_mitsuba(
    folder: Path,
    scene: Scene,
    camera: Camera,
    width: int,
    height: int,
    *,
    frame: int = 0,
    bounces: int | None = None,
    samples: int = 64,
) -> Path:
    """Write a scene that Mitsuba 3's path integrator renders as ``reference_image`` does.

    Where something is cut away it is the volumetric one, whose shadow rays pass holes too.

    Args:
        folder: where the files go; made when it is not there.
        scene: the scene.
        camera: what to look through.
        width: pixels.
        height: pixels.
        frame: the lights are where they are in this frame.
        bounces: as in :func:`gibench.reference.path_tracer.reference_image`.
        samples: per pixel, box-filtered.

    Returns:
        The path of the XML file.

    Raises:
        BadInput: a camera that makes no image, a spot light with a soft edge, which Mitsuba has no
            emitter for, a cut-out that glows, or a surface two of whose images differ in
            coordinates.
    """
    image_plane(camera, width, height)
    folder.mkdir(parents=True, exist_ok=True)
    root = ET.Element("scene", version="3.0.0")
    tracing = "path" if scene.cutouts is None else "volpath"
    integrator = ET.SubElement(root, "integrator", type=tracing)
    _value(integrator, "integer", "max_depth", -1 if bounces is None else bounces + 2)
    _sensor(root, camera, width, height, samples)
    for number, material in enumerate(scene.materials):
        mine = scene.material_ids == number
        if scene.cutouts is not None:
            _cut_out_shapes(root, folder, scene, scene.cutouts, number)
            mine[scene.cutouts.triangle] = False
        if scene.glow is not None:
            _glowing_shapes(root, folder, scene, scene.glow, mine)
            mine[scene.glow.triangle] = False
        triangles = scene.triangles[mine]
        if len(triangles):
            file = folder / f"material{number}.ply"
            used, corner = np.unique(triangles, return_inverse=True)
            _write_ply(
                file=file,
                positions=scene.positions[used],
                normals=scene.normals[used],
                uvs=scene.uvs[used],
                corner=corner,
            )
            _shape(root, file, material, scene.textures)
    for light in scene.lights_at(frame):
        _light(root, light)
    _environment(root, folder, scene.environment)
    xml = folder / "scene.xml"
    ET.indent(root)
    ET.ElementTree(root).write(xml, encoding="utf-8", xml_declaration=True)
    return xml


def _sensor(root: ET.Element, camera: Camera, width: int, height: int, samples: int) -> None:
    sensor = ET.SubElement(root, "sensor", type="perspective")
    _value(sensor, "string", "fov_axis", "y")
    _value(sensor, "float", "fov", camera.fov_degrees)
    reach = math.dist(camera.position, camera.target)
    _value(sensor, "float", "near_clip", 1e-4 * reach)
    _value(sensor, "float", "far_clip", 1e5 * reach)
    transform = ET.SubElement(sensor, "transform", name="to_world")
    ET.SubElement(
        transform,
        "lookat",
        origin=_list(camera.position),
        target=_list(camera.target),
        up=_list(camera.up),
    )
    film = ET.SubElement(sensor, "film", type="hdrfilm")
    _value(film, "integer", "width", width)
    _value(film, "integer", "height", height)
    _value(film, "string", "pixel_format", "rgb")
    _value(film, "string", "component_format", "float32")
    ET.SubElement(film, "rfilter", type="box")
    sampler = ET.SubElement(sensor, "sampler", type="independent")
    _value(sampler, "integer", "sample_count", samples)


def _cut_out_shapes(
    root: ET.Element, folder: Path, scene: Scene, cutouts: Cutouts, number: int
) -> None:
    """The triangles of a material with something cut away, a shape for each mask."""
    material = scene.materials[number]
    for place, image in enumerate(cutouts.images):
        rows = np.flatnonzero(
            (cutouts.image == place) & (scene.material_ids[cutouts.triangle] == number)
        )
        if not len(rows):
            continue
        corners, uvs = scene.triangles[cutouts.triangle[rows]], cutouts.uvs[rows]
        if any(material.emission):
            raise BadInput(
                f"the cut-out {material.name} glows, which has no counterpart in Mitsuba",
                mend="cut its holes in the mesh",
            )
        if material.texture >= 0 and not np.array_equal(scene.uvs[corners], uvs):
            raise BadInput(
                f"the mask and the image of {material.name} have coordinates of their own, which "
                "has no counterpart in Mitsuba",
                mend="give them the same coordinates",
            )
        file = folder / f"material{number}-cut{place}.ply"
        _write_corners(file, scene, corners, uvs)
        _shape(root, file, material, scene.textures, image)


def _write_corners(
    file: Path, scene: Scene, corners: npt.NDArray[Any], uvs: npt.NDArray[Any]
) -> None:
    """Triangles of ``corners`` (k, 3), vertices of the scene, with ``uvs`` (k, 3, 2)."""
    flat = corners.reshape(-1)
    _write_ply(
        file=file,
        positions=scene.positions[flat],
        normals=scene.normals[flat],
        uvs=uvs.reshape(-1, 2),
        corner=np.arange(len(flat)),
    )


def _glowing_shapes(
    root: ET.Element, folder: Path, scene: Scene, glow: Glow, mine: npt.NDArray[np.bool_]
) -> None:
    """The triangles ``mine`` (t,) of a material that emit by images, a shape for each image."""
    for place, image in enumerate(glow.images):
        rows = np.flatnonzero((glow.image == place) & mine[glow.triangle])
        if not len(rows):
            continue
        number = int(scene.material_ids[glow.triangle[rows[0]]])
        material = scene.materials[number]
        corners, uvs = scene.triangles[glow.triangle[rows]], glow.uvs[rows]
        off = scene.uvs[corners] - uvs
        if material.texture >= 0 and np.abs(off - np.round(off[:, :1])).max() > _SAME_UV:
            raise BadInput(
                f"the images of colour and emission of {material.name} have coordinates of their "
                "own, which has no counterpart in Mitsuba",
                mend="give them the same coordinates",
            )
        file = folder / f"material{number}-glow{place}.ply"
        _write_corners(file, scene, corners, uvs)
        _shape(root, file, material, scene.textures, glow=image)


def _shape(
    root: ET.Element,
    file: Path,
    material: Material,
    textures: tuple[Texture, ...],
    mask: npt.NDArray[np.bool_] | None = None,
    glow: Floats | None = None,
) -> None:
    shape = ET.SubElement(root, "shape", type="ply")
    _value(shape, "string", "filename", file.name)
    holder = shape
    if mask is not None:
        holder = ET.SubElement(shape, "bsdf", type="mask")
        opacity = file.with_suffix(".mask.pfm")
        _write_pfm(opacity, np.repeat(mask[:, :, None], 3, axis=2).astype(np.float32))
        bitmap = ET.SubElement(holder, "texture", type="bitmap", name="opacity")
        _value(bitmap, "string", "filename", opacity.name)
        _value(bitmap, "string", "filter_type", "nearest")
        _value(bitmap, "boolean", "raw", "true")
    bsdf = ET.SubElement(holder, "bsdf", type="diffuse")
    if material.texture < 0:
        _value(bsdf, "rgb", "reflectance", _list(material.base_color))
    else:
        # The base colour is multiplied into an image of its own, as Mitsuba has no product.
        image = file.with_suffix(".pfm")
        _write_pfm(
            image, textures[material.texture].pixels * np.asarray(material.base_color, np.float32)
        )
        bitmap = ET.SubElement(bsdf, "texture", type="bitmap", name="reflectance")
        _value(bitmap, "string", "filename", image.name)
        _value(bitmap, "boolean", "raw", "true")
    if max(material.emission) > 0:
        emitter = ET.SubElement(shape, "emitter", type="area")
        if glow is None:
            _value(emitter, "rgb", "radiance", _list(material.emission))
            return
        radiance = file.with_suffix(".glow.pfm")
        _write_pfm(radiance, glow)
        bitmap = ET.SubElement(emitter, "texture", type="bitmap", name="radiance")
        _value(bitmap, "string", "filename", radiance.name)
        _value(bitmap, "boolean", "raw", "true")


def _light(root: ET.Element, light: Light) -> None:
    if isinstance(light, DirectionalLight):
        emitter = ET.SubElement(root, "emitter", type="directional")
        _value(emitter, "vector", "direction", _list(light.direction))
        _value(emitter, "rgb", "irradiance", _list(light.irradiance))
    elif isinstance(light, PointLight):
        emitter = ET.SubElement(root, "emitter", type="point")
        _value(emitter, "point", "position", _list(light.position))
        _value(emitter, "rgb", "intensity", _list(light.intensity))
    else:
        _spot(root, light)


def _spot(root: ET.Element, light: SpotLight) -> None:
    if light.outer_angle - light.inner_angle > _HARD_EDGE:
        raise BadInput(
            "a spot light with a soft edge has no counterpart in Mitsuba",
            mend="give it an inner angle equal to its outer angle",
        )
    emitter = ET.SubElement(root, "emitter", type="spot")
    _value(emitter, "rgb", "intensity", _list(light.intensity))
    cutoff = math.degrees(light.outer_angle)
    _value(emitter, "float", "cutoff_angle", cutoff)
    _value(emitter, "float", "beam_width", cutoff * (1 - 1e-5))
    position, axis = np.asarray(light.position), np.asarray(light.direction)
    up = (0.0, 1.0, 0.0) if abs(axis[1]) < 0.9 else (1.0, 0.0, 0.0)
    transform = ET.SubElement(emitter, "transform", name="to_world")
    ET.SubElement(
        transform, "lookat", origin=_list(position), target=_list(position + axis), up=_list(up)
    )


def _environment(root: ET.Element, folder: Path, environment: Environment) -> None:
    pixels = environment.pixels
    if not np.any(pixels):
        return
    if np.ptp(pixels.reshape(-1, 3), axis=0).max() == 0:
        emitter = ET.SubElement(root, "emitter", type="constant")
        _value(emitter, "rgb", "radiance", _list(pixels[0, 0]))
        return
    emitter = ET.SubElement(root, "emitter", type="envmap")
    _value(emitter, "string", "filename", "environment.pfm")
    transform = ET.SubElement(emitter, "transform", name="to_world")
    ET.SubElement(transform, "rotate", y="1", angle="180")
    _write_pfm(folder / "environment.pfm", envmap_pixels(environment))


def envmap_pixels(environment: Environment) -> Floats:
    """The environment as Mitsuba's envmap has it, (2 h + 1, w, 3), turned by 180 degrees about +Y.

    Mitsuba puts its first and last row on the poles, we put rows at pixel centres; a grid of twice
    the rows holds both, so that bilinear interpolation gives the same radiance everywhere.
    """
    height, width = environment.pixels.shape[:2]
    rows = np.arange(2 * height + 1) / 2 - 0.5
    low = np.clip(np.floor(rows).astype(np.int64), 0, height - 1)
    high = np.clip(np.ceil(rows).astype(np.int64), 0, height - 1)
    pixels = (environment.pixels[low] + environment.pixels[high]) / np.float32(2)
    # Mitsuba wants more than one column.
    return np.tile(pixels, (1, 4, 1)) if width == 1 else pixels


def _write_ply(
    file: Path, positions: Floats, normals: Floats, uvs: Floats, corner: npt.NDArray[Any]
) -> None:
    """Vertices (v, ...) and the triangles' corners (t, 3) or flat."""
    faces_of = corner.reshape(-1, 3)
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces_of)}", "property list uchar int vertex_indices"]
    down = uvs * (1, -1) + (0, 1)  # Mitsuba's v points down
    vertices = np.hstack((positions, normals, down))
    faces = np.empty(len(faces_of), np.dtype([("count", "u1"), ("vertex", "<i4", 3)]))
    faces["count"] = 3
    faces["vertex"] = faces_of
    with file.open("wb") as stream:
        stream.write(("\n".join([*header, "end_header"]) + "\n").encode())
        stream.write(vertices.astype("<f4").tobytes())
        stream.write(faces.tobytes())


def _write_pfm(file: Path, pixels: Floats) -> None:
    """Portable float map: rows from the bottom up, little endian."""
    height, width = pixels.shape[:2]
    with file.open("wb") as stream:
        stream.write(f"PF\n{width} {height}\n-1.0\n".encode())
        stream.write(np.ascontiguousarray(pixels[::-1]).astype("<f4").tobytes())


def _value(parent: ET.Element, kind: str, name: str, value: object) -> None:
    ET.SubElement(parent, kind, name=name, value=str(value))


def _list(values: object) -> str:
    return ", ".join(repr(float(v)) for v in np.asarray(values, np.float64))
