"""What is refused of captured probes' settings, what they ask for, and whose turn it is."""

from dataclasses import fields, replace

import numpy as np
import pytest
from support.captured_oracle import NAMES, create
from support.synthetic_bake import random_scene
from support.tiny_scenes import empty_room

from gibench.errors import BadInput, CannotRun
from gibench.scene.model import Camera
from gibench.techniques.parts.captured_probes.held import HeldProbes, probe_bytes
from gibench.techniques.parts.captured_probes.schedule import Schedule
from gibench.techniques.registry import find_technique

WRONG = [
    ({"probes": 0}, "0 probes"),
    ({"counts": "4x0x2"}, "4x0x2"),
    ({"origin": "0,0,0", "counts": "2x2x2"}, "go together"),
    ({"origin": "0,0,0", "spacing": "1,1,1"}, "without counts"),
    ({"origin": "0,0,0", "spacing": "1,-1,1", "counts": "2x2x2"}, "spacing"),
    ({"map_texels": 0}, "map_texels is 0"),
    ({"map_texels": 31}, "map_texels is 31"),
    ({"map_texels": -2}, "map_texels is -2"),
    ({"capture_texels": 1}, "capture_texels is 1"),
    ({"sharpness": -0.5}, "sharpness is -0.5"),
    ({"sharpness": float("nan")}, "finite"),
    ({"storage": "fp8"}, "fp32 or fp16"),
    ({"gloss_steps": 1}, "gloss_steps is 1"),
    ({"gloss_steps": -2}, "gloss_steps is -2"),
    ({"gloss_steps": 9}, "gloss_steps is 9"),
    ({"update": "sometimes"}, "relit or static"),
    ({"bounces": "0"}, "bounces is '0'"),
    ({"bounces": "several"}, "bounces is 'several'"),
    ({"bounces": "3"}, "cannot stop at 3 bounces"),
    ({"relit_share": 0.0}, "relit_share"),
    ({"far_slower": 0.5}, "far_slower"),
    ({"far_from": -1.0}, "far_from"),
    ({"backface_threshold": 1.5}, "backface_threshold"),
]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("values", "message"), WRONG)
def test_nonsense_gets_one_clear_line(name, values, message):
    with pytest.raises(BadInput, match=message) as caught:
        find_technique(name).settings(values)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("setting", ["distance_sharpness", "visibility_bias", "surface_bias"])
def test_what_visibility_adds_is_not_below_zero(setting):
    with pytest.raises(BadInput, match=f"{setting} is -1"):
        find_technique("light-field-probes").settings({setting: -1.0})


@pytest.mark.parametrize("name", NAMES)
def test_every_setting_says_what_it_does(name):
    for field in fields(find_technique(name).settings_type):
        assert len(field.metadata["help"]) > 10 and "unit" in field.metadata


