"""Direct light only, through the frame loop."""

from dataclasses import replace

import numpy as np
import pytest
from support.glow_scenes import glowing
from support.made import check_memory, made
from support.shading_oracle import open_device, render
from support.synthetic_bake import random_lightmap, random_scene

from gibench.device import Launch, ProgramSpec, RayCounts, count_rays, integer, updates
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.techniques.parts.camera_pass import camera_launch, rendered
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.macros import TILE_SIDE
from gibench.techniques.registry import BakeContext, find_technique
from gibench.techniques.technique import Pass, Technique


@pytest.fixture
def direct(tmp_path):
    rng = np.random.default_rng(9)
    scene = random_scene(rng)
    lightmap = random_lightmap(rng, scene, 100, 20, 20)
    spec = find_technique("direct")
    settings = spec.settings({})
    baked = spec.bake(BakeContext(scene, lightmap, settings, tmp_path))
    return made(
        spec, open_device(), scene, lightmap, settings, baked, "tuned", 64, 40, 30, scene.cameras[0]
    )


def test_frame_is_the_direct_light(direct):
    assert isinstance(direct, Technique)
    prepared = prepare_passes(direct, 64)
    assert [one.name for one in prepared] == ["camera"]
    enqueue_frame(direct, prepared, 17)
    image = direct.device.read(direct.scene.image)
    expected = render(direct.scene.scene, 17, 40, 30)
    np.testing.assert_allclose(
        image[expected.certain], expected.direct[expected.certain], rtol=2e-4, atol=2e-5
    )
    np.testing.assert_array_equal(direct.images()["frame"], image)
    assert direct.indirect_irradiance().shape == (100, 3)
    assert not direct.indirect_irradiance().any()
    assert direct.counts() == {"receivers": 100}


@pytest.mark.parametrize("size", [16, 50])
@pytest.mark.parametrize("packets", [False, True])
def test_surfaces_that_emit_by_images(rng, size, packets):
    """Bilinear, repeating, of any brightness, in kernels that read single rays and packets."""
    scene = glowing(random_scene(rng), rng, share=1.0, images=((3, 5), (33, 16)))
    frame = FrameScene(open_device(), scene, 24, 18, scene.cameras[0])
    frame.begin_frame(17)
    image = rendered(frame, size, packets=packets)
    expected = render(scene, 17, 24, 18)
    sure = expected.certain
    np.testing.assert_allclose(image[sure], expected.direct[sure], rtol=1e-3, atol=0.02)
    dark = render(replace(scene, glow=None), 17, 24, 18)
    assert (np.abs(dark.direct - expected.direct) > 0.05).any(axis=2).mean() > 0.01


def test_lights_move_with_the_frame(direct):
    prepared = prepare_passes(direct, 64)
    enqueue_frame(direct, prepared, 0)
    first = direct.device.read(direct.scene.image)
    enqueue_frame(direct, prepared, 60)
    assert np.any(direct.device.read(direct.scene.image) != first)


def test_memory_is_declared(direct):
    spec = find_technique("direct")
    least, held = check_memory(spec, direct, spec.settings({}), "tuned", 64, 100)
    assert 0.5 * held < least < held


def test_a_pass_that_cannot_be_built_fails_alone(direct):
    program = ProgramSpec("parts/dilate.cl", {"COMPONENTS": 1})

    class Broken:
        device = direct.device

        def passes(self):
            missing = Launch(program, "no_such_kernel", (), items=1)

            def not_there():
                return [Launch(ProgramSpec("no/such.cl"), "dilate", (), items=1)]

            return [Pass("a", lambda: [missing]), Pass("b", not_there), *direct.passes()]

    prepared = prepare_passes(Broken(), 64)
    assert [one.status for one in prepared] == ["failed", "failed", "ok"]
    assert "no_such_kernel" in prepared[0].problem
    assert "no/such.cl" in prepared[1].problem
    assert all("\n" not in (one.problem or "") for one in prepared)


def test_a_launch_without_work_is_not_enqueued(direct):
    counts = iter([3, 0])
    program = ProgramSpec("parts/dilate.cl", {"COMPONENTS": 1})
    args = (updates("map", direct.scene.image), integer("width", 0), integer("height", 0))

    class Idle:
        device = direct.device

        def passes(self):
            return [Pass("idle", lambda: [Launch(program, "dilate", args, items=counts.__next__)])]

        def begin_frame(self, frame):
            pass

    prepared = prepare_passes(Idle(), 64)
    assert enqueue_frame(Idle(), prepared, 0).pass_ms["idle"] > 0
    assert enqueue_frame(Idle(), prepared, 1).pass_ms["idle"] == 0


@pytest.mark.parametrize("size", [16, 100])
def test_shadow_rays_are_counted_after_a_frame(direct, size):
    prepared = prepare_passes(direct, 64)
    assert prepared[0].work.rays == 40 * 30
    enqueue_frame(direct, prepared, 17)
    expected = render(direct.scene.scene, 17, 40, 30)
    counted = prepared[0].counted(size)
    rays = expected.shadow_rays[expected.certain].sum()
    open_to_doubt = len(direct.scene.scene.lights) * np.count_nonzero(~expected.certain)
    assert 1200 < 1200 + rays <= counted.rays <= 1200 + rays + open_to_doubt
    assert counted == replace(prepared[0].work, rays=counted.rays)


def test_every_pixels_rays_are_counted(direct):
    direct.begin_frame(17)
    expected = render(direct.scene.scene, 17, 40, 30)
    launch = camera_launch(direct.scene)
    # Work-items visit the pixels in squares, within them along a Morton curve.
    tile, code = np.divmod(np.arange(launch.items), TILE_SIDE**2)
    x = tile % 5 * TILE_SIDE + sum((code >> 2 * bit & 1) << bit for bit in range(3))
    y = tile // 5 * TILE_SIDE + sum((code >> 2 * bit + 1 & 1) << bit for bit in range(3))
    shown = y < 30
    before = RayCounts(0, 0)
    checked = 0
    for n in range(400, 440):
        after = count_rays(direct.device, replace(launch, items=n, workgroup_size=1), 1)
        if n > 400 and shown[n - 1] and expected.certain[y[n - 1], x[n - 1]]:
            assert after.closest - before.closest == 1
            assert after.occluded - before.occluded == expected.shadow_rays[y[n - 1], x[n - 1]]
            checked += 1
        before = after
    assert checked > 20


def test_packets_count_the_same_rays(direct):
    direct.begin_frame(17)
    device = direct.device
    rays = [
        count_rays(device, camera_launch(direct.scene, packets=packets), 16)
        for packets in (False, True)
    ]
    assert rays[0] == rays[1]
    assert rays[0].closest == 40 * 30
