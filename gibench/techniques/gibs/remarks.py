"""Why GIBS will not come near a scene's light, told before a run."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gibench.scene.model import Camera, Scene
from gibench.techniques.camera_path import AROUND, FLIGHT, FlightOptions
from gibench.techniques.gibs.radii import covering_surfels
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.job import Job
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.rare_light import NOISE, OR_DARK, rare_light
from gibench.techniques.parts.reach import light_in_reach
from gibench.techniques.parts.thin_walls import leaking_walls
from gibench.techniques.registry import PUBLISHED

# Share of the indirect light that may fall where little of what is seen has surfels. Rays find some
# of it all the same: with 5 and 21 % (church, street) the bias is -0.6 and -2 %, with 37 % (atrium)
# -32 %, 57 % (vase) -29 %, 73 % (thin-house) -16 % and 83 % (Sponza) -87 %.
_MISSED: Final = 0.3
_LOOKS: Final = 80  # cameras along a path
_WINDOW: Final = 256  # rays that a surfel's mean holds, kernels_cl/gibs/estimator.cl
_TIMES_COVERED: Final = 3.3
"""Surfels alive over those that would lie once over all surfaces: 3.0 to 4.9 in the built-in scenes
that have room for them."""
_FEWEST: Final = 1.05
"""Surfels alive over those that would lie once over all surfaces, with which a tenth of the light
is lost: -10.8 % with 1.0 in `two-rooms`, -4.5 % with 1.6, -18 % with 0.8."""
_SURFEL_BYTES: Final = 1400  # with its place in the grid's lists, about
_HITS_IN_ALL: Final = 400.0
"""Of all surfels' rays, on what seldom is met: two standard deviations of the mean are 10 %."""


def remarks(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Surfaces that get no surfel, and light that rays seldom find."""
    settings: GibsSettings = job.settings
    by_rays = settings.by_rays(job.variant == PUBLISHED)
    told = []
    if not job.shot.flight.frames:
        aspect = job.shot.width / job.shot.height
        missed = 1 - light_in_reach(scene, camera, aspect, by_rays)
        if missed > _MISSED:
            how = "the camera and the surfels' rays" if by_rays else "the camera"
            rays = "" if by_rays else "--set gibs.placement=rays or "
            given, left = _path(settings, scene, camera, aspect, by_rays)
            told.append(
                f"{missed:.0%} of the indirect light falls on surfaces that {how} hardly reach; "
                f"what gets no surfel stays black: {rays}{given} shows all but "
                f"{left:.0%}, with more surfels to hold, to trace and to look up"
            )
    if by_rays:
        told += _no_room(settings, scene, camera)
    return told + _rare(job, scene, camera)[0]


def _path(
    settings: GibsSettings, scene: Scene, camera: Camera, aspect: float, by_rays: bool
) -> tuple[str, float]:
    """Which of the built-in paths shows most of what a camera at rest does not, and what share of
    the light it leaves; as typed, with room for the surfels that lie everywhere then.
    """
    left = {}
    for name in (FLIGHT, AROUND):
        flight = FlightOptions(name).of(scene, camera)
        assert flight is not None
        shares = np.linspace(0.0, 1.0, _LOOKS)
        views = [flight.path.at(share, camera) for share in shares]
        left[name] = 1 - light_in_reach(scene, views, aspect, by_rays)
    best = min(left, key=lambda name: left[name])
    given = f"--camera-path {best}"
    wanted = _TIMES_COVERED * covering_surfels(scene, camera, settings)
    if by_rays and wanted > settings.recycle_pressure_from * settings.surfels:
        given += f" --set gibs.surfels={_room_for(wanted, settings)}"
    return given, left[best]


def _room_for(surfels: float, settings: GibsSettings) -> int:
    """What the setting must be so that rays place so many."""
    return math.ceil(surfels / settings.recycle_pressure_from / 1000) * 1000


def _no_room(settings: GibsSettings, scene: Scene, camera: Camera) -> list[str]:
    """Surfaces that would not lie below one layer of the surfels that are placed before recycling
    begins."""
    once = covering_surfels(scene, camera, settings)
    room = settings.recycle_pressure_from * settings.surfels
    if _FEWEST * once <= room:
        return []
    wanted = _TIMES_COVERED * once
    surfels = _room_for(wanted, settings)
    more = (surfels - settings.surfels) * _SURFEL_BYTES / 2**20
    return [
        f"its surfaces take about {wanted:,.0f} surfels, and rays place none beyond {room:,.0f} of "
        f"the {settings.surfels:,} there is room for: what comes late stays black; --set "
        f"gibs.surfels={surfels} has room for them, with about {more:.0f} MiB more and time for "
        f"each surfel"
    ]


def flaws(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Light that is noise, though its mean is right; without depth tests walls thinner than a
    surfel half the scene's diagonal away reaches.
    """
    return _rare(job, scene, camera)[1] + _thin(job, scene)


def _rare(job: Job, scene: Scene, camera: Camera) -> tuple[list[str], list[str]]:
    """Light that a surfel's rays seldom find: for all surfels together too seldom for the mean, or
    often enough.
    """
    settings: GibsSettings = job.settings
    space = free_space(scene)
    rays = 2.0 * _WINDOW  # a surfel's go to one hemisphere
    share = min(s for s in (space.small_emitters or 1.0, space.bright_sky) if s > 0)
    surfels = min(covering_surfels(scene, camera, settings), settings.surfels)
    enough = share * rays * surfels >= _HITS_IN_ALL
    told = rare_light(space, rays, "of a surfel", "", NOISE if enough else OR_DARK)
    return ([], told) if enough else (told, [])


def _thin(job: Job, scene: Scene) -> list[str]:
    settings: GibsSettings = job.settings
    if settings.depth_moments:
        return []
    away = float(np.linalg.norm(np.subtract(*scene.bounds))) / 2
    field = scene.cameras[0].fov_degrees if scene.cameras else 50.0
    radius = away * 2 * math.tan(math.radians(field) / 2) * settings.radius_share
    return leaking_walls(
        scene,
        radius,
        "a surfel's radius, and depth is not tested",
        "--set gibs.depth_moments=true tests it, for 192 bytes a surfel and some time",
    )
