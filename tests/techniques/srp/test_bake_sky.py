"""The sky apart from the probes: what receivers see of it, and that probes no longer hold it."""

from __future__ import annotations

import numpy as np
import pytest
from support.srp_setups import SETTINGS
from support.tiny_scenes import room

from gibench.bake.run import run_bake
from gibench.errors import BadInput
from gibench.rays.embree import EmbreeTracer
from gibench.scene.environment import Environment
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.host_light import from_clusters, probe_radiance
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.sky import tables_with_sky, with_sky
from gibench.techniques.srp.bake.stages import Given, srp_stages
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.visibility import visibility_tables

PLACES = np.array([[-0.6, 0.5, -0.7], [0.7, 0.4, 0.8], [0.0, 1.7, 0.1]], np.float32)


@pytest.mark.parametrize("visibility", ["exact", "cached"])
def test_a_receiver_holds_its_own_visibility_of_the_sky(rng, visibility):
    """Its block is pi / M sum of Y over the rays that escape, in float64; no other ray's end moves,
    and under radiance 1 from everywhere all of them together give pi.
    """
    scene, lightmap = room(4, open_top=True)
    probes, order = ProbeSet(PLACES, 2.6), 3
    settings = SrpBakeSettings(
        sh_order=order, transport_rays=128, visibility=visibility, least_valid=0.0
    )
    tracer, seed = EmbreeTracer(scene.corners, threads=1), int(rng.integers(1000))
    tables = None
    if visibility == "cached":
        tables = visibility_tables(scene, lightmap, probes, tracer, 1e-5, seed)
    apart = tables_with_sky(tables) if tables else None
    given = scene, lightmap, with_sky(probes), settings, tracer, apart, seed
    chosen = np.sort(rng.choice(len(lightmap.receivers), 24, replace=False)).astype(np.int32)
    worker = TransportBaker(*given).worker()
    rows, rays = worker.rows(chosen), worker.primary_rays(chosen)
    matrix = rows.matrix.reshape(len(chosen), len(rows.probes), -1).astype(np.float64)
    assert rows.probes[-1] == len(PLACES)
    for row, valid, origins, directions in zip(
        matrix, rows.valid, rays.origins, rays.directions, strict=True
    ):
        hits = tracer.closest(origins, directions)
        usable = (hits.triangle < 0) & (np.linalg.norm(directions, axis=1) > 0.5)
        expected = np.pi / max(valid, 1) * sh_basis(order, directions[usable]).sum(axis=0)
        np.testing.assert_allclose(row[-1], expected, atol=2e-5)
        if valid:
            assert row[:, 0].sum() * np.sqrt(4 * np.pi) == pytest.approx(np.pi, rel=1e-4)


def test_a_bake_s_light_of_the_sky_is_what_escapes_to_it(tmp_path):
    """Under a sky of one colour and black surfaces, irradiance is pi times that colour times the
    share of a receiver's usable rays that escape; the probes hold nothing of it.
    """
    scene, lightmap = room(5, open_top=True)
    settings = SrpBakeSettings(**SETTINGS, sky="receivers", svd_threshold=0.0)
    bake = run_bake(srp_stages(Given(scene, lightmap, settings)), tmp_path)
    assert bake.probes.sky and len(bake.probes.placed) == 6
    assert not (bake.relight.texel[:-1] == -1).any() and (bake.relight.texel[-1] == -1).all()
    sky = Environment.constant((2.0, 1.0, 0.5))
    count = len(lightmap.receivers)
    light = probe_radiance(bake.relight, lightmap, np.zeros((count, 3)), sky)
    assert not light[:-1].any()
    found = from_clusters(bake.clusters, light, count)
    tracer = EmbreeTracer(scene.corners, threads=1)
    tables = visibility_tables(scene, lightmap, bake.probes.placed, tracer, 1e-5, 0)
    given = scene, lightmap, bake.probes, settings, tracer, tables_with_sky(tables), 0
    every = np.arange(count, dtype=np.int32)
    worker = TransportBaker(*given).worker()
    rows, rays = worker.rows(every), worker.primary_rays(every)
    hits = tracer.closest(rays.origins.reshape(-1, 3), rays.directions.reshape(-1, 3))
    escapes = (hits.triangle.reshape(count, -1) < 0) & (rays.directions != 0).any(axis=2)
    expected = np.pi * escapes.sum(axis=1) / np.maximum(rows.valid, 1) * (rows.valid > 0)
    # The relight rays' own noise and that of compression; the share itself is exact.
    np.testing.assert_allclose(found[:, 1], expected, atol=0.25)
    assert np.abs(found[:, 1] - expected).mean() < 0.06
    np.testing.assert_allclose(found, found[:, 1:2] * sky.radiance(np.zeros((1, 3))), atol=1e-9)


def test_other_interpolations_have_the_sky_in_the_probes():
    with pytest.raises(BadInput, match="sky=receivers is not for interpolation=spatial"):
        SrpBakeSettings(sky="receivers", interpolation="spatial")
    with pytest.raises(BadInput, match="sky is 'moon'"):
        SrpBakeSettings(sky="moon")
    usual = SrpBakeSettings()
    assert usual.everything != SrpBakeSettings(sky="receivers").everything
    assert "probes" not in usual.everything
