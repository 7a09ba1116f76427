"""DDGI as a technique: what it converges to, what it lets through, what it costs."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.ddgi_oracle import USABLE, VARIANTS, create, randomise, state_of, term
from support.made import check_memory
from support.pairwise import pairwise
from support.shading_oracle import pixel_directions
from support.synthetic_bake import random_scene
from support.tiny_scenes import box, empty_room, quad_scene

from gibench.errors import CannotRun
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.builtin import build
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Material, PointLight
from gibench.techniques.ddgi import SPEC

PASSES = [
    "probe_trace",
    "probe_shade",
    "blend_irradiance",
    "blend_distance",
    "border_copy",
    "relocation",
    "classification",
    "variability",
    "camera",
    "application",
]
FEW = {"counts": "3x3x3", "rays": 60, "fixed_rays": 20}
SPONZA = "sponza_crytek/sponza.obj"


def frames(technique, count, size=64, first=0):
    prepared = prepare_passes(technique, size)
    assert all(p.problem is None for p in prepared)
    for frame in range(first, first + count):
        enqueue_frame(technique, prepared, frame)
    return prepared


def looking(scene, position=(0.0, 1.2, 0.9), target=(0.0, 1.2, 0.0)):
    return replace(scene, cameras=(Camera(position, target, 70.0),))


@pytest.fixture(scope="module")
def soup():
    return random_scene(np.random.default_rng(5), 60)


@pytest.mark.parametrize("storage", ["fp16", "fp32"])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("size", [16, 64])
def test_memory_is_declared(soup, variant, storage, size):
    technique = create(soup, {**FEW, "storage": storage}, variant, size)
    settings = SPEC.settings({**FEW, "storage": storage})
    least, held = check_memory(SPEC, technique, settings, variant, size, 50)
    assert 0.5 * held < least < held
    before = technique.device.memory.total_bytes
    assert technique.indirect_irradiance().shape == (50, 3)
    assert technique.device.memory.total_bytes == before


@pytest.mark.parametrize("variant", VARIANTS)
def test_passes_and_their_work(soup, variant):
    technique = create(soup, FEW, variant)
    prepared = prepare_passes(technique, 64)
    assert [p.name for p in prepared] == PASSES
    times = enqueue_frame(technique, prepared, 0)
    assert all(ms > 0 for ms in times.pass_ms.values())
    work = {p.name: p.work for p in prepared}
    assert work["probe_trace"].rays == 27 * 60
    assert work["blend_irradiance"].flops == 27 * 40 / 2 * 36 * 8
    assert technique.counts() == {"probes": 27, "rays": 27 * 60, "receivers": 50}


def test_same_seed_same_images_and_variants_agree(soup):
    found = []
    for variant in (*VARIANTS, "tuned"):
        technique = create(soup, FEW, variant)
        frames(technique, 4)
        found.append({**technique.images(), "receivers": technique.indirect_irradiance()})
    published, tuned, again = found
    assert set(tuned) == {"frame", "direct only", "indirect only", "probes", "receivers"}
    for title, image in tuned.items():
        np.testing.assert_array_equal(image, again[title])
        # fp16 maps are rounded at random: a last bit of a sum may turn one step of 5e-4.
        np.testing.assert_allclose(published[title], image, rtol=0, atol=0.02 * image.max())


@pytest.mark.parametrize(
    ("variant", "storage", "average"),
    pairwise(VARIANTS, ["fp16", "fp32"], ["linear", "encoded"]),
)
def test_furnace(variant, storage, average):
    """In a closed room of albedo 0.5 and emission 1 radiance is 1 / (1 - 0.5), irradiance 2 pi.

    It gets there as the moving average does. Of encoded values, with hysteresis 0.97 and half of
    the light fed back, an error of the stored value shrinks by 1 - 0.03 / 2 a frame; 300 frames
    leave about 1 %.
    """
    scene, lightmap = empty_room(side=4)
    glowing = (Material("glowing", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),)
    scene = looking(replace(scene, materials=glowing))
    settings = {**FEW, "storage": storage, "average": average}
    technique = create(scene, settings, variant, lightmap=lightmap)
    # The scalar recurrence that every texel follows, in float64.
    power = 1.0 if average == "linear" else 0.2
    stored = 0.5**power  # frame 0: no probe holds anything, rays bring the emission alone
    for frame in range(1, 300):
        sample = ((1 + 0.5 * 2 * stored ** (1 / power)) / 2) ** power
        kept = 0.97 if average == "encoded" else min(0.97, frame / (frame + 4))
        stored += (1 - kept) * (sample - stored)
    frames(technique, 300)
    found = technique.indirect_irradiance()
    np.testing.assert_allclose(found, 2 * np.pi, rtol=0.02)
    expected = 2 * np.pi * stored ** (1 / power)
    tolerance = 1e-4 if storage == "fp32" else 1e-2
    assert found.mean() == pytest.approx(expected, rel=tolerance)
    image = technique.images()["frame"]
    assert image.mean() == pytest.approx(1 + 0.5 * found.mean() / np.pi, rel=0.02)


def test_a_probe_inside_a_wall_ends_outside_or_inactive():
    """A room with a thick block in its middle; probes begin in it, beside it and far from it."""
    quads = box((-2, 0, -2), (2, 2, 2), inward=True) + box(
        (-0.5, 0.4, -0.5), (0.5, 1.6, 0.5), False
    )
    scene, lightmap = quad_scene(quads, 4)
    scene = looking(scene, (0.0, 1.0, 1.8), (0.0, 1.0, 0.0))
    technique = create(scene, {"counts": "9x5x9"}, lightmap=lightmap, image=(4, 4))
    grid = state_of(technique).grid
    low, high = np.array([-0.5, 0.4, -0.5]), np.array([0.5, 1.6, 0.5])

    def within(position):
        return ((position > low) & (position < high)).all(axis=1)

    began = within(grid)
    assert began.sum() == 27
    frames(technique, 12)
    s = state_of(technique)
    assert not (within(s.position) & (s.state & 1 > 0)).any()
    # Those that were near enough to the block's surface moved out, the innermost cannot.
    assert ((s.state == USABLE) & began).any()
    assert ((s.state & 1 == 0) & began).any()
    assert (np.abs(s.position[:, [0, 2]]) < 2).all()


def test_scrolling_follows_the_camera():
    scene, lightmap = empty_room(side=4)
    glowing = (Material("glowing", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),)
    scene = looking(replace(scene, materials=glowing), (0.0, 1.2, 0.0), (0.0, 1.2, -1.0))
    settings = {"counts": "3x3x3", "spacing": "0.4,0.4,0.6", "origin": "-0.4,0.8,-0.6",
                "rays": 60, "fixed_rays": 20, "scrolling": True, "relocation": False,
                "classification": False}  # fmt: skip
    technique = create(scene, settings, lightmap=lightmap)
    frames(technique, 3)
    before = state_of(technique)
    assert (before.state == USABLE).all()
    technique.look_from(Camera((0.45, 1.2, 0.0), (0.45, 1.2, -1.0), 70.0))
    technique.begin_frame(3)
    after = state_of(technique)
    kept = (before.grid == after.grid).all(axis=1)
    np.testing.assert_allclose(after.grid.mean(axis=0), [0.4, 1.2, 0.0], atol=1e-9)
    assert kept.sum() == 18
    assert (after.state[kept] == USABLE).all()
    assert (after.state[~kept] == 1).all()
    assert technique.images()["frame"].max() > 1
    frames(technique, 1, first=3)
    assert (state_of(technique).state == USABLE).all()


def test_no_light_through_the_wall_between_two_rooms():
    scene = build("two-rooms")
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(scene.triangles), 600)
    c = scene.corners[chosen].astype(np.float64)
    weights = rng.dirichlet((1, 1, 1), len(chosen))
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    _, base = empty_room(side=10)
    receivers = replace(
        base.receivers,
        position=np.einsum("nk,nkd->nd", weights, c).astype(np.float32),
        normal=normal.astype(np.float32),
    )
    lightmap: Lightmap = replace(base, receivers=receivers)
    technique = create(scene, {"rays": 128, "storage": "fp32"}, lightmap=lightmap, image=(4, 4))
    frames(technique, 40)
    found, x = technique.indirect_irradiance(), receivers.position[:, 0]
    assert found[x < 0].mean() > 1
    assert found[x > 0].mean() < 0.01 * found[x < 0].mean()


def test_the_probes_picture_shows_probes():
    scene, lightmap = empty_room(side=4)
    scene = looking(scene, (0.0, 1.2, 1.0), (0.0, 1.2, 0.0))
    technique = create(scene, FEW, lightmap=lightmap, image=(160, 120))
    frames(technique, 1)
    s = state_of(technique)
    # A black room without light: only inactive probes, in dark red, differ from it.
    technique.device.write(technique.probes.data, np.c_[s.offset, np.zeros(27)])
    images = technique.images()
    drawn = np.any(images["probes"] != images["frame"], axis=2)
    assert 0.001 < drawn.mean() < 0.3
    np.testing.assert_allclose(images["probes"][drawn], np.tile([0.05, 0, 0], (drawn.sum(), 1)))
    assert drawn[60, 80]


@pytest.mark.parametrize("storage", ["fp16", "fp32"])
def test_the_probes_picture_equals_every_sphere_by_every_ray(rng, storage):
    """Nearest sphere of all, and what its probe's map holds for the normal there, in float64."""
    width, height = 160, 120
    scene, lightmap = empty_room(side=4)
    scene = looking(scene, (0.3, 1.1, 1.0), (-0.1, 1.3, 0.0))
    settings = {"counts": "5x4x6", "storage": storage}
    technique = create(scene, settings, lightmap=lightmap, image=(width, height))
    frames(technique, 1)
    randomise(technique, rng, (0, USABLE))
    technique.device.write(
        technique.probes.data, np.c_[np.zeros((120, 3)), state_of(technique).state]
    )
    s, images = state_of(technique), technique.images()
    eye, d = np.array(scene.cameras[0].position), pixel_directions(scene.cameras[0], width, height)
    radius, centre = 0.05 * min(s.spacing), s.position - eye
    middle = d @ centre.T
    inside = radius**2 - (centre**2).sum(axis=1) + middle**2
    hit = np.where(inside > 0, middle - np.sqrt(np.maximum(inside, 0)), np.inf)
    hit[hit < 0] = np.inf
    probe, t = hit.argmin(axis=1), hit.min(axis=1)
    expected, drawn = images["frame"].reshape(-1, 3).astype(np.float64), np.isfinite(t)
    for n in np.flatnonzero(drawn):
        shown = np.array([0.05, 0, 0])
        if s.state[probe[n]] == USABLE:
            normal = (t[n] * d[n] - centre[probe[n]]) / radius
            stored = term(s, probe[n], normal[None])[0]
            shown = 2 * (stored if s.linear else stored**2)
        expected[n] = shown
    # At a silhouette float32 and float64 may differ on whether a sphere is met, and on its normal.
    certain = (np.abs(inside) > 0.05 * radius**2).all(axis=1)
    assert len(set(probe[drawn])) > 20 and set(s.state[probe[drawn]]) == {0, USABLE}
    assert (certain & drawn).sum() > 200
    found = images["probes"].reshape(-1, 3)
    np.testing.assert_allclose(found[certain], expected[certain], rtol=2e-3, atol=1e-4)


