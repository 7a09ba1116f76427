"""SRP taken apart: its light with one part replaced by what is exact, or by something else.

Everything that follows the bake is done on the host in float64
(:mod:`gibench.techniques.srp.bake.host_light`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from math import pi
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix, vstack

from gibench.arrays import Doubles, Ints
from gibench.bake.run import run_bake
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import ProbeSettings, Scene
from gibench.techniques.parts.captured_probes.lighting import direct_irradiance
from gibench.techniques.parts.captured_probes.points import Points
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.bake.host_light import (
    from_clusters,
    from_rows,
    probe_radiance,
    settled,
)
from gibench.techniques.srp.bake.relight import relight_samples, texels_of_hits
from gibench.techniques.srp.bake.sampling import triangle_planes
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import Given, srp_stages
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.transport_rows import TransportRows
from gibench.techniques.srp.bake.visibility import visibility_tables
from gibench.techniques.srp.bake.weights import nearby

MORE_RELIGHT = 16
"""Times as many relight rays, where these are replaced."""
_AT_ONCE = 128


@dataclass(frozen=True)
class Parts:
    """What SRP's light is made of on one scene.

    Attributes:
        scene: the scene, its lights standing.
        lightmap: its receivers.
        settings: of the bake.
        bake: what it gave.
        sent: (n, 3) what the receivers send out without indirect light, W/m2/sr.
        truth: (n, 3) true irradiance, W/m2.
        seed: of the bake.
        folder: where bakes are kept.
    """

    scene: Scene = field(repr=False)
    lightmap: Lightmap = field(repr=False)
    settings: SrpBakeSettings
    bake: SrpBake = field(repr=False)
    sent: Doubles = field(repr=False)
    truth: Doubles = field(repr=False)
    seed: int
    folder: Any

    @property
    def count(self) -> int:
        """Receivers."""
        return len(self.lightmap.receivers)

    def gather(self, sent: Doubles) -> Doubles:
        """Irradiance (n, 3), W/m2, of what receivers send out (n, 3), W/m2/sr."""
        light = probe_radiance(self.bake.relight, self.lightmap, sent, self.scene.environment)
        return from_clusters(self.bake.clusters, light, self.count)

    def light(self, gather: Callable[[Doubles], Doubles] | None = None) -> Doubles:
        """Irradiance (n, 3) of many bounces, W/m2, by SRP's own steps or another's."""
        albedo = self.lightmap.receivers.albedo
        return settled(gather or self.gather, self.sent, albedo, bounces=True)


def without_compression(parts: Parts) -> Doubles:
    """Light (n, 3), W/m2, by the transport as it is before compression."""
    rows = list(_rows(parts))

    def gather(sent: Doubles) -> Doubles:
        light = probe_radiance(parts.bake.relight, parts.lightmap, sent, parts.scene.environment)
        return from_rows(rows, light, parts.count)

    return parts.light(gather)


def with_true_light(parts: Parts) -> Doubles:
    """Light (n, 3), W/m2, by probes that see the true light at the end of each relight ray."""
    albedo = parts.lightmap.receivers.albedo
    return parts.gather(parts.sent + albedo / pi * parts.truth)


def with_light_of_the_point(parts: Parts) -> Doubles:
    """Light by probes that see the direct light of the very point where each relight ray ends,
    not that of the middle of its receiver.
    """
    scene, tracer, relight = parts.scene, scene_tracer(parts.scene), parts.bake.relight
    receivers, normals = parts.lightmap.receivers, triangle_planes(parts.scene.corners)[:, :3]
    basis, albedo = relight.basis.astype(np.float64), receivers.albedo.astype(np.float64)
    first = np.empty((len(relight.texel), basis.shape[1], 3))
    for position, texel, out in zip(parts.bake.probes.positions, relight.texel, first, strict=True):
        start = np.broadcast_to(position.astype(np.float32), relight.directions.shape)
        hits = tracer.closest(start, relight.directions)
        met = np.flatnonzero(texel >= 0)
        own = parts.lightmap.receiver_of_texel[texel[met]]
        along = hits.distance[met, None].astype(np.float64) * relight.directions[met]
        normal = normals[hits.triangle[met]].astype(np.float64)
        points = Points(position + along, normal, normal)
        direct = direct_irradiance(scene, scene.lights_at(0), tracer, points)
        out[:] = basis[met].T @ (receivers.emission[own] + albedo[own] / pi * direct)

    def gather(sent: Doubles) -> Doubles:
        reflected = sent - parts.sent
        light = probe_radiance(relight, parts.lightmap, reflected, scene.environment)
        return from_clusters(parts.bake.clusters, first + light, parts.count)

    return parts.light(gather)


def with_more_relight_rays(parts: Parts) -> Doubles:
    """Light (n, 3), W/m2, by probes with :data:`MORE_RELIGHT` times the relight rays."""
    more = relight_samples(
        parts.scene,
        parts.lightmap,
        parts.bake.probes,
        scene_tracer(parts.scene),
        parts.settings.order,
        MORE_RELIGHT * parts.settings.relight_samples,
        parts.seed,
    )
    return replace(parts, bake=replace(parts.bake, relight=more)).light()


def without_band_limit(parts: Parts, unseen: bool = False) -> Doubles:
    """Light by what the receivers' own rays meet, instead of the probes' band-limited radiance
    there.

    Args:
        parts: the parts.
        unseen: of all rays, those among them whose end no probe sees.
    """
    gathered = list(_seen_by_rays(parts, unseen))
    matrix = vstack([own for own, _ in gathered]).tocsr()
    sky = np.concatenate([own for _, own in gathered])
    return parts.light(lambda sent: np.asarray(matrix @ sent) + sky)


def one_bounce(parts: Parts) -> Doubles:
    """Light (n, 3), W/m2, that was reflected once at most, whatever it comes from."""
    receivers = parts.lightmap.receivers
    unreflected = parts.gather(receivers.emission.astype(np.float64))
    return parts.gather(parts.sent + receivers.albedo / pi * unreflected)


def baked_otherwise(
    parts: Parts, positions: npt.NDArray[np.float32] | None = None, **settings: Any
) -> Doubles:
    """Light by a bake of other settings, or of probes at ``positions`` (p, 3)."""
    scene = parts.scene
    if positions is not None:
        scene = replace(scene, probes=ProbeSettings(len(positions), positions))
        settings = {**settings, "probes": None}
    given = Given(scene, parts.lightmap, replace(parts.settings, **settings), parts.seed)
    bake = run_bake(srp_stages(given), parts.folder)
    return replace(parts, bake=bake).light()


def _baker(parts: Parts) -> TransportBaker:
    scene, lightmap, probes = parts.scene, parts.lightmap, parts.bake.probes
    tracer, tables = scene_tracer(scene), None
    if parts.settings.visibility == "cached":
        tables = visibility_tables(
            scene, lightmap, probes, tracer, surface_offset(scene), parts.seed
        )
    return TransportBaker(scene, lightmap, probes, parts.settings, tracer, tables, parts.seed)


def _members(parts: Parts) -> Iterator[Ints]:
    for begin in range(0, parts.count, _AT_ONCE):
        yield np.arange(begin, min(begin + _AT_ONCE, parts.count), dtype=np.int32)


def _rows(parts: Parts) -> Iterator[tuple[Ints, TransportRows]]:
    worker = _baker(parts).worker()
    return ((members, worker.rows(members)) for members in _members(parts))


def _seen_by_rays(parts: Parts, unseen: bool) -> Iterator[tuple[csr_matrix, Doubles]]:
    """What receivers take from each other (m, n), and from the sky (m, 3), W/m2."""
    worker, tracer = _baker(parts).worker(), scene_tracer(parts.scene)
    normals = triangle_planes(parts.scene.corners)[:, :3]
    lightmap = parts.lightmap
    for members in _members(parts):
        rays = worker.primary_rays(members)
        shape = rays.directions.shape[:2]
        flat = rays.directions.reshape(-1, 3)
        hits = tracer.closest(rays.origins.reshape(-1, 3), flat)
        if unseen:
            counts = np.full(len(members), shape[1])
            usable = np.einsum("rx,rx->r", flat, flat) > 0.5
            facing = np.einsum("rx,rx->r", normals[np.maximum(hits.triangle, 0)], flat) < 0
            usable &= (hits.triangle < 0) | facing
        else:
            usable = _seen_by_probes(parts, worker.decisions(members), members)
            counts = np.maximum(usable.sum(axis=1), 1)
            least = parts.settings.least_valid * parts.settings.transport_rays
            usable[counts < least] = False
            usable = usable.reshape(-1)
        row = np.repeat(np.arange(len(members)), shape[1])
        texel = texels_of_hits(lightmap, hits)
        met = np.where(texel >= 0, lightmap.receiver_of_texel[np.maximum(texel, 0)], -1)
        hit = usable & (met >= 0)
        matrix = csr_matrix(
            (pi / counts[row[hit]], (row[hit], met[hit])), shape=(len(members), parts.count)
        )
        light = np.where(
            (usable & (hits.triangle < 0))[:, None], parts.scene.environment.radiance(flat), 0.0
        )
        yield matrix, pi / counts[:, None] * light.reshape(*shape, 3).sum(axis=1)


def _seen_by_probes(
    parts: Parts, decisions: npt.NDArray[np.bool_], members: Ints
) -> npt.NDArray[np.bool_]:
    """(m, s) rays whose end any probe in reach sees."""
    pairs = nearby(parts.lightmap.receivers.position[members], parts.bake.probes)
    seen = np.zeros((len(members), decisions.shape[1]), np.bool_)
    for number, (begin, end) in enumerate(zip(pairs.start[:-1], pairs.start[1:], strict=True)):
        seen[number] = decisions[begin:end].any(axis=0)
    return seen


REPLACEMENTS: dict[str, Callable[[Parts], Doubles]] = {
    "nothing": Parts.light,
    "compression": without_compression,
    "visibility tables": partial(baked_otherwise, visibility="exact"),
    "light at relight hits": with_true_light,
    "direct light of the map": with_light_of_the_point,
    "relight rays": with_more_relight_rays,
    "band limit": without_band_limit,
    "band limit, unseen rays": partial(without_band_limit, unseen=True),
    "sky in probes": partial(baked_otherwise, sky="receivers"),
    "bounces": one_bounce,
    "placement, by error": partial(baked_otherwise, placement="error"),
}
"""Light with a part replaced, by what is replaced; the one that takes longest last."""
