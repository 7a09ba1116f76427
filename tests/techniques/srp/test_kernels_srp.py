"""SRP's kernels against float64 NumPy, both variants, on random baked data."""

import numpy as np
import pytest
from support.launches import run_pass
from support.pairwise import pairwise
from support.srp_setups import SHAPES, create
from support.synthetic_bake import random_bake, random_lightmap, random_scene

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.techniques.srp.conform import local_memory
from gibench.techniques.srp.conform_oracle import (
    expected_irradiance,
    expected_probe_radiance,
    expected_signal,
    write_lambda,
)
from gibench.techniques.srp.pack import padded, projection_width
from gibench.techniques.srp.storage import store_cluster, stored_values


@pytest.fixture(scope="module")
def setting():
    rng = np.random.default_rng(11)
    scene = random_scene(rng, 12)
    return rng, scene, random_lightmap(rng, scene, 613, 41, 33)


@pytest.mark.parametrize(
    ("shape", "case"),
    pairwise(
        SHAPES,
        [(7, 100, 7), (6, 257, 64), (0, 33, 100)],
        more={1: [(7, 257, 64), (2, 64, 100), (0, 33, 16), (6, 90, 32)]},
    ),
)
def test_probe_update(setting, shape, case):
    """``case``: order, samples, work-items per group."""
    order, samples, size = case
    rng, scene, lightmap = setting
    bake = random_bake(rng, lightmap, order=order, samples=samples)
    # So little local memory for the tuned variant that 257 samples take several turns.
    technique = create(bake, scene, lightmap, shape, size, local_memory=local_memory(shape, size))
    radiance = rng.uniform(0, 3, (41 * 33, 3)).astype(np.float32)
    values = technique.device.read(technique.variant.radiance)
    values[: len(radiance), :3] = radiance
    technique.device.write(technique.variant.radiance, values)
    run_pass(technique, "probe_update", size)
    expected = expected_probe_radiance(scene, bake, radiance.astype(np.float64))
    found = technique.variant.probe_radiance()
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * np.abs(expected).max())


ORDERS_AND_SIZES = [(7, 7), (5, 64), (0, 100)]
MORE_ORDERS_AND_SIZES = [(7, 64), (5, 100), (2, 32), (1, 1), (0, 16)]


@pytest.mark.parametrize(
    ("shape", "order_and_size", "storage"),
    pairwise(
        SHAPES, ORDERS_AND_SIZES, ["fp32", "fp16", "snorm16"], more={1: MORE_ORDERS_AND_SIZES}
    ),
)
def test_projection_and_transport(setting, shape, order_and_size, storage):
    order, size = order_and_size
    rng, scene, lightmap = setting
    bake = random_bake(rng, lightmap, order=order)
    technique = create(bake, scene, lightmap, shape, size, {"storage": storage})
    radiance = rng.normal(size=(11, bake.coefficients, 3)).astype(np.float32)
    write_lambda(technique, radiance)
    run_pass(technique, "cluster_projection", size)
    run_pass(technique, "irradiance_transport", size)
    expected = expected_irradiance(bake, radiance.astype(np.float64), 613, storage)
    found = technique.indirect_irradiance()
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * np.abs(expected).max())
    dark = bake.clusters[1].receivers
    assert len(dark) > 0
    assert not found[dark].any()
    # Nothing is written outside the receivers' texels.
    texels = technique.device.read(technique.indirect.map)
    outside = np.setdiff1d(np.arange(len(texels)), lightmap.receivers.texel)
    assert not texels[outside].any()


@pytest.mark.parametrize(
    ("shape", "order_and_size", "storage"),
    pairwise(SHAPES, [(4, 7), (1, 64), (2, 100)], ["fp32", "fp16", "snorm16"]),
)
def test_projection_and_transport_of_order_1(rng, shape, order_and_size, storage):
    order, size = order_and_size
    scene = random_scene(rng, 12)
    lightmap = random_lightmap(rng, scene, 613, 41, 33)
    bake = random_bake(rng, lightmap, order=order, receiver_order=1)
    technique = create(bake, scene, lightmap, shape, size, {"storage": storage})
    radiance = rng.normal(size=(11, bake.coefficients, 3)).astype(np.float32)
    write_lambda(technique, radiance)
    run_pass(technique, "cluster_projection", size)
    run_pass(technique, "irradiance_transport", size)
    expected = expected_signal(bake, radiance.astype(np.float64), 613, storage)
    found = technique.indirect.at_receivers()
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * np.abs(expected).max())
    np.testing.assert_array_equal(technique.indirect_irradiance(), found[:, 0])
    assert not found[bake.clusters[1].receivers].any()
    texels = technique.device.read(technique.indirect.map)
    outside = np.setdiff1d(np.arange(len(texels)), technique.indirect.entries)
    assert not texels[outside].any()


