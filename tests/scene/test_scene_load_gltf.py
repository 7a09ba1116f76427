"""glTF files made here, with known answers."""

from __future__ import annotations

import base64
import io
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from gibench.errors import BadInput
from gibench.scene.load import load_scene
from gibench.scene.model import DirectionalLight, PointLight, SpotLight
from gibench.scene.readers.backs import STEP
from gibench.scene.readers.clean import clean
from gibench.scene.readers.gltf import load_gltf

TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
COMPONENTS = {"f4": 5126, "u4": 5125, "u2": 5123, "u1": 5121}
TRIANGLE = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], np.float32)


class File:
    """A glTF file in the making; every array becomes one buffer view."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }
        self.data = b""

    def array(self, values: Any, dtype: str = "f4", **more: Any) -> int:
        a = np.asarray(values, "<" + dtype)
        a = a.reshape(len(a), -1)
        view = self.view(a.tobytes())
        self.json["accessors"].append(
            {
                "bufferView": view,
                "componentType": COMPONENTS[dtype],
                "count": len(a),
                "type": TYPES[a.shape[1]],
                **more,
            }
        )
        return len(self.json["accessors"]) - 1

    def view(self, data: bytes) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        )
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def mesh(self, positions: Any = TRIANGLE, indices: Any = None, **more: Any) -> File:
        attributes = {"POSITION": self.array(positions)}
        for name in [key for key in more if key.isupper()]:
            attributes[name] = self.array(more.pop(name))
        primitive = {"attributes": attributes, **more}
        if indices is not None:
            primitive["indices"] = self.array(indices, "u2")
        self.json["meshes"].append({"primitives": [primitive]})
        return self

    def gltf(self, path: Path) -> Path:
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.json["buffers"] = [{"uri": uri, "byteLength": len(self.data)}]
        path.write_text(json.dumps(self.json))
        return path

    def glb(self, path: Path) -> Path:
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path


@pytest.mark.parametrize("kind", ["gltf", "glb", "bin"])
def test_every_container_gives_the_same_triangle(tmp_path: Path, kind: str) -> None:
    file = File().mesh(indices=[0, 1, 2])
    if kind == "bin":
        file.gltf(tmp_path / "a.gltf")
        file.json["buffers"][0]["uri"] = "some%20data.bin"
        (tmp_path / "some data.bin").write_bytes(file.data)
        path = tmp_path / "a.gltf"
        path.write_text(json.dumps(file.json))
    else:
        path = getattr(file, kind)(tmp_path / f"a.{kind}")
    scene = load_scene(str(path))
    assert np.array_equal(scene.corners, TRIANGLE[None])
    assert np.array_equal(scene.normals, np.tile(np.float32([0, 0, 1]), (3, 1)))
    assert scene.name == "a"
    assert scene.lights_at(0) != scene.lights_at(17)  # the default sun moves
    assert scene.environment.pixels.max() > 0


def test_nodes_multiply_and_mirrored_instances_keep_their_fronts(tmp_path: Path) -> None:
    file = File().mesh(indices=[0, 1, 2], NORMAL=np.tile([0, 0, 1], (3, 1)))
    turn = math.sqrt(0.5)
    file.json["nodes"] = [
        {"translation": [10, 0, 0], "children": [1, 2]},
        {"mesh": 0, "rotation": [0, turn, 0, turn], "scale": [2, 1, 1]},
        # Column-major: x mirrored, moved up.
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]},
    ]
    scene = load_scene(str(file.gltf(tmp_path / "a.gltf")))
    # Scaled in x, then x turned onto -z.
    np.testing.assert_allclose(scene.corners[0], [[10, 0, 0], [10, 0, -4], [10, 3, 0]], atol=1e-6)
    assert {tuple(c) for c in scene.corners[1].tolist()} == {(10, 5, 0), (8, 5, 0), (10, 8, 0)}
    a, b, c = scene.corners[1].astype(float)
    assert np.cross(b - a, c - a)[2] > 0
    np.testing.assert_allclose(scene.normals[scene.triangles[1]], [[0, 0, 1]] * 3)
    np.testing.assert_allclose(scene.normals[scene.triangles[0]], [[1, 0, 0]] * 3, atol=1e-6)
    assert scene.object_ids[0] != scene.object_ids[1]
    assert any("1 mirrored part" in line for line in scene.warnings)


@pytest.mark.parametrize(
    ("mode", "indices", "expected"),
    [
        (4, [0, 1, 2, 0, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_lists_strips_and_fans(
    tmp_path: Path, mode: int, indices: list[int], expected: list[list[int]]
) -> None:
    square = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    content = load_gltf(File().mesh(square, indices, mode=mode).gltf(tmp_path / "a.gltf"))
    assert content.parts[0].triangles.tolist() == expected
    mesh = clean(content, "a")
    assert (mesh.normals[:, 2] == 1).all()


def test_points_are_counted_not_used(tmp_path: Path) -> None:
    file = File().mesh(indices=[0, 1, 2])
    primitive = dict(file.json["meshes"][0]["primitives"][0], mode=0)
    file.json["meshes"][0]["primitives"] += [primitive, primitive]
    scene = load_scene(str(file.gltf(tmp_path / "a.gltf")))
    assert len(scene.triangles) == 1
    assert "ignored: primitives of points or lines (2)" in scene.warnings


def test_lights_and_cameras(tmp_path: Path) -> None:
    file = File().mesh(indices=[0, 1, 2])
    half = math.sqrt(0.5)
    down = [-half, 0, 0, half]  # -z onto -y
    file.json |= {
        "scenes": [{"nodes": [0, 1, 2, 3, 4]}],
        "nodes": [
            {"mesh": 0},
            {"rotation": down, "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 1}}},
            {
                "translation": [1, 2, 3],
                "rotation": down,
                "extensions": {"KHR_lights_punctual": {"light": 2}},
            },
            {"translation": [0, 0, 9], "camera": 0},
        ],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {
            "KHR_lights_punctual": {
                "lights": [
                    {"type": "directional", "intensity": 3, "color": [1, 0.5, 0]},
                    {"type": "point", "intensity": 7},
                    {"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.3}},
                ]
            }
        },
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
    }
    scene = load_scene(str(file.gltf(tmp_path / "a.gltf")))
    sun, point, spot = scene.lights
    assert isinstance(sun, DirectionalLight)
    assert isinstance(point, PointLight)
    assert isinstance(spot, SpotLight)
    np.testing.assert_allclose(sun.direction, [0, -1, 0], atol=1e-12)
    assert sun.irradiance == (3, 1.5, 0)
    assert point == PointLight((1, 2, 3), (7, 7, 7))
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-12)
    assert (spot.inner_angle, spot.outer_angle) == (0.2, 0.3)
    assert scene.environment.pixels.max() == 0
    (camera,) = scene.cameras
    assert camera.position == (0, 0, 9)
    assert camera.target == (0, 0, 8)
    assert camera.fov_degrees == pytest.approx(math.degrees(0.5))


def test_materials_textures_and_uvs(tmp_path: Path) -> None:
    png = io.BytesIO()
    Image.fromarray(np.uint8([[[255, 0, 0], [188, 188, 188]]])).save(png, "PNG")
    file = File()
    uv = np.float32([[0, 0], [1, 0], [0, 1]])
    file.mesh(indices=[0, 1, 2], material=0, TEXCOORD_0=uv, TEXCOORD_1=uv / 2)
    file.json |= {
        "images": [{"bufferView": file.view(png.getvalue())}, {"uri": "missing.png"}],
        "textures": [{"source": 0}, {"source": 1}],
        "materials": [
            {
                "name": "lamp",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.5, 0.25, 1, 1],
                    "baseColorTexture": {
                        "index": 0,
                        "extensions": {
                            "KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 1]}
                        },
                    },
                },
                "emissiveFactor": [1, 0.5, 1],
                "emissiveTexture": {"index": 0},
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
                "alphaMode": "MASK",
            },
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}},
        ],
    }
    scene = load_scene(str(file.gltf(tmp_path / "a.gltf")))
    lamp = scene.materials[0]
    assert (lamp.name, lamp.base_color, lamp.texture) == ("lamp", (0.5, 0.25, 1.0), 0)
    grey = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(
        scene.textures[0].pixels, [[[1, 0, 0], [grey] * 3]], rtol=1e-6, atol=0
    )
    # Over the triangle u has the density 2 (1 - u); texels are at u = 1/4 and 3/4, repeated.
    u = (np.arange(10_000) + 0.5) / 10_000
    red = np.interp(u, [-0.25, 0.25, 0.75, 1.25], [0, 1, 0, 1])
    share = (2 * (1 - u) * red).mean()
    np.testing.assert_allclose(
        lamp.emission,
        [4 * (share + (1 - share) * grey), 2 * (1 - share) * grey, 4 * (1 - share) * grey],
        rtol=0.01,
    )
    np.testing.assert_allclose(scene.uvs[scene.triangles[0]], [[0.5, 1], [2.5, 1], [0.5, 0]])
    assert scene.lightmap_uvs is not None
    np.testing.assert_array_equal(scene.lightmap_uvs[scene.triangles[0]], uv / 2)
    assert scene.materials[1].texture == -1
    assert "ignored: textures whose file is missing (1)" in scene.warnings
    assert scene.cutouts is None  # the image has no alpha
    assert not scene.lights  # it glows, so no sun is added


def test_lightmap_uvs_must_cover_the_scene_once(tmp_path: Path) -> None:
    uv = np.float32([[0, 0], [1, 0], [0, 1]])
    file = File().mesh(indices=[0, 1, 2], TEXCOORD_1=uv)
    file.json["nodes"] = [{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}]
    assert load_scene(str(file.gltf(tmp_path / "a.gltf"))).lightmap_uvs is None
    file.mesh(indices=[0, 1, 2])
    file.json["nodes"][2]["mesh"] = 1
    assert load_scene(str(file.gltf(tmp_path / "b.gltf"))).lightmap_uvs is None


def test_sparse_and_strided_accessors(tmp_path: Path) -> None:
    file = File()
    interleaved = np.zeros((3, 8), "<f4")
    interleaved[:, :3], interleaved[:, 4:7] = TRIANGLE, [0, 0, 1]
    view = file.view(interleaved.tobytes())
    file.json["bufferViews"][view]["byteStride"] = 32
    places, values = file.view(np.uint8([1]).tobytes()), file.view(np.float32([9, 0, 0]).tobytes())
    common = {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"}
    file.json["accessors"] = [
        common
        | {
            "sparse": {
                "count": 1,
                "indices": {"bufferView": places, "componentType": 5121},
                "values": {"bufferView": values},
            }
        },
        common | {"byteOffset": 16},
    ]
    file.json["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]}]
    scene = load_scene(str(file.gltf(tmp_path / "a.gltf")))
    assert scene.corners.tolist() == [[[0, 0, 0], [9, 0, 0], [0, 3, 0]]]
    assert not any("normal" in line for line in scene.warnings)


def _broken(file: File, kind: str) -> None:
    j = file.json
    if kind == "cycle":
        j["nodes"] = [{"mesh": 0, "children": [1]}, {"children": [0]}]
    elif kind == "draco":
        j["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    elif kind == "no node":
        j["nodes"][0]["children"] = [7]
    elif kind == "no mesh":
        j["nodes"][0]["mesh"] = 3
    elif kind == "outside":
        j["accessors"][0]["count"] = 4000
    elif kind == "version":
        j["asset"]["version"] = "1.0"
    elif kind == "no scene":
        j["scene"] = 5
    elif kind == "nothing":
        j["scenes"] = [{}]
    elif kind == "types":
        j["meshes"] = "hello"
    elif kind == "view":
        j["accessors"][0]["bufferView"] = -1
    elif kind == "rotation":
        j["nodes"][0]["rotation"] = [0, 0, 0, 0]


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("cycle", "reached twice"),
        ("draco", "KHR_draco_mesh_compression"),
        ("no node", "no node 7"),
        ("no mesh", "no mesh 3"),
        ("outside", "reaches outside"),
        ("version", "version 1.0"),
        ("no scene", "no scene 5"),
        ("nothing", "no triangles"),
        ("types", "not a sound glTF"),
        ("view", "no buffer view -1"),
        ("rotation", "rotation"),
    ],
)
def test_broken_files_say_why_in_one_line(tmp_path: Path, kind: str, says: str) -> None:
    file = File().mesh(indices=[0, 1, 2])
    _broken(file, kind)
    path = file.gltf(tmp_path / "a.gltf")
    with pytest.raises(BadInput, match=says) as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_a_truncated_or_damaged_glb_never_gives_a_traceback(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("glb")
    whole = File().mesh(indices=[0, 1, 2]).glb(folder / "a.glb").read_bytes()
    cut = data.draw(st.integers(0, len(whole) - 1))
    (folder / "cut.glb").write_bytes(whole[:cut])
    with pytest.raises(BadInput):
        load_scene(str(folder / "cut.glb"))
    damaged = bytearray(whole)
    damaged[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    (folder / "bad.glb").write_bytes(damaged)
    try:
        load_scene(str(folder / "bad.glb"))
    except BadInput as error:
        assert "\n" not in str(error)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), vertices=st.integers(3, 40), count=st.integers(1, 60))
def test_a_random_mesh_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, seed: int, vertices: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    positions = (rng.normal(size=(vertices, 3)) * 10 ** rng.uniform(-3, 3)).astype(np.float32)
    triangles = np.array([rng.permutation(vertices)[:3] for _ in range(count)])
    path = tmp_path_factory.mktemp("mesh") / "a.glb"
    scene = load_scene(str(File().mesh(positions, triangles.ravel()).glb(path)))
    # But for triangles that lie in one another back to back, which are moved a hair apart.
    hair = 2 * STEP * np.abs(positions).max() if "in one plane" in str(scene.warnings) else 0.0
    np.testing.assert_allclose(scene.corners, positions[triangles], rtol=0, atol=hair)
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-6)
    a, b, c = np.moveaxis(scene.corners.astype(float), 1, 0)
    flat = np.cross(b - a, c - a)
    assert (np.einsum("tcx,tx->tc", scene.normals[scene.triangles], flat) > 0).all()