def test_what_does_not_fit_is_refused(soup):
    technique = create(soup, FEW, "published", local_memory=20)
    refused = {p.name: p for p in prepare_passes(technique, 64)}["blend_irradiance"]
    assert refused.status == "skipped"
    with pytest.raises(CannotRun, match="buffer 'probe_hits' asks for"):
        create(soup, {"probes": 1_500_000})


@pytest.mark.slow
def test_the_papers_volume_on_sponza():
    root = Path(os.environ.get("GIBENCH_SCENES", "/work/shared/scenes"))
    if not (root / SPONZA).exists():
        pytest.skip(f"{root / SPONZA} is not there")
    from gibench.scene.load import load_scene

    scene = load_scene(str(root / SPONZA))
    _, lightmap = empty_room(side=4)
    technique = create(scene, {"counts": "20x10x10"}, lightmap=lightmap, image=(16, 9))
    assert technique.counts()["probes"] == 2000
    frames(technique, 2)
    s = state_of(technique)
    assert 0.2 < (s.state == USABLE).mean() < 1
    assert np.isfinite(technique.images()["frame"]).all()


@pytest.mark.parametrize("variant", VARIANTS)
def test_rays_are_counted_after_a_frame(variant):
    """A lamp above a slab: rays are shared between probes inside of it, which rest, and others."""
    scene, _ = quad_scene(
        [
            *box((-1, 0, -1), (1, 2, 1), inward=True),
            *box((-0.7, 0.1, -0.7), (0.7, 0.8, 0.7), False),
        ],
        2,
        lights=(PointLight((0.0, 1.7, 0.0), (1.0, 1.0, 1.0)),),
    )
    technique = create(looking(scene), FEW, variant)
    prepared = {one.name: one for one in frames(technique, 3)}
    active = int(np.count_nonzero(state_of(technique).state.astype(int) & 1))
    traced = prepared["probe_trace"]
    assert 0 < active < 27
    assert traced.work.rays == 27 * 60
    assert traced.counted(16).rays == 27 * 20 + active * 40
    shaded = prepared["probe_shade"].counted(16)
    assert shaded.bytes_written == 16 * active * 40
    # Every ray of an active probe hits a front, and the lamp is before half of them and more.
    assert 0.5 * active * 40 < shaded.rays <= active * 40
    assert prepared["camera"].counted(16).rays > prepared["camera"].work.rays
    for name in ("blend_irradiance", "blend_distance", "variability"):
        blended = prepared[name].counted(16)
        assert blended.flops == pytest.approx(prepared[name].work.flops * active / 27), name