# fp16 rounds each factor by at most 2^-11 of itself. snorm16 rounds by at most half of a step of
# largest / 32767; of a normal row the largest is under 4.5 sigma, so each factor's relative error
# is 4.5 / (32767 sqrt(12)) = 4e-5 and two independent ones make 5.6e-5.
@pytest.mark.parametrize(
    ("storage", "error"), [("fp32", 1e-7), ("fp16", 2.0**-11), ("snorm16", 5.6e-5)]
)
def test_storage_error(setting, storage, error):
    rng, _, lightmap = setting
    for cluster in random_bake(rng, lightmap).clusters:
        if len(cluster.projection) == 0:
            continue
        stored = store_cluster(cluster, storage)
        product = (stored_values(stored.reconstruction, storage) * stored.scale) @ stored_values(
            stored.projection, storage
        )
        exact = cluster.reconstruction.astype(np.float64) @ cluster.projection.astype(np.float64)
        found = np.linalg.norm(product - exact) / np.linalg.norm(exact)
        assert found < error
        bits = stored.projection
        if storage == "fp16":
            values = bits.view(np.float16).astype(np.float64)
            assert np.all((values == 0) | (np.abs(values) >= 2.0**-14))
            assert np.all(np.isfinite(values))
            top = np.abs(values).max(axis=1)
            assert np.all((top >= 2.0**14) & (top <= 2.0**15))


def test_storage_of_zero_and_extreme_rows():
    from gibench.techniques.srp.bake.data import Cluster

    projection = np.array([[0, 0], [1e-30, -2e-30], [3e30, 1e30]], np.float32)
    reconstruction = np.array([[1, 0.5, -1e-20]], np.float32)
    cluster = Cluster(
        np.array([0], np.int32), np.array([0], np.int32), projection, reconstruction, 0
    )
    for storage in ("fp16", "snorm16"):
        stored = store_cluster(cluster, storage)
        basis = stored_values(stored.projection, storage) * stored.scale.astype(np.float64)[:, None]
        each = stored_values(stored.reconstruction, storage).T * basis
        exact = reconstruction.T.astype(np.float64) * projection
        np.testing.assert_allclose(each, exact, rtol=1e-3)


def test_projection_width():
    for width in (1, 2, 4, 8, 16):
        for order in range(8):
            c = (order + 1) ** 2
            chosen = projection_width(c, width)
            assert chosen <= width
            assert padded(c, chosen) <= padded(c, width)
    assert projection_width(64, 16) == 16
    assert projection_width(9, 16) == 4


@pytest.mark.parametrize(("shape", "receiver_order"), [*zip(SHAPES, (0, 1, 1), strict=True)])
def test_whole_frame(setting, shape, receiver_order):
    """Frames one after the other feed indirect light back exactly as in NumPy."""
    _, scene, lightmap = setting
    bake = random_bake(np.random.default_rng(4), lightmap, order=3, receiver_order=receiver_order)
    technique = create(bake, scene, lightmap, shape, 64)
    prepared = prepare_passes(technique, 64)
    r = lightmap.receivers
    indirect = np.zeros((613, 3))
    for frame in range(3):
        enqueue_frame(technique, prepared, frame)
        radiance = technique.device.read(technique.variant.radiance)[: 41 * 33, :3]
        direct = (radiance[r.texel] - r.emission) / r.albedo * np.pi - indirect
        # What is left after the fed-back part is the direct light of this frame: no less than 0.
        assert direct.min() > -1e-3
        assert direct.max() > 0.5
        light = expected_probe_radiance(scene, bake, radiance.astype(np.float64))
        indirect = expected_irradiance(bake, light, 613, "fp16")
        found = technique.indirect_irradiance()
        np.testing.assert_allclose(found, indirect, rtol=0, atol=2e-5 * np.abs(indirect).max())
