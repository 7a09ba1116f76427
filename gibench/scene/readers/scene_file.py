"""Scene TOML: mesh files with transforms, lights, environment, cameras, probe settings, motions.

``scenes/modern-hall.example.toml`` shows most of it. Paths are relative to the TOML's folder.
Without ``[[light]]``, ``[environment]`` and ``[[camera]]`` the mesh files' own are used, and where
there are none the defaults of ``defaults.py``.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Array, Vec3
from gibench.errors import BadInput, printable
from gibench.progress import progress
from gibench.scene.environment import Environment
from gibench.scene.files import find_beside, read_bytes
from gibench.scene.model import (
    BLACK,
    Camera,
    DirectionalLight,
    Light,
    PointLight,
    ProbeSettings,
    Region,
    Scene,
    SpotLight,
    Texture,
)
from gibench.scene.motion.file import read_motions
from gibench.scene.poses import turn_about
from gibench.scene.readers.assemble import assembled
from gibench.scene.readers.content import Content, Part, join_contents, unit
from gibench.scene.readers.environment_image import load_environment
from gibench.scene.readers.float_images import UnreadableImage
from gibench.scene.readers.mesh import read_mesh
from gibench.scene.readers.recentre import motions_from_file, points_from_file
from gibench.scene.readers.shapes import SHAPES
from gibench.scene.readers.textures import texture_from_bytes
from gibench.scene.toml_table import Table

SCHEMA_VERSION = 1

_TOP_KEYS = (
    "schema_version", "name", "receivers", "mesh", "light", "environment", "camera", "probes",
    "region", "motion",
)  # fmt: skip
_MESH_KEYS = (
    "file", "shape", "scale", "rotate_degrees", "translate", "matrix", "flip", "base_color",
    "emission", "texture", "name",
)  # fmt: skip
_LIGHT_KEYS = {
    "directional": ("type", "direction", "irradiance", "swing_degrees", "period_frames"),
    "point": ("type", "position", "intensity", "orbit_radius", "period_frames"),
    "spot": ("type", "position", "direction", "intensity", "inner_degrees", "outer_degrees"),
}
_ENVIRONMENT_KEYS = {
    "constant": ("type", "radiance"),
    "gradient": ("type", "zenith", "horizon", "ground"),
    "image": ("type", "file", "scale"),
}
_CAMERA_KEYS = ("name", "position", "target", "fov_degrees", "up")


def load_scene_file(path: Path) -> Scene:
    """Load a scene TOML.

    Raises:
        BadInput: bad TOML, an unknown key, a wrong value, or a mesh file that is broken.
    """
    try:
        text = read_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise BadInput("not a text file in UTF-8", where=path) from error
    return scene_from_toml(text, where=path, folder=path.parent)


def scene_from_toml(text: str, *, where: object, folder: Path) -> Scene:
    """Build the scene that TOML ``text`` describes.

    Args:
        text: the file's content.
        where: the file's name, for messages.
        folder: where relative paths start.

    Raises:
        BadInput: as ``load_scene_file``.
    """
    try:
        entries = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"not valid TOML ({error})", where=where) from error
    top = Table(entries, "the scene file", where, _TOP_KEYS)
    if entries.get("schema_version") != SCHEMA_VERSION:
        top.fail("schema_version", f"this gibench reads schema_version = {SCHEMA_VERSION}")
    tables = _tables(top, "mesh")
    if not tables:
        top.fail("mesh", 'name at least one mesh: [[mesh]] with file = "..." or shape = "..."')
    contents = []
    images: dict[Path, Texture] = {}
    with progress("Loading meshes", len(tables)) as advance:
        for i, table in enumerate(tables, 1):
            contents.append(_mesh(Table(table, f"[[mesh]] {i}", where, _MESH_KEYS), folder, images))
            advance(1)
    content = join_contents(contents)
    if len(contents) > 1:  # each file's lightmap UVs fill the whole atlas
        content = replace(
            content, parts=tuple(replace(part, lightmap_uvs=None) for part in content.parts)
        )
    lights = [
        read_light(entry, label=f"[[light]] {i}", where=where)
        for i, entry in enumerate(_tables(top, "light"), 1)
    ]
    cameras = [
        read_camera(entry, label=f"[[camera]] {i}", where=where)
        for i, entry in enumerate(_tables(top, "camera"), 1)
    ]
    content = replace(
        content,
        lights=tuple(lights) or content.lights,
        cameras=tuple(cameras) or content.cameras,
    )
    name = top.text("name", default=printable(Path(str(where)).stem))
    scene = assembled(name, content, where)
    if "environment" in top:
        environment = read_environment(entries["environment"], where=where, folder=folder)
        # With an environment of its own the scene is lit: no sun is added to it.
        scene = replace(
            scene, environment=environment, lights=scene.lights if content.lights else ()
        )
    scene = replace(scene, receivers=top.whole("receivers", scene.receivers, low=1))
    regions = [
        read_region(entry, label=f"[[region]] {i}", where=where)
        for i, entry in enumerate(_tables(top, "region"), 1)
    ]
    motions = motions_from_file(read_motions(entries.get("motion", []), where), scene)
    scene = replace(scene, regions=tuple(regions), motions=motions)
    if "probes" in top:
        probes = _probes(
            Table(entries["probes"], "[probes]", where, ("count", "positions")),
            folder,
            scene.origin,
        )
        scene = replace(scene, probes=probes or scene.probes)
    return scene


def read_light(entries: Any, *, label: str, where: object) -> Light:
    """A light from a table with ``type`` and the fields of its dataclass; angles in degrees.

    Raises:
        BadInput: an unknown type or key, or a wrong value.
    """
    kind = _kind(entries, label, where, tuple(_LIGHT_KEYS))
    table = Table(entries, label, where, _LIGHT_KEYS[kind])
    if kind == "directional":
        return DirectionalLight(
            direction=_direction(table),
            irradiance=table.color("irradiance"),
            swing_degrees=table.number("swing_degrees", 0.0, low=0, high=180),
            period_frames=table.whole("period_frames", 240, low=1),
        )
    if kind == "point":
        return PointLight(
            position=table.vector("position"),
            intensity=table.color("intensity"),
            orbit_radius=table.number("orbit_radius", 0.0, low=0),
            period_frames=table.whole("period_frames", 240, low=1),
        )
    outer = table.number("outer_degrees", 45.0, low=0, high=90)
    return SpotLight(
        position=table.vector("position"),
        direction=_direction(table),
        intensity=table.color("intensity"),
        inner_angle=math.radians(table.number("inner_degrees", 0.0, low=0, high=outer)),
        outer_angle=math.radians(outer),
    )


def read_camera(entries: Any, *, label: str, where: object) -> Camera:
    """A camera from a table with ``position`` and ``target``; called by its label without a name.

    Raises:
        BadInput: an unknown key, a wrong value, or no direction to look in.
    """
    table = Table(entries, label, where, _CAMERA_KEYS)
    camera = Camera(
        position=table.vector("position"),
        target=table.vector("target"),
        fov_degrees=table.number("fov_degrees", 50.0, low=1, high=170),
        up=table.vector("up", (0.0, 1.0, 0.0)),
        name=table.text("name", default=label.strip("[").replace("]]", "")),
    )
    view = np.subtract(camera.target, camera.position)
    if not np.linalg.norm(np.cross(view, camera.up)) > 0:
        table.fail("target", "it must not lie on the camera or straight along 'up' from it")
    return camera


def read_region(entries: Any, *, label: str, where: object) -> Region:
    """A region from a table with ``name``, ``box`` and perhaps ``camera``.

    Raises:
        BadInput: an unknown key, or a box that is empty or leaves the image.
    """
    table = Table(entries, label, where, ("name", "camera", "box"))
    left, top, right, bottom = table.numbers("box", 4)
    if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
        table.fail("box", "give left, top, right and bottom as shares of the image, 0 to 1")
    camera = table.text("camera") if "camera" in table else ""
    return Region(table.text("name"), camera, (left, top, right, bottom))


def read_environment(entries: Any, *, where: object, folder: Path) -> Environment:
    """An environment from a table with ``type``: constant, gradient or image.

    Raises:
        BadInput: an unknown type or key, a wrong value, or an image that cannot be read.
    """
    kind = _kind(entries, "[environment]", where, tuple(_ENVIRONMENT_KEYS))
    table = Table(entries, "[environment]", where, _ENVIRONMENT_KEYS[kind])
    if kind == "constant":
        return Environment.constant(table.color("radiance"))
    if kind == "gradient":
        return Environment.gradient(
            table.color("zenith"), table.color("horizon"), table.color("ground")
        )
    return load_environment(_beside(table, "file", folder), table.number("scale", 1.0, low=0))


def _kind(entries: Any, label: str, where: object, kinds: tuple[str, ...]) -> str:
    # Which keys are known depends on the type, so it is read before they are checked.
    if not isinstance(entries, dict):
        raise BadInput(f"{label} is not a table", where=where)
    return Table(entries, label, where, tuple(entries)).choice("type", kinds)


def _tables(top: Table, key: str) -> list[Any]:
    value = top.entries.get(key, [])
    if not isinstance(value, list):
        top.fail(key, f"write it as [[{key}]]")
    return value


def _direction(table: Table) -> tuple[float, float, float]:
    direction = table.vector("direction")
    if not any(direction):
        table.fail("direction", "give a vector that is not zero")
    return unit(np.array(direction))


def _beside(table: Table, key: str, folder: Path) -> Path:
    name = table.text(key)
    found = find_beside(folder, name)
    if found is None:
        raise BadInput(
            f"'{key}' in {table.label}: no file '{name}'",
            where=table.where,
            mend=f"paths start at {folder}",
        )
    return found


def _mesh(table: Table, folder: Path, images: dict[Path, Texture]) -> Content:
    if ("file" in table) == ("shape" in table):
        table.fail("file", "give either file or shape")
    if "file" in table:
        content = read_mesh(_beside(table, "file", folder))
    else:
        shape = table.choice("shape", tuple(SHAPES))
        content = Content((SHAPES[shape](),), object_names=(shape,))
    if "name" in table:  # for all of it
        objects = 1 + max((part.object_id for part in content.parts), default=0)
        content = replace(content, object_names=(table.text("name"),) * objects)
    content = content.transformed(_matrix(table))
    if table.flag("flip"):
        content = replace(content, parts=tuple(_flipped(part) for part in content.parts))
    return _overridden(content, table, folder, images)


def _flipped(part: Part) -> Part:
    normals = None if part.normals is None else -np.asarray(part.normals, np.float64)
    return replace(part, triangles=part.triangles[:, ::-1], normals=normals)


def _overridden(
    content: Content, table: Table, folder: Path, images: dict[Path, Texture]
) -> Content:
    """The content with the table's base_color, emission and texture on all its materials."""
    materials, textures = content.materials, content.textures
    if "texture" in table or "base_color" in table:
        parts = tuple(replace(part, colors=None) for part in content.parts)
        content = replace(content, parts=parts)
    if "emission" in table:
        content = replace(content, maps=tuple(replace(m, emission=None) for m in content.maps))
    if "texture" in table:
        path = _beside(table, "texture", folder)
        try:
            if path not in images:
                images[path] = texture_from_bytes(path.name, read_bytes(path))
        except UnreadableImage as error:
            raise BadInput(f"not an image that can be read ({error})", where=path) from error
        textures = (*textures, images[path])
        # The texture is the albedo unless a colour is given to tint it.
        materials = tuple(
            replace(m, texture=len(textures) - 1, base_color=(1.0, 1.0, 1.0)) for m in materials
        )
    elif "base_color" in table:
        materials = tuple(replace(m, texture=-1) for m in materials)
    if "base_color" in table:
        color = table.color("base_color", high=1)
        materials = tuple(replace(m, base_color=color) for m in materials)
    if "emission" in table:
        emission = table.color("emission", BLACK)
        materials = tuple(replace(m, emission=emission) for m in materials)
    if "file" not in table:
        materials = tuple(replace(m, name=table.text("shape")) for m in materials)
    return replace(content, materials=materials, textures=textures)


