"""The stages of a bake of captured probes: each probe's maps, then their light where lit once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.bake.stage import Arrays, Format, Keep, Stage, Unit, stage_key
from gibench.rays.embree import scene_tracer
from gibench.scene.model import ProbeSettings, Scene
from gibench.techniques.parts.captured_probes.bounced import RayGather
from gibench.techniques.parts.captured_probes.capture import capture, cube_directions
from gibench.techniques.parts.captured_probes.lighting import (
    Visibility,
    filtered_moments,
    lit_once,
)
from gibench.techniques.parts.captured_probes.lobes import prefiltered
from gibench.techniques.parts.captured_probes.maps import texel_directions
from gibench.techniques.parts.captured_probes.resample import ProbeMaps, Resampling, resampled
from gibench.techniques.parts.captured_probes.settings import CapturedProbeSettings
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.registry import BakeContext
from gibench.work import Worker

# Raised whenever what a stage computes, or how it is stored, changes.
MAPS_VERSION = 2
LIGHT_VERSION = 3


@dataclass(frozen=True)
class Asked:
    """What every stage is computed from; plain data.

    Attributes:
        scene: the scene.
        settings: of the probes.
        distance_sharpness: power of the cosine that distances are filtered by; None where they are
            not.
        surface_bias: how far off its surface a point is looked at, m.
        visibility_bias: taken off its distance, m.
        rays: of a texel and bounce that further bounces are gathered by; 0: from the probes'
            irradiance.
        denoise: radius of the filter that smooths what they find, texels.
    """

    scene: Scene
    settings: CapturedProbeSettings
    distance_sharpness: float | None
    surface_bias: float
    visibility_bias: float
    rays: int = 0
    denoise: int = 0

    @property
    def volume(self) -> Volume:
        """Where the probes are."""
        return self.settings.volume(self.scene)


@dataclass(frozen=True)
class CapturedProbes:
    """What frames begin from.

    Attributes:
        volume: where the probes are.
        maps: each probe's G-buffer.
        usable: (p,) probes that do not lie inside a surface.
        far: distance of the far plane, m.
        irradiance: (p, t, 3) float32, W/m2; None where probes are lit while frames run.
        distance: (p, t, 2) float32 filtered mean and mean square, in units of ``far``; None where
            there are none or they are filtered while frames run.
        lobes: of each step of roughness (p, t, 3) float32 prefiltered radiance, W/m2/sr; empty
            where there are none or they are filtered while frames run.
    """

    volume: Volume
    maps: tuple[ProbeMaps, ...] = field(repr=False)
    usable: npt.NDArray[np.bool_] = field(repr=False)
    far: float
    irradiance: Floats | None = field(default=None, repr=False)
    distance: Floats | None = field(default=None, repr=False)
    lobes: tuple[Floats, ...] = field(default=(), repr=False)

    @property
    def captured_bytes(self) -> int:
        """The most that a probe's cube took while it was baked."""
        return max(own.captured_bytes for own in self.maps)


def far_plane(volume: Volume) -> float:
    """Distance of the far plane, m: the volume's diagonal."""
    return float(np.linalg.norm(np.array(volume.counts) * np.array(volume.spacing)))


def probe_stages(name: str, context: BakeContext, asked: Asked) -> tuple[Stage, ...]:
    """The stages of technique ``name``; the last one's value is a :class:`CapturedProbes`."""
    scene, settings, volume = asked.scene, asked.settings, asked.volume
    # Neither lights nor cameras are in a G-buffer.
    unlit = replace(scene, lights=(), cameras=(), probes=ProbeSettings())
    # The same for every technique of captured probes.
    maps = Stage(
        name="captured-maps",
        key=stage_key(
            "captured-maps",
            MAPS_VERSION,
            unlit.content_hash(),
            volume,
            settings.capture_texels,
            settings.map_texels,
            settings.map_sharpness,
        ),
        compute=_maps,
        given=asked,
        units=tuple(Unit(f"probe-{index:05d}", index) for index in range(volume.probes)),
        format=Format(_write_maps, _read_maps),
        title="Capturing probes",
        made_from=(("scene", scene.name), ("probes", volume.probes)),
    )
    needs: tuple[Stage, ...] = (maps,)
    if not settings.relit:
        light = Stage(
            name=f"{name}-light",
            key=stage_key(
                f"{name}-light",
                LIGHT_VERSION,
                scene.lights_at(0),
                settings.bounce_count,
                settings.backface_threshold,
                asked.distance_sharpness,
                asked.surface_bias,
                asked.visibility_bias,
                asked.rays,
                asked.denoise,
                settings.gloss_steps,
                needs=needs,
            ),
            compute=_light,
            given=asked,
            needs=needs,
            format=Format(_write_light, _read_light),
            made_from=(("scene", scene.name), ("settings", repr(settings))),
        )
        needs = (maps, light)
    whole = Stage(
        name=f"{name}-probes",
        key=stage_key(f"{name}-probes", 0, settings.backface_threshold, needs=needs),
        compute=_whole,
        given=asked,
        needs=needs,
        keep=Keep.NEVER,
    )
    return *needs, whole


