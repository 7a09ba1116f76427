"""Why SRP will not come near a scene's light, told before a run."""

from __future__ import annotations

from typing import Final

from gibench.scene.model import Camera, Scene
from gibench.techniques.job import Job
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.rare_light import rare_light
from gibench.techniques.srp.settings import SrpSettings

_WANTED: Final = 10.0  # hits of a probe's rays
_WANTED_IN_ALL: Final = 20.0  # of all probes' rays, for the mean
_MOST_RAYS: Final = 16_384  # beyond, a probe's update costs more than a frame has


def remarks(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Light that the probes' rays, the same every frame, seldom find."""
    settings: SrpSettings = job.settings
    space = free_space(scene)
    share = min(s for s in (space.small_emitters or 1.0, space.bright_sky) if s > 0)
    rays = round(_WANTED / share)
    mend, end = "", ""
    if rays > _MOST_RAYS:  # then the mean alone
        probes = settings.probes or scene.probes.count
        rays, end = round(_WANTED_IN_ALL / share / probes), ", for the mean; noise stays"
    if settings.relight_samples < rays <= _MOST_RAYS:
        times = rays / settings.relight_samples
        mend = f", or --set srp.relight_samples={rays}: {times:.1f} times the rays of probe_update"
        mend += end
    return rare_light(space, settings.relight_samples, "of a probe", mend)