def _matrix(table: Table) -> Array:
    """Translate * rotate * scale, rotations about x, then y, then z; or the matrix as it stands."""
    steps = [key for key in ("scale", "rotate_degrees", "translate") if key in table]
    if "matrix" in table:
        if steps:
            table.fail("matrix", f"give either matrix or {', '.join(steps)}")
        return table.matrix("matrix")
    scale = table.entries.get("scale", 1.0)
    factors = (
        [table.number("scale", 1.0)] * 3
        if not isinstance(scale, list)
        else (table.numbers("scale", 3))
    )
    if not all(factors):
        table.fail("scale", "give factors that are not zero")
    linear = np.diag(factors)
    for axis, degrees in enumerate(table.vector("rotate_degrees", (0.0, 0.0, 0.0))):
        linear = turn_about(axis, degrees) @ linear
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = table.vector("translate", (0.0, 0.0, 0.0))
    return matrix


def _probes(table: Table, folder: Path, origin: Vec3) -> ProbeSettings | None:
    if "positions" not in table:
        return ProbeSettings(table.whole("count", low=1)) if "count" in table else None
    value = table.entries["positions"]
    if isinstance(value, str):
        positions = _positions_from_file(_beside(table, "positions", folder))
    else:
        try:
            positions = np.asarray(value, np.float64)
        except (ValueError, TypeError):
            table.fail("positions", "give a list of [x, y, z], or a .npy or .csv file")
    if positions.ndim != 2 or positions.shape[1] != 3 or not len(positions):
        raise BadInput(
            f"'positions' in {table.label} has shape {positions.shape}",
            where=table.where,
            mend="give one x, y, z per probe",
        )
    if not np.isfinite(positions).all():
        raise BadInput(f"'positions' in {table.label} holds NaN or infinity", where=table.where)
    if "count" in table and table.whole("count", low=1) != len(positions):
        table.fail("count", f"leave it out or make it {len(positions)}, as there are positions")
    moved = points_from_file(positions, origin) if any(origin) else positions
    return ProbeSettings(len(positions), moved.astype(np.float32))


def _positions_from_file(path: Path) -> Array:
    try:
        if path.suffix.lower() == ".npy":
            return np.asarray(np.load(path, allow_pickle=False), np.float64)
        text = read_bytes(path).decode("utf-8").replace(",", " ")
        rows = [line.split() for line in text.splitlines() if line.strip()]
        if rows and not _numeric(rows[0]):  # a heading
            rows = rows[1:]
        return np.asarray(rows, np.float64)
    except (ValueError, OSError, EOFError, TypeError) as error:
        raise BadInput(f"not probe positions ({error})", where=path) from error


def _numeric(words: list[str]) -> bool:
    try:
        [float(word) for word in words]
    except ValueError:
        return False
    return True
