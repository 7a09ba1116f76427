"""The truth with normal maps: what it shades with, and what light that gives."""

from dataclasses import replace

import numpy as np
import pytest
from support.glow_scenes import bumpy
from support.normal_map_oracle import mapped
from support.reference_scenes import box, lightmap_of, quad, random_scene, scene_of

from gibench.reference import host_cl, wavefront
from gibench.reference.packed import pack_fragments, pack_scene
from gibench.reference.path_tracer import reference_image, reference_irradiance
from gibench.reference.queues import Queues
from gibench.reference.starts import ReceiverStart
from gibench.reference.wavefront import Wavefront
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, DirectionalLight, Material
from gibench.scene.normal_maps import NormalMaps


@pytest.mark.parametrize("group", [1, 16, 100])
def test_the_kernel_shades_with_the_mapped_normal(rng, monkeypatch, group):
    """Of random triangles, tangents and signs; uvs that repeat and are mirrored."""
    monkeypatch.setattr(
        wavefront, "host_program", lambda **more: host_cl.host_program(group, **more)
    )
    scene = bumpy(random_scene(rng), rng)
    lightmap = lightmap_of(scene, range(len(scene.triangles)))
    front = Wavefront(pack_scene(scene, 0, normal_maps=True), None,
                      ReceiverStart(pack_fragments(lightmap.fragments)), 0)  # fmt: skip
    samples, owners = 9, len(scene.triangles)
    q = Queues(front.program, owners * samples, front._slots)
    at = q.vertices[0]
    front.program.run("draw_starts", -(-owners * samples // front.program.lanes),
                      *_starts(owners * samples, samples), q.stride,
                      wavefront.updates("drawn", q.drawn))  # fmt: skip
    front.program.run(
        "start_at_receivers", owners * samples, *_starts(owners * samples, samples)[:-1],
        front._triangles, *front._start, *q.drawn_before,
        wavefront.writes("throughput", q.throughput), wavefront.writes("collected", q.collected),
        *at.reached, *front._normal_maps,
    )  # fmt: skip
    front.program.queue.finish()
    bent = 0
    for p in rng.choice(owners * samples, 120, replace=False):
        triangle = p // samples
        corners = scene.corners[triangle].astype(float)
        e, f = corners[1] - corners[0], corners[2] - corners[0]
        flat = np.cross(e, f)
        off = at.origin.array[p] - corners[0]
        u, v = np.cross(off, f) @ flat / (flat @ flat), np.cross(e, off) @ flat / (flat @ flat)
        b, geometric = np.array((1 - u - v, u, v)), flat / np.linalg.norm(flat)
        normal = b @ scene.normals[scene.triangles[triangle]].astype(float)
        normal /= np.linalg.norm(normal)
        expected = mapped(scene, triangle, b, normal, geometric)
        if abs(expected @ geometric) < 1e-2:
            continue  # on either side of the rule by rounding
        np.testing.assert_allclose(at.shading.array[p], expected, atol=3e-3)
        bent += np.abs(expected - normal).max() > 0.05
    assert bent > 30


def _starts(count, samples):
    unsigned = wavefront.unsigned
    return (unsigned("count", count), unsigned("first", 0), unsigned("samples", samples),
            unsigned("round_seed", 5))  # fmt: skip


def tilted_floor(sign, turn, uv_turned):
    """A floor whose map tilts its normal by 30 degrees along +x of the image."""
    floor = quad((0, 0, 0), (0, 0, 1), (1, 0, 0))
    scene = scene_of(np.array(floor), 0, [Material("floor", (0.5, 0.5, 0.5))])
    tilt = np.array((np.sin(np.pi / 6), 0, np.cos(np.pi / 6)))
    tangent = np.array((np.cos(turn), 0, np.sin(turn)), np.float32)
    uvs = scene.corners[:, :, [0, 2]] * (-1 if uv_turned else 1)
    maps = NormalMaps(
        (np.broadcast_to(tilt, (4, 4, 3)).astype(np.float32),), np.arange(2, dtype=np.int32),
        np.zeros(2, np.int32), uvs.astype(np.float32), np.ones(2, np.float32),
        np.broadcast_to([*tangent, sign], (2, 3, 4)).astype(np.float32),
    )  # fmt: skip
    normal = np.sin(np.pi / 6) * tangent + np.cos(np.pi / 6) * np.array((0, 1, 0))
    return replace(scene, normal_maps=maps), normal


@pytest.mark.parametrize("sign, turn, uv_turned", [(1, 0.0, False), (-1, 2.0, True)])
def test_light_on_a_tilted_floor(sign, turn, uv_turned):
    """A lamp by the cosine to the mapped normal; a sky by the part of its hemisphere above ground:
    the mean of the cosine over half the sky and half of the rest, (1 + cos 30) / 2.
    """
    scene, normal = tilted_floor(sign, turn, uv_turned)
    camera = Camera((0.5, 3, 0.5), (0.5, 0, 0.5), 5.0, up=(0, 0, 1))
    direction = np.array((0.3, -0.9, 0.2)) / np.linalg.norm((0.3, -0.9, 0.2))
    lit = replace(scene, lights=(DirectionalLight(tuple(direction), (2.0, 2.0, 2.0)),))
    image = reference_image(lit, camera, 4, 4, paths=64, bounces=0, normal_maps=True).value
    np.testing.assert_allclose(image, 0.5 / np.pi * 2 * (-direction @ normal), rtol=2e-3)
    plain = reference_image(lit, camera, 4, 4, paths=64, bounces=0).value
    np.testing.assert_allclose(plain, 0.5 / np.pi * 2 * -direction[1], rtol=1e-3)
    sky = replace(scene, environment=Environment.constant((1.0, 1.0, 1.0)))
    found = reference_irradiance(sky, lightmap_of(sky, range(2)), paths=1 << 13, normal_maps=True)
    expected = np.pi * (1 + np.cos(np.pi / 6)) / 2
    assert (np.abs(found.value - expected) < 5 * found.stderr + 2e-3).all()


def test_maps_matter_only_where_they_are_asked_for(rng):
    walls = scene_of(np.array(box()), 0, [Material("wall", (0.5, 0.5, 0.5))],
                     lights=[DirectionalLight((0, -1, 0), (1.0, 1.0, 1.0))])  # fmt: skip
    scene = bumpy(walls, rng, share=1.0)
    lightmap = lightmap_of(scene, range(12))
    plain, same = (reference_irradiance(s, lightmap, paths=64) for s in (walls, scene))
    np.testing.assert_array_equal(plain.value, same.value)
    assert plain.key == same.key
    bent = reference_irradiance(scene, lightmap, paths=64, normal_maps=True)
    assert bent.key != plain.key
    none = reference_irradiance(walls, lightmap, paths=64, normal_maps=True)
    assert none.key == plain.key
