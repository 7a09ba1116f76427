"""Each pass of captured probes against float64, at group sizes that divide the work and not."""

import numpy as np
import pytest
from support.captured_oracle import (
    NAMES,
    SMALL,
    VARIANTS,
    chebyshev,
    create,
    filtered_irradiance,
    filtered_moments,
    gather,
    inner,
    randomise,
    relit,
    within_reach,
)
from support.ddgi_oracle import bordered, texel_directions
from support.launches import run_pass
from support.pairwise import pairwise
from support.synthetic_bake import random_scene
from support.tiny_scenes import empty_room
from support.vector_widths import skip_too_wide

from gibench.device import Device
from gibench.techniques.parts.captured_probes.maps import texel_solid_angles


@pytest.fixture(scope="module")
def soup():
    return random_scene(np.random.default_rng(5), 60)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("captured")


def gathered(technique, size, position, normal):
    """Irradiance at points, by the kernel of the receivers."""
    device, shape = technique.device, position.shape
    held = [
        device.upload(f"gather_{n}", np.ascontiguousarray(a, np.float32))
        for n, a in (("p", position), ("n", normal), ("e", np.zeros(shape)))
    ]
    device.enqueue(technique._passes.receivers(*held), size)
    found = device.read(held[2])
    device.release(*held)
    return found


@pytest.mark.parametrize(
    ("name", "variant", "size_and_storage"),
    pairwise(NAMES, VARIANTS, [(1, "fp32"), (7, "fp16"), (64, "fp32")]),
)
def test_gather(rng, soup, cache, name, variant, size_and_storage):
    size, storage = size_and_storage
    settings = {**SMALL, "storage": storage}
    technique = create(name, soup, settings, cache, variant, size)
    randomise(technique, rng)
    volume = technique.probes.baked.volume
    low = np.array(volume.origin) - 1.4 * np.array(volume.spacing)
    high = np.array(volume.origin) + (np.array(volume.counts) + 0.4) * np.array(volume.spacing)
    position, normal = rng.uniform(low, high, (301, 3)), rng.normal(size=(301, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    position, normal = (a.astype(np.float32).astype(np.float64) for a in (position, normal))
    expected = gather(technique, position, normal, normal)
    found = gathered(technique, size, position, normal)
    certain = within_reach(technique, position, normal)
    assert certain.mean() > 0.95
    found, expected = found[certain], expected[certain]
    assert 0.2 < (expected > 0).any(axis=1).mean() < 1  # some lie out of reach of all probes
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3)
    assert np.median(np.abs(found - expected)) < 1e-5


# Behind the mean by so much, with such a variance: at the edge, beyond it, without variance.
CASES = [(-0.1, 0.01), (-1e-4, 0.01), (0.0, 0.01), (1e-3, 0.01), (0.05, 0.01), (0.2, 0.01),
         (0.2, 0.0), (0.2, 1e-5), (0.2, 1.0), (-0.1, 0.0)]  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_chebyshev_bound_at_and_beyond_its_edges(cache, variant):
    """Between a dark probe that is tested and a bright one that sees all: 1 / (1 + bound)."""
    scene, _ = empty_room(side=2)
    scene = random_scene(np.random.default_rng(2), 5)
    settings = {**SMALL, "counts": "2x1x1", "origin": "-0.5,0,0", "spacing": "1,1,1",
                "storage": "fp32", "surface_bias": 0.0}  # fmt: skip
    technique = create("light-field-probes", scene, settings, cache, variant)
    held, device = technique.probes, technique.device
    data = device.read(held.placed.data)
    data[:, 3] = 3
    device.write(held.placed.data, data)
    bright = np.zeros(held.irradiance.shape)
    bright[1] = 1.0
    device.write(held.irradiance, bright)
    far, bias = held.baked.far, 0.01 / held.baked.far
    for behind, variance in CASES:
        mean = 0.5 / far - bias - behind
        moments = np.ones(held.distance.shape)
        moments[0] = mean, mean**2 + variance
        device.write(held.distance, moments)
        point, up = np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]])
        found = gathered(technique, 16, point, up)[0]
        square = float(np.float32(mean**2 + variance))
        bound = float(chebyshev(0.5 / far, bias, float(np.float32(mean)), square))
        if behind != 0.0:
            assert (bound == 1.0) == (behind < 0)
        np.testing.assert_allclose(found, 1 / (1 + bound), rtol=1e-3, atol=1e-6)
    # Where no probe sees the point there is no light, and nothing that is no number.
    moments[:] = 0.01, 0.01**2
    device.write(held.distance, moments)
    assert np.isfinite(gathered(technique, 16, point, up)).all()


