"""Our camera images against Mitsuba 3, a renderer that nobody here wrote.

The test is the one of Mitsuba's own render tests (Jung, Hanika, Dachsbacher 2020; Subr and Arvo
2007): a z-test per pixel and channel at a Sidak-corrected level of 1 %, passed by 99.75 % of them.
Here either side has its own variance, read off independent renders, hence Welch's t.
"""

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from support.cut_scenes import CAMERA, leaves
from support.glow_scenes import sign
from support.pairwise import pairwise
from support.reference_scenes import DARK, box, plain_texture, quad, scene_of, sphere

from gibench.errors import BadInput
from gibench.reference.mitsuba_export import envmap_pixels, write_mitsuba
from gibench.reference.path_tracer import reference_image
from gibench.scene.builtin import build
from gibench.scene.environment import Environment
from gibench.scene.load import load_scene
from gibench.scene.model import Camera, DirectionalLight, Material, PointLight, SpotLight, Texture
from gibench.scene.readers.backs import apart, with_backs
from gibench.scene.readers.clean import CleanMesh

mi = pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed (gibench[truth])")
if "scalar_rgb" in mi.variants():
    mi.set_variant("scalar_rgb")

ROOM = (
    "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 0 1 0\nv 1 1 0\nv 1 1 1\nv 0 1 1\n"
    "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6\n"
)
SIZE, RENDERS, SAMPLES, PATHS = 24, 12, 32, 1024
RNG = np.random.default_rng(7)
SKY = Environment((RNG.random((5, 8, 3)) + 8 * (RNG.random((5, 8, 1)) > 0.9)).astype(np.float32))


def mitsuba_image(folder, scene, camera, bounces, frame=0):
    xml = write_mitsuba(
        folder, scene, camera, SIZE, SIZE, frame=frame, bounces=bounces, samples=SAMPLES
    )
    loaded = mi.load_file(str(xml))
    images = [np.array(mi.render(loaded, seed=s), np.float64) for s in range(RENDERS)]
    mean = np.mean(images, axis=0)
    return mean, np.std(images, axis=0, ddof=1) / math.sqrt(RENDERS)


def share_that_passes(ours, mean, error):
    a, b = ours.stderr**2, error**2
    both = a + b + (1e-6 * mean.max()) ** 2
    freedom = both**2 / (a**2 / (ours.rounds - 1) + b**2 / (RENDERS - 1) + 1e-60)
    p = 2 * stats.t.sf(np.abs(ours.value - mean) / np.sqrt(both), freedom)
    level = 1 - (1 - 0.01) ** (1 / p.size)
    return np.mean(p > level)


def compare(folder, scene, camera, bounces, frame=0):
    ours = reference_image(
        scene, camera, SIZE, SIZE, bounces=bounces, paths=PATHS, frame=frame, seed=5
    )
    mean, error = mitsuba_image(folder, scene, camera, bounces, frame)
    passes = share_that_passes(ours, mean, error)
    off = (ours.value - mean).mean(axis=(0, 1))
    spread = np.sqrt((ours.stderr**2 + error**2).sum(axis=(0, 1))) / SIZE**2
    return passes, off / np.maximum(spread, 1e-6 * mean.mean()), spread / mean.mean(axis=(0, 1))


def agree(folder, scene, camera, bounces, frame=0):
    passes, whole, precision = compare(folder, scene, camera, bounces, frame)
    assert passes >= 0.9975
    # And the whole image, which sees what no single pixel does.
    assert (np.abs(whole) < 4.5).all(), whole
    assert (precision < 0.02).all(), precision


@pytest.mark.parametrize(
    ("environment", "bounces", "name"),
    pairwise([None, SKY], [1, None], ["cornell-box", "blue-orange-box"]),
)
def test_built_in_scenes(tmp_path, name, bounces, environment):
    scene = build(name)
    if environment:
        scene = replace(scene, environment=environment)
    agree(tmp_path, scene, scene.cameras[0], bounces, frame=20)


