"""Alpha masks at load: which triangles are cut, by which texels; the lightmap of what is left."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.cut_scenes import leaves
from test_scene_load_gltf import File

from gibench.bake.lightmap import lightmap_key
from gibench.scene.cutouts import Cutouts, surface_texels
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.load import load_scene
from gibench.scene.model import Scene

SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
UVS = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])  # glTF's v points down
# Alphas of 4 x 4 texels, in which the two triangles differ; row 0 is the top.
ALPHA = np.uint8([[0, 0, 0, 255], [0, 0, 255, 255], [0, 100, 255, 255], [200, 255, 255, 255]])


def png(alpha: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.dstack([np.full((*np.shape(alpha), 3), 188, np.uint8), alpha])).save(
        out, "PNG"
    )
    return out.getvalue()


def gltf(path: Path, alpha: Any, material: dict[str, Any], uvs: Any = UVS, **more: Any) -> Scene:
    """A square with an image of ``alpha``."""
    file = File()
    file.mesh(SQUARE, [0, 1, 2, 0, 2, 3], material=0, TEXCOORD_0=uvs, **more)
    pbr = {"baseColorTexture": {"index": 0}, **material.pop("pbr", {})}
    file.json |= {
        "images": [{"bufferView": file.view(png(alpha))}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": pbr, "alphaMode": "MASK", **material}],
    }
    return load_scene(str(file.gltf(path / "a.gltf")))


def cut(scene: Scene) -> Cutouts:
    assert scene.cutouts is not None
    return scene.cutouts


@pytest.mark.parametrize("cutoff, factor", [(None, 1.0), (0.3, 1.0), (0.5, 0.7), (0.9, 0.95)])
def test_a_gltf_mask_is_alpha_times_factor_at_least_the_cutoff(
    tmp_path: Path, cutoff: float | None, factor: float
) -> None:
    material: dict[str, Any] = {"pbr": {"baseColorFactor": [1, 1, 1, factor]}}
    if cutoff is not None:
        material["alphaCutoff"] = cutoff
    scene = gltf(tmp_path, ALPHA, material)
    assert len(scene.triangles) == 2
    assert not any("cut" in line or "alpha" in line for line in scene.warnings)
    expected = ALPHA / 255 * factor >= (0.5 if cutoff is None else cutoff)
    np.testing.assert_array_equal(cut(scene).images[0], expected)
    np.testing.assert_array_equal(cut(scene).uvs, scene.uvs[scene.triangles[cut(scene).triangle]])


def test_without_effect_a_mask_costs_nothing(tmp_path: Path) -> None:
    whole = np.full((4, 4), 255, np.uint8)
    assert gltf(tmp_path, whole, {}).cutouts is None
    opaque = gltf(tmp_path, ALPHA, {"alphaMode": "OPAQUE"})
    assert opaque.cutouts is None
    assert opaque.geometry_hash() != gltf(tmp_path, ALPHA, {}).geometry_hash()


def test_what_is_cut_away_whole_is_left_out(tmp_path: Path) -> None:
    alpha = np.full((8, 8), 255, np.uint8)
    alpha[:, 4:] = 0
    file = File()
    file.mesh(SQUARE, [0, 1, 2, 0, 2, 3], material=0, TEXCOORD_0=UVS * (0.4, 1) + (0.05, 0))
    beside = np.add(SQUARE, (2, 0, 0))
    file.mesh(beside, [0, 1, 2, 0, 2, 3], material=0, TEXCOORD_0=UVS * (0.4, 1) + (0.55, 0))
    file.json |= {
        "nodes": [{"mesh": 0}, {"mesh": 1}],
        "scenes": [{"nodes": [0, 1]}],
        "images": [{"bufferView": file.view(png(alpha))}],
        "textures": [{"source": 0}],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "MASK"}
        ],
    }
    scene = load_scene(str(file.gltf(tmp_path / "a.gltf")))
    assert scene.cutouts is None
    assert scene.positions[:, 0].max() == 1.0


def test_where_all_is_cut_away_it_stays(tmp_path: Path) -> None:
    scene = gltf(tmp_path, np.zeros((4, 4), np.uint8), {})
    assert scene.cutouts is None
    assert any("everything is cut out (material 0): drawn whole" in w for w in scene.warnings)


def test_backs_have_the_same_holes(tmp_path: Path) -> None:
    scene = gltf(tmp_path, ALPHA, {"doubleSided": True})
    assert len(scene.triangles) == 4
    corners = scene.corners[cut(scene).triangle]
    for triangle, uvs in zip(corners, cut(scene).uvs, strict=True):
        np.testing.assert_allclose(triangle[:, :2], uvs, atol=1e-5)


def test_colours_of_vertices_leave_the_mask_in_place(tmp_path: Path) -> None:
    """Their image takes the place of texture coordinates, not of the mask's."""
    (tmp_path / "a.png").write_bytes(png(ALPHA))
    (tmp_path / "a.mtl").write_text("newmtl leaf\nKd 1 1 1\nmap_d -s 2 1 -o 0.5 0 a.png\n")
    lines = [f"v {x} {y} {z} {x} {y} 0.5" for x, y, z in SQUARE]
    lines += [f"vt {u} {1 - v}" for u, v in UVS]
    (tmp_path / "a.obj").write_text(
        "\n".join(["mtllib a.mtl", *lines, "usemtl leaf", "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"])
    )
    scene = load_scene(str(tmp_path / "a.obj"))
    assert len(scene.textures) == 1
    corners = scene.corners[cut(scene).triangle]
    np.testing.assert_allclose(cut(scene).uvs, corners[:, :, :2] * (2, 1) + (0.5, 0), atol=1e-6)
    np.testing.assert_array_equal(cut(scene).images[0], ALPHA / 255 >= 0.5)