@pytest.mark.parametrize(
    ("name", "bounces", "variant_and_size"),
    pairwise(NAMES, ["1", "any"], [("published", 7), ("tuned", 64)]),
)
def test_relight(rng, soup, cache, name, bounces, variant_and_size):
    variant, size = variant_and_size
    settings = {**SMALL, "bounces": bounces, "storage": "fp32", "backface_threshold": 1.0}
    technique = create(name, soup, settings, cache, variant, size)
    randomise(technique, rng)
    technique.scene.begin_frame(3)
    probes = rng.choice(12, 5, replace=False).astype(np.int32)
    technique.device.write(technique.probes.capture["relit"], probes)
    expected, certain = relit(technique, soup, 3, probes)
    run_pass(technique, "probe_relight", size)
    found = technique.device.read(technique.probes.capture["radiance"])
    assert found.shape == (5, 3, 48)  # 36 texels, whole vectors
    assert not found[:, :, 36:].any()
    found = found[:, :, :36].transpose(0, 2, 1)
    assert certain.mean() > 0.7
    np.testing.assert_allclose(found[certain], expected[certain], rtol=3e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("width", "variant_and_size", "side"),
    pairwise(
        *([1, 8, 16], [("published", 1), ("tuned", 7), ("tuned", 100)], [6, 10]),
        more={0: [4], 2: [4]},
    ),
)
def test_filters(rng, soup, cache, monkeypatch, width, variant_and_size, side):
    skip_too_wide(width)
    variant, size = variant_and_size
    monkeypatch.setattr(Device, "vector_width", property(lambda self: width))
    settings = {**SMALL, "map_texels": side, "storage": "fp32", "distance_sharpness": 20.0}
    technique = create("light-field-probes", soup, settings, cache, variant, size)
    held, device = technique.probes, technique.device
    probes = np.array([7, 0, 11, 4, 3], np.int32)
    device.write(held.capture["relit"], probes)
    count = technique._passes.schedule.each_frame
    assert 0 < count <= 5
    radiance = np.zeros(held.capture["radiance"].shape)
    radiance[:, :, : side**2] = rng.uniform(0, 3, (5, 3, side**2))
    device.write(held.capture["radiance"], radiance)
    moments = rng.uniform(0, 1, held.capture["captured_moments"].shape)
    device.write(held.capture["captured_moments"], moments)
    before = device.read(held.placed.data)[:, 3]
    run_pass(technique, "filter_irradiance", size)
    run_pass(technique, "filter_distance", size)
    chosen = probes[:count]
    light = inner(device.read(held.irradiance))
    expected = filtered_irradiance(radiance[:count, :, : side**2].transpose(0, 2, 1), side)
    np.testing.assert_allclose(light[chosen, :, :3], expected, rtol=2e-5)
    distance = inner(device.read(held.distance))
    np.testing.assert_allclose(
        distance[chosen], filtered_moments(moments[chosen], side, 20.0), atol=2e-4
    )
    others = np.setdiff1d(np.arange(12), chosen)
    assert not light[others].any() and not distance[others].any()
    state = device.read(held.placed.data)[:, 3]
    assert (state[chosen] == 3).all()
    np.testing.assert_array_equal(state[others], before[others])
    run_pass(technique, "border_copy", size)
    whole = device.read(held.irradiance)
    np.testing.assert_array_equal(whole, bordered(whole))


@pytest.mark.parametrize("variant", VARIANTS)
def test_irradiance_of_known_radiance(rng, soup, cache, variant):
    """The closed forms of constant, linear and delta radiance, one probe each."""
    side = 24
    settings = {**SMALL, "map_texels": side, "storage": "fp32", "backface_threshold": 1.0}
    technique = create("irradiance-probes", soup, settings, cache, variant)
    held, device = technique.probes, technique.device
    d, angle = texel_directions(side), texel_solid_angles(side)
    a, b, texel = rng.uniform(1, 2, 3), rng.uniform(-1, 1, (3, 3)), int(rng.integers(side**2))
    radiance = np.zeros(held.capture["radiance"].shape)
    radiance[0, :, : side**2] = a[:, None]
    radiance[1, :, : side**2] = (a + d @ b).T
    radiance[2, :, texel] = a
    device.write(held.capture["radiance"], radiance)
    device.write(held.capture["relit"], np.array([2, 5, 8, 0, 1], np.int32))
    run_pass(technique, "filter_irradiance", 64)
    light = inner(device.read(held.irradiance))[..., :3]
    np.testing.assert_allclose(light[2], np.broadcast_to(np.pi * a, light[2].shape), rtol=1e-5)
    linear = np.pi * a + 2 * np.pi / 3 * d @ b
    np.testing.assert_allclose(light[5], linear, atol=0.02 * np.abs(linear).max())
    delta = angle[texel] * a * np.maximum(0, d @ d[texel])[:, None]
    np.testing.assert_allclose(light[8], delta, atol=0.02 * delta.max())