def gltf_scene():
    root = Path(os.environ.get("GIBENCH_SCENES", "/work/shared/scenes"))
    if not root.is_dir():
        root = Path(__file__).parents[3] / "shared" / "scenes"
    files = sorted((root / "gltf_tests").glob("BoxTextured-glTF/*.gltf"))
    if not files:
        pytest.skip(f"no glTF test scenes in {root}")
    return load_scene(str(files[0]))


@pytest.mark.parametrize(
    ("environment", "bounces"),
    [
        pytest.param(None, None, id="many"),
        pytest.param(SKY, 1, id="one-sky"),
        pytest.param(None, 1, id="one", marks=pytest.mark.slow),
        pytest.param(SKY, None, id="many-sky", marks=pytest.mark.slow),
    ],
)
def test_a_gltf_scene(tmp_path, bounces, environment):
    """A textured cube on a floor, with lights and surroundings of our own."""
    cube = gltf_scene()
    low, high = cube.bounds
    span = float((high - low).max())
    base = np.array(
        quad((low[0] - span, low[1], low[2] - span), (0, 0, 3 * span), (3 * span, 0, 0))
    )
    floor = scene_of(base, 0, [Material("floor", (0.7, 0.6, 0.5))])
    vertices, materials = len(cube.positions), len(cube.materials)
    scene = replace(
        cube,
        positions=np.vstack((cube.positions, floor.positions)),
        normals=np.vstack((cube.normals, floor.normals)),
        uvs=np.vstack((cube.uvs, floor.uvs)),
        lightmap_uvs=None,
        triangles=np.vstack((cube.triangles, floor.triangles + vertices)).astype(np.int32),
        material_ids=np.append(cube.material_ids, floor.material_ids + materials).astype(np.int32),
        object_ids=np.append(cube.object_ids, floor.object_ids + 1000).astype(np.int32),
        materials=(*cube.materials, *floor.materials),
        lights=(
            DirectionalLight((-0.48, -0.64, -0.6), (3.0, 3.0, 2.0)),
            PointLight(tuple(high + span * 0.6), (2.0, 3.0, 4.0)),
        ),
        environment=environment or Environment.constant((0.0, 0.0, 0.0)),
    )
    middle = (low + high) / 2
    camera = Camera(tuple(middle + span * np.array((1.7, 1.3, 2.1))), tuple(middle), 45.0)
    agree(tmp_path, scene, camera, bounces)


def lamp_room():
    """An emissive panel, a hard spot, a texture and an open side on a sky: all that we export."""
    stripes = Texture("stripes", RNG.random((4, 4, 3)).astype(np.float32))
    panel = np.array(quad((0.3, 0.98, 0.3), (0.3, 0, 0), (0, 0, 0.4)))
    walls = box()[2:]  # without z = 0
    ids = [0] * len(walls) + [1, 1]
    uvs = RNG.random((3 * len(ids), 2)).astype(np.float32) * 3 - 1
    spot = SpotLight((0.5, 0.8, 0.6), (0.6, -0.8, 0.0), (1.0, 2.0, 3.0), 0.5, 0.5)
    materials = [
        Material("wall", (0.9, 0.8, 0.7), texture=0),
        Material("lamp", (0.3, 0.3, 0.3), (5, 4, 2)),
    ]
    return scene_of(
        [*walls, *panel],
        ids,
        materials,
        lights=[spot],
        uvs=uvs,
        textures=[stripes],
        environment=SKY,
    )


@pytest.mark.parametrize("bounces", [0, 2, None])
def test_emitters_textures_and_spots(tmp_path, bounces):
    camera = Camera((0.4, 0.5, -1.2), (0.5, 0.5, 0.5), 50.0)
    agree(tmp_path, lamp_room(), camera, bounces)


