"""Backs of two-sided surfaces, and rays that meet two faces in one plane."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer
from gibench.scene.load import load_scene
from gibench.scene.model import Scene
from gibench.scene.readers.backs import STEP

# A wall in the plane x = 0 as two quads back to back whose diagonals cross.
WALL = (
    "v 0 0 -1\nv 0 0 1\nv 0 2 1\nv 0 2 -1\n"
    "f 1 4 3 2\n"  # towards +x
    "f 2 3 4 1\n"  # towards -x
)
ROOM = (
    "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nv -1 2 1\n"
    "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6\n"
)


def _obj(folder: Path, text: str) -> Scene:
    (folder / "a.obj").write_text(text)
    return load_scene(str(folder / "a.obj"))


def _flat(scene: Scene) -> np.ndarray:
    corners = scene.corners.astype(np.float64)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.parametrize("tracer", ["embree", "device"])
@pytest.mark.parametrize("offset", [0.0, 7.3])
def test_a_ray_meets_the_face_that_fronts_it(
    tmp_path: Path, tracer: str, offset: float, rng: np.random.Generator
) -> None:
    moved = "\n".join(
        f"v {float(line.split()[1]) + offset} {line.split()[2]} {line.split()[3]}"
        if line.startswith("v ")
        else line
        for line in WALL.splitlines()
    )
    scene = _obj(tmp_path, moved)
    assert len(scene.triangles) == 4
    assert any("4 triangles in one plane" in line for line in scene.warnings)
    place = np.array([offset, 0.0, 0.0])
    origins = place + rng.uniform((-2, 0, -1), (2, 2, 1), (20000, 3))
    targets = place + rng.uniform((0, 0.01, -0.99), (0, 1.99, 0.99), (20000, 3))
    far = np.abs(origins[:, 0] - offset) > 0.01
    origins, directions = (a[far].astype(np.float32) for a in (origins, targets - origins))
    if tracer == "embree":
        hits = EmbreeTracer(scene.corners).closest(origins, directions)
    else:
        device = Device(load_profile("iphone7"))
        tree = DeviceBvh.upload(device, build_bvh(scene.corners))
        hits = DeviceTracer(device, tree).closest(origins, directions)
    assert (hits.triangle >= 0).all()
    facing = np.einsum("nx,nx->n", _flat(scene)[hits.triangle], directions)
    assert (facing < 0).all()


def test_faces_that_only_touch_or_look_the_same_way_stay(tmp_path: Path) -> None:
    # Side by side, one behind the other, twice the same, and in one plane without overlap.
    text = (
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 0 0 -.01\nv 1 0 -.01\nv 1 1 -.01\n"
        "f 1 2 3 4\nf 2 3 6 5\nf 9 8 7\nf 1 2 3\n"
    )
    scene = _obj(tmp_path, text)
    assert not any("in one plane" in line for line in scene.warnings)
    assert set(np.unique(scene.positions[:, 2])) == {np.float32(0), np.float32(-0.01)}


def test_part_of_a_floor_under_a_box_moves_a_hair(tmp_path: Path) -> None:
    floor = "v -5 0 -5\nv 5 0 -5\nv 5 0 5\nv -5 0 5\nf 1 4 3 2\n"
    bottom = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 5 6 7 8\n"
    scene = _obj(tmp_path, floor + bottom)
    up = _flat(scene)[:, 1] > 0
    height = scene.corners[:, :, 1]
    step = 5 * STEP
    np.testing.assert_allclose(height[up], step, rtol=1e-3)
    np.testing.assert_allclose(height[~up], -step, rtol=1e-3)


def _gltf(path: Path, quads: dict[str, tuple[list[list[float]], bool]]) -> Scene:
    """A file of named quads, each with a material that is two-sided or not."""
    accessors, views, data = [], [], b""
    for corners, _ in quads.values():
        array = np.array(corners, "<f4")
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes()
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": 5126,
                "count": len(corners),
                "type": "VEC3",
            }
        )
    (path / "a.bin").write_bytes(data)
    file = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(range(len(quads)))}],
        "nodes": [{"mesh": i, "name": name} for i, name in enumerate(quads)],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": i}, "mode": 4, "material": i}]}
            for i in range(len(quads))
        ],
        "materials": [{"name": n, "doubleSided": two} for n, (_, two) in quads.items()],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"uri": "a.bin", "byteLength": len(data)}],
    }
    (path / "a.gltf").write_text(json.dumps(file))
    return load_scene(str(path / "a.gltf"))


def _box(size: float, *, inside: bool) -> list[list[float]]:
    lines = [line.split()[1:] for line in ROOM.splitlines()]
    points = np.array([list(map(float, line)) for line in lines[:8]]) * size / 2
    corners = []
    for face in lines[8:]:
        a, b, c, d = (points[int(word) - 1] for word in face)
        for triangle in ((a, b, c), (a, c, d)):
            corners += list(triangle if inside else triangle[::-1])
    return [list(map(float, corner)) for corner in corners]


SHEET = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]


def test_a_two_sided_sheet_has_a_back_and_others_have_none(tmp_path: Path) -> None:
    scene = _gltf(tmp_path, {"sheet": (SHEET, True), "plain": ([[5, 0, 0], *SHEET[1:]], False)})
    assert len(scene.triangles) == 3
    first, back = _flat(scene)[0], _flat(scene)[2]
    np.testing.assert_allclose(back, -first, rtol=1e-5)
    assert scene.object_ids.tolist() == [0, 1, 0]
    assert scene.material_ids.tolist() == [0, 1, 0]
    facing = np.einsum("tcx,tx->tc", scene.normals[scene.triangles].astype(float), _flat(scene))
    assert (facing > 0).all()
    assert any("1 triangle of two-sided materials" in line for line in scene.warnings)


@pytest.mark.parametrize(
    ("inside", "size", "other", "doubled"),
    [
        (False, 1.0, "none", False),  # a solid
        (False, 1.0, "within", True),  # a lamp in its shade
        (False, 1.0, "outside", False),
        (True, 4.0, "within", False),  # a room and what stands in it
        (True, 4.0, "outside", True),
    ],
)
def test_backs_that_nothing_can_see_are_left_out(
    tmp_path: Path, inside: bool, size: float, other: str, doubled: bool
) -> None:
    place = {"within": [0.0, size / 2, 0.0], "outside": [0.0, 5 * size, 0.0]}
    quads = {"box": (_box(size, inside=inside), True)}
    if other in place:
        quads["thing"] = ((np.array(SHEET) + place[other]).tolist(), False)
    scene = _gltf(tmp_path, quads)
    assert len(scene.triangles) == 12 * (1 + doubled) + (other in place)
