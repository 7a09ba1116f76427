"""The path-traced truth on files as people have them, against closed forms and equal scenes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.reference_scenes import lightmap_of

from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.load import load_scene
from gibench.scene.model import Scene

ROOM = (
    "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nv -1 2 1\n"
    "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6\n"
)


def _scene(folder: Path, obj: str, toml: str) -> Scene:
    (folder / "a.obj").write_text(obj)
    (folder / "a.toml").write_text("schema_version = 1\n" + toml)
    return load_scene(str(folder / "a.toml"))


def _irradiance(scene: Scene, triangles: range, paths: int = 1 << 14) -> np.ndarray:
    """Mean over the area of some triangles, per channel, and its standard error."""
    lightmap = lightmap_of(scene, triangles)
    found = reference_irradiance(scene, lightmap, paths=paths)
    weights = lightmap.receivers.area / lightmap.receivers.area.sum()
    mean = (found.value * weights[:, None]).sum(axis=0)
    error = np.sqrt(((found.stderr * weights[:, None]) ** 2).sum(axis=0))
    return np.stack((mean, error))


@pytest.mark.parametrize("offset", [0.0, 10_000.0, 450_000.0])
def test_a_room_far_off_gets_the_light_that_it_gets_at_the_origin(
    tmp_path: Path, offset: float
) -> None:
    # Each reflection spreads 0.7 of a lamp of 4 pi x 5 W over 24 m2 of closed room.
    expected = 4 * math.pi * 5 * 0.7 / (1 - 0.7) / 24
    scene = _scene(
        tmp_path,
        ROOM,
        f'[[mesh]]\nfile = "a.obj"\nbase_color = 0.7\ntranslate = [{offset}, 0, {-offset}]\n'
        f'[[light]]\ntype = "point"\nposition = [{offset + 0.3}, 1.5, {-offset}]\nintensity = 5\n',
    )
    mean, error = _irradiance(scene, range(12), 1 << 12)
    assert (np.abs(mean - expected) <= 4 * error + 1e-4).all()
    assert np.abs(mean / expected - 1).max() < 0.01


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1.0, 2500.0])
def test_a_room_of_any_size_gets_the_same_light(tmp_path: Path, size: float) -> None:
    # As above, a lamp whose intensity grows with the room's area; rays that left their surfaces by
    # a length of our own would see less of a tiny room than there is.
    expected = 4 * math.pi * 5 * 0.7 / (1 - 0.7) / 24
    scene = _scene(
        tmp_path,
        ROOM,
        f'[[mesh]]\nfile = "a.obj"\nbase_color = 0.7\nscale = {size}\n'
        f'[[light]]\ntype = "point"\nposition = [{0.3 * size}, {1.5 * size}, 0]\n'
        f"intensity = {5 * size * size}\n",
    )
    mean, error = _irradiance(scene, range(12), 1 << 12)
    assert (np.abs(mean - expected) <= 4 * error + 1e-4).all()


WALLS = {
    # One wall of two faces in a plane, of different diagonals, and a slab of 2 mm.
    "coincident": "v 0 0 -1\nv 0 0 1\nv 0 2 1\nv 0 2 -1\nf 9 12 11 10\nf 10 11 12 9\n",
    "slab": "v .001 0 -1\nv .001 0 1\nv .001 2 1\nv .001 2 -1\nf 9 12 11 10\n"
    "v -.001 0 -1\nv -.001 0 1\nv -.001 2 1\nv -.001 2 -1\nf 14 15 16 13\n",
}


def test_a_wall_of_two_coincident_faces_is_a_slab(tmp_path: Path) -> None:
    found = {}
    for kind, wall in WALLS.items():
        scene = _scene(
            tmp_path,
            ROOM + wall,
            '[[mesh]]\nfile = "a.obj"\nbase_color = 0.7\n'
            '[[light]]\ntype = "point"\nposition = [-0.5, 1.5, 0]\nintensity = 5\n',
        )
        assert len(scene.triangles) == 16
        found[kind] = _irradiance(scene, range(16))
    # All light of the lamp stays in its half, of 16 m2; the mean is over the 32 m2 of both.
    expected = 4 * math.pi * 5 * 0.7 / (1 - 0.7) / 32
    for mean, error in found.values():
        assert (np.abs(mean - expected) <= 4 * error + 0.005 * expected).all()


def test_a_surface_emits_what_its_part_of_the_image_says(tmp_path: Path) -> None:
    # The left half of the image is 4 times as bright as the right one; a plate shows either.
    half = np.zeros((8, 16, 3), np.uint8)
    half[:, :8], half[:, 8:] = 255, 137  # sRGB 137/255 is linear 0.2502
    Image.fromarray(half).save(tmp_path / "glow.png")
    (tmp_path / "a.mtl").write_text("newmtl lamp\nKd 0 0 0\nKe 2 1 4\nmap_Ke glow.png\n")
    below = "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nf 1 2 3 4\n"
    above = "v 0 1 0\nv 1 1 0\nv 1 1 1\nv 0 1 1\n"
    results = {}
    for part, (low, high) in {"bright": (0.1, 0.4), "dark": (0.6, 0.9)}.items():
        uvs = f"vt {low} 0.2\nvt {high} 0.2\nvt {high} 0.8\nvt {low} 0.8\n"
        (tmp_path / f"{part}.obj").write_text(
            "mtllib a.mtl\n" + below + above + uvs + "usemtl lamp\nf 5/1 6/2 7/3 8/4\n"
        )
        scene = load_scene(str(tmp_path / f"{part}.obj"))
        results[part] = _irradiance(scene, range(2))[0]
    # Howell, A Catalog of Radiation Heat Transfer, C-11: two squares of side 1 at distance 1.
    q = math.sqrt(2)
    factor = 2 / math.pi * (math.log(2 / math.sqrt(3)) + 2 * q * math.atan(1 / q) - math.pi / 2)
    dark = ((137 / 255 + 0.055) / 1.055) ** 2.4
    for part, share in {"bright": 1.0, "dark": dark}.items():
        expected = math.pi * factor * share * np.array([2.0, 1.0, 4.0])
        np.testing.assert_allclose(results[part], expected, rtol=0.01)


def test_glass_lets_light_through(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl glass\nKd 1 1 1\nd 0.1\nnewmtl wall\nKd 0.5 0.5 0.5\n")
    floor = "mtllib a.mtl\nusemtl wall\nv -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nf 1 4 3 2\n"
    pane = "usemtl glass\nv -9 1 -9\nv 9 1 -9\nv 9 1 9\nv -9 1 9\nf 5 8 7 6\nf 5 6 7 8\n"
    sky = '[[mesh]]\nfile = "a.obj"\n[environment]\ntype = "constant"\nradiance = 1\n'
    scene = _scene(tmp_path, floor + pane, sky)
    assert any("left out (glass)" in line for line in scene.warnings)
    mean, _ = _irradiance(scene, range(len(scene.triangles)), 1 << 10)
    np.testing.assert_allclose(mean, math.pi, rtol=1e-3)
