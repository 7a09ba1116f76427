"""SRP as a technique: memory, determinism, settings, what a profile forbids."""

from dataclasses import fields, replace

import numpy as np
import pytest
from support.made import check_memory, made
from support.shading_oracle import open_device
from support.srp_setups import VARIANTS, create
from support.synthetic_bake import random_bake, random_lightmap, random_scene
from support.vector_widths import widths

from gibench.device import Device
from gibench.errors import BadInput, CannotRun
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.profiles import load_profile
from gibench.techniques.registry import find_technique
from gibench.techniques.srp import SPEC, SrpSettings

PASSES = [
    "lightmap_update",
    "probe_update",
    "cluster_projection",
    "irradiance_transport",
    "dilate",
    "camera",
    "application",
]


@pytest.fixture(scope="module")
def setting():
    rng = np.random.default_rng(2)
    scene = random_scene(rng, 30)
    lightmap = random_lightmap(rng, scene, 400, 27, 31)
    return scene, lightmap, random_bake(rng, lightmap, order=4)


@pytest.mark.parametrize("variant", VARIANTS)
def test_passes_and_their_work(setting, variant):
    scene, lightmap, bake = setting
    technique = create(bake, scene, lightmap, variant, 64)
    prepared = prepare_passes(technique, 64)
    assert [one.name for one in prepared] == PASSES
    assert all(one.status == "ok" for one in prepared)
    times = enqueue_frame(technique, prepared, 0)
    assert list(times.pass_ms) == PASSES
    assert all(ms > 0 for ms in times.pass_ms.values())
    assert times.wall_ms > sum(times.pass_ms.values())
    assert times.gap_ms == pytest.approx(times.wall_ms - sum(times.pass_ms.values()))
    work = {one.name: one.work for one in prepared}
    values = sum(c.projection.size for c in bake.clusters)
    assert work["cluster_projection"].flops == 6 * values
    assert work["cluster_projection"].bytes_read == 2 * values + 12 * 11 * 25
    assert work["camera"].rays == 24 * 16
    assert 0 < work["lightmap_update"].rays < 3 * 400
    assert technique.counts()["receivers"] == 400
    assert technique.counts()["probes"] == 11


@pytest.mark.parametrize("storage", ["fp32", "fp16", "snorm16"])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("width", widths(1, 16))
def test_memory_is_declared(setting, monkeypatch, variant, storage, width):
    monkeypatch.setattr(Device, "vector_width", property(lambda self: width))
    scene, lightmap, _ = setting
    # Of both orders, not each with each.
    receiver_order = int((storage == "fp16") != (width == 1))
    rng = np.random.default_rng(3)
    bake = random_bake(rng, lightmap, order=4, receiver_order=receiver_order)
    technique = create(bake, scene, lightmap, variant, 64, {"storage": storage})
    settings = SPEC.settings(
        {
            "sh_order": 4, "probes": 11, "relight_samples": bake.relight.texel.shape[1],
            "storage": storage, "receiver_order": receiver_order,
        }
    )  # fmt: skip
    least, held = check_memory(SPEC, technique, settings, variant, 64, 400)
    assert 0.1 * held < least < held


def test_usual_orders():
    """Silvennoinen and Lehtinen 2017, section 5.1: receivers of order 1, probes of order 4."""
    assert (SPEC.settings({}).sh_order, SPEC.settings({}).receiver_order) == (7, 0)
    assert SPEC.settings({"receiver_order": 1}).sh_order == 4
    for order in range(8):
        assert SPEC.settings({"receiver_order": 1, "sh_order": order}).sh_order == order


def images_after(technique, size, frames):
    prepared = prepare_passes(technique, size)
    for frame in range(frames):
        enqueue_frame(technique, prepared, frame)
    return technique.images()


@pytest.mark.parametrize("variant", VARIANTS)
def test_same_seed_same_images(setting, variant):
    scene, lightmap, bake = setting
    first = images_after(create(bake, scene, lightmap, variant, 64), 64, 4)
    second = images_after(create(bake, scene, lightmap, variant, 64), 64, 4)
    assert set(first) == {"frame", "direct only", "indirect only", "probes"}
    for title, image in first.items():
        assert image.shape == (16, 24, 3)
        np.testing.assert_array_equal(image, second[title])
    np.testing.assert_allclose(
        first["frame"], first["direct only"] + first["indirect only"], rtol=1e-5, atol=1e-6
    )
    assert np.any(first["probes"] != first["frame"])


