"""What SRP says of surfaces whose light its placed probes do not see, against a closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.tiny_scenes import box, quad_scene

from gibench.profiles import load_profile
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.model import Material, PointLight, ProbeSettings, Scene
from gibench.techniques.job import Job
from gibench.techniques.registry import BakeContext, find_technique
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.unseen_ends import unseen_light

INNER, OUTER = (2.0, 2.4, 2.2), (2.4, 2.8, 2.6)
INSIDE = np.array([[-0.4, 1.2, 0.1], [0.5, 1.0, -0.3]], np.float32)


def surface(sides) -> float:
    x, y, z = sides
    return 2 * (x * y + y * z + z * x)


def house(sky: float, lamp: float) -> Scene:
    """A closed room with walls 0.2 m thick, a lamp in it, under a sky of one colour."""
    rooms = [(INNER, 0.0, True), (OUTER, -0.2, False)]
    quads = [
        quad
        for (x, y, z), low, inward in rooms
        for quad in box((-x / 2, low, -z / 2), (x / 2, low + y, z / 2), inward=inward)
    ]
    scene, _ = quad_scene(quads, 2, sky=(sky,) * 3)
    return replace(
        scene,
        lights=(PointLight((0.3, 1.5, -0.2), (lamp,) * 3),),
        materials=(Material("grey", (0.5,) * 3),),
        material_ids=np.zeros(len(scene.triangles), np.int32),
    )


def test_what_the_sky_sends_to_the_outside_no_probe_inside_sees(rng):
    """pi L on the outside, on the inside half of the lamp's 4 pi I, reflected once."""
    sky, lamp = rng.uniform(0.5, 2.0, 2)
    scene = house(sky, lamp)
    lightmap = unwrap(scene, 400)
    outside, inside = np.pi * sky * surface(OUTER), 0.5 * 4 * np.pi * lamp
    found = unseen_light(scene, lightmap, ProbeSet(INSIDE, 4.0))
    assert found == pytest.approx(outside / (outside + inside), rel=0.1)
    # Who is out of reach sees nothing either.
    assert unseen_light(scene, lightmap, ProbeSet(INSIDE, 1e-3)) == pytest.approx(1.0)
    far = np.array([[30, 30, 30], [-30, -30, -30]], np.float32)
    both = ProbeSet(np.concatenate([INSIDE, far]), 100.0)
    assert unseen_light(scene, lightmap, both) < 0.01
    # The sky, which is a probe of its own, lies nowhere.
    apart = ProbeSet(np.concatenate([INSIDE, far[:1]]), 100.0, sky=True)
    assert unseen_light(scene, lightmap, apart) == pytest.approx(found, rel=0.1)


def test_the_remark_names_the_sky_apart_and_none_is_made_inside(tmp_path):
    scene = replace(house(1.0, 1.0), probes=ProbeSettings(positions=INSIDE))
    spec, lightmap = find_technique("srp"), unwrap(scene, 400)

    def told(of: Scene, moving=None, **settings) -> list[str]:
        given = spec.settings(settings)
        job = Job("srp", given, "tuned", of.name, load_profile("vega56"), 64)
        return spec.bake_remarks(job, BakeContext(of, lightmap, given, tmp_path, 0, moving))

    (one,) = told(scene)
    assert "% of the light falls on surfaces of whose rays no probe sees the end" in one
    assert "--set srp.sky=receivers" in one and "MiB" in one
    assert told(scene, sky="receivers") == []
    moving = np.zeros(len(scene.triangles), np.bool_)
    moving[0] = True
    (still,) = told(scene, moving)
    assert "no setting lights them where objects move" in still
    dark = replace(scene, environment=replace(scene.environment, pixels=np.zeros((1, 1, 3), "f4")))
    assert told(dark) == []
    assert find_technique("ddgi").bake_remarks(*[None] * 2) == []