def test_the_volume_is_the_one_asked_for():
    scene = random_scene(np.random.default_rng(0))
    spec = find_technique("light-field-probes")
    place = {"spacing": "0.5,0.5,0.5", "counts": "4x4x4"}
    with pytest.raises(BadInput, match="misses the scene 'soup'"):
        spec.check(scene, spec.settings({"origin": "10,0,0", **place}))
    assert spec.settings({"origin": "1,0,0", **place}).volume(scene).origin == (1.0, 0.0, 0.0)
    assert spec.settings({}).volume(scene).probes <= 16
    assert spec.settings({"counts": "5x1x2"}).volume(scene).counts == (5, 1, 2)
    assert spec.settings({"map_texels": 128}).map_sharpness == pytest.approx(7230, rel=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_maps_above_the_devices_limit_are_refused(name, tmp_path):
    """Before anything is captured, by what is declared; and by the device."""
    scene, _ = empty_room(side=2)
    settings = {"counts": "2x1x1", "map_texels": 2, "capture_texels": 2}
    technique = create(name, scene_with_camera(scene), settings, tmp_path)
    chosen = find_technique(name).settings({**settings, "map_texels": 20_000})
    with pytest.raises(CannotRun, match="buffer 'irradiance_maps' asks for"):
        technique.device.release(technique.probes.irradiance)
        technique.device.create(
            next(b for b in HeldProbes.buffers(chosen, 2) if b.name == "irradiance_maps")
        )


def scene_with_camera(scene):
    return replace(scene, cameras=(Camera((0.0, 1.2, 0.9), (0.0, 1.2, 0.0)),))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("update", ["static", "relit"])
@pytest.mark.parametrize(("storage", "steps"), [("fp16", 0), ("fp32", 0), ("fp16", 5)])
def test_memory_of_a_probe_in_closed_form(name, update, storage, steps):
    """By what another sixteen probes take, what a frame's share of them shares taken out."""
    asked = {"map_texels": 128, "update": update, "storage": storage, "gloss_steps": steps}
    settings = find_technique(name).settings(asked)
    shared = ("relit", "radiance", "texel_table", "volume", "split_sum")
    held = [
        sum(b.nbytes for b in HeldProbes.buffers(settings, n) if b.name not in shared)
        for n in (16, 32)
    ]
    assert held[1] - held[0] == 16 * probe_bytes(settings)
    assert held[0] == 16 * probe_bytes(settings)


def test_memory_of_the_published_maps():
    """132.05 and 198.06 KiB with borders at 16 bits a value."""
    kib = {}
    for name in NAMES:
        settings = find_technique(name).settings({"update": "static"})
        kib[name] = probe_bytes(settings) / 1024
    assert kib["irradiance-probes"] == pytest.approx((130**2 * 8 + 16) / 1024)
    assert kib["light-field-probes"] == pytest.approx((130**2 * 12 + 16) / 1024)


def test_far_probes_wait_longer_and_none_is_forgotten():
    positions = np.array([[x, 0.0, 0.0] for x in range(10)])
    numbers = np.arange(10, dtype=np.int32) + 5
    schedule = Schedule(positions, numbers, each_frame=2, far=4.5, slower=4.0)
    first = [schedule.next((0.0, 0.0, 0.0)) for _ in range(5)]
    chosen = np.concatenate([probes for probes, _ in first])
    np.testing.assert_array_equal(chosen, numbers)
    assert all(fresh.all() for _, fresh in first)
    counts = np.zeros(10)
    for _ in range(500):
        probes, fresh = schedule.next((0.0, 0.0, 0.0))
        assert len(set(probes.tolist())) == 2 and not fresh.any()
        counts[probes - 5] += 1
    assert counts.sum() == 1000
    near, far = counts[:5], counts[5:]  # 4.5 spacings away and more
    assert np.ptp(near) <= 0.1 * near.mean() and np.ptp(far) <= 0.1 * far.mean()
    assert near.mean() / far.mean() == pytest.approx(4, rel=0.1)
    # The camera goes to the other end, and those there are near.
    counts[:] = 0
    for _ in range(500):
        counts[schedule.next((9.0, 0.0, 0.0))[0] - 5] += 1
    assert counts[5:].min() > 3 * counts[:4].max()


def test_the_published_memory_of_an_irradiance_probe():
    """149.25 KB: a map of irradiance and a chain of five of radiance, without borders, in the 4
    bytes of a texel that Anonymous 2022 (section 4.2.1) gives them, R11G11B10Float.
    """
    texels = 128**2 + sum(side**2 for side in (128, 64, 32, 16, 8))
    assert 4 * texels / 1024 == 149.25
    settings = find_technique("irradiance-probes").settings({"update": "static", "gloss_steps": 5})
    borders = 4 * (128 + 1) + sum(4 * (side + 1) for side in (128, 64, 32, 16, 8))
    assert probe_bytes(settings) == 16 + 8 * (texels + borders)
