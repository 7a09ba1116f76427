"""What a file asks for and does not get is said; sizes beyond float32 are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.mutants import glb

from gibench.errors import BadInput
from gibench.scene.load import load_scene
from gibench.scene.model import Scene

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
ORDER = np.array([0, 1, 2, 0, 2, 3], "<u2")
LAMP = {"emissiveFactor": [1, 1, 1]}


def _gltf(folder: Path, material: dict[str, Any] | None = None, **changes: Any) -> Scene:
    """Two quads, the second a metre behind; ``nodes`` and the like replace the file's."""
    data = CORNERS.tobytes() + ORDER.tobytes()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    file = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "materials": [LAMP if material is None else material],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 1]}],
        "scenes": [{"nodes": [0, 1]}],
        **changes,
    }
    path = folder / "a.glb"
    path.write_bytes(glb(json.loads(json.dumps(file)), data))
    return load_scene(str(path))


def _obj(folder: Path, mtl: str, scale: float = 1.0) -> Scene:
    lines = [f"v {' '.join(f'{scale * x:.9g}' for x in corner)}" for corner in CORNERS.tolist()]
    (folder / "a.obj").write_text("\n".join(["mtllib a.mtl", *lines, "usemtl m", "f 1 2 3 4", ""]))
    (folder / "a.mtl").write_text(mtl)
    return load_scene(str(folder / "a.obj"))


@pytest.mark.parametrize(
    "name, said",
    [
        ("KHR_materials_diffuse_transmission", True),
        ("EXT_lights_image_based", True),
        ("ACME_glow_in_the_dark", True),
        ("KHR_materials_clearcoat", False),
        ("KHR_texture_transform", False),
    ],
)
def test_an_extension_that_is_not_read_is_said_once(tmp_path: Path, name: str, said: bool) -> None:
    scene = _gltf(tmp_path, extensionsUsed=[name, name])
    assert sum(name in line for line in scene.warnings) == said


def test_nodes_that_are_switched_off_are_left_out_with_what_is_below(tmp_path: Path) -> None:
    off = {"KHR_node_visibility": {"visible": False}}
    on = {"KHR_node_visibility": {"visible": True}}
    nodes = [
        {"mesh": 0, "extensions": on},
        {"extensions": off, "children": [2]},
        {"mesh": 0, "translation": [0, 0, 1]},
    ]
    scene = _gltf(tmp_path, nodes=nodes, extensionsRequired=["KHR_node_visibility"])
    assert len(scene.triangles) == 2
    assert any("not visible, and all below them (1)" in line for line in scene.warnings)


def test_a_file_that_asks_for_a_later_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"asks for glTF 2\.1; only glTF 2\.0 is read"):
        _gltf(tmp_path, asset={"version": "2.1", "minVersion": "2.1"})
    assert len(_gltf(tmp_path, asset={"version": "2.1", "minVersion": "2.0"}).triangles) == 4


def test_an_albedo_over_one_is_said(tmp_path: Path) -> None:
    bright = {**LAMP, "pbrMetallicRoughness": {"baseColorFactor": [1.5, 0.25, 0, 1]}}
    scene = _gltf(tmp_path, bright)
    assert scene.materials[0].base_color == (1.0, 0.25, 0.0)
    assert "ignored: base colours over 1: 1 used (1)" in scene.warnings
    bright["pbrMetallicRoughness"] = {"baseColorFactor": [1, 0.25, 0, 1]}
    assert not any("over 1" in line for line in _gltf(tmp_path, bright).warnings)


@pytest.mark.parametrize("emission, added", [([0, 0, 0], True), ([0, 1, 0], False)])
def test_a_sun_that_is_added_is_said(tmp_path: Path, emission: list[int], added: bool) -> None:
    scene = _gltf(tmp_path, {"emissiveFactor": emission})
    assert len(scene.lights) == added
    assert any("a swinging sun and a sky added" in line for line in scene.warnings) == added


@pytest.mark.parametrize("first, said", [(".1 .1 .1", True), (".5 .5 .5", False)])
def test_a_material_defined_twice_is_said(tmp_path: Path, first: str, said: bool) -> None:
    scene = _obj(tmp_path, f"newmtl m\nKd {first}\nnewmtl m\nKd .5 .5 .5\n")
    assert scene.materials[scene.material_ids[0]].base_color == (0.5, 0.5, 0.5)
    line = "1 material defined more than once (m): the last definition used"
    assert (line in scene.warnings) == said


@pytest.mark.parametrize(
    "lines, said",
    [("illum 4\nTf 1 1 1", True), ("illum 7", True), ("illum 2", False), ("illum 4\nd .9", False)],
)
def test_glass_by_its_illumination_model_alone_is_said(
    tmp_path: Path, lines: str, said: bool
) -> None:
    scene = _obj(tmp_path, f"newmtl m\n{lines}\n")
    assert any("of glass by illum alone (m)" in line for line in scene.warnings) == said


@pytest.mark.parametrize(
    "scale, fits", [(6e-8, False), (1e-7, True), (1.0, True), (7e8, True), (8e8, False)]
)
def test_scenes_beyond_what_float32_can_light_are_refused(
    tmp_path: Path, scale: float, fits: bool
) -> None:
    if fits:
        assert len(_obj(tmp_path, "newmtl m\n", scale).triangles) == 2
        return
    with pytest.raises(BadInput, match=r"m across; scale it to between 1e-07 and 1e\+09 m"):
        _obj(tmp_path, "newmtl m\n", scale)
