"""Scene TOMLs, shapes, environment images and the entry."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gibench.errors import BadInput
from gibench.scene.load import load_scene
from gibench.scene.model import DirectionalLight, PointLight, Scene, SpotLight
from gibench.scene.readers.environment_image import load_environment
from gibench.scene.readers.shapes import SHAPES

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
HEAD = "schema_version = 1\n"
MESH = '[[mesh]]\nfile = "t.obj"\n'


def _load(folder: Path, text: str) -> Scene:
    (folder / "t.obj").write_text(TRIANGLE)
    path = folder / "s.toml"
    path.write_text(HEAD + text)
    return load_scene(str(path))


def test_everything_a_scene_file_can_say(tmp_path: Path) -> None:
    np.save(tmp_path / "probes.npy", np.eye(3))
    Image.fromarray(np.uint8([[[255, 255, 255]]])).save(tmp_path / "white.png")
    scene = _load(
        tmp_path,
        'name = "mine"\nreceivers = 1234\n'
        + MESH
        + "scale = 2\nrotate_degrees = [0, 0, 90]\ntranslate = [10, 0, 0]\nemission = 3\n"
        + MESH
        + "matrix = [1,0,0,0, 0,1,0,0, 0,0,-1,7, 0,0,0,1]\nbase_color = [0.1, 0.2, 0.3]\n"
        + '[[mesh]]\nshape = "cube"\ntexture = "white.png"\n'
        + '[[light]]\ntype = "directional"\ndirection = [0, -2, 0]\nirradiance = 5\n'
        + "swing_degrees = 10\n"
        + '[[light]]\ntype = "point"\nposition = [1, 2, 3]\nintensity = [1, 2, 3]\n'
        + "orbit_radius = 0.5\nperiod_frames = 9\n"
        + '[[light]]\ntype = "spot"\nposition = [1, 2, 3]\ndirection = [1, 0, 0]\n'
        + "intensity = 1\nouter_degrees = 30\n"
        + '[environment]\ntype = "constant"\nradiance = [1, 2, 3]\n'
        + "[[camera]]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_degrees = 33\n"
        + '[probes]\npositions = "probes.npy"\n',
    )
    assert (scene.name, scene.receivers, scene.probes.count) == ("mine", 1234, 3)
    np.testing.assert_allclose(scene.corners[0], [[10, 0, 0], [10, 2, 0], [8, 0, 0]], atol=1e-6)
    assert (scene.corners[1][:, 2] == 7).all()
    a, b, c = scene.corners[1].astype(float)
    assert np.cross(b - a, c - a)[2] < 0  # mirrored in z: the front went with it
    first, second, cube = (scene.materials[i] for i in scene.material_ids[[0, 1, 2]])
    assert first.emission == (3, 3, 3)
    assert (second.base_color, second.emission) == ((0.1, 0.2, 0.3), (0, 0, 0))
    assert (cube.base_color, cube.texture) == ((1, 1, 1), 0)
    assert len(scene.triangles) == 2 + 12
    sun, point, spot = scene.lights
    assert sun == DirectionalLight((0, -1, 0), (5, 5, 5), 10)
    assert point == PointLight((1, 2, 3), (1, 2, 3), 0.5, 9)
    assert spot == SpotLight((1, 2, 3), (1, 0, 0), (1, 1, 1), 0, math.radians(30))
    assert scene.environment.pixels.tolist() == [[[1, 2, 3]]]
    assert scene.cameras[0].fov_degrees == 33
    assert scene.probes.positions is not None
    np.testing.assert_array_equal(scene.probes.positions, np.eye(3))


def test_rotations_go_about_x_then_y_then_z(tmp_path: Path) -> None:
    scene = _load(tmp_path, MESH + "rotate_degrees = [90, 90, 0]\n")
    # x: (1,0,0) stays, (0,1,0) -> (0,0,1); y: (1,0,0) -> (0,0,-1), (0,0,1) -> (1,0,0).
    np.testing.assert_allclose(scene.corners[0], [[0, 0, 0], [0, 0, -1], [1, 0, 0]], atol=1e-6)


def test_defaults_and_flip(tmp_path: Path) -> None:
    scene = _load(tmp_path, MESH + "flip = true\n")
    assert scene.name == "s"
    assert (scene.normals == [0, 0, -1]).all()
    assert scene.lights
    dark = _load(tmp_path, MESH + '[environment]\ntype = "constant"\nradiance = 1\n')
    assert not dark.lights
    probes = _load(tmp_path, MESH + "[probes]\npositions = [[1, 2, 3]]\n").probes
    assert probes.count == 1
    (tmp_path / "p.csv").write_text("x,y,z\n1,2,3\n4,5,6\n")
    probes = _load(tmp_path, MESH + '[probes]\npositions = "p.csv"\n').probes
    assert probes.positions is not None
    assert probes.positions.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "at least one mesh"),
        (MESH + "color = 1\n", "unknown key 'color' in .*keys are file, shape"),
        ("colour = 1\n" + MESH, "unknown key 'colour'"),
        ('[[mesh]]\nfile = "none.obj"\n', "no file 'none.obj'"),
        ('[[mesh]]\nshape = "teapot"\n', "rectangle, disk, cube, sphere"),
        ("[[mesh]]\n", "either file or shape"),
        (MESH + "scale = 0\n", "not zero"),
        (MESH + "scale = inf\n", "'scale'"),
        (MESH + "translate = [1, 2]\n", "list of 3 numbers"),
        (MESH + "matrix = [1, 2]\n", "list of 16 numbers"),
        (MESH + "base_color = [2, 0, 0]\n", "from 0 to 1"),
        (MESH + "emission = -1\n", "of at least 0"),
        (MESH + '[[light]]\ntype = "laser"\n', "directional, point, spot"),
        (MESH + '[[light]]\ntype = "point"\nintensity = 1\n', "'position' in .* is missing"),
        (MESH + '[[light]]\ntype = "directional"\ndirection = [0,0,0]\nirradiance = 1\n', "zero"),
        (MESH + '[environment]\ntype = "image"\nfile = "no.hdr"\n', "no file 'no.hdr'"),
        (MESH + '[environment]\ntype = "image"\nfile = "t.obj"\n', "not an image"),
        (MESH + "[[camera]]\nposition = [0,0,0]\ntarget = [0,1,0]\n", "along 'up'"),
        (MESH + "[probes]\ncount = 0\n", "at least 1"),
        (MESH + "[probes]\npositions = [[1, 2]]\n", "one x, y, z per probe"),
        (MESH + '[probes]\npositions = "t.obj"\n', "not probe positions"),
        (MESH + "receivers = \n", "not valid TOML"),
        ("mesh = 3\n", "write it as"),
        ("light = [1]\n" + MESH, "not a table"),
    ],
)
def test_faults_say_why_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(BadInput, match=says) as caught:
        _load(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_the_entry_refuses_what_is_no_scene(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cornell-box"):
        load_scene("no-such-scene")
    with pytest.raises(BadInput, match="folder"):
        load_scene(str(tmp_path))
    (tmp_path / "a.fbx").write_text("x")
    with pytest.raises(BadInput, match=r"\.gltf, \.glb, \.obj"):
        load_scene(str(tmp_path / "a.fbx"))
    with pytest.raises(BadInput, match="no scene called"):
        load_scene("a\0b")
    (tmp_path / "v.toml").write_text("schema_version = 2\n")
    with pytest.raises(BadInput, match="schema_version = 1"):
        load_scene(str(tmp_path / "v.toml"))
    assert load_scene("cornell-box").name == "cornell-box"


@pytest.mark.parametrize(
    ("shape", "area", "volume"),
    [("rectangle", 4, 0), ("disk", math.pi, 0), ("cube", 24, 8), ("sphere", 12.566, 4.189)],
)
def test_shapes_have_their_size_and_face_outwards(shape: str, area: float, volume: float) -> None:
    part = SHAPES[shape]()
    corners = part.positions[part.triangles]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert np.linalg.norm(flat, axis=1).sum() == pytest.approx(area, rel=0.01)
    assert np.einsum("ij,ij->", corners[:, 0], flat) / 3 == pytest.approx(volume, rel=0.01)
    assert part.normals is not None
    assert (np.einsum("tcx,tx->tc", part.normals[part.triangles], flat) > 0).all()


@pytest.mark.parametrize("run_length", [False, True])
def test_radiance_hdr(tmp_path: Path, run_length: bool) -> None:
    rgbe = np.zeros((2, 10, 4), np.uint8)
    rgbe[0, :, :] = [127, 63, 0, 129]
    rgbe[1] = np.arange(40).reshape(10, 4) + 100
    body = b""
    for row in rgbe:
        if not run_length:
            body += row.tobytes()
            continue
        body += bytes([2, 2, 0, 10])
        for channel in row.T:
            if (channel == channel[0]).all():
                body += bytes([128 + 10, channel[0]])
            else:
                body += bytes([4, *channel[:4]]) + bytes([6, *channel[4:]])
    path = tmp_path / "a.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 10\n" + body)
    pixels = load_environment(path, 2.0).pixels
    expected = 2 * (rgbe[..., :3] + 0.5) * 2.0 ** (rgbe[..., 3:].astype(float) - 136)
    np.testing.assert_allclose(pixels, expected, rtol=1e-6)
    np.testing.assert_allclose(pixels[0, 0, 0], 2 * 127.5 / 128)
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(BadInput, match="cut short"):
        load_environment(path)


def test_ldr_environment_is_decoded_from_srgb(tmp_path: Path) -> None:
    Image.fromarray(np.uint8([[[188, 255, 0]]])).save(tmp_path / "a.png")
    pixels = load_environment(tmp_path / "a.png", 10).pixels
    np.testing.assert_allclose(pixels, [[[5.0289, 10, 0]]], rtol=1e-4)
