"""Normal maps and tangents at load."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from test_scene_load_gltf import File

from gibench.scene.load import load_scene
from gibench.scene.model import Scene
from gibench.scene.normal_maps import NormalMaps, packed_normals, unit_normals, unpacked_normals
from gibench.scene.readers.tangents import tangents

REFERENCE = Path(__file__).with_name("mikktspace.json")
SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
UVS = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])  # glTF's v points down
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def png(pixels: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return out.getvalue()


def colours(vectors: Any) -> Any:
    return np.rint((np.asarray(vectors) + 1) / 2 * 255)


def maps(scene: Scene) -> NormalMaps:
    assert scene.normal_maps is not None
    return scene.normal_maps


def gltf(path: Path, image: bytes, matrix: Any = None, uvs: Any = UVS, **attributes: Any) -> Scene:
    file = File()
    file.mesh(SQUARE, [0, 1, 2, 0, 2, 3], material=0, TEXCOORD_0=uvs, **attributes)
    if matrix is not None:
        file.json["nodes"][0]["matrix"] = np.asarray(matrix, float).T.reshape(-1).tolist()
    file.json |= {
        "images": [{"bufferView": file.view(image)}],
        "textures": [{"source": 0}],
        "materials": [
            {
                "normalTexture": {"index": 0, "scale": 0.5},
                "doubleSided": "TANGENT" not in attributes,
            }
        ],
    }
    return load_scene(str(file.gltf(path / "a.gltf")))


def obj(folder: Path, statement: str, image: bytes | None, face: str = FACE) -> Scene:
    (folder / "a.mtl").write_text(f"newmtl m\n{statement}\n")
    if image is not None:
        (folder / "a.png").write_bytes(image)
    (folder / "a.obj").write_text("mtllib a.mtl\nusemtl m\n" + QUAD + face)
    return load_scene(str(folder / "a.obj"))


def test_tangents_are_those_of_the_reference_code() -> None:
    """Of mikktspace.c (as in pymikktspace 0.3.0), for a smooth sheet with a mirrored seam and
    triangles apart: tests/support/mikktspace_reference.py has made the file.
    """
    held = {name: np.array(rows) for name, rows in json.loads(REFERENCE.read_text()).items()}
    found = tangents(held["positions"], held["normals"], held["uvs"])
    np.testing.assert_allclose(found, held["tangents"], atol=2e-4)  # it is float32
    assert set(np.unique(found[..., 3])) == {-1.0, 1.0}


def test_tangents_where_the_image_has_no_area(rng: np.random.Generator) -> None:
    corners = rng.normal(size=(5, 3, 3))
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat(flat / np.linalg.norm(flat, axis=1, keepdims=True), 3, axis=0)
    found = tangents(corners, normals.reshape(5, 3, 3), np.zeros((5, 3, 2)))
    np.testing.assert_allclose(np.linalg.norm(found[..., :3], axis=2), 1, atol=1e-6)
    dots = np.einsum("tcx,tcx->tc", found[..., :3], normals.reshape(5, 3, 3))
    np.testing.assert_allclose(dots, 0, atol=1e-6)


def test_texels_of_two_numbers(rng: np.random.Generator) -> None:
    vectors = unit_normals(rng.normal((0.0, 0.0, 1.0), 1.0, (9, 7, 3)))
    found = unpacked_normals(packed_normals(vectors)).reshape(vectors.shape)
    np.testing.assert_allclose(found[..., :2], vectors[..., :2], atol=2e-5)
    np.testing.assert_allclose(found[..., 2] ** 2, vectors[..., 2] ** 2, atol=1e-4)
    assert vectors[..., 2].min() >= 0


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_gltf_normal_map(tmp_path: Path, rng: np.random.Generator, mirrored: bool) -> None:
    vectors = unit_normals(rng.normal((0.0, 0.0, 2.0), 1.0, (4, 6, 3)))
    matrix = np.diag([-1.0 if mirrored else 1.0, 1, 1, 1])
    scene = gltf(tmp_path, png(colours(vectors)), matrix)
    found = maps(scene)
    assert found.triangle.tolist() == [0, 1, 2, 3]  # and the backs
    np.testing.assert_allclose(found.images[0], vectors, atol=0.02)
    np.testing.assert_allclose(found.scale, 0.5)
    place = scene.corners[found.triangle][:, :, :2] * (-1 if mirrored else 1, 1)
    np.testing.assert_allclose(found.uvs, place, atol=1e-5)
    along = matrix[:3, 0]
    for row, triangle in enumerate(found.triangle):
        normals = scene.normals[scene.triangles[triangle]].astype(float)
        side = 1.0 if row < 2 else -1.0
        tangent, sign = found.tangents[row, :, :3], found.tangents[row, :, 3:]
        np.testing.assert_allclose(tangent, np.tile(side * along, (3, 1)), atol=1e-6)
        # The bitangent is where v grows, turned on backs with all the rest.
        bitangent = sign * np.cross(normals, tangent)
        np.testing.assert_allclose(bitangent, np.tile((0, side, 0), (3, 1)), atol=1e-6)
    assert "normal maps of 1 material not used but by what is told to" in " | ".join(scene.warnings)


@pytest.mark.parametrize("mirrored", [False, True])
def test_tangents_of_the_file_are_taken(tmp_path: Path, mirrored: bool) -> None:
    own = np.float32([[0, 2, 0, -1]] * 4)
    flat = np.float32([[0, 0, 1]] * 4)
    matrix = np.array([[0, -3.0, 0, 0], [3.0, 0, 0, 0], [0, 0, -3.0 if mirrored else 3.0, 0],
                       [0, 0, 0, 1]])  # fmt: skip
    image = png(colours(np.tile((0.0, 0.0, 1.0), (2, 2, 1))))
    found = maps(gltf(tmp_path, image, matrix, TANGENT=own, NORMAL=flat))
    np.testing.assert_allclose(found.tangents[..., :3], np.tile((-1.0, 0, 0), (2, 3, 1)), atol=1e-6)
    assert (found.tangents[..., 3] == (1 if mirrored else -1)).all()
    computed = maps(gltf(tmp_path, image, matrix, TANGENT=own))  # useless without normals
    np.testing.assert_allclose(computed.tangents[..., :3], np.tile((0, 1, 0), (2, 3, 1)), atol=1e-6)


def test_one_channel_is_no_normal_map(tmp_path: Path) -> None:
    scene = gltf(tmp_path, png(np.full((4, 4), 128)))
    assert scene.normal_maps is None
    said = [line for line in scene.warnings if "one channel" in line]
    assert len(said) == 1
    assert "\n" not in said[0]
    scene = obj(tmp_path, "norm a.png", png(np.full((4, 4), 128)))
    assert scene.normal_maps is None
    assert [w for w in scene.warnings if "'a.png' is not used: has one channel" in w]


@pytest.mark.parametrize("keyword", ["norm", "map_Bump", "bump"])
def test_missing_maps_and_coordinates_are_said(tmp_path: Path, keyword: str) -> None:
    scene = obj(tmp_path, f"{keyword} none.png", None)
    assert scene.normal_maps is None
    said = "1 texture missing or unreadable (none.png): the geometric normal used"
    assert [w for w in scene.warnings if w.endswith(said)]
    assert "plain colours" not in str(scene.warnings)
    image = png(colours(np.tile((0.0, 0.6, 0.8), (4, 4, 1))))
    scene = obj(tmp_path, f"{keyword} a.png", image, "f 1 2 3 4\n")
    assert scene.normal_maps is None
    assert "normal maps of 1 material without coordinates (m)" in " | ".join(scene.warnings)
    (tmp_path / "a.png").write_bytes(b"no image")
    scene = obj(tmp_path, f"{keyword} a.png", None)
    assert [w for w in scene.warnings if w.startswith("normal map 'a.png' is not used")]


@pytest.mark.parametrize("keyword", ["norm", "map_Bump", "bump"])
def test_normals_under_any_keyword(tmp_path: Path, keyword: str) -> None:
    vectors = np.tile((0.48, 0.36, 0.8), (4, 4, 1))
    scene = obj(tmp_path, f"{keyword} -bm 3 -s 2 2 a.png", png(colours(vectors)))
    np.testing.assert_allclose(maps(scene).images[0], vectors, atol=0.01)
    assert maps(scene).uvs.max() == 2
    assert not any("options" in line for line in scene.warnings)


@pytest.mark.parametrize("strength", [1.0, 0.25, -2.0])
def test_heights_become_normals_by_their_gradient(tmp_path: Path, strength: float) -> None:
    """A ramp that rises to the right and, half as fast, upwards; it repeats with a jump."""
    height, width = 40, 80
    row, column = np.indices((height, width))
    ramp = column + (height - 1 - row)
    scene = obj(tmp_path, f"map_Bump -bm {strength} a.png", png(ramp))
    found = maps(scene).images[0][1:-1, 1:-1].astype(float)
    slope = strength * 80 / 100 / 255
    np.testing.assert_allclose(found[..., 0] / found[..., 2], -slope, rtol=1e-3)
    np.testing.assert_allclose(found[..., 1] / found[..., 2], -slope, rtol=1e-3)
    sixteen = io.BytesIO()
    Image.fromarray((ramp * 257).astype(np.uint16)).save(sixteen, "PNG")
    again = maps(obj(tmp_path, f"bump -bm {strength} a.png", sixteen.getvalue())).images[0]
    np.testing.assert_allclose(again[1:-1, 1:-1], found, atol=1e-5)


def test_normal_maps_change_no_result(tmp_path: Path) -> None:
    image = png(colours(np.tile((0.6, 0.0, 0.8), (4, 4, 1))))
    plain, bumpy = obj(tmp_path, "", None), obj(tmp_path, "norm a.png", image)
    assert plain.content_hash() == bumpy.content_hash()
    other = obj(tmp_path, "norm -s 2 2 a.png", image)
    assert maps(bumpy).content_hash() != maps(other).content_hash()
