"""DDGI's settings: what is refused, the volume that they ask for, which rays probes cast."""

import numpy as np
import pytest
from support.synthetic_bake import random_scene

from gibench.errors import BadInput
from gibench.techniques.ddgi import SPEC
from gibench.techniques.ddgi.placement import PROBES_PER_SRP_PROBE, make_volume, ray_directions


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"probes": 0}, "0 probes"),
        ({"probes": -5}, "-5 probes"),
        ({"rays": 0}, "0 rays"),
        ({"rays": 32}, "32 of 32 rays are fixed"),
        ({"fixed_rays": -1}, "fixed"),
        ({"counts": "20x-10x10"}, "20x-10x10"),
        ({"counts": "20x0x10"}, "20x0x10"),
        ({"counts": "many"}, "many"),
        ({"storage": "fp8"}, "fp16 or fp32|fp32 or fp16"),
        ({"hysteresis": 1.0}, "hysteresis"),
        ({"hysteresis": float("nan")}, "finite"),
        ({"gamma": 0.0}, "gamma"),
        ({"average": "median"}, "median"),
        ({"irradiance_texels": 1}, "irradiance_texels"),
        ({"normal_bias": -0.1}, "normal_bias"),
        ({"crush_threshold": 2.0}, "crush_threshold"),
        ({"origin": "0,0,0", "spacing": "1,1,1"}, "without counts"),
        ({"origin": "0,0,0", "counts": "2x2x2"}, "go together"),
        ({"origin": "0,0", "spacing": "1,1,1", "counts": "2x2x2"}, "origin is '0,0'"),
        ({"origin": "0,0,0", "spacing": "1,0,1", "counts": "2x2x2"}, "spacing"),
    ],
)
def test_nonsense_gets_one_clear_line(values, message):
    with pytest.raises(BadInput, match=message) as caught:
        SPEC.settings(values)
    assert "\n" not in str(caught.value)


def test_every_setting_says_what_it_does():
    for field in SPEC.settings_type.__dataclass_fields__.values():
        assert len(field.metadata["help"]) > 10
        assert "unit" in field.metadata


def test_the_volume_is_the_one_asked_for():
    scene = random_scene(np.random.default_rng(0))
    place = {"spacing": "0.5,0.5,0.5", "counts": "4x4x4"}
    with pytest.raises(BadInput, match="misses the scene 'soup'"):
        make_volume(scene, SPEC.settings({"origin": "10,0,0", **place}))
    volume = make_volume(scene, SPEC.settings({"origin": "1,0,0", **place}))
    assert volume.origin == (1.0, 0.0, 0.0)
    assert make_volume(scene, SPEC.settings({"counts": "4x3x5"})).counts == (4, 3, 5)
    assert make_volume(scene, SPEC.settings({"probes": 5})).probes <= 5
    most = PROBES_PER_SRP_PROBE * scene.probes.count
    assert 0.5 * most < make_volume(scene, SPEC.settings({})).probes <= most


def test_ray_directions():
    settings = SPEC.settings({})
    a, b = ray_directions(settings, 1, 3), ray_directions(settings, 1, 4)
    assert a.shape == (256, 3)
    np.testing.assert_array_equal(a[:32], b[:32])
    assert np.abs(a[32:] - b[32:]).max() > 0.1
    np.testing.assert_array_equal(a, ray_directions(settings, 1, 3))


def test_what_stays_of_a_texel():
    """Of linear averages little at first; the SDK's keep the same share from the first frame on."""
    linear, encoded = SPEC.settings({}), SPEC.settings({"average": "encoded"})
    assert (linear.exponent, encoded.exponent) == (2.0, 5.0)
    assert SPEC.settings({"gamma": 3.5}).exponent == 3.5
    assert [linear.kept(n) for n in (0, 4, 12)] == [0.0, 0.5, 0.75]
    assert linear.kept(128) < linear.kept(130) == linear.kept(4000) == 0.97
    assert encoded.kept(0) == encoded.kept(4000) == 0.97
