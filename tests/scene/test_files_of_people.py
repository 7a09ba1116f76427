"""Scene files as programs write them and people pass them on, each built here with its right value.

Every kind is after a public report; ``test_cases.py`` names them.
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.mutants import glb

from gibench.errors import BadInput
from gibench.scene.lightmap.albedo import mean_albedo
from gibench.scene.load import load_scene
from gibench.scene.model import Scene

VERTICES = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nv -1 2 1\n"
FACES = "usemtl wall\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nusemtl red\nf 1 5 8 4\n"
OBJ = "mtllib a.mtl\n" + VERTICES + FACES
MTL = "newmtl wall\nKd 0.5 0.5 0.5\nnewmtl red\nKd 0.8 0.1 0.1\n"
RIGHT = {"wall": (0.5, 0.5, 0.5), "red": (0.8, 0.1, 0.1)}
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


def _written(folder: Path, **files: str | bytes) -> Scene:
    """Load ``a.obj`` of files whose names have ``_`` for the dot."""
    for name, content in files.items():
        path = folder / name.replace("_", ".")
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_scene(str(folder / "a.obj"))


def _colors(scene: Scene) -> dict[str, tuple[float, ...]]:
    used = np.unique(scene.material_ids).tolist()
    return {scene.materials[i].name: scene.materials[i].base_color for i in used}


def _area(scene: Scene) -> float:
    corners = scene.corners.astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)


def _said(scene: Scene) -> str:
    return " | ".join(scene.warnings)


MARK = b"\xef\xbb\xbf"
TEXTS: dict[str, tuple[bytes, bytes]] = {
    "plain": (OBJ.encode(), MTL.encode()),
    "marks": (MARK + OBJ.encode(), MARK + MTL.encode()),
    "UTF-16": (OBJ.encode("utf-16"), MTL.encode("utf-16")),
    "Windows": (OBJ.replace("\n", "\r\n").encode(), MTL.replace("\n", "\r\n").encode()),
    "old Macintosh": (OBJ.replace("\n", "\r").encode(), MTL.replace("\n", "\r").encode()),
    "comment ends in a backslash": (
        b"# from D:\\models\\\n" + OBJ.encode(),
        b"# from D:\\\n" + MTL.encode(),
    ),
    "continued": (OBJ.replace("f 1 4", "f 1 \\\n 4").encode(), MTL.encode()),
    "comments": (
        OBJ.replace("a.mtl\n", "a.mtl # exported\n").replace("f 1 4 3 2", "f 1 4 3 2 #1").encode(),
        MTL.replace("0.1 0.1\n", "0.1 0.1 # red\n").encode(),
    ),
    "two libraries": (
        OBJ.replace("a.mtl", "b.mtl a.mtl").encode(),
        MTL.replace("newmtl wall\nKd 0.5 0.5 0.5\n", "").encode(),
    ),
    "quoted": (OBJ.replace("a.mtl", '"a.mtl"').encode(), MTL.encode()),
    "another machine's path": (
        OBJ.replace("a.mtl", "C:\\Users\\artist\\a.mtl").encode(),
        MTL.encode(),
    ),
    "another case": (OBJ.replace("a.mtl", "A.MTL").encode(), MTL.encode()),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_every_way_to_write_text(tmp_path: Path, kind: str) -> None:
    obj, mtl = TEXTS[kind]
    scene = _written(tmp_path, a_obj=obj, a_mtl=mtl, b_mtl="newmtl wall\nKd 0.5 0.5 0.5\n")
    assert _area(scene) == pytest.approx(16)
    assert _colors(scene) == RIGHT
    assert scene.warnings == (
        "8 triangles without normals: flat normals computed",
        "no light and nothing that glows: a swinging sun and a sky added",
    )


@pytest.mark.parametrize("names", [("Material #1", "Material #2"), ("a#1", "a#2"), ("Ö", "ü ß")])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_names_with_hashes_and_umlauts(
    tmp_path: Path, names: tuple[str, str], encoding: str
) -> None:
    def named(text: str) -> bytes:
        return text.replace("wall", names[0]).replace("red", names[1]).encode(encoding)

    scene = _written(tmp_path, a_obj=named(OBJ), a_mtl=named(MTL))
    assert _colors(scene) == {names[0]: RIGHT["wall"], names[1]: RIGHT["red"]}


def test_a_library_with_blanks_in_its_name(tmp_path: Path) -> None:
    (tmp_path / "my own room.mtl").write_text(MTL)
    scene = _written(tmp_path, a_obj=OBJ.replace("a.mtl", "none.mtl my own room.mtl"))
    assert _colors(scene) == RIGHT
    assert "material file 'none.mtl' not found" in _said(scene)


def test_statements_that_make_no_sense_are_said(tmp_path: Path) -> None:
    mtl = "newmtl wall\nKd spectral a.rfl 1\nnewmtl red\nKd 0.8 0.1 0.1\nd nonsense\nNs\nmap_Kd\n"
    scene = _written(tmp_path, a_obj=OBJ, a_mtl=mtl)
    assert _colors(scene) == {"wall": (0.8, 0.8, 0.8), "red": RIGHT["red"]}
    assert "2 statements of materials not understood (Kd spectral a.rfl 1, d nonsense)" in _said(
        scene
    )


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        ("0 0, 3 0, 3 1, 1 1, 1 3, 0 3", 5.0),  # an L
        ("0 3, 0 0, 3 0, 3 1, 1 1, 1 3", 5.0),
        ("0 0, 0 2, 1 1, 2 2, 2 0", 3.0),  # a chevron
        ("0 0, 4 0, 4 3, 3 3, 3 1, 1 1, 1 3, 0 3", 8.0),  # a wall with a doorway
        ("0 0, 2 0, 1 0.5, 1 2", 1.25),  # a dented quad
        ("0 0, 1 0, 2 0, 2 1, 1 1, 0 1", 2.0),  # corners along its edges
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_polygons_with_a_dent_stay_open_there(
    tmp_path: Path, outline: str, area: float, turned: bool, rng: np.random.Generator
) -> None:
    points = np.array([list(map(float, p.split())) for p in outline.split(",")])
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    corners = points @ frame[:2] + rng.normal(size=3)
    for first in range(len(corners)):
        ring = np.roll(corners, first, axis=0)
        text = "".join(f"v {x} {y} {z}\n" for x, y, z in ring.tolist())
        face = "f " + " ".join(str(i + 1) for i in range(len(ring)))
        scene = _written(tmp_path, a_obj=text + face)
        assert _area(scene) == pytest.approx(area, rel=1e-5)
        flat = np.cross(*(np.diff(scene.corners.astype(float), axis=1).transpose(1, 0, 2)))
        assert np.linalg.norm(flat.sum(axis=0)) / 2 == pytest.approx(area, rel=1e-5)


def test_a_polygon_that_crosses_itself_is_said(tmp_path: Path) -> None:
    star = [(np.cos(a), np.sin(a)) for a in 4 * np.pi / 5 * np.arange(5)]
    text = "".join(f"v {x} {y} 0\n" for x, y in star) + "f 1 2 3 4 5\n"
    assert "1 polygon without an area, or crossing its own outline" in _said(
        _written(tmp_path, a_obj=text)
    )


def test_a_decimal_comma_is_named_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="line 3: '1,5' is no number; write numbers with a point"):
        _written(tmp_path, a_obj=OBJ.replace("v 1 0 -1", "v 1,5 0 -1", 1))


def _png(pixels: Any, **options: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(out, options.pop("format", "PNG"), **options)
    return out.getvalue()


IMAGES = {
    "8 bits": (_png(np.full((2, 2), 64, np.uint8)), ((64 / 255 + 0.055) / 1.055) ** 2.4),
    "16 bits": (
        _png(np.full((2, 2), 64 * 257, np.uint16)),
        ((64 / 255 + 0.055) / 1.055) ** 2.4,
    ),
    "floats": (_png(np.full((2, 2), 0.25, np.float32), format="TIFF"), 0.25),
}


@pytest.mark.parametrize("kind", IMAGES)
def test_images_of_many_depths(tmp_path: Path, kind: str) -> None:
    data, expected = IMAGES[kind]
    text = "mtllib a.mtl\nusemtl m\n" + QUAD
    scene = _written(tmp_path, a_obj=text, a_mtl="newmtl m\nmap_Kd a.img\n", a_img=data)
    np.testing.assert_allclose(scene.textures[0].pixels, expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "uvs"),
    [
        ("", (0, 1)),
        ("-s 2 3 1", (0, 2)),
        ("-o 0.5 0 0", (0.5, 1.5)),
        ("-s 2 2 -o 0.25", (0.25, 2.25)),
        ("-blendu on -imfchan m -bm 2", (0, 1)),
        ("-mm 0 1 -s 4 4 4", (0, 4)),
    ],
)
def test_options_of_texture_maps(tmp_path: Path, options: str, uvs: tuple[float, float]) -> None:
    scene = _written(
        tmp_path,
        a_obj="mtllib a.mtl\nusemtl m\n" + QUAD,
        a_mtl=f"newmtl m\nmap_Kd {options} a.png\n",
        a_png=IMAGES["8 bits"][0],
    )
    assert (scene.uvs[:, 0].min(), scene.uvs[:, 0].max()) == uvs
    assert ("options of texture maps not used: -mm 0 1" in _said(scene)) == ("-mm" in options)


@pytest.mark.parametrize("place", ["beside the OBJ", "beside the MTL", "another machine's"])
def test_images_beside_the_library_or_the_mesh(tmp_path: Path, place: str) -> None:
    (tmp_path / "mats").mkdir()
    name = "D:\\textures\\a.png" if place == "another machine's" else "a.png"
    (tmp_path / "mats" / "a.mtl").write_text(f'newmtl m\nmap_Kd "{name}"\n')
    folder = tmp_path / "mats" if place == "beside the MTL" else tmp_path
    (folder / "a.png").write_bytes(IMAGES["8 bits"][0])
    scene = _written(tmp_path, a_obj="mtllib mats\\a.mtl\nusemtl m\n" + QUAD)
    assert len(scene.textures) == 1
    assert "missing" not in _said(scene)


@pytest.mark.parametrize("statement", ["d 0.2", "Tr 0.8", "d 0.2\nTr 0", "d -halo 0.2"])
def test_surfaces_more_clear_than_opaque_are_left_out(tmp_path: Path, statement: str) -> None:
    mtl = MTL + statement + "\n"
    scene = _written(tmp_path, a_obj=OBJ, a_mtl=mtl)
    assert set(_colors(scene)) == {"wall"}
    assert "2 triangles of surfaces that let more light through than they stop" in _said(scene)
    lamp = _written(tmp_path, a_obj=OBJ, a_mtl=mtl + "Ke 1 1 1\n")
    assert set(_colors(lamp)) == {"wall", "red"}
    everything = _written(tmp_path, a_obj=OBJ.replace("wall", "red"), a_mtl=mtl)
    assert "everything is see-through (red): drawn opaque" in _said(everything)


def test_cut_outs_gloss_and_normal_maps_are_kept_by_name_and_said(tmp_path: Path) -> None:
    scene = _written(
        tmp_path,
        a_obj="mtllib a.mtl\nusemtl leaf\n" + QUAD,
        a_mtl="newmtl leaf\nmap_d a.png\nPr 0.25\nPm 1\nnorm -bm 1 bumps.png\nmap_Pr rough.png\n",
        a_png=IMAGES["8 bits"][0],
    )
    (leaf,) = scene.materials
    assert (leaf.alpha_mode, leaf.opacity_map, leaf.normal_map) == ("mask", "a.png", "bumps.png")
    assert (leaf.roughness, leaf.metalness, leaf.roughness_map) == (0.25, 1.0, "rough.png")
    for words in ("everything is cut out (leaf)", "normal maps of 1", "gloss and metal"):
        assert words in _said(scene)


def test_vertex_colours_reach_the_albedo(tmp_path: Path) -> None:
    text = "v 0 0 0 1 0 0\nv 4 0 0 0 1 0\nv 0 4 0 0 0 1\nf 1 2 3\n"
    scene = _written(tmp_path, a_obj=text)
    weights = np.array([[[0.5, 0.25, 0.25]] * 3, [[0.1, 0.8, 0.1]] * 3])
    found = mean_albedo(scene, np.zeros(2, np.int64), weights)
    np.testing.assert_allclose(found, weights[:, 0], atol=0.09)  # b + c - a is not in 0..1 here
    pale = text.replace(" 1 0 0\n", " .5 .2 .2\n", 1).replace("0 1 0\n", ".2 .6 .2\n")
    scene = _written(tmp_path, a_obj=pale.replace("0 0 1\n", ".4 .2 .7\n"))
    found = mean_albedo(scene, np.zeros(2, np.int64), weights)
    colors = np.array([[0.5, 0.2, 0.2], [0.2, 0.6, 0.2], [0.4, 0.2, 0.7]])
    np.testing.assert_allclose(found, weights[:, 0] @ colors, atol=1e-5)


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
UVS = np.array([[0, 0], [0.5, 0], [0, 0.5]], "<f4")


def _gltf(path: Path, material: dict[str, Any], images: list[bytes] = [], **top: Any) -> Scene:  # noqa: B006
    """One triangle with TEXCOORD_0 and, doubled, TEXCOORD_1 and TEXCOORD_2."""
    data, views = b"", []
    for content in (TRIANGLE.tobytes(), UVS.tobytes(), (2 * UVS).tobytes(), *images):
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content)})
        data += content
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 2, "TEXCOORD_2": 2}
    file = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [material],
        "bufferViews": views,
        "accessors": [
            {"bufferView": i, "componentType": 5126, "count": 3, "type": kind}
            for i, kind in enumerate(("VEC3", "VEC2", "VEC2"))
        ],
        "images": [{"bufferView": 3 + i, "mimeType": "image/png"} for i in range(len(images))],
        "textures": [{"source": i} for i in range(len(images))],
        **top,
    }
    path.write_bytes(glb(file, data))
    return load_scene(str(path))


def test_specular_glossiness_is_read(tmp_path: Path) -> None:
    gloss = {"diffuseFactor": [0.2, 0.1, 0.05, 1], "glossinessFactor": 0.75}
    name = "KHR_materials_pbrSpecularGlossiness"
    material = {"extensions": {name: gloss}}
    scene = _gltf(tmp_path / "a.glb", material, extensionsRequired=[name])
    assert scene.materials[0].base_color == (0.2, 0.1, 0.05)
    # The extension's specular colour is white where none is given: a mirror, so all metal.
    assert scene.materials[0].roughness == 0.25
    assert scene.materials[0].metalness == pytest.approx(1.0)
    gloss |= {"diffuseTexture": {"index": 0}, "diffuseFactor": [1, 1, 1, 1]}
    scene = _gltf(tmp_path / "a.glb", material, [IMAGES["8 bits"][0]])
    assert scene.materials[0].texture == 0


@pytest.mark.parametrize(("uv_set", "width"), [(0, 0.5), (1, 1.0), (2, 1.0)])
def test_any_set_of_coordinates_in_any_slot(tmp_path: Path, uv_set: int, width: float) -> None:
    # The left half of the image is black.
    image = np.zeros((2, 64, 3), np.uint8)
    image[:, 32:] = 255
    info = {"index": 0, "texCoord": uv_set}
    scene = _gltf(
        tmp_path / "a.glb",
        {
            "pbrMetallicRoughness": {"baseColorTexture": info},
            "emissiveFactor": [1, 1, 1],
            "emissiveTexture": info,
        },
        [_png(image)],
    )
    assert scene.uvs[:, 0].max() == width
    # A quarter of the triangle lies in the right half where its coordinates reach 1.
    expected = 0.25 if width == 1 else 0.0
    np.testing.assert_allclose(scene.materials[0].emission, expected, atol=0.02)


@pytest.mark.parametrize(
    ("material", "left"),
    [
        ({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.1]}}, 0),
        ({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.9]}}, 1),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.1]}}, 1),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}}}, 0),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.3}}}, 1),
        ({"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.1]}}, 0),
    ],
)
def test_blend_and_transmission(tmp_path: Path, material: dict[str, Any], left: int) -> None:
    second = {"attributes": {"POSITION": 0}}
    first = {"attributes": {"POSITION": 0}, "material": 0}
    scene = _gltf(tmp_path / "a.glb", material, meshes=[{"primitives": [first, second]}])
    assert len(scene.triangles) == 1 + left
    says = any(words in _said(scene) for words in ("let more light through", "opaque", "cut out"))
    assert says == (material.get("alphaMode") is not None or "extensions" in material)


def test_unlit_and_two_sided_are_kept(tmp_path: Path) -> None:
    material = {"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}
    scene = _gltf(tmp_path / "a.glb", material)
    assert scene.materials[0].unlit
    assert scene.materials[0].two_sided
    assert "unlit 1 material" in _said(scene)


def test_glb_with_a_mark_and_a_chunk_of_a_later_version(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    data = TRIANGLE.tobytes()
    file = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "buffers": [{"byteLength": len(data)}],
    }
    chunks = ((b"JSON", MARK + json.dumps(file).encode()), (b"EXT!", b"12"), (b"BIN\0", data))
    body = b"".join(struct.pack("<I4s", len(c), kind) + c for kind, c in chunks)
    path = tmp_path / "a.glb"
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    assert len(load_scene(str(path)).triangles) == 1
    assert not recwarn.list


def test_animations_are_said(tmp_path: Path) -> None:
    animation = {"channels": [], "samplers": []}
    scene = _gltf(tmp_path / "a.glb", {}, animations=[animation, animation])
    assert "animations: the pose at rest used (2)" in _said(scene)


def test_a_scene_that_is_not_far_stays_bit_for_bit(tmp_path: Path) -> None:
    text = "v 100.1 0 0\nv 104.3 0 0\nv 100.1 3.7 0\nf 1 2 3\n"
    scene = _written(tmp_path, a_obj=text)
    assert scene.origin == (0, 0, 0)
    np.testing.assert_array_equal(
        scene.corners[0], np.float32([[100.1, 0, 0], [104.3, 0, 0], [100.1, 3.7, 0]])
    )
    far = _written(tmp_path, a_obj=text.replace("10", "44800010"))
    assert far.origin[0] > 0
    assert _area(far) == pytest.approx(_area(scene), rel=1e-5)
    assert "far from the origin" in _said(far)
