"""What probe places are judged by: some receivers, their rays, and random lights on the scene.

The lights are spots at random places in the open, of random direction and width; where the sky is
seen, suns in it; and where it shines, lobes of it: what may be switched on at runtime, not what the
scene has. Surfaces reflect them, so that no place is black. The error of a set of probes is that of
the irradiance that their band-limited radiance makes of each of these lights, by the rays of the
receivers themselves, so that no ray's chance is part of it. Of few rays it would be mostly the
chance of which ray meets what probes blur, which places cannot mend: hence many rays, and few
random sums of the lights, whose squared errors add up to those of all lights on average
(Hutchinson 1989).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import pi

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.rays.offset import SHORT_OF_TARGET, surface_offset
from gibench.rays.tracer import Hits, RayTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.relight import ESCAPED, relight_samples, texels_of_hits
from gibench.techniques.srp.bake.sampling import sphere_directions, triangle_planes
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.weights import spatial_weight

# Lights, random sums of them, rays of a receiver, and receivers in reach of a probe, about.
LIGHTS, SUMS, RAYS, IN_REACH = 128, 16, 128, 200
# A fourth of the lights are suns where more than this share of the rays escapes.
_SKY_SHARE = 0.02
# Half the width of a spot, degrees, and the least share of the receivers that it must light.
_SPOT_DEGREES = (20.0, 60.0)
_LEAST_LIT = 0.01
_TRIES = 16
# Bounces, and rays that all of a bounce takes.
_BOUNCES, _BOUNCE_RAYS = 4, 1 << 20


@dataclass(frozen=True)
class Lights:
    """Sums of random lights.

    Attributes:
        sent: (n, k) float32: what each receiver sends out under each sum, W/m2/sr.
        axis: (l, 3) of a light that is a lobe of the sky.
        sky: (l,) its strength, 0 for a spot.
        share: (l, k) of the lights in the sums.
    """

    sent: Floats = field(repr=False)
    axis: Doubles = field(repr=False)
    sky: Doubles = field(repr=False)
    share: Doubles = field(repr=False)

    def summed(self, share: Doubles) -> Lights:
        """Sums of these, by the ``share`` (k, j) of each."""
        sent = self.sent @ share.astype(np.float32)
        return replace(self, sent=sent, share=self.share @ share)

    def seen(self, receiver: Ints, escaped: npt.NDArray[np.bool_], directions: Floats) -> Floats:
        """(r, k) float32 radiance along rays that meet ``receiver`` (r,), -1 for nothing or the
        sky.
        """
        light = np.where(receiver[:, None] >= 0, self.sent[np.maximum(receiver, 0)], 0.0)
        lobes = np.maximum(directions[escaped].astype(np.float64) @ self.axis.T, 0.0) ** 2
        light[escaped] = (lobes * self.sky) @ self.share
        return np.asarray(light, np.float32)


@dataclass(frozen=True)
class Trial:
    """Receivers, their rays and what arrives along them.

    Attributes:
        position: (m, 3) of the receivers, m.
        weight: (m, 1) what a squared error at a receiver counts.
        place: (m, s, 3) float32: where a ray ends, lifted off the surface, or its direction.
        plane: (m, s, 4) float32 of the surface there.
        escaped: (m, s) rays that meet nothing.
        valid: (m, s) rays that meet nothing or the front of a surface.
        truth: (m, k) irradiance under each sum of lights, W/m2.
    """

    position: Doubles = field(repr=False)
    weight: Doubles = field(repr=False)
    place: Floats = field(repr=False)
    plane: Floats = field(repr=False)
    escaped: npt.NDArray[np.bool_] = field(repr=False)
    valid: npt.NDArray[np.bool_] = field(repr=False)
    truth: Doubles = field(repr=False)

    def reached_from(self, place: Doubles, radius: float) -> Doubles:
        """(m,) weights of a probe at ``place`` (3,), m, of support ``radius``, m: 0 out of reach,
        and where a receiver counts nothing.
        """
        distance = np.linalg.norm(self.position - place, axis=1)
        return np.where(self.weight[:, 0] > 0, spatial_weight(distance / radius), 0.0)

    def seen_from(
        self, place: Doubles, own: Ints, tracer: RayTracer
    ) -> tuple[npt.NDArray[np.bool_], Doubles]:
        """Which ends (r, s) of the rays of receivers ``own`` (r,) are seen from ``place`` (3,), m,
        and (r, s, 3) the way to them.
        """
        end, escaped = self.place[own].astype(np.float64), self.escaped[own]
        toward = np.where(escaped[..., None], end, end - place)
        plane = self.plane[own].astype(np.float64)
        ask = self.valid[own] & (escaped | (plane[..., :3] @ place > plane[..., 3]))
        sees = ask.copy()
        limit = np.where(escaped, np.inf, 1.0 - SHORT_OF_TARGET).astype(np.float32)
        rays = toward[ask].astype(np.float32)
        origins = np.ascontiguousarray(np.broadcast_to(place.astype(np.float32), rays.shape))
        sees[ask] = ~tracer.occluded(origins, rays, limit[ask])
        return sees, toward


@dataclass(frozen=True)
class Offer:
    """What one place for a probe gives.

    Attributes:
        receivers: (r,) of the trial within its reach.
        weight: (r, s) float32 its weight at each of their rays, 0 where it does not see the end.
        light: (r, s, k) float16 its radiance there times 1, under each sum of lights.
    """

    receivers: Ints = field(repr=False)
    weight: Floats = field(repr=False)
    light: npt.NDArray[np.float16] = field(repr=False)


@dataclass(frozen=True)
class _Surfaces:
    """What lights shine on: the receivers' positions off their surface, and normals."""

    lifted: Floats
    normal: Floats
    tracer: RayTracer = field(repr=False)

    def spot(self, places: Doubles, rng: np.random.Generator) -> Doubles:
        """(n,) irradiance of a spot at one of ``places`` (c, 3)."""
        place = places[rng.integers(len(places))]
        axis = self.lifted[rng.integers(len(self.lifted))] - place
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        edge = np.cos(np.radians(rng.uniform(*_SPOT_DEGREES)))
        away = self.lifted - place
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        cosine = -np.einsum("nx,nx->n", away, self.normal) / distance
        ask = np.flatnonzero((away @ axis > edge * distance) & (cosine > 0))
        origins = np.broadcast_to(place.astype(np.float32), (len(ask), 3)).copy()
        limit = 1.0 - SHORT_OF_TARGET
        ask = ask[~self.tracer.occluded(origins, away[ask].astype(np.float32), limit)]
        found = np.zeros(len(cosine))
        if len(ask):
            # As far away as it is wide at most: close to a wall it would be all that counts.
            near = float(np.median(distance[ask]))
            found[ask] = cosine[ask] / np.maximum(distance[ask] / near, 0.5) ** 2
        return found

    def sun(self, towards: Floats) -> Doubles:
        """(n,) irradiance of parallel light from ``towards`` (3,)."""
        cosine = self.normal.astype(np.float64) @ towards
        ask = np.flatnonzero(cosine > 0)
        rays = np.broadcast_to(towards, (len(ask), 3)).astype(np.float32)
        ask = ask[~self.tracer.occluded(self.lifted[ask], rays, np.inf)]
        found = np.zeros(len(cosine))
        found[ask] = cosine[ask]
        return found


