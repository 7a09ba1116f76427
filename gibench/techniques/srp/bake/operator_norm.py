"""Expected reconstruction error of a probe set (Silvennoinen and Lehtinen 2017, section 5.2)."""

from __future__ import annotations

from dataclasses import replace
from math import comb, pi
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.progress import progress
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import SHORT_OF_TARGET, surface_offset
from gibench.rays.tracer import RayTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet, sh_count
from gibench.techniques.srp.bake.sampling import sphere_directions, triangle_planes
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.visibility import visibility_tables

RECEIVER_ORDER = 9
"""Of the incident radiance at a receiver: 100 coefficients (section 5.2)."""


def cosine_vector(normal: npt.NDArray[Any], order: int = RECEIVER_ORDER) -> Doubles:
    """(n, (order + 1)^2): what irradiance on surfaces of ``normal`` (n, 3) makes of SH radiance.

    The clamped cosine's zonal coefficients times the basis in the normal's direction (Ramamoorthi
    and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps", eq. 8).
    """
    basis = sh_basis(order, normal)
    for degree in range(order + 1):
        basis[:, degree**2 : (degree + 1) ** 2] *= _clamped_cosine(degree)
    return basis


def operator_norm(
    scene: Scene,
    lightmap: Lightmap,
    probes: ProbeSet,
    settings: SrpBakeSettings,
    directions: int = 1024,
    seed: int = 0,
) -> Doubles:
    """||<cos, (I - P_x P*) .>|| of every receiver over the norm of <cos, .> (equation 12).

    The receiver's radiance is projected to the probes (each probe takes the role of a receiver and
    the receiver that of its only probe, with infinite support, so that its radiance counts where
    it and the probe see the same point) and reconstructed from there by the uncompressed transport.
    0 is perfect for every lighting; 1 is no better than black.

    Args:
        scene: the scene.
        lightmap: its receivers.
        probes: the probes.
        settings: of the transport: order, rays and interpolation.
        directions: per probe. Their noise adds to the norm: on the Cornell Box with 2, 10 and 29
            probes 1024 gave 3 % more than 4096.
        seed: of the samples.

    Returns:
        (n,) the relative norm.
    """
    settings = replace(settings, receiver_order=0)
    tracer = scene_tracer(scene)
    offset = surface_offset(scene)
    tables = None
    if settings.visibility == "cached" and settings.interpolation == "srp":
        tables = visibility_tables(scene, lightmap, probes, tracer, offset, seed)
    worker = TransportBaker(scene, lightmap, probes, settings, tracer, tables, seed).worker()
    coefficients = sh_count(settings.order)
    rng = np.random.default_rng([seed, 7])
    around = sphere_directions(directions, rng).astype(np.float32)
    basis = sh_basis(settings.order, around) * (4.0 * np.pi / directions)
    points, planes, escaped, back = _seen_by_probes(scene, probes, tracer, around)
    receivers = lightmap.receivers
    ideal = cosine_vector(receivers.normal)
    norms = np.empty(len(receivers))
    with progress("Operator norm", len(receivers)) as advance:
        for begin in range(0, len(receivers), 64):
            chunk = np.arange(begin, min(begin + 64, len(receivers)), dtype=np.int32)
            rows = worker.rows(chunk)
            transport = rows.matrix.reshape(len(chunk), len(rows.probes), coefficients)
            for receiver, row in zip(chunk, transport, strict=True):
                used = np.flatnonzero(np.any(row != 0, axis=1))
                probe = rows.probes[used]
                origin = receivers.position[receiver] + offset * receivers.normal[receiver]
                weights = row[used].astype(np.float64) @ basis.T
                towards, sees = _mutual(
                    tracer,
                    origin=origin,
                    normal=receivers.normal[receiver],
                    points=points[probe],
                    planes=planes[probe],
                    escaped=escaped[probe],
                    back=back[probe],
                    around=around,
                )
                chain = weights[sees] @ sh_basis(RECEIVER_ORDER, towards[sees])
                own = ideal[receiver]
                norms[receiver] = np.linalg.norm(own - chain) / np.linalg.norm(own)
            advance(len(chunk))
    return norms


def _seen_by_probes(
    scene: Scene, probes: ProbeSet, tracer: RayTracer, around: npt.NDArray[np.float32]
) -> tuple[Any, Any, Any, Any]:
    """What the probes see: points (p, s, 3) off their surface, planes (p, s, 4), two masks."""
    shape = (len(probes), len(around))
    points = np.empty((*shape, 3), np.float32)
    planes = np.empty((*shape, 4), np.float32)
    escaped, back = np.empty(shape, np.bool_), np.empty(shape, np.bool_)
    of_triangle = triangle_planes(scene.corners)
    offset = surface_offset(scene)
    for i, position in enumerate(probes.positions.astype(np.float32)):
        hits = tracer.closest(np.broadcast_to(position, around.shape).copy(), around)
        plane = of_triangle[np.maximum(hits.triangle, 0)]
        distance = np.where(np.isfinite(hits.distance), hits.distance, 0.0)[:, None]
        points[i] = position + distance * around + offset * plane[:, :3]
        planes[i] = plane
        escaped[i] = hits.triangle < 0
        back[i] = np.einsum("sx,sx->s", plane[:, :3], around) >= 0
    return points, planes, escaped, back & ~escaped


def _mutual(
    tracer: RayTracer,
    *,
    origin: Any,
    normal: Any,
    points: Any,
    planes: Any,
    escaped: Any,
    back: Any,
    around: npt.NDArray[np.float32],
) -> tuple[Doubles, npt.NDArray[np.bool_]]:
    """Directions (k, s, 3) in which the receiver sees the probes' points, and whether it does."""
    towards = np.where(escaped[..., None], around[None], points - origin).astype(np.float32)
    front = np.einsum("ksx,x->ks", planes[..., :3], origin) > planes[..., 3]
    ask = ~back & (escaped | front) & (np.einsum("ksx,x->ks", towards, normal) > 0)
    limit = np.where(escaped, np.inf, 1.0 - SHORT_OF_TARGET).astype(np.float32)
    sees = ask.copy()
    asked = towards[ask]
    origins = np.broadcast_to(np.asarray(origin, np.float32), asked.shape)
    sees[ask] = ~tracer.occluded(
        np.ascontiguousarray(origins), np.ascontiguousarray(asked), limit[ask]
    )
    directions = towards.astype(np.float64)
    directions /= np.maximum(np.linalg.norm(directions, axis=-1, keepdims=True), 1e-30)
    return directions, sees


def _clamped_cosine(degree: int) -> float:
    """pi, 2 pi / 3, pi / 4, 0, ... (Ramamoorthi and Hanrahan 2001, equation 8)."""
    if degree == 1:
        return 2 * pi / 3
    if degree % 2:
        return 0.0
    half = degree // 2
    sign = -1 if half % 2 == 0 else 1
    return float(sign * 2 * pi * comb(degree, half) / ((degree + 2) * (degree - 1) * 2**degree))
