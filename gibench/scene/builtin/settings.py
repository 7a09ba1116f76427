"""Settings of the built-in scenes (``scenes/builtin/*.toml``) and the assembly of their pieces.

Lights, cameras, the environment, probes, regions and motions are written as in a scene file of a
user's (``readers/scene_file.py``); materials and the parameters of generated geometry are theirs.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Vec3
from gibench.resources import data
from gibench.scene.builtin.bumps import Bumps, bumpy_surfaces
from gibench.scene.builtin.patterns import pattern
from gibench.scene.builtin.pieces import Piece
from gibench.scene.colours import Change
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, Light, Material, ProbeSettings, Region, Scene, Texture
from gibench.scene.motion.file import read_motions
from gibench.scene.readers.defaults import suggested_sizes
from gibench.scene.readers.scene_file import (
    read_camera,
    read_environment,
    read_light,
    read_region,
)


@dataclass(frozen=True)
class Settings:
    """What a built-in scene's file says.

    Attributes:
        name: of the scene.
        receivers: number of receivers to aim for.
        probes: number of probes, or None where it says none.
        lights: as in the file, directions made unit.
        environment: light from outside.
        cameras: the main one first.
        regions: of its images.
        materials: albedo (and texture) by name.
        textures: in the order the materials count them.
        motions: of its objects.
        bumps: by material.
        geometry: everything else in the file.
    """

    name: str
    receivers: int
    probes: int | None
    lights: tuple[Light, ...]
    environment: Environment = field(repr=False)
    cameras: tuple[Camera, ...]
    regions: tuple[Region, ...]
    materials: dict[str, Material]
    textures: tuple[Texture, ...]
    motions: tuple[Change, ...]
    bumps: dict[str, Bumps]
    geometry: dict[str, Any] = field(repr=False)


def read_settings(name: str) -> Settings:
    """The settings of the built-in scene ``name``."""
    text = (data("scenes") / "builtin" / f"{name}.toml").read_text("utf-8")
    table = tomllib.loads(text)
    colors: dict[str, Any] = dict(table.pop("materials", {}))
    colors |= table.get("room", {}).get("colors", {})
    colors |= {box["name"]: box["color"] for box in table.get("boxes", ())}
    textures: list[Texture] = []
    materials: dict[str, Material] = {}
    for n, color in colors.items():
        if isinstance(color, dict) and "roughness" in color:
            rough, metal = float(color["roughness"]), float(color["metalness"])
            materials[n] = Material(n, _vec3(color["color"]), roughness=rough, metalness=metal)
        elif isinstance(color, dict) and "emission" in color:
            materials[n] = Material(n, _vec3(color["color"]), _vec3(color["emission"]))
        elif isinstance(color, dict):
            materials[n] = Material(n, (1.0, 1.0, 1.0), texture=len(textures))
            textures.append(pattern(n, color["pattern"], [_vec3(c) for c in color["colors"]]))
        else:
            materials[n] = Material(n, _vec3(color))
    where = f"{name}.toml"

    def tables(key: str) -> list[tuple[str, Any]]:
        return [(f"[[{key}]] {i}", entry) for i, entry in enumerate(table.pop(key, ()), 1)]

    return Settings(
        name=name,
        receivers=int(table.pop("receivers")),
        probes=int(table.pop("probes")["count"]) if "probes" in table else None,
        lights=tuple(read_light(e, label=label, where=where) for label, e in tables("light")),
        environment=read_environment(table.pop("environment"), where=where, folder=Path()),
        cameras=tuple(read_camera(e, label=label, where=where) for label, e in tables("camera")),
        regions=tuple(read_region(e, label=label, where=where) for label, e in tables("region")),
        materials=materials,
        textures=tuple(textures),
        motions=read_motions(table.pop("motion", []), where),
        bumps={name: Bumps(**values) for name, values in table.pop("bumps", {}).items()},
        geometry=table,
    )


def _vec3(values: Any) -> Vec3:
    x, y, z = values
    return float(x), float(y), float(z)


def _probes(count: int | None, triangles: int) -> ProbeSettings:
    if count is not None:
        return ProbeSettings(count)
    return ProbeSettings(suggested_sizes(triangles)[1], automatic=True)


def assemble(settings: Settings, parts: list[Piece]) -> Scene:
    """One scene from ``parts``; objects are numbered as their names first appear."""
    starts = np.cumsum([0, *(len(p.positions) for p in parts)])
    counts = [len(p.triangles) for p in parts]
    materials = {name: i for i, name in enumerate(settings.materials)}
    objects: dict[str, int] = {}
    object_of = [objects.setdefault(p.name, len(objects)) for p in parts]
    triangles = np.concatenate([p.triangles + s for p, s in zip(parts, starts, strict=False)])
    made = Scene(
        name=settings.name,
        positions=np.concatenate([p.positions for p in parts]).astype(np.float32),
        normals=np.concatenate([p.normals for p in parts]).astype(np.float32),
        uvs=np.concatenate([p.uvs for p in parts]).astype(np.float32),
        triangles=triangles.astype(np.int32),
        material_ids=np.repeat([materials[p.material] for p in parts], counts).astype(np.int32),
        object_ids=np.repeat(object_of, counts).astype(np.int32),
        materials=tuple(settings.materials.values()),
        textures=settings.textures,
        lights=settings.lights,
        environment=settings.environment,
        cameras=settings.cameras,
        probes=_probes(settings.probes, len(triangles)),
        receivers=settings.receivers,
        regions=settings.regions,
        object_names=tuple(objects),
        motions=settings.motions,
    )
    bumpy = {materials[name]: bumps for name, bumps in settings.bumps.items()}
    return replace(made, normal_maps=bumpy_surfaces(made, bumpy)) if bumpy else made