def random_lights(
    scene: Scene,
    lightmap: Lightmap,
    tracer: RayTracer,
    places: Doubles,
    escapes: Floats,
    sky_share: float,
    rng: np.random.Generator,
) -> Lights:
    """Lights on a scene, of which all reflect.

    Args:
        scene: the scene.
        lightmap: its receivers.
        tracer: of the scene.
        places: (c, 3) in the open, where spots may be, m.
        escapes: (e, 3) directions in which receivers see the sky.
        sky_share: of all the receivers' rays.
        rng: draws them.
    """
    receivers, offset = lightmap.receivers, surface_offset(scene)
    lifted = receivers.position + np.float32(offset) * receivers.normal
    surfaces = _Surfaces(lifted, receivers.normal, tracer)
    irradiance = np.zeros((len(receivers), LIGHTS), np.float32)
    axis, sky = np.zeros((LIGHTS, 3)), np.zeros(LIGHTS)
    seen = sky_share > _SKY_SHARE
    lobes = LIGHTS // 4 if seen and scene.environment.radiance(escapes).any() else 0
    suns = lobes + (LIGHTS // 4 if seen else 0)
    for light in range(LIGHTS):
        if light < lobes:
            axis[light], sky[light] = escapes[rng.integers(len(escapes))], 1.0
            continue
        for _ in range(_TRIES):
            if light < suns:
                irradiance[:, light] = surfaces.sun(escapes[rng.integers(len(escapes))])
            else:
                irradiance[:, light] = surfaces.spot(places, rng)
            if np.count_nonzero(irradiance[:, light]) >= _LEAST_LIT * len(lifted):
                break
    direct = Lights(irradiance / np.float32(pi), axis, sky, np.eye(LIGHTS))
    return replace(direct, sent=_reflected(scene, lightmap, tracer, direct, rng))


def _reflected(
    scene: Scene, lightmap: Lightmap, tracer: RayTracer, lights: Lights, rng: np.random.Generator
) -> Floats:
    """(n, k) float32 what receivers of grey albedo send out after a few bounces, W/m2/sr."""
    receivers, offset = lightmap.receivers, surface_offset(scene)
    albedo = receivers.albedo.mean(axis=1)[:, None]
    count = len(receivers)
    rays = int(np.clip(_BOUNCE_RAYS // count, 8, 64))
    normals = np.repeat(receivers.normal, rays, axis=0).astype(np.float64)
    around = sphere_directions(count * rays, rng)[rng.permutation(count * rays)]
    directions = normals + 0.999 * around
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.repeat(receivers.position, rays, axis=0) + np.float32(offset) * normals
    flat = directions.astype(np.float32)
    hits = tracer.closest(origins.astype(np.float32), flat)
    met, escaped = _met(scene, lightmap, hits, flat)
    starts = np.arange(0, len(flat), rays)
    direct = lights.sent * albedo
    sent = direct
    for _ in range(_BOUNCES):
        now = replace(lights, sent=sent)
        light = np.concatenate(
            [
                np.add.reduceat(
                    now.seen(met[part], escaped[part], flat[part]),
                    starts[: (part.stop - part.start) // rays],
                    axis=0,
                )
                for part in _parts(len(flat), rays)
            ]
        )
        sent = direct + albedo * light / rays
    return np.asarray(sent, np.float32)


def _parts(count: int, rays: int) -> list[slice]:
    """Runs of whole receivers, of some 100,000 rays."""
    step = max(1, 100_000 // rays) * rays
    return [slice(begin, min(begin + step, count)) for begin in range(0, count, step)]


def _met(
    scene: Scene, lightmap: Lightmap, hits: Hits, directions: Floats
) -> tuple[Ints, npt.NDArray[np.bool_]]:
    """(r,) receivers that rays meet from the front, -1 for none, and whether they escape."""
    normal = triangle_planes(scene.corners)[np.maximum(hits.triangle, 0), :3]
    escaped = hits.triangle < 0
    texel = texels_of_hits(lightmap, hits)
    met = np.where(texel >= 0, lightmap.receiver_of_texel[np.maximum(texel, 0)], -1)
    front = np.einsum("rx,rx->r", normal, directions) < 0
    return np.where(front & ~escaped, met, -1), escaped


def make_trial(
    scene: Scene,
    lightmap: Lightmap,
    tracer: RayTracer,
    settings: SrpBakeSettings,
    start: ProbeSet,
    open_places: Doubles,
    seed: int,
) -> tuple[Trial, Lights]:
    """The trial of a scene, and the sums of lights: scaled so that the error of each light is
    relative to its own power, and the mean of them counts.

    Receivers that ``start`` leaves dark, as of too few of their rays any probe sees the end, count
    nothing: from inside of a building no probe can serve its outside, which under the sky would be
    most of the error.
    """
    rng = np.random.default_rng([seed, 11])
    receivers = lightmap.receivers
    count = min(len(receivers), round(IN_REACH * max(1.0, len(start) / settings.overlap)))
    chosen = np.sort(rng.choice(len(receivers), count, replace=False)).astype(np.int32)
    asked = SrpBakeSettings(sh_order=0, transport_rays=RAYS, visibility="exact")
    worker = TransportBaker(scene, lightmap, start, asked, tracer, None, seed).worker()
    rays = worker.primary_rays(chosen)
    flat = rays.directions.reshape(-1, 3)
    hits = tracer.closest(rays.origins.reshape(-1, 3), flat)
    planes = triangle_planes(scene.corners)
    plane = planes[np.maximum(hits.triangle, 0)]
    sent = np.einsum("rx,rx->r", flat, flat) > 0.5
    escaped = (hits.triangle < 0) & sent
    front = np.einsum("rx,rx->r", plane[:, :3], flat) < 0
    valid = sent & (escaped | front)
    distance = np.where(np.isfinite(hits.distance), hits.distance, 0.0)[:, None]
    place = rays.origins.reshape(-1, 3) + distance * flat
    place += np.float32(surface_offset(scene)) * plane[:, :3]
    place[escaped] = flat[escaped]
    lights = random_lights(
        scene, lightmap, tracer, open_places, flat[escaped], float(escaped.mean()), rng
    )
    met = np.where(valid & ~escaped, _met(scene, lightmap, hits, flat)[0], -1)
    seen = lights.seen(met, escaped, flat)
    shape = (count, RAYS)
    truth = pi * seen.reshape(*shape, -1).astype(np.float64).mean(axis=1)
    trial = Trial(
        receivers.position[chosen].astype(np.float64),
        np.ones((count, 1)),
        place.astype(np.float32).reshape(*shape, 3),
        plane.reshape(*shape, 4),
        escaped.reshape(shape),
        valid.reshape(shape),
        truth,
    )
    served = _served(trial, tracer, start, settings.least_valid)
    area = receivers.area[chosen] * (served if served.any() else np.ones(count))
    area /= area.sum()
    power = area @ truth**2
    scale = np.sqrt(np.divide(1.0, power, out=np.zeros_like(power), where=power > 0))
    share = scale[:, None] * rng.normal(size=(len(power), SUMS))
    weight = area[:, None] / (SUMS * max(1, int(np.count_nonzero(power))))
    return replace(trial, weight=weight, truth=truth @ share), lights.summed(share)


def _served(
    trial: Trial, tracer: RayTracer, probes: ProbeSet, least_valid: float
) -> npt.NDArray[np.bool_]:
    """(m,) receivers that ``probes`` do not leave dark."""
    seen = np.zeros_like(trial.valid)
    for place in probes.positions.astype(np.float64):
        own = np.flatnonzero(trial.reached_from(place, probes.radius) > 0).astype(np.int32)
        seen[own] |= trial.seen_from(place, own, tracer)[0]
    return np.asarray(seen.mean(axis=1) >= max(least_valid, 1e-9))


def make_offers(
    scene: Scene,
    lightmap: Lightmap,
    tracer: RayTracer,
    settings: SrpBakeSettings,
    trial: Trial,
    lights: Lights,
    places: Doubles,
    radius: float,
    seed: int,
) -> list[Offer]:
    """What each of ``places`` (c, 3) gives with support ``radius``, m."""
    relight = relight_samples(
        scene, lightmap, ProbeSet(places.astype(np.float32), radius), tracer,
        settings.order, settings.relight_samples, seed,
    )  # fmt: skip
    basis = relight.basis.astype(np.float64)
    offers = []
    for place, texel in zip(places, relight.texel, strict=True):
        met = np.where(texel >= 0, lightmap.receiver_of_texel[np.maximum(texel, 0)], -1)
        light = basis.T @ lights.seen(met, texel == ESCAPED, relight.directions)
        reach = trial.reached_from(place, radius)
        own = np.flatnonzero(reach > 0).astype(np.int32)
        sees, toward = trial.seen_from(place, own, tracer)
        given = np.zeros((*sees.shape, light.shape[1]), np.float16)
        unit = toward[sees] / np.linalg.norm(toward[sees], axis=1, keepdims=True)
        given[sees] = sh_basis(settings.order, unit) @ light
        weight = (sees * reach[own, None]).astype(np.float32)
        offers.append(Offer(own, weight, given))
    return offers
