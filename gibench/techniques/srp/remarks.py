"""Why SRP will not come near a scene's light, told before a run."""

from __future__ import annotations

from typing import Final

from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.techniques.job import Job
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.rare_light import rare_light
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.unseen_ends import unseen_light

_WANTED: Final = 10.0  # hits of a probe's rays
_WANTED_IN_ALL: Final = 400.0  # of all probes' rays: were they independent, 10 % to two sigma
_MOST_RAYS: Final = 16_384  # beyond, a probe's own light is left to be noise
_UNSEEN: Final = 0.1
"""Share of the light that may fall where probes see none arrive: 0 to 1 % in the built-in scenes,
whose bias is at most 8 % for other reasons, 42 % in Sponza, at -40 %."""
_SKY_BYTES: Final = 80  # a receiver's part of the sky's column, about: 78 in Sponza, at order 7


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
    if settings.relight_samples < rays:
        times = rays / settings.relight_samples
        mend = f", or --set srp.relight_samples={rays}: {times:.1f} times the rays of probe_update"
        mend += end
    return rare_light(space, settings.relight_samples, "of a probe", mend)


def unseen_remarks(scene: Scene, lightmap: Lightmap, probes: ProbeSet, *, moves: bool) -> list[str]:
    """Surfaces that the placed probes leave black, as they see none of what their light comes from.

    Args:
        scene: the scene.
        lightmap: its receivers.
        probes: as they are placed.
        moves: whether objects move, which the sky apart from the probes forbids.
    """
    unseen = unseen_light(scene, lightmap, probes)
    if unseen <= _UNSEEN:
        return []
    extra = _SKY_BYTES * len(lightmap.receivers) / 2**20
    mend = (
        "no setting lights them where objects move"
        if moves
        else "--set srp.sky=receivers keeps the sky at each receiver instead of in the probes, for "
        f"another bake, about {extra:.1f} MiB and a probe more to project"
    )
    return [
        f"{unseen:.0%} of the light falls on surfaces of whose rays no probe sees the end, as on a "
        f"model's outside under the sky, which stay black: {mend}"
    ]
