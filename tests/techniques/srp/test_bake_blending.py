"""Transport blended plainly, by distance or by what a receiver sees of a probe."""

from __future__ import annotations

import numpy as np
import pytest
from support.tiny_scenes import empty_room, room

from gibench.errors import BadInput
from gibench.rays.embree import EmbreeTracer
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.weights import spatial_weight
from gibench.techniques.srp.conform_bake_oracle import intersect


@pytest.mark.parametrize("kind", ["spatial", "visibility"])
@pytest.mark.parametrize("order", [0, 3])
def test_plain_blending_against_float64(kind, order):
    """Equation 4.3 sample by sample, in the receiver's own direction."""
    scene, lightmap = room()
    places = [[-0.8, 0.4, -0.8], [0.7, 0.3, 0.8], [0.0, 1.7, 0.1], [0.75, 1.5, -0.9]]
    probes = ProbeSet(np.array(places, np.float32), 1.7)
    settings = SrpBakeSettings(
        sh_order=order, transport_rays=77, interpolation=kind, least_valid=0.0
    )
    tracer = EmbreeTracer(scene.corners, threads=1)
    baker = TransportBaker(scene, lightmap, probes, settings, tracer, None, 3)
    worker = baker.worker()
    receivers = np.arange(0, len(lightmap.receivers), 5, dtype=np.int32)
    rows, rays = worker.rows(receivers), worker.primary_rays(receivers)
    c = (order + 1) ** 2
    matrix = rows.matrix.reshape(len(receivers), -1, c)
    blocked_some = False
    for i, receiver in enumerate(receivers):
        x = lightmap.receivers.position[receiver].astype(np.float64)
        n = lightmap.receivers.normal[receiver].astype(np.float64)
        p = probes.positions.astype(np.float64)
        weight = spatial_weight(np.linalg.norm(x - p, axis=1) / probes.radius)
        if kind == "visibility":
            towards = p - (x + baker.offset * n)
            struck = intersect(scene.corners.astype(np.float64), p - towards, towards)
            free = (struck.min(axis=1) >= 1) & (towards @ n > 0)
            blocked_some |= bool((~free & (weight > 0)).any())
            weight = weight * free
        d = rays.directions[i].astype(np.float64)
        live = (d**2).sum(axis=1) > 0.5
        if weight.sum() == 0:
            assert rows.valid[i] == 0 and not matrix[i].any()
            continue
        assert rows.valid[i] == live.sum()
        mean = np.pi * sh_basis(order, d[live]).mean(axis=0)
        expected = weight[rows.probes][:, None] / weight.sum() * mean
        np.testing.assert_allclose(matrix[i], expected, atol=3e-6)
    assert blocked_some or kind == "spatial"


def test_spatial_blending_of_a_uniform_room_is_exact():
    """Where radiance is the same everywhere, alpha's constant part alone is pi / Y_0."""
    scene, lightmap = empty_room()
    probes = ProbeSet(np.array([[0.1, 1.0, 0.2], [-0.4, 1.2, 0.0]], np.float32), 9.0)
    settings = SrpBakeSettings(sh_order=0, transport_rays=64, interpolation="spatial")
    tracer = EmbreeTracer(scene.corners, threads=1)
    worker = TransportBaker(scene, lightmap, probes, settings, tracer, None, 0).worker()
    rows = worker.rows(np.arange(len(lightmap.receivers), dtype=np.int32))
    radiance = np.sqrt(4 * np.pi)  # the coefficient of radiance 1
    np.testing.assert_allclose(rows.matrix.sum(axis=1) * radiance, np.pi, rtol=1e-5)


def test_interpolation_is_checked():
    with pytest.raises(BadInput, match="interpolation is 'nearest'"):
        SrpBakeSettings(interpolation="nearest")
