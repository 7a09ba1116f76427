"""Surfel caches, frame by frame (Jendersie et al. 2016)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from gibench.arrays import Floats
from gibench.device import Device, ProgramSpec, updates
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.techniques.job import Job, World
from gibench.techniques.parts.camera_pass import suits_packets
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gathered import gathered_at
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.recolouring import Recolouring
from gibench.techniques.parts.standing_light import StandingLight
from gibench.techniques.registry import TUNED
from gibench.techniques.surfel_cache.bake.data import SurfelBake
from gibench.techniques.surfel_cache.pack import (
    Sizes,
    arrays_of,
    flux_scale,
    most_colours,
    surfel_shares,
)
from gibench.techniques.surfel_cache.passes import FramePasses
from gibench.techniques.surfel_cache.settings import SurfelCacheSettings
from gibench.techniques.surfel_cache.shared_exponent import SHARED_MACROS
from gibench.techniques.technique import FloatArray, Pass

REST_CHANGE = 0.005
"""Root mean square change of all caches' coefficients from look to look, as a share of themselves,
that counts as none."""
# Albedo to whole numbers, emission to mantissas: three channels each, and their scale.
_ENCODED_FLOPS = 10


class SurfelCache:
    """Surfel caches on a device.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    name: ClassVar[str] = "surfel-cache"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        settings: SurfelCacheSettings = job.settings
        bake: SurfelBake = world.baked
        tuned = job.variant == TUNED
        self.device, self.bake = device, bake
        self._light = StandingLight(REST_CHANGE)
        self._job, self._world = job, world
        self.scene = FrameScene.of(device, job.shot, world)
        self.sizes = Sizes.of(bake, settings, tuned, device.vector_width)
        held = device.allocate(
            self.sizes.buffers(), arrays_of(bake, world.scene, self.sizes, world.motion)
        )
        surfels, motion = bake.surfels, world.motion
        self.recolouring: Recolouring | None = None
        if (shares := surfel_shares(world.scene, bake, motion)) is not None:
            self.recolouring = Recolouring.create(
                device,
                shares,
                self.scene.surfaces.materials,
                ProgramSpec("surfel_cache/recolour.cl", {**SCENE_MACROS, **SHARED_MACROS}),
                (
                    updates("surfel_albedo", held["surfel_albedo"]),
                    updates("surfel_emission", held["surfel_emission"]),
                ),
                stored_bytes=8,
                stored_flops=_ENCODED_FLOPS,
            )
        albedo, emission = most_colours(bake, motion)
        scale = flux_scale(world.scene, len(surfels), surfels.area, albedo, emission)
        self.frame = FramePasses(
            scene=self.scene,
            bake=bake,
            settings=settings,
            sizes=self.sizes,
            held=held,
            hits=HitBuffer.create(device, job.shot.width, job.shot.height),
            flux_scale=scale,
            packets=tuned and suits_packets(device),
            workgroup_size=job.group_size,
        )

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order."""
        first = [] if self.recolouring is None else self.recolouring.passes()
        return [*first, *self.frame.passes()]

    def begin_frame(self, frame: int) -> None:
        """Move lights, camera and objects."""
        self.scene.begin_frame(frame)

    def at_rest(self) -> bool:
        """Whether its bounces have come together: every frame adds one (Jendersie et al. 2016,
        section 4.1: surfels are lit by the last frame's caches), until the caches' coefficients
        change by no more than ``REST_CHANGE`` of themselves from one look to the next.
        """
        held = [self.device.read(self.frame.held[name]) for name in ("cache_map", "cache_grid")]
        light = [each.view(np.float16)[..., :3].reshape(-1) for each in held]
        return self._light.takes(np.concatenate(light))

    def look_from(self, camera: Camera) -> None:
        """See the scene from ``camera`` wherever there is no flight."""
        self.scene.look_from(camera)

    def images(self) -> dict[str, FloatArray]:
        """The frame, its direct and its indirect part, (h, w, 3) W/m2/sr."""
        return self.frame.application.images(self._job.group_size)

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2, in the lightmap's order.

        The receivers are on the device only meanwhile: no frame needs them.

        Raises:
            CannotRun: they do not fit beside the technique.
        """
        return gathered_at(
            self._world.lightmap.receivers,
            self.device,
            self.frame.receivers,
            self._job.group_size,
            {"looked_up_place": self._places()},
        )

    def _places(self) -> Floats:
        uvs = self.device.read(self.frame.held["cache_uvs"]).reshape(-1, 3, 2)
        return map_places(self._world.scene, self._world.lightmap, uvs)

    def counts(self) -> dict[str, int]:
        """Surfels, caches that are lit, and receivers it is compared on."""
        caches = self.bake.caches
        return {
            "surfels": len(self.bake.surfels),
            "caches": caches.on_map + caches.in_grid,
            "receivers": len(self._world.lightmap.receivers),
        }

    def notes(self) -> list[str]:
        """Where the caches are, how deep the hierarchy is, and what it took to link them."""
        caches, rays = self.bake.caches, self.bake.links.rays
        pairs = len(self.bake.surfels) * (caches.on_map + caches.in_grid)
        return [
            f"{caches.on_map:,} caches on the map and {caches.in_grid:,} in a grid of "
            f"{'x'.join(str(n) for n in caches.volume.counts)}; {caches.left_out:,} inside "
            "geometry are left out",
            f"a hierarchy of {len(self.bake.hierarchy.level) - 1} levels over "
            f"{len(self.bake.surfels):,} surfels of {self.bake.surfels.area * 1e4:.3g} cm2",
            f"{rays:,} rays for links, {rays / pairs:.3f} for every pair of a cache and a surfel",
        ]


def map_places(scene: Scene, lightmap: Lightmap, uvs: Floats) -> Floats:
    """Where receivers lie in a map of ``uvs`` (t, 3, 2), (n, 2) texels: by the largest piece of
    surface that each covers; negative where that has no place.
    """
    fragments, receivers = lightmap.fragments, lightmap.receivers
    places = np.full((len(receivers), 2), -1.0, np.float32)
    has = np.flatnonzero(np.diff(fragments.start))
    owner = np.repeat(np.arange(len(receivers)), np.diff(fragments.start))
    order = np.lexsort((fragments.area, owner))
    triangle = fragments.triangle[order[fragments.start[has + 1] - 1]]
    a, b, c = (scene.corners[triangle, k].astype(np.float64) for k in range(3))
    e, f, p = b - a, c - a, receivers.position[has].astype(np.float64) - a
    ee, ef, ff = ((x * y).sum(axis=1) for x, y in ((e, e), (e, f), (f, f)))
    pe, pf = (p * e).sum(axis=1), (p * f).sum(axis=1)
    det = np.maximum(ee * ff - ef * ef, 1e-30)
    u, v = (pe * ff - pf * ef) / det, (pf * ee - pe * ef) / det
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), 0, 1)
    weights /= weights.sum(axis=1, keepdims=True)
    corners = uvs[triangle].astype(np.float64)
    at = np.einsum("ij,ijk->ik", weights, corners)
    at[corners[:, 0, 0] < 0] = -1.0
    places[has] = at
    return places
