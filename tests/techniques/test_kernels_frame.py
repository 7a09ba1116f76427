"""The kernels that every technique shares, against float64 NumPy and Embree."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.made import by_name
from support.shading_oracle import bilinear, direct_irradiance, open_device, render
from support.synthetic_bake import random_lightmap, random_scene

import gibench
from gibench.conform.parts import DILATED, SENT
from gibench.device import Launch, ProgramSpec, integer, reads, writes
from gibench.techniques.parts.camera_pass import camera_launch
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.lightmap_lookup import lightmap_application
from gibench.techniques.parts.lightmap_update import lightmap_update
from gibench.techniques.parts.macros import SCENE_MACROS, SHOW_DIRECT, SHOW_INDIRECT
from gibench.techniques.parts.material_table import srgb_codes, srgb_to_linear
from gibench.techniques.parts.receiver_signal import ReceiverSignal

SIZES = (1, 7, 64, 100)  # 7 and 100 divide none of the problems below


def run(device, launches, workgroup_size):
    for launch in launches:
        device.enqueue(launch, workgroup_size)


def beside(rng, first, components):
    """A signal of ``components`` whose first is ``first``, and whose others are random."""
    others = rng.uniform(5, 9, (first.size // 4, components - 1, 4))
    return np.concatenate([first.reshape(-1, 1, 4), others], axis=1).astype(np.float32)


@pytest.mark.parametrize("packets", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_camera_and_application(seed, packets):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng)
    lightmap = random_lightmap(rng, scene, 200, 23, 17)
    values = rng.uniform(0, 2, (17, 23, 4)).astype(np.float32)
    width, height, frame = 51, 37, 31
    expected = render(scene, frame, width, height, lightmap, values[..., :3].astype(np.float64))
    assert expected.certain.mean() > 0.9
    device = open_device()
    shared = FrameScene(device, scene, width, height, scene.cameras[0])
    receivers = FrameLightmap.upload(device, lightmap)
    signal = ReceiverSignal.create(receivers, "signal", components=1 + 3 * seed)
    device.write(signal.map, beside(rng, values, signal.components))
    hits = HitBuffer.create(device, width, height)
    applied = lightmap_application(shared, hits, signal, packets)
    shared.begin_frame(frame)
    wanted = {
        SHOW_DIRECT: expected.direct,
        SHOW_INDIRECT: expected.indirect,
        SHOW_DIRECT | SHOW_INDIRECT: expected.direct + expected.indirect,
    }
    images = []
    for size, (show, image) in zip((7, 64, 100), wanted.items(), strict=True):
        run(device, [camera_launch(shared, hits, packets=packets)], size)
        if show != SHOW_DIRECT:
            run(device, [applied.launch(show)], size)
        found = device.read(shared.image)
        np.testing.assert_allclose(
            found[expected.certain], image[expected.certain], rtol=2e-4, atol=2e-5
        )
        images.append(found)
    assert images[0].max() > 0.5
    assert images[1].max() > 0.05
    drawn = applied.images(64)
    for title, image in zip(("direct only", "indirect only", "frame"), images, strict=True):
        np.testing.assert_array_equal(drawn[title], image)
    # Nothing but the direct light is left of it where that alone is asked for.
    run(device, [camera_launch(shared, hits, packets=packets), applied.launch(SHOW_DIRECT)], 1)
    np.testing.assert_array_equal(device.read(shared.image), images[0])
    # What is kept besides changes no pixel.
    run(device, [camera_launch(shared, packets=packets)], 1)
    np.testing.assert_array_equal(device.read(shared.image), images[0])
    surfaces = hits.surfaces()
    assert np.count_nonzero(images[1].any(axis=2)) <= surfaces < width * height


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("bounces", [False, True])
def test_lightmap_update(size, bounces):
    rng = np.random.default_rng(size + bounces)
    scene = random_scene(rng)
    lightmap = random_lightmap(rng, scene, 333, 25, 40)
    device = open_device()
    shared = FrameScene(device, scene, 8, 8, scene.cameras[0])
    receivers = FrameLightmap.upload(device, lightmap)
    last = rng.uniform(0, 2, (1000, 4)).astype(np.float32)
    indirect = ReceiverSignal.create(receivers, "last", components=4 if size == 7 else 1)
    device.write(indirect.map, beside(rng, last, indirect.components))
    radiance = receivers.new_map("radiance")
    shared.begin_frame(100)
    declared = lightmap_update(shared, receivers, indirect, radiance, bounces)
    run(device, declared.launches(), size)
    r = lightmap.receivers
    normal = r.normal.astype(np.float64)
    lit = direct_irradiance(scene, 100, r.position, normal, normal)
    irradiance = lit.irradiance + (last[r.texel, :3] if bounces else 0)
    expected = r.emission + r.albedo / np.pi * irradiance
    found = device.read(radiance)
    assert lit.certain.mean() > 0.9
    np.testing.assert_allclose(
        found[r.texel[lit.certain], :3],
        expected[lit.certain],
        rtol=SENT.relative,
        atol=SENT.absolute,
    )
    outside = np.setdiff1d(np.arange(1000), r.texel)
    assert not found[outside].any()
    assert 0 < declared.work.rays <= 3 * 333


def test_lightmap_update_counts_its_rays_in_the_frame_last_run():
    rng = np.random.default_rng(7)
    scene = random_scene(rng)
    lightmap = random_lightmap(rng, scene, 333, 25, 40)
    device = open_device()
    shared = FrameScene(device, scene, 8, 8, scene.cameras[0])
    receivers = FrameLightmap.upload(device, lightmap)
    maps = ReceiverSignal.create(receivers, "indirect"), receivers.new_map("radiance")
    declared = lightmap_update(shared, receivers, *maps, True)
    r = lightmap.receivers
    normal = r.normal.astype(np.float64)
    counts = []
    for frame in (0, 60, 180):
        shared.begin_frame(frame)
        lit = direct_irradiance(scene, frame, r.position, normal, normal)
        counts.append(declared.counted(32).rays)
        assert abs(counts[-1] - lit.rays.sum()) <= 3 * (~lit.certain).sum()
    assert len(set(counts)) > 1


@pytest.mark.parametrize("components", [1, 4])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("listed", [False, True])
def test_dilate(size, listed, components):
    rng = np.random.default_rng(size)
    scene = random_scene(rng, 4)
    lightmap = random_lightmap(rng, scene, 70, 19, 23)
    device = open_device()
    receivers = FrameLightmap.upload(device, lightmap)
    signal = ReceiverSignal.create(receivers, "signal", components)
    values = device.read(signal.map)
    drawn = rng.uniform(0, 3, (70, components, 3)).astype(np.float32)
    values[signal.entries, :3] = drawn.reshape(-1, 3)
    device.write(signal.map, values)
    border = device.upload("border", border_texels(lightmap)) if listed else None
    run(device, signal.dilate(border).launches(), size)
    source = values.reshape(23, 19, components, 4).astype(np.float64)
    expected = source.copy()
    for y in range(23):
        for x in range(19):
            near = source[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].reshape(-1, components, 4)
            valid = near[near[:, 0, 3] > 0]
            if source[y, x, 0, 3] == 0 and len(valid):
                expected[y, x, :, :3] = valid[:, :, :3].mean(axis=0)
    found = device.read(signal.map).reshape(23, 19, components, 4)
    np.testing.assert_allclose(found, expected, rtol=DILATED.relative)
    np.testing.assert_array_equal(signal.at_receivers(), drawn)
    np.testing.assert_array_equal(signal.irradiance(), drawn[:, 0])
    assert np.count_nonzero(found[:, :, components - 1].any(axis=2)) > 70


LOOKUP = """
#include "common/lightmap.cl"
__kernel void look_up(LIGHTMAP_PARAMS, __global const float *u, __global const float *v,
                      __global const int *triangle, int count, __global float *signal)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Hit hit = {0.0f, u[i], v[i], triangle[i]};
    float3 found[COMPONENTS];
    lightmap_signal(LIGHTMAP_ARGS, hit, found);
    for (int c = 0; c < COMPONENTS; ++c)
        store3(signal, (size_t)COMPONENTS * i + c, found[c]);
}
"""


@pytest.mark.parametrize("components", [1, 4])
def test_a_signal_is_looked_up_whole(components, tmp_path):
    rng = np.random.default_rng(components)
    scene = random_scene(rng, 40)
    lightmap = random_lightmap(rng, scene, 200, 23, 17)
    tree = shutil.copytree(Path(gibench.__file__).parents[1] / "kernels_cl", tmp_path / "kernels")
    (tree / "look_up.cl").write_text(LOOKUP)
    device = open_device()
    device.kernel_root = tree
    receivers = FrameLightmap.upload(device, lightmap)
    signal = ReceiverSignal.create(receivers, "signal", components)
    values = rng.uniform(0, 2, (17, 23, components, 4)).astype(np.float32)
    device.write(signal.map, values)
    triangle = rng.integers(0, len(scene.triangles), 500).astype(np.int32)
    u = rng.uniform(0, 1, 500)
    v = rng.uniform(0, 1, 500) * (1 - u)
    out = device.empty("found", (500, components, 3), np.float32)
    args = (
        *signal.lookup_args,
        reads("u", device.upload("u", u.astype(np.float32))),
        reads("v", device.upload("v", v.astype(np.float32))),
        reads("triangle", device.upload("triangle", triangle)),
        integer("count", 500),
        writes("signal", out),
    )
    program = ProgramSpec("look_up.cl", {**SCENE_MACROS, **signal.macros})
    run(device, [Launch(program, "look_up", args, items=500)], 64)
    found = device.read(out)
    weights = np.stack([1 - u - v, u, v], axis=1)
    at = np.einsum("nk,nkd->nd", weights, lightmap.triangle_uvs[triangle].astype(np.float64))
    placed = ~np.isnan(at[:, 0])
    assert placed.sum() > 0
    image = values[..., :3].reshape(17, 23, -1).astype(np.float64)
    looked_up = bilinear(image, *(np.nan_to_num(at).T - 0.5), wrap=False)
    expected = np.where(placed[:, None], looked_up, 0).reshape(500, components, 3)
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-5)
    assert found[:, components - 1].max() > 0.5


def test_memory_is_declared():
    rng = np.random.default_rng(3)
    scene = random_scene(rng, 77)
    device = open_device()
    shared = FrameScene(device, scene, 33, 9, scene.cameras[0])
    declared = FrameScene.buffers(scene, 33, 9, shared.bvh)
    assert device.memory.allocated == by_name(declared)
    least = by_name(FrameScene.buffers(scene, 33, 9))
    assert all(n <= device.memory.allocated[name] for name, n in least.items())
    receivers = FrameLightmap.upload(device, random_lightmap(rng, scene, 50, 10, 11))
    declared += FrameLightmap.buffers(77, 50)
    assert device.memory.allocated == by_name(declared)
    receivers.new_map("map", 3)
    declared.append(FrameLightmap.map_buffer("map", 113))
    assert device.memory.allocated == by_name(declared)
    ReceiverSignal.create(receivers, "signal", components=4)
    declared.append(ReceiverSignal.spec("signal", 110, components=4))
    assert device.memory.allocated == by_name(declared)


def test_srgb_codes_are_exact_for_8_bit_sources():
    codes = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(srgb_codes(srgb_to_linear()[codes]), codes)
