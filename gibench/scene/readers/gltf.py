"""glTF 2.0: `.gltf` with files or data URIs, and `.glb`.

JSON is parsed by pygltflib; what the specification leaves to the loader is done here. Choices:
light intensities (lux, candela) and emissive strengths (nit) are photometric in glTF and are used
as radiometric units as they stand (W/m2, W/sr, W/m2/sr), since files are authored for an exposure
and not for a spectrum.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib

from gibench.arrays import Array
from gibench.errors import BadInput
from gibench.scene.files import read_bytes
from gibench.scene.model import (
    Camera,
    Light,
    SpotLight,
)
from gibench.scene.readers.content import (
    Content,
    Part,
    transform_light,
    transform_part,
    unit,
    vec3,
)
from gibench.scene.readers.gltf_buffers import Buffers, compressed
from gibench.scene.readers.gltf_container import (
    NOT_SAID,
    READ_EXTENSIONS,
    check_extensions,
    parsed,
)
from gibench.scene.readers.gltf_formulas import local_matrix, punctual_light, triangles
from gibench.scene.readers.gltf_materials import Materials, Slot
from gibench.scene.readers.gltf_skins import Skins
from gibench.scene.readers.gltf_wrap import wrapped

# Compressions that are not read: a file with them is refused where it has nothing else.
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


def load_gltf(path: Path) -> Content:
    """Read a glTF 2.0 file, its node hierarchy flattened to world space.

    Raises:
        BadInput: not a sound glTF 2.0 file, a missing buffer, or a required extension that is not
            supported.
    """
    data = read_bytes(path)
    try:
        gltf = parsed(data, path)
        check_extensions(gltf, path)
        with np.errstate(all="ignore"):  # NaN and infinity are dealt with in clean.py
            return _Reader(gltf, path).read()
    except BadInput:
        raise
    # pygltflib checks no types: a wrong one anywhere in the JSON surfaces as one of these.
    except (
        TypeError,
        ValueError,
        LookupError,
        AttributeError,
        ArithmeticError,
        MemoryError,
    ) as error:
        raise BadInput(f"not a sound glTF 2.0 file ({error})", where=path) from error


@dataclass
class _Found:
    """What walking the nodes collects."""

    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)
    meshes: Counter[int] = field(default_factory=Counter)


class _Reader:
    """One file being read."""

    def __init__(self, gltf: pygltflib.GLTF2, path: Path) -> None:
        self.gltf = gltf
        self.path = path
        self.buffers = Buffers(gltf, path)
        self.found = _Found()
        self.visited: set[int] = set()
        self.materials = Materials(gltf, self.buffers, path, self.found.ignored)
        self.skins = Skins(gltf, self.buffers, self.found.ignored)
        self.primitives: dict[tuple[int, int], Part | None] = {}

    def read(self) -> Content:
        materials, maps = self.materials.read()
        if animations := len(self.gltf.animations or []):
            self.found.ignored["animations: the pose at rest used"] += animations
        for name in sorted({str(name) for name in self.gltf.extensionsUsed or []}):
            if name not in READ_EXTENSIONS | NOT_SAID:
                self.found.ignored[f"the extension {name}"] += 1
        for node in self._roots():
            self._walk(node, np.eye(4))
        if any(count > 1 for count in self.found.meshes.values()):
            # Instances would share one place in the atlas.
            if any(part.lightmap_uvs is not None for part in self.found.parts):
                self.found.ignored["lightmap UVs (TEXCOORD_1) of a file with instanced meshes"] += 1
            self.found.parts = [replace(part, lightmap_uvs=None) for part in self.found.parts]
        if not self.found.parts:
            ignored = self._warnings()
            raise BadInput(
                "no triangles" + (f" ({'; '.join(ignored)})" if ignored else ""),
                where=self.path,
                mend="the file must hold a scene with a mesh of triangles",
            )
        content = Content(
            tuple(self.found.parts),
            tuple(materials),
            tuple(self.materials.textures),
            tuple(self.found.lights),
            tuple(self.found.cameras),
            tuple(node.name or "" for node in self.gltf.nodes or []),
            maps=tuple(maps),
        )
        content = wrapped(content, self.materials.wraps(), self.found.ignored)
        return replace(content, warnings=self._warnings())

    def _warnings(self) -> tuple[str, ...]:
        return tuple(f"ignored: {what} ({n})" for what, n in sorted(self.found.ignored.items()))

    def _roots(self) -> list[int]:
        scenes, nodes = self.gltf.scenes or [], self.gltf.nodes or []
        if self.gltf.scene is not None or scenes:
            index = self.gltf.scene
            if index is None:
                index = self._first_with_a_mesh()
            if not isinstance(index, int) or not 0 <= index < len(scenes):
                raise BadInput(f"there is no scene {index!r} in the file", where=self.path)
            return list(scenes[index].nodes or [])
        children = {child for node in nodes for child in node.children or []}
        return [i for i in range(len(nodes)) if i not in children]

    def _first_with_a_mesh(self) -> int:
        """The first scene of a file that names none to begin with: the loader's choice (3.5.1)."""
        scenes, nodes = self.gltf.scenes or [], self.gltf.nodes or []
        for index, scene in enumerate(scenes):
            todo, seen = list(scene.nodes or []), set()
            while todo:
                node = todo.pop()
                if not isinstance(node, int) or not 0 <= node < len(nodes) or node in seen:
                    continue
                if nodes[node].mesh is not None:
                    if index:
                        self.found.ignored[f"scenes without a mesh before scene {index}"] += index
                    return index
                seen.add(node)
                todo += nodes[node].children or []
        return 0

    def _walk(self, root: int, parent: Array) -> None:
        """Visit a node and all below it, depth first."""
        nodes = self.gltf.nodes or []
        stack = [(root, parent)]
        while stack:
            index, parent = stack.pop()
            if not isinstance(index, int) or not 0 <= index < len(nodes):
                raise BadInput(f"there is no node {index!r}", where=self.path)
            if index in self.visited:
                raise BadInput(
                    f"node {index} is reached twice: it is its own ancestor or has two parents",
                    where=self.path,
                    mend="glTF nodes form trees",
                )
            self.visited.add(index)
            if _hidden(nodes[index]):
                self.found.ignored["nodes that are not visible, and all below them"] += 1
                continue
            world = parent @ local_matrix(nodes[index])
            self._visit(nodes[index], index, world)
            stack += [(child, world) for child in reversed(nodes[index].children or [])]

    def _visit(self, node: Any, index: int, world: Array) -> None:
        if node.mesh is not None:
            self.found.meshes[node.mesh] += 1
            self._add_mesh(node.mesh, index, world, node.skin)
        if node.camera is not None:
            self._add_camera(node.camera, world)
        light = (node.extensions or {}).get("KHR_lights_punctual")
        if light is not None:
            self._add_light(light["light"], world)
        if "EXT_mesh_gpu_instancing" in (node.extensions or {}):
            self.found.ignored["EXT_mesh_gpu_instancing: one instance used"] += 1

    def _add_mesh(self, mesh_index: int, node_index: int, world: Array, skin: Any) -> None:
        meshes = self.gltf.meshes or []
        if not 0 <= mesh_index < len(meshes):
            raise BadInput(f"there is no mesh {mesh_index}", where=self.path)
        for i, primitive in enumerate(meshes[mesh_index].primitives or []):
            key = (mesh_index, i)
            if key not in self.primitives:
                self.primitives[key] = self._primitive(primitive)
            part = self.primitives[key]
            if part is not None:
                part = replace(part, object_id=node_index)
                if skin is None:
                    self.found.parts.append(transform_part(part, world))
                else:
                    self.found.parts.append(self.skins.posed(part, primitive, skin))

    def _primitive(self, primitive: Any) -> Part | None:
        mode = 4 if primitive.mode is None else primitive.mode
        if mode not in (4, 5, 6):
            self.found.ignored["primitives of points or lines"] += 1
            return None
        attributes = primitive.attributes
        if attributes.POSITION is None:
            self.found.ignored["primitives without positions"] += 1
            return None
        if primitive.targets:
            self.found.ignored["morph targets"] += 1
        for name in _COMPRESSED:
            if name in (primitive.extensions or {}) and self.buffers.is_empty(attributes.POSITION):
                raise compressed(name, self.path)
        positions = self.buffers.accessor(attributes.POSITION, 3)
        if primitive.indices is None:
            indices = np.arange(len(positions))
        else:
            indices = self.buffers.accessor(primitive.indices, 1)[:, 0].astype(np.int64)
        count = len(positions)
        uses = self.materials.uses(primitive.material)
        sets = {
            n: self._attribute(attributes, f"TEXCOORD_{n}", (2,), count)
            for n in {1, *(use.uv_set for use in uses.slots.values())}
        }
        uvs = {name: _placed(sets[use.uv_set], use) for name, use in uses.slots.items()}
        colors = self._colors(attributes, count)
        return Part(
            positions=positions,
            triangles=triangles(indices, mode),
            material=uses.material,
            normals=self._attribute(attributes, "NORMAL", (3,), count),
            uvs=uvs["color"],
            lightmap_uvs=sets[1],
            emission_uvs=uvs["emission"],
            normal_uvs=uvs["normal"],
            gloss_uvs=uvs["gloss"],
            tangents=self._attribute(attributes, "TANGENT", (4,), count),
            opacity_uvs=uvs["color"],
            transmission_uvs=uvs["transmission"],
            colors=None if colors is None else colors[:, :3],
            alphas=None if colors is None or colors.shape[1] < 4 else colors[:, 3],
        )

    def _colors(self, attributes: Any, count: int) -> Array | None:
        """COLOR_0 (v, 3 or 4), linear, from 0 to 1 (glTF 2.0, 3.7.2.1)."""
        colors = self._attribute(attributes, "COLOR_0", (3, 4), count)
        if colors is None:
            return None
        sound = np.nan_to_num(colors.astype(np.float64), nan=1.0)
        if (sound > 1).any():
            self.found.ignored["colours of vertices (COLOR_0) over 1: 1 used"] += 1
        return np.clip(sound, 0.0, 1.0)

    def _attribute(
        self, attributes: Any, name: str, widths: tuple[int, ...], count: int
    ) -> Array | None:
        index = getattr(attributes, name, None)
        if index is None:
            return None
        values = self.buffers.accessor(index, *widths)
        if len(values) != count:
            self.found.ignored[f"{name} of another length than POSITION"] += 1
            return None
        return values

    def _add_camera(self, index: int, world: Array) -> None:
        cameras = self.gltf.cameras or []
        if not 0 <= index < len(cameras):
            raise BadInput(f"there is no camera {index}", where=self.path)
        camera = cameras[index]
        if camera.perspective is None:
            self.found.ignored["orthographic cameras"] += 1
            return
        if not 0 < camera.perspective.yfov < math.pi:
            self.found.ignored["cameras with a senseless field of view"] += 1
            return
        position = world[:3, 3]
        self.found.cameras.append(
            Camera(
                position=vec3(position),
                target=vec3(position + np.asarray(unit(-world[:3, 2]))),
                fov_degrees=math.degrees(camera.perspective.yfov),
                up=unit(world[:3, 1]),
                name=camera.name or f"camera {len(self.found.cameras) + 1}",
            )
        )

    def _add_light(self, index: int, world: Array) -> None:
        table = (self.gltf.extensions or {}).get("KHR_lights_punctual", {}).get("lights", [])
        if not 0 <= index < len(table):
            raise BadInput(f"there is no light {index}", where=self.path)
        lamp = punctual_light(table[index])
        if lamp is None:
            self.found.ignored[f"lights of type {table[index].get('type')!r}"] += 1
            return
        if table[index].get("range") is not None:
            self.found.ignored["ranges of lights: they shine on beyond them"] += 1
        if isinstance(lamp, SpotLight) and lamp.inner_angle > lamp.outer_angle:
            self.found.ignored["inner cones of spots wider than the outer: the outer used"] += 1
            lamp = replace(lamp, inner_angle=lamp.outer_angle)
        self.found.lights.append(transform_light(lamp, world))


def _placed(uvs: Array | None, use: Slot) -> Array | None:
    """Coordinates of a texture slot, v upwards."""
    if uvs is None:
        return None
    moved = uvs.astype(np.float64) @ use.matrix[:2, :2].T + use.matrix[:2, 2]
    return np.column_stack((moved[:, 0], 1.0 - moved[:, 1]))


def _hidden(node: Any) -> bool:
    """Whether a node and all below it are switched off (KHR_node_visibility)."""
    return (node.extensions or {}).get("KHR_node_visibility", {}).get("visible", True) is False
