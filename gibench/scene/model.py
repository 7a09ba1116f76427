"""The Scene: triangles, materials, lights, environment, cameras.

Conventions: metres, right-handed, Y up, counter-clockwise front faces. Colours are linear RGB with
Rec. 709 primaries; radiance in W/m2/sr, irradiance in W/m2, intensity in W/sr, each per channel.
All surfaces are diffuse and reflect on their front side; the back of a triangle is black.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints, Vec3
from gibench.scene.colours import Change
from gibench.scene.cutouts import Cutouts
from gibench.scene.environment import Environment
from gibench.scene.gloss import GlossMaps
from gibench.scene.glow import Glow
from gibench.scene.normal_maps import NormalMaps

BLACK: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Texture:
    """An image sampled bilinearly with repeat.

    Attributes:
        name: where it came from.
        pixels: (height, width, 3) float32, linear; row 0 is v = 1 (the top, as in glTF and PNG).
    """

    name: str
    pixels: Floats = field(repr=False)


@dataclass(frozen=True)
class Material:
    """A diffuse material.

    Light depends on the first four attributes alone. The others are what the file says besides;
    loading turns some of them into geometry (``readers/realise.py``) and says what is not used.

    Attributes:
        name: as in the file.
        base_color: diffuse albedo, times the texture where there is one.
        emission: emitted radiance, W/m2/sr; the mean over triangles that emit by an image.
        texture: index into ``Scene.textures``, or -1.
        emission_map: name of the image that emission was multiplied with, or "".
        alpha_mode: "opaque", "mask" (cut out where alpha is under the cutoff) or "blend".
        alpha_cutoff: of "mask".
        opacity: share of the light that does not pass, times the alpha of an image.
        opacity_map: name of that image, or "".
        transmission: share of the light that passes a thin surface (glass), 0 to 1.
        two_sided: the back reflects as the front does.
        roughness: perceptual, 0 to 1 (glTF 2.0, appendix B.2.3; MTL's Pr), times the image's where
            there is one (``Scene.gloss_maps``).
        metalness: 0 to 1 (glTF's metallic; MTL's Pm), times the image's.
        roughness_map: name of the image of roughness and metalness, or "".
        normal_map: name of the image of tangent space normals, or "".
        unlit: shown in its colour whatever the light (KHR_materials_unlit).
    """

    name: str
    base_color: Vec3 = (0.8, 0.8, 0.8)
    emission: Vec3 = BLACK
    texture: int = -1
    # Not in the representation, which is hashed: no result depends on them.
    emission_map: str = field(default="", repr=False)
    alpha_mode: str = field(default="opaque", repr=False)
    alpha_cutoff: float = field(default=0.5, repr=False)
    opacity: float = field(default=1.0, repr=False)
    opacity_map: str = field(default="", repr=False)
    transmission: float = field(default=0.0, repr=False)
    two_sided: bool = field(default=False, repr=False)
    roughness: float = field(default=1.0, repr=False)
    metalness: float = field(default=0.0, repr=False)
    roughness_map: str = field(default="", repr=False)
    normal_map: str = field(default="", repr=False)
    unlit: bool = field(default=False, repr=False)


@dataclass(frozen=True)
class DirectionalLight:
    """Parallel light, the sun.

    Attributes:
        direction: unit vector the light travels along.
        irradiance: on a surface that faces it, W/m2.
        swing_degrees: the direction swings by this angle to each side about the vertical axis.
        period_frames: frames for one swing there and back.
    """

    direction: Vec3
    irradiance: Vec3
    swing_degrees: float = 0.0
    period_frames: int = 240

    @property
    def moves(self) -> bool:
        """Whether it is elsewhere in other frames; a vertical one turns about itself."""
        x, _, z = self.direction
        return bool(self.swing_degrees) and (x != 0 or z != 0)

    def at(self, frame: int) -> DirectionalLight:
        """The light in ``frame`` (its direction turned about +Y)."""
        if not self.swing_degrees:
            return self
        phase = 2.0 * math.pi * frame / self.period_frames
        angle = math.radians(self.swing_degrees) * math.sin(phase)
        x, y, z = self.direction
        c, s = math.cos(angle), math.sin(angle)
        return replace(self, direction=(c * x + s * z, y, -s * x + c * z))


@dataclass(frozen=True)
class PointLight:
    """A point light.

    Attributes:
        position: m.
        intensity: W/sr.
        orbit_radius: the light circles its position horizontally at this radius, m.
        period_frames: frames for one circle.
    """

    position: Vec3
    intensity: Vec3
    orbit_radius: float = 0.0
    period_frames: int = 240

    @property
    def moves(self) -> bool:
        """Whether it is elsewhere in other frames."""
        return bool(self.orbit_radius)

    def at(self, frame: int) -> PointLight:
        """The light in ``frame``."""
        if not self.orbit_radius:
            return self
        phase = 2.0 * math.pi * frame / self.period_frames
        x, y, z = self.position
        r = self.orbit_radius
        return replace(self, position=(x + r * math.cos(phase), y, z + r * math.sin(phase)))


@dataclass(frozen=True)
class SpotLight:
    """A spot light; its cone fades smoothly from the inner to the outer angle (glTF's formula).

    Attributes:
        position: m.
        direction: unit vector along the axis.
        intensity: on the axis, W/sr.
        inner_angle: radians from the axis, full intensity inside.
        outer_angle: radians from the axis, dark outside.
    """

    position: Vec3
    direction: Vec3
    intensity: Vec3
    inner_angle: float = 0.0
    outer_angle: float = math.pi / 4

    @property
    def moves(self) -> bool:
        """It never does."""
        return False

    def at(self, frame: int) -> SpotLight:
        """The light in ``frame``."""
        return self


Light = DirectionalLight | PointLight | SpotLight


class Dimmer(Protocol):
    """Changes the strength of all of a scene's lights at once."""

    def share(self, frame: int) -> float:
        """Share of the lights' strength in ``frame``."""
        ...


def dimmed(light: Light, share: float) -> Light:
    """``light`` with ``share`` of its strength."""
    if isinstance(light, DirectionalLight):
        r, g, b = light.irradiance
        return replace(light, irradiance=(share * r, share * g, share * b))
    r, g, b = light.intensity
    return replace(light, intensity=(share * r, share * g, share * b))


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        position: m.
        target: the point it looks at.
        fov_degrees: vertical field of view.
        up: roughly upwards.
        name: for pictures.
    """

    position: Vec3
    target: Vec3
    fov_degrees: float = 50.0
    up: Vec3 = (0.0, 1.0, 0.0)
    name: str = "camera"


@dataclass(frozen=True)
class Region:
    """A named part of a camera's image, for errors of its own.

    Attributes:
        name: in tables.
        camera: name of the camera; "" for any.
        box: left, top, right, bottom as shares of the image's width and height, y downwards.
    """

    name: str
    camera: str
    box: tuple[float, float, float, float]


@dataclass(frozen=True)
class ProbeSettings:
    """What a scene says of its probes.

    Attributes:
        count: number of probes SRP places unless told otherwise.
        positions: (p, 3) given by hand, or None to place them.
        automatic: nobody chose ``count``: techniques take what the scene's geometry wants.
    """

    count: int = 100
    positions: Floats | None = field(default=None, repr=False)
    # Not in the representation, which is hashed: geometry and count say what comes of it.
    automatic: bool = field(default=False, repr=False)


MOST_UNFOLDED = 300_000
"""Triangles up to which xatlas unwraps a scene; it takes minutes for more. The real Sponza has
262 267.
"""


@dataclass(frozen=True)
class Scene:
    """A scene, flattened to world space.

    Corner attributes are per vertex; loaders split vertices where attributes differ.

    Attributes:
        name: short name for tables.
        positions: (v, 3) float32, m.
        normals: (v, 3) float32 unit shading normals, on the side the triangle's winding faces.
        uvs: (v, 2) float32 texture coordinates, v upwards (OBJ's convention).
        triangles: (t, 3) int32 vertex indices, none degenerate.
        material_ids: (t,) int32.
        object_ids: (t,) int32, one number per node or group of the file.
        object_names: by that number; several objects may share a name, and "" is none. No result
            depends on them.
        lightmap_uvs: (v, 2) float32 in [0, 1], or None where the file has none.
        receivers: number of receivers to aim for unless the user says otherwise.
        regions: parts of the image whose error is told apart; no result depends on them.
        motions: of its objects and materials, at rest unless a run follows them.
        warnings: what was dropped while loading, one line each, with counts.
        origin: the point of the file's space where this scene has its origin, m; not 0, 0, 0 where
            the file lies far from its own (``readers/recentre.py``).
        cutouts: what alpha masks cut away of its triangles, or None.
        dimmer: of its lights, or None; what glows and the environment stay as they are.
        glow: its triangles that emit by an image, or None.
        normal_maps: its triangles that have one, or None; no result depends on them unless asked.
        gloss_maps: its triangles with an image of roughness and metalness, or None; likewise.
    """

    name: str
    positions: Floats = field(repr=False)
    normals: Floats = field(repr=False)
    uvs: Floats = field(repr=False)
    triangles: Ints = field(repr=False)
    material_ids: Ints = field(repr=False)
    object_ids: Ints = field(repr=False)
    materials: tuple[Material, ...] = (Material("default"),)
    textures: tuple[Texture, ...] = ()
    lights: tuple[Light, ...] = ()
    environment: Environment = field(default_factory=lambda: Environment.constant(BLACK))
    cameras: tuple[Camera, ...] = ()
    probes: ProbeSettings = field(default_factory=ProbeSettings)
    lightmap_uvs: Floats | None = field(default=None, repr=False)
    receivers: int = 100_000
    regions: tuple[Region, ...] = ()
    object_names: tuple[str, ...] = field(default=(), repr=False)
    motions: tuple[Change, ...] = ()
    warnings: tuple[str, ...] = ()
    origin: Vec3 = BLACK
    cutouts: Cutouts | None = field(default=None, repr=False)
    dimmer: Dimmer | None = field(default=None, repr=False)
    glow: Glow | None = field(default=None, repr=False)
    normal_maps: NormalMaps | None = field(default=None, repr=False)
    gloss_maps: GlossMaps | None = field(default=None, repr=False)

    @property
    def bounds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Smallest and largest corner (3,) of what the triangles cover, m."""
        is_used = np.zeros(len(self.positions), np.bool_)
        is_used[self.triangles] = True
        used = self.positions[is_used].astype(np.float64)
        return used.min(axis=0), used.max(axis=0)

    @property
    def corners(self) -> Floats:
        """(t, 3, 3) float32: the three corner positions of every triangle."""
        return self.positions[self.triangles]

    def object_numbers(self) -> Ints:
        """The triangles' objects numbered from 0 in the order of ``object_ids``, (t,) int32."""
        numbers = np.unique(self.object_ids, return_inverse=True)[1]
        return numbers.reshape(-1).astype(np.int32)

    @property
    def lights_move(self) -> bool:
        """Whether any of its lights is elsewhere in other frames."""
        return any(light.moves for light in self.lights)

    def lights_at(self, frame: int) -> tuple[Light, ...]:
        """The lights in ``frame``."""
        lights = tuple(light.at(frame) for light in self.lights)
        if self.dimmer is None:
            return lights
        share = self.dimmer.share(frame)
        return tuple(dimmed(light, share) for light in lights)

    def geometry_hash(self) -> str:
        """SHA-256 of all that baked visibility depends on: the triangles, what is cut away."""
        digest = hashlib.sha256()
        cut = () if self.cutouts is None else self.cutouts.arrays()
        for array in (self.positions, self.triangles, *cut):
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def content_hash(self) -> str:
        """SHA-256 of everything in the scene that a result can depend on."""
        digest = hashlib.sha256(self.geometry_hash().encode())
        for part in _arrays(self):
            digest.update(str((part.shape, part.dtype.str)).encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        digest.update(repr((self.materials, self.lights, self.cameras, self.probes)).encode())
        return digest.hexdigest()


def _arrays(scene: Scene) -> Iterator[npt.NDArray[Any]]:
    yield from (scene.normals, scene.uvs, scene.material_ids, scene.object_ids)
    if scene.lightmap_uvs is not None:
        yield scene.lightmap_uvs
    if scene.probes.positions is not None:
        yield scene.probes.positions
    yield scene.environment.pixels
    yield from (texture.pixels for texture in scene.textures)
    if scene.glow is not None:
        yield from scene.glow.arrays()