def test_variants_agree(setting):
    scene, lightmap, bake = setting
    found = []
    for variant in VARIANTS:
        technique = create(bake, scene, lightmap, variant, 32)
        images = images_after(technique, 32, 3)
        found.append((images["frame"], technique.indirect_irradiance()))
    for published, tuned in zip(*found, strict=True):
        np.testing.assert_allclose(tuned, published, rtol=0, atol=1e-5 * np.abs(published).max())


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("update", "step"), [("half", 2), ("quarter", 4)])
def test_probes_take_turns(setting, variant, update, step):
    scene, lightmap, bake = setting
    settings = {"probe_update": update}
    technique = create(bake, scene, lightmap, variant, 64, settings)
    prepared = prepare_passes(technique, 64)
    before = technique.variant.probe_radiance()
    for frame in range(step + 1):
        enqueue_frame(technique, prepared, frame)
        after = technique.variant.probe_radiance()
        changed = np.flatnonzero((after != before).any(axis=(1, 2)))
        np.testing.assert_array_equal(changed, np.arange(frame % step, 11, step))
        before = after


def test_bounces_off_is_one_bounce(setting):
    scene, lightmap, bake = setting
    technique = create(bake, scene, lightmap, "tuned", 64, {"bounces": False})
    prepared = prepare_passes(technique, 64)
    results = []
    for _ in range(2):
        enqueue_frame(technique, prepared, 5)
        results.append(technique.indirect_irradiance())
    np.testing.assert_array_equal(*results)
    fed_back = create(bake, scene, lightmap, "tuned", 64)
    prepared = prepare_passes(fed_back, 64)
    enqueue_frame(fed_back, prepared, 5)
    np.testing.assert_array_equal(fed_back.indirect_irradiance(), results[0])
    enqueue_frame(fed_back, prepared, 5)
    assert np.any(fed_back.indirect_irradiance() != results[0])


def test_what_the_local_memory_forbids_is_skipped_alone(setting):
    scene, lightmap, bake = setting
    technique = create(bake, scene, lightmap, "published", 512, local_memory=4096)
    prepared = {one.name: one for one in prepare_passes(technique, 512)}
    refused = prepared.pop("probe_update")
    assert refused.status == "skipped"
    assert "6,144 bytes" in refused.problem
    assert "4,096" in refused.problem
    assert refused.launches == ()
    assert all(one.status == "ok" for one in prepared.values())
    times = enqueue_frame(technique, [refused, *prepared.values()], 0)
    assert "probe_update" not in times.pass_ms


def test_a_workgroup_size_the_profile_forbids_is_skipped(setting):
    scene, lightmap, bake = setting
    device = open_device(simd_width=32)
    technique = made(
        *(SPEC, device, scene, lightmap, SPEC.settings({"sh_order": 4}), bake, "tuned"),
        *(48, 8, 8, scene.cameras[0]),
    )
    for one in prepare_passes(technique, 48):
        assert one.status == "skipped"
        assert "no multiple of the SIMD width 32" in one.problem


def test_a_budget_too_small_is_refused_before_it_is_used(setting):
    scene, lightmap, bake = setting
    profile = replace(load_profile("iphone7"), memory_budget_bytes=100_000)
    with pytest.raises(CannotRun, match="are left"):
        made(
            *(SPEC, Device(profile), scene, lightmap, SPEC.settings({}), bake, "tuned"),
            *(64, 64, 64, scene.cameras[0]),
        )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sh_order": 9}, "SH order is 9; 0 to 7"),
        ({"sh_order": -1}, "SH order is -1"),
        ({"storage": "fp8"}, "storage is 'fp8'"),
        ({"probe_update": "third"}, "probe_update is 'third'; use all, half"),
        ({"relight_samples": 0}, "relight_samples is 0"),
        ({"probes": -5}, "probes is -5"),
        ({"receiver_order": 2}, "receiver_order is 2"),
        ({"radius": 3}, "no setting 'radius'"),
    ],
)
def test_senseless_settings(values, message):
    with pytest.raises(BadInput, match=message):
        SPEC.settings(values)


def test_every_setting_explains_itself():
    assert find_technique("srp") is SPEC
    for field in fields(SrpSettings):
        assert len(field.metadata["help"]) > 20
        assert "unit" in field.metadata