def test_smooth_normals(tmp_path):
    """A finely cut sphere: where a shading normal looks away but its triangle does not, Mitsuba is
    black and we are not, so a coarse one would differ at its silhouette."""
    middle = np.array((0.5, 0.42, 0.5))
    ball = sphere(4) * 0.4 + middle
    walls = box()[2:]
    materials = [Material("wall", (0.8, 0.7, 0.6)), Material("ball", (0.7, 0.7, 0.9))]
    lamp = PointLight((0.2, 0.9, 0.2), (1.0, 1.0, 1.0))
    ids = [0] * len(walls) + [1] * len(ball)
    scene = scene_of([*walls, *ball], ids, materials, lights=[lamp], environment=SKY)
    normals, first = scene.normals.copy(), 3 * len(walls)
    normals[first:] = (scene.positions[first:] - middle) / 0.4
    camera = Camera((0.4, 0.5, -1.2), tuple(middle), 50.0)
    agree(tmp_path, replace(scene, normals=normals), camera, None)


def test_cut_outs(tmp_path, rng):
    """Leaves with masks, textured, under a lamp whose shadow rays pass the holes."""
    scene = leaves(rng, count=5, image=(4, 3), repeat=2).masked
    spots = Texture("spots", rng.random((4, 4, 3)).astype(np.float32))
    wall, leaf = scene.materials
    scene = replace(scene, materials=(wall, replace(leaf, texture=0)), textures=(spots,))
    agree(tmp_path, scene, CAMERA, None)
    written = (tmp_path / "scene.xml").read_text()
    assert written.count('type="mask"') == 5
    uvs = replace(scene, cutouts=replace(scene.cutouts, uvs=scene.cutouts.uvs * 2))
    glowing = replace(scene, materials=(wall, replace(leaf, emission=(1.0, 1.0, 1.0))))
    with pytest.raises(BadInput, match="glows"):
        write_mitsuba(tmp_path, glowing, CAMERA, 4, 4)
    with pytest.raises(BadInput, match="coordinates of their own"):
        write_mitsuba(tmp_path, uvs, CAMERA, 4, 4)


def test_a_glowing_sign(tmp_path, rng):
    """A wall that emits by an image with sparks, over an image of its own."""
    pixels = rng.random((6, 8, 3)) ** 3
    pixels[2, 3] *= 200
    walls, lamp = box()[2:], Material("wall", (0.7, 0.6, 0.5))
    scene = sign(pixels, (0, 0, 0), (1, 0, 0), (0, 1, 0), walls, materials=(lamp,))
    camera = Camera((0.4, 0.5, 0.9), (0.5, 0.45, 0.0), 80.0)
    agree(tmp_path, scene, camera, None)
    assert (tmp_path / "scene.xml").read_text().count('name="radiance"') == 2
    spots = Texture("spots", rng.random((4, 4, 3)).astype(np.float32))
    painted = tuple(replace(m, base_color=(1.0, 1.0, 1.0), texture=0) for m in scene.materials)
    scene = replace(scene, materials=painted, textures=(spots,))
    with pytest.raises(BadInput, match="coordinates of their own"):
        write_mitsuba(tmp_path, scene, camera, 4, 4)