@pytest.mark.parametrize("lines, left", [("d 0.4\n", 0), ("d 0.6\n", 2), ("", 2)])
def test_a_mask_without_coordinates_or_image(tmp_path: Path, lines: str, left: int) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl leaf\n{lines}map_d gone.png\nnewmtl wall\n")
    corners = "\n".join(f"v {x} {y} {z}" for x, y, z in SQUARE)
    (tmp_path / "a.obj").write_text(
        f"mtllib a.mtl\n{corners}\nusemtl leaf\nf 1 2 3\nf 1 3 4\nusemtl wall\nf 3 2 1\n"
    )
    scene = load_scene(str(tmp_path / "a.obj"))
    assert scene.cutouts is None
    assert len(scene.triangles) == left + 1


def test_surface_texels_against_every_texel(rng: np.random.Generator) -> None:
    image = rng.random((5, 7)) < 0.5
    uvs = rng.uniform(-3, 3, (200, 1, 2)) + rng.uniform(-0.3, 0.3, (200, 3, 2))
    found, of = surface_texels(image, uvs)
    size, sure = np.array([7, 5]), 0
    for triangle, some, count in zip(uvs * [1, -1] + [0, 1], found, of, strict=True):
        bounds = np.array([triangle.min(axis=0), triangle.max(axis=0)]) * size
        if np.abs(bounds - np.rint(bounds)).min() < 2e-3:
            continue  # what lies on a border counts to both sides, within some slack
        (left, top), (right, bottom) = np.floor(bounds).astype(int)
        columns, rows = np.arange(left, right + 1)[:7], np.arange(top, bottom + 1)[:5]
        part = image[np.ix_(rows % 5, columns % 7)]
        assert (count, some) == (part.size, part.sum())
        sure += 1
    assert sure > 150


def test_receivers_are_what_is_there(rng: np.random.Generator) -> None:
    """Areas of what is left, no receiver on nothing, as many as asked for."""
    both = leaves(rng, count=5, image=(4, 4))
    lightmap = unwrap(both.masked, 4000)
    assert len(lightmap.receivers) == pytest.approx(4000, rel=0.04)  # few charts, large steps
    of_leaf = both.masked.cutouts.rows(len(both.masked.triangles))[lightmap.fragments.triangle] >= 0
    area = lightmap.fragments.area
    meshed = both.meshed.corners[both.leaf_of[1] >= 0].astype(np.float64)
    sides = meshed[:, 1:] - meshed[:, :1]
    there = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2
    assert area[of_leaf].sum() == pytest.approx(there, rel=0.05)
    assert area[~of_leaf].sum() == pytest.approx(6.0, rel=1e-4)
    assert (np.diff(lightmap.fragments.start) > 0).all()


def test_keys_hold_what_is_cut_away(rng: np.random.Generator) -> None:
    scene = leaves(rng).masked
    cutouts = cut(scene)
    other = replace(cutouts, images=tuple(~image for image in cutouts.images))
    changed = (replace(scene, cutouts=None), replace(scene, cutouts=other))
    for key in (Scene.geometry_hash, Scene.content_hash, lambda one: lightmap_key(one, 100)):
        assert len({key(one) for one in (scene, *changed)}) == 3