def _maps(asked: Asked, needed: Sequence[Any], unit: Unit, worker: Worker) -> ProbeMaps:
    """Capture a probe's cube, resample it, and let it go."""
    settings, volume = asked.settings, asked.volume
    directions = worker.shared("cube", lambda: cube_directions(settings.capture_texels))

    def make() -> Resampling:
        texels = texel_directions(settings.map_texels)
        return Resampling.of(texels, directions, settings.map_sharpness)

    resampling = worker.shared("resampling", make)
    position = volume.positions[unit.index]
    captured = capture(asked.scene, scene_tracer(asked.scene), position, directions)
    return resampled(captured, resampling, far_plane(volume))


def _usable(asked: Asked, maps: Sequence[ProbeMaps]) -> npt.NDArray[np.bool_]:
    return np.array([own.back_share <= asked.settings.backface_threshold for own in maps])


@dataclass(frozen=True)
class _Light:
    """Of probes that are lit once: what :class:`CapturedProbes` has."""

    irradiance: Floats = field(repr=False)
    distance: Floats | None = field(repr=False)
    lobes: tuple[Floats, ...] = field(repr=False)


def _light(asked: Asked, needed: Sequence[Any], unit: Unit, worker: Worker) -> _Light:
    """Light them."""
    maps: Sequence[ProbeMaps] = needed[0]
    scene, settings, volume = asked.scene, asked.settings, asked.volume
    distance, visibility = None, None
    if asked.distance_sharpness is not None:
        moments = np.stack([own.moments for own in maps])
        distance = filtered_moments(moments, settings.map_texels, asked.distance_sharpness)
        visibility = Visibility(distance, far_plane(volume), asked.visibility_bias)
    rays = None
    if asked.rays:
        rays = RayGather(asked.rays, asked.denoise, asked.visibility_bias, far_plane(volume))
    lit = lit_once(
        scene,
        scene.lights_at(0),
        scene_tracer(scene),
        maps,
        volume,
        _usable(asked, maps),
        settings.map_texels,
        bounces=settings.bounce_count,
        surface_bias=asked.surface_bias,
        visibility=visibility,
        rays=rays,
    )
    lobes: tuple[Floats, ...] = ()
    if settings.gloss_steps:
        lobes = prefiltered(lit.radiance, settings.map_texels, settings.gloss_steps)
    return _Light(lit.irradiance, distance, lobes)


def _whole(asked: Asked, needed: Sequence[Any], unit: Unit, worker: Worker) -> CapturedProbes:
    maps: tuple[ProbeMaps, ...] = needed[0]
    volume = asked.volume
    found = CapturedProbes(volume, maps, _usable(asked, maps), far_plane(volume))
    if len(needed) == 1:
        return found
    light: _Light = needed[1]
    return replace(found, irradiance=light.irradiance, distance=light.distance, lobes=light.lobes)


# How it is stored

_MAP_ARRAYS = ("triangle", "barycentric", "albedo", "emission", "moments")


def _write_maps(maps: ProbeMaps) -> Arrays:
    arrays: Arrays = {name: getattr(maps, name) for name in _MAP_ARRAYS}
    told = np.array([maps.back_share, maps.captured_bytes], np.float64)
    return {**arrays, "told": told}


def _read_maps(unit: Unit, stored: Arrays) -> ProbeMaps:
    back_share, captured_bytes = stored["told"]
    arrays = {name: stored[name] for name in _MAP_ARRAYS}
    return ProbeMaps(**arrays, back_share=float(back_share), captured_bytes=int(captured_bytes))


def _write_light(light: _Light) -> Arrays:
    arrays: Arrays = {"irradiance": light.irradiance}
    if light.distance is not None:
        arrays["distance"] = light.distance
    return {**arrays, **{f"lobes-{step}": own for step, own in enumerate(light.lobes)}}


def _read_light(unit: Unit, stored: Arrays) -> _Light:
    steps = sum(name.startswith("lobes-") for name in stored)
    lobes = tuple(stored[f"lobes-{step}"] for step in range(steps))
    return _Light(stored["irradiance"], stored.get("distance"), lobes)