def test_two_sided_surfaces(tmp_path, rng):
    """Backs that loading adds, against Mitsuba's own two-sided materials on the fronts alone."""
    (tmp_path / "a.obj").write_text(ROOM)
    sheets = "".join(
        f"v {x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in rng.uniform(0.1, 0.9, (12, 3)).tolist()
    )
    faces = "".join(f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}\n" for i in range(4))
    (tmp_path / "sheets.obj").write_text(sheets + faces)
    toml = (
        'schema_version = 1\n[[mesh]]\nfile = "a.obj"\nbase_color = [0.8, 0.7, 0.6]\n'
        '[[mesh]]\nfile = "sheets.obj"\nbase_color = [0.3, 0.6, 0.9]\n'
        '[[light]]\ntype = "point"\nposition = [0.31, 0.83, 0.27]\nintensity = 1\n'
        "[[camera]]\nposition = [0.5, 0.5, 0.05]\ntarget = [0.5, 0.4, 1.0]\nfov_degrees = 80\n"
    )
    (tmp_path / "a.toml").write_text(toml)
    fronts = load_scene(str(tmp_path / "a.toml"))
    mesh = CleanMesh(
        fronts.positions, fronts.normals, fronts.uvs, fronts.triangles, fronts.material_ids,
        fronts.object_ids, None, (),
    )  # fmt: skip
    materials = [replace(m, two_sided=n > 0) for n, m in enumerate(fronts.materials)]
    doubled = apart(with_backs(mesh, materials, fronts.lights, fronts.cameras), backs=4)
    assert len(doubled.triangles) == len(fronts.triangles) + 4
    names = ("positions", "normals", "uvs", "triangles", "material_ids", "object_ids")
    both = replace(fronts, **{name: getattr(doubled, name) for name in names})
    camera = fronts.cameras[0]
    ours = reference_image(both, camera, SIZE, SIZE, paths=PATHS, seed=5)
    xml = write_mitsuba(tmp_path / "m", fronts, camera, SIZE, SIZE, samples=SAMPLES)
    text = xml.read_text()
    last = text.rindex('<bsdf type="diffuse"')
    end = text.index("</bsdf>", last) + len("</bsdf>")
    text = text[:last] + '<bsdf type="twosided">' + text[last:end] + "</bsdf>" + text[end:]
    xml.write_text(text)
    loaded = mi.load_file(str(xml))
    images = [np.array(mi.render(loaded, seed=s), np.float64) for s in range(RENDERS)]
    mean, error = np.mean(images, axis=0), np.std(images, axis=0, ddof=1) / math.sqrt(RENDERS)
    assert share_that_passes(ours, mean, error) >= 0.9975
    off = (ours.value - mean).mean(axis=(0, 1))
    spread = np.sqrt((ours.stderr**2 + error**2).sum(axis=(0, 1))) / SIZE**2
    assert (np.abs(off) < 4.5 * spread).all()
    dark = reference_image(fronts, camera, SIZE, SIZE, paths=PATHS // 4, seed=5)
    assert (np.abs(dark.value.mean(axis=(0, 1)) - mean.mean(axis=(0, 1))) > 9 * spread).any()


def test_the_comparison_can_fail(tmp_path):
    """A reflectance off by 4 % is found."""
    scene = build("cornell-box")
    wrong = replace(
        scene,
        materials=tuple(
            replace(m, base_color=tuple(1.04 * c for c in m.base_color)) for m in scene.materials
        ),
    )
    ours = reference_image(wrong, scene.cameras[0], SIZE, SIZE, paths=PATHS, seed=5)
    mean, error = mitsuba_image(tmp_path, scene, scene.cameras[0], None)
    spread = np.sqrt((ours.stderr**2 + error**2).sum(axis=(0, 1))) / SIZE**2
    assert (np.abs((ours.value - mean).mean(axis=(0, 1))) > 6 * spread).any()


def test_environments_are_the_same_function(tmp_path):
    for pixels in (SKY.pixels, SKY.pixels[:, :1], SKY.pixels[:3, :7]):
        sky = Environment(pixels)
        bitmap = mi.Bitmap(np.ascontiguousarray(envmap_pixels(sky)))
        turn = mi.ScalarTransform4f().rotate([0, 1, 0], 180)
        theirs = mi.load_dict({"type": "envmap", "bitmap": bitmap, "to_world": turn})
        d = RNG.normal(size=(100, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        for direction, expected in zip(d, sky.radiance(d), strict=True):
            si = mi.SurfaceInteraction3f()
            si.wi = mi.Vector3f(*(float(-x) for x in direction))
            assert np.array(theirs.eval(si)) == pytest.approx(expected, abs=1e-5)


def test_a_soft_spot_is_refused(tmp_path):
    soft = SpotLight((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 0.1, 0.6)
    scene = scene_of(box(), 0, [DARK], lights=[soft], textures=[plain_texture((1, 1, 1))])
    with pytest.raises(BadInput, match="soft edge"):
        write_mitsuba(tmp_path, scene, Camera((0.5, 0.5, 0.9), (0.5, 0.5, 0)), 4, 4)
