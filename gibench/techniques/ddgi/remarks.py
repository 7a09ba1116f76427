"""Why DDGI will not come near a scene's light, told before a run."""

from __future__ import annotations

import math
from typing import Final

from gibench.scene.model import Camera, Scene
from gibench.techniques.ddgi.placement import SPACINGS, make_volume, wanted_probes
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.job import Job
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.parts.rare_light import rare_light
from gibench.techniques.parts.thin_walls import leaking_walls
from gibench.techniques.parts.unseen_sky import told_of_sky

# Probes further apart than surfaces lie on both sides of a wall, and few between walls.
_FURTHEST: Final = 0.9
# Share of all light that may fall where no probe is. Probes behind the surface still give it some:
# with 10 and 12 % (thin-house, vase) the bias stays below 7 %, with 48 % (Sponza) it is -55 %.
_UNSEEN: Final = 0.2
# About what a probe takes beside its rays: maps, distances, variation; then a ray's hit and light.
_PROBE_BYTES: Final = 2000
_RAY_BYTES: Final = 40


def remarks(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Probes too few between surfaces, and light that their rays seldom find."""
    settings: DdgiSettings = job.settings
    space, volume = free_space(scene), make_volume(scene, settings)
    told = []
    furthest = max(volume.spacing)
    if furthest > _FURTHEST * space.closeness:
        wanted = wanted_probes(scene, SPACINGS * space.closeness)
        mib = wanted * (_PROBE_BYTES + _RAY_BYTES * settings.rays) / 2**20
        told.append(
            f"a fifth of the surfaces have others within {space.closeness:.3g} m, and probes are "
            f"{furthest:.3g} m apart: light is lost in walls or leaks through them; "
            f"--probes {wanted} sets them close enough, with {wanted / volume.probes:.1f} times "
            f"the rays and about {mib:.0f} MiB"
        )
    if not settings.scrolling:
        bias = (settings.normal_bias + settings.view_bias) * min(volume.spacing)
        reach = _reach(settings, volume)
        told += told_of_sky("ddgi", scene, volume, bias, "rays and memory", _UNSEEN, reach)
    window = 2 / (1 - settings.hysteresis) - 1
    longer = ", or average longer: --set ddgi.hysteresis=0.995 settles in six times the frames"
    return told + rare_light(space, settings.blended * window, "of a probe", longer)


def _reach(settings: DdgiSettings, volume: Volume) -> float:
    """What a probe's distances are averaged over at the next probe, m."""
    texel = math.sqrt(4 * math.pi) / settings.distance_texels
    lobe = 2 * math.sqrt(2 * math.log(2) / max(settings.distance_exponent, 1.0))
    return max(texel, lobe) * max(volume.spacing)


def flaws(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Walls that probes do not resolve: thinner than what their distances are averaged over at the
    next probe, a texel or the lobe of ``distance_exponent``, where near and far are one mean with a
    large variance.
    """
    settings: DdgiSettings = job.settings
    volume = make_volume(scene, settings)
    return leaking_walls(
        scene,
        _reach(settings, volume),
        "over which a probe's distances are averaged at the next probe",
        f"--probes {8 * volume.probes} halves that, with eight times the rays and memory",
    )
