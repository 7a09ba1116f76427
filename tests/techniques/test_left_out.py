"""What a technique does not show of a scene is said, and what would show it."""

import numpy as np
from support.glow_scenes import bumpy

from gibench.scene.builtin import build
from gibench.techniques.registry import find_technique, left_out, techniques

OPTIONS = "--set srp.receiver_order=1 --set srp.normal_maps=true"


def test_normal_maps_that_are_not_used_are_said_and_what_uses_them() -> None:
    plain = build("cornell-box")
    scene = bumpy(plain, np.random.default_rng(1))
    srp = find_technique("srp")
    used = srp.settings({"receiver_order": 1, "normal_maps": True})
    assert left_out(srp, used, scene) == []
    assert left_out(srp, srp.settings({"receiver_order": 1}), scene) == [
        f"normal maps are not used; {OPTIONS} uses them"
    ]
    for name, spec in techniques().items():
        assert left_out(spec, spec.settings({}), plain) == []
        (told,) = left_out(spec, spec.settings({}), scene)
        assert OPTIONS in told and (name == "srp") == (f"by srp with {OPTIONS}" not in told)
