"""Settings of the built-in scenes (``scenes/builtin/*.toml``) and the assembly of their parts."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gibench.arrays import Vec3
from gibench.resources import data
from gibench.scene.builtin.patterns import pattern
from gibench.scene.builtin.pieces import Part
from gibench.scene.model import (
    Camera,
    DirectionalLight,
    Environment,
    Light,
    Material,
    PointLight,
    ProbeSettings,
    Region,
    Scene,
    Texture,
)
from gibench.scene.motion.file import read_motions
from gibench.scene.motion.poses import Motion


@dataclass(frozen=True)
class Settings:
    """What a built-in scene's file says.

    Attributes:
        name: of the scene.
        receivers: number of receivers to aim for.
        probes: number of probes.
        lights: as in the file, directions made unit.
        environment: light from outside.
        cameras: the main one first.
        regions: of its images.
        materials: albedo (and texture) by name.
        textures: in the order the materials count them.
        motions: of its objects.
        geometry: everything else in the file.
    """

    name: str
    receivers: int
    probes: int
    lights: tuple[Light, ...]
    environment: Environment = field(repr=False)
    cameras: tuple[Camera, ...]
    regions: tuple[Region, ...]
    materials: dict[str, Material]
    textures: tuple[Texture, ...]
    motions: tuple[Motion, ...]
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
        if isinstance(color, dict):
            materials[n] = Material(n, (1.0, 1.0, 1.0), texture=len(textures))
            textures.append(pattern(n, color["pattern"], [_vec3(c) for c in color["colors"]]))
        else:
            materials[n] = Material(n, _vec3(color))
    return Settings(
        name=name,
        receivers=int(table.pop("receivers")),
        probes=int(table.pop("probes")),
        lights=tuple(_light(light) for light in table.pop("lights")),
        environment=_environment(table.pop("environment")),
        cameras=tuple(
            Camera(
                position=_vec3(camera["position"]),
                target=_vec3(camera["target"]),
                fov_degrees=float(camera["fov_degrees"]),
                name=camera["name"],
            )
            for camera in table.pop("cameras")
        ),
        regions=tuple(_region(region) for region in table.pop("regions", ())),
        materials=materials,
        textures=tuple(textures),
        motions=read_motions(table.pop("motion", []), f"{name}.toml"),
        geometry=table,
    )


def _vec3(values: Any) -> Vec3:
    x, y, z = values
    return float(x), float(y), float(z)


def _region(table: dict[str, Any]) -> Region:
    left, top, right, bottom = (float(value) for value in table["box"])
    return Region(table["name"], table["camera"], (left, top, right, bottom))


def _light(table: dict[str, Any]) -> Light:
    if table["kind"] == "directional":
        direction = np.asarray(table["direction"], np.float64)
        return DirectionalLight(
            direction=_vec3(direction / np.linalg.norm(direction)),
            irradiance=_vec3(table["irradiance"]),
            swing_degrees=float(table["swing_degrees"]),
            period_frames=int(table["period_frames"]),
        )
    return PointLight(
        position=_vec3(table["position"]),
        intensity=_vec3(table["intensity"]),
        orbit_radius=float(table["orbit_radius"]),
        period_frames=int(table["period_frames"]),
    )


def _environment(table: dict[str, Any]) -> Environment:
    if table["kind"] == "gradient":
        return Environment.gradient(
            _vec3(table["zenith"]), _vec3(table["horizon"]), _vec3(table["ground"])
        )
    return Environment.constant(_vec3(table["radiance"]))


def assemble(settings: Settings, parts: list[Part]) -> Scene:
    """One scene from ``parts``; objects are numbered as their names first appear."""
    starts = np.cumsum([0, *(len(p.positions) for p in parts)])
    counts = [len(p.triangles) for p in parts]
    materials = {name: i for i, name in enumerate(settings.materials)}
    objects: dict[str, int] = {}
    object_of = [objects.setdefault(p.name, len(objects)) for p in parts]
    triangles = np.concatenate([p.triangles + s for p, s in zip(parts, starts, strict=False)])
    return Scene(
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
        probes=ProbeSettings(settings.probes),
        receivers=settings.receivers,
        regions=settings.regions,
        object_names=tuple(objects),
        motions=settings.motions,
    )
