"""Files whose light is easily got wrong: each has the right light, or a line that says what is not
read and what is done instead.
"""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from test_scene_load_gltf import File

from gibench.measure.session.shared import Shared
from gibench.scene.lightmap.albedo import mean_albedo
from gibench.scene.load import load_scene, names_apart
from gibench.scene.model import Scene, SpotLight
from gibench.study.site import Site

SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
ORDER = [0, 1, 2, 0, 2, 3]
UVS = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])  # glTF's v points down
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"
HALVES = np.tile(np.uint8([[255, 0, 0], [255, 0, 0], [0, 255, 0], [0, 255, 0]]), (4, 1, 1))


def _png(pixels: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return out.getvalue()


def _gltf(folder: Path, material: dict[str, Any] | None, *images: Any, **attributes: Any) -> Scene:
    """A square of the material before one without."""
    file = File()
    more = {} if material is None else {"material": 0}
    file.mesh(SQUARE, ORDER, **more, **attributes)
    file.mesh(SQUARE, ORDER)
    file.json |= {
        "images": [{"bufferView": file.view(_png(image))} for image in images],
        "textures": [{"source": i} for i in range(len(images))],
        "nodes": [{"mesh": 0}, {"mesh": 1, "translation": [0, 0, -1]}],
        "scenes": [{"nodes": [0, 1]}],
    }
    if material is not None:
        file.json["materials"] = [material]
    return load_scene(str(file.gltf(folder / "a.gltf")))


def _obj(folder: Path, mtl: str, text: str = QUAD + FACE, **images: Any) -> Scene:
    (folder / "a.mtl").write_text(f"newmtl m\n{mtl}\n")
    for name, pixels in images.items():
        (folder / f"{name}.png").write_bytes(_png(pixels))
    (folder / "a.obj").write_text("mtllib a.mtl\nusemtl m\n" + text)
    return load_scene(str(folder / "a.obj"))


def _albedos(scene: Scene) -> np.ndarray:
    """Of the first square's two triangles."""
    whole = np.tile(np.eye(3), (2, 1, 1))
    return mean_albedo(scene, np.arange(2), whole)


def _said(scene: Scene) -> str:
    return " | ".join(scene.warnings)


@pytest.mark.parametrize("mode, words", [("MASK", "cut out"), ("BLEND", "than they stop left out")])
def test_alpha_of_vertices_counts_as_that_of_the_material(
    tmp_path: Path, mode: str, words: str
) -> None:
    def load(alpha: float, mode: str) -> Scene:
        colors = np.float32([[1, 0, 0, alpha]] * 4)
        return _gltf(tmp_path, {"alphaMode": mode}, COLOR_0=colors)

    gone = load(0.25, mode)
    assert len(gone.triangles) == 2
    assert words in _said(gone)
    for there in (load(0.75, mode), load(0.25, "OPAQUE")):
        assert len(there.triangles) == 4
        np.testing.assert_allclose(_albedos(there), [(1, 0, 0)] * 2)
        assert words not in _said(there)


def test_alpha_of_vertices_multiplies_that_of_the_mask(tmp_path: Path) -> None:
    image = np.full((4, 4, 4), 255)
    image[:, 2:, 3] = 153  # 0.6
    material = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    colors = np.float32([[1, 1, 1, 1]] * 4)
    whole = _gltf(tmp_path, material, image, TEXCOORD_0=UVS, COLOR_0=colors)
    assert whole.cutouts is None
    colors[:, 3] = 0.75  # 0.75 and 0.45
    cut = _gltf(tmp_path, material, image, TEXCOORD_0=UVS, COLOR_0=colors)
    assert cut.cutouts is not None
    np.testing.assert_array_equal(cut.cutouts.images[0], [[True, True, False, False]] * 4)
    colors[2, 3] = 0.7
    assert "within 2 triangles of cut-outs of material 0: the mean of each used" in _said(
        _gltf(tmp_path, material, image, TEXCOORD_0=UVS, COLOR_0=colors)
    )


def test_an_image_of_colour_without_coordinates_is_its_mean(tmp_path: Path) -> None:
    textured = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    second = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}
    faces = {"none": "f 1 2 3 4\n", "mixed": "f 1/1 2/2 3 4\n"}
    for scene in (
        _gltf(tmp_path, textured, HALVES),
        _gltf(tmp_path, second, HALVES, TEXCOORD_0=UVS),
        *(_obj(tmp_path, "map_Kd t.png", QUAD + face, t=HALVES) for face in faces.values()),
    ):
        np.testing.assert_allclose(_albedos(scene), [(0.5, 0.5, 0)] * 2)
        assert "images of colour of 1 material without coordinates" in _said(scene)
        assert "): their mean used" in _said(scene)
    with_uvs = _gltf(tmp_path, textured, HALVES, TEXCOORD_0=UVS)
    assert "without coordinates" not in _said(with_uvs)
    assert len(with_uvs.textures) == 1


def test_an_image_of_emission_without_coordinates_is_its_mean(tmp_path: Path) -> None:
    lamp = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}
    scene = _gltf(tmp_path, lamp, HALVES)
    assert scene.materials[scene.material_ids[0]].emission == pytest.approx((0.5, 0.5, 0))
    assert "images of emission of 1 material without coordinates (material 0): their mean" in _said(
        scene
    )


def test_coordinates_that_are_no_numbers_are_said(tmp_path: Path) -> None:
    uvs = UVS.copy()
    uvs[0, 0] = np.nan
    textured = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    scene = _gltf(tmp_path, textured, HALVES, TEXCOORD_0=uvs)
    assert "1 texture coordinate not finite: 0 used" in scene.warnings


def test_a_gltf_surface_without_material_is_white(tmp_path: Path) -> None:
    colors = np.float32([[0.5, 0.25, 0]] * 4)
    np.testing.assert_allclose(_albedos(_gltf(tmp_path, None, COLOR_0=colors))[0], (0.5, 0.25, 0))
    np.testing.assert_allclose(_albedos(_gltf(tmp_path, None)), 1)
    bright = _gltf(tmp_path, None, COLOR_0=colors * 4)
    np.testing.assert_allclose(_albedos(bright)[0], (1, 1, 0))
    assert "ignored: colours of vertices (COLOR_0) over 1: 1 used (1)" in bright.warnings


@pytest.mark.parametrize(
    "numbers, color, words",
    [
        ("0.5 0.25 0", (0.5, 0.25, 0), ""),
        ("255 51 0", (1, 0.2, 0), "from 0 to 255: divided by 255"),
        ("1.5 0.5 0", (1, 0.5, 0), "4 colours of vertices over 1: 1 used"),
        ("0.5 0.25 0.125 1", (0.5, 0.25, 0.125), "4 vertices of seven numbers: taken as x y z r"),
        ("0.5 0.25 0.125 0.5", (0.5, 0.25, 0.125), "x y z r g b a, the alpha not used"),
        ("1 0.5 0.25 0.125", (0.5, 0.25, 0.125), "taken as x y z w r g b"),
    ],
)
@pytest.mark.parametrize("blocks", [False, True])
def test_colours_of_an_obj_files_vertices(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    numbers: str,
    color: tuple[float, ...],
    words: str,
    blocks: bool,
) -> None:
    text = "".join(f"v {x:g} {y:g} {z:g} {numbers}\n" for x, y, z in SQUARE.tolist())
    if blocks:
        monkeypatch.setattr("gibench.scene.readers.obj_blocks._LEAST_LINES", 1)
        monkeypatch.setattr("gibench.scene.readers.obj.LARGE_TEXT", 0)
    scene = _obj(tmp_path, "Kd 1 1 1", text + "f 1 2 3 4\n")
    np.testing.assert_allclose(_albedos(scene), [color] * 2)
    assert words in _said(scene)
    assert bool(words) == ("of vertices" in _said(scene) or "seven numbers" in _said(scene))


@pytest.mark.parametrize("red, stays", [(0, True), (102, True), (153, False), (255, False)])
def test_an_image_of_transmission_multiplies_it(tmp_path: Path, red: int, stays: bool) -> None:
    glass = {"transmissionFactor": 1, "transmissionTexture": {"index": 0}}
    image = np.full((4, 4, 3), 255)
    image[..., 0] = red  # as it stands, not sRGB
    material = {"name": "glass", "extensions": {"KHR_materials_transmission": glass}}
    scene = _gltf(tmp_path, material, image, TEXCOORD_0=UVS)
    assert len(scene.triangles) == (4 if stays else 2)
    assert ("than they stop left out (glass)" in _said(scene)) != stays


def test_a_skinned_mesh_stands_where_its_joints_are(tmp_path: Path) -> None:
    def load(bound: bool) -> Scene:
        file = File().mesh(SQUARE, ORDER)
        attributes = file.json["meshes"][0]["primitives"][0]["attributes"]
        skin: dict[str, Any] = {"joints": [2, 3]}
        if bound:
            joints = np.array([[0, 1, 0, 0]] * 4, np.uint8)
            weights = np.float32([[1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]])
            attributes["JOINTS_0"] = file.array(joints, "u1")
            attributes["WEIGHTS_0"] = file.array(weights)
            moved = np.eye(4, dtype=np.float32)
            moved[3, 0] = -1  # columns one after another: back along x
            both = np.stack([np.eye(4, dtype=np.float32), moved])
            view = {"bufferView": file.view(both.tobytes()), "componentType": 5126}
            skin["inverseBindMatrices"] = len(file.json["accessors"])
            file.json["accessors"].append({**view, "count": 2, "type": "MAT4"})
        file.json["skins"] = [skin]
        file.json["scenes"] = [{"nodes": [0, 2]}]
        file.json["nodes"] = [
            {"children": [1], "scale": [0.01] * 3, "translation": [7, 0, 0]},
            {"mesh": 0, "skin": 0, "rotation": [0, 1, 0, 0]},
            {"children": [3]},
            {"translation": [1, 2, 0]},
        ]
        return load_scene(str(file.gltf(tmp_path / "a.gltf")))

    stands = load(bound=False)
    np.testing.assert_allclose(np.unique(stands.positions, axis=0), np.unique(SQUARE, axis=0))
    assert "skins without sound joints and weights: as the mesh stands (1)" in _said(stands)
    posed = load(bound=True)
    # Joint 0 does nothing, joint 1 moves by 2 upwards.
    expected = np.float32([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 3, 0]])
    np.testing.assert_allclose(np.unique(posed.positions, axis=0), np.unique(expected, axis=0))
    assert "skin" not in _said(posed)


@pytest.mark.parametrize(
    "lines, words",
    [
        ("Ks 0.5 0.5 0.5\nillum 2", "Ks of 1 material)"),
        ("Ks 0.5 0.5 0.5\nillum 1", ""),
        ("Ks 0.04 0.04 0.04\nNs 900\nNi 1.45\nKa 1 1 1\nTf 1 1 1\nillum 2", ""),
        ("Ks 0.5 0.5 0.5\nPr 1", ""),
        ("illum 3", "illum 3 of 1 material)"),
        ("refl -type sphere t.png\ndisp t.png", "refl of 1 material, disp of 1 material)"),
        ("map_Tr t.png", "map_Tr of 1 material)"),
        ("Pc 0.5\nPs 0", "Pc of 1 material)"),
    ],
)
def test_statements_of_materials_that_are_not_read(tmp_path: Path, lines: str, words: str) -> None:
    found = [line for line in _obj(tmp_path, lines).warnings if "not read" in line]
    assert len(found) == bool(words)
    assert all(words in line and "surfaces are diffuse" in line for line in found)


def test_statements_of_objects_that_are_not_read(tmp_path: Path) -> None:
    text = QUAD + "s 1\nbevel on\nF 1 2 3\ncall b.obj\ncall b.obj\nfo 1 2 3\nf 1 3 4\n"
    scene = _obj(tmp_path, "Kd 1 1 1", text)
    assert "3 statements not known, left out (call, F)" in scene.warnings
    assert len(scene.triangles) == 2


@pytest.mark.parametrize(
    "statement, ends",
    [
        ("-s\t2 2 1\t-o 0 0 0\tt.png", 2),
        ("t.png -s 2 2 1", 2),
        ("t.png -clamp off -s 2 2", 2),
        ('"t.png"  -s 2 2 1', 2),
        ("t.png", 1),
    ],
)
def test_options_between_tabs_and_behind_the_name(
    tmp_path: Path, statement: str, ends: float
) -> None:
    scene = _obj(tmp_path, f"map_Kd {statement}", t=HALVES)
    assert scene.uvs[:, 0].max() == ends
    assert not any("missing" in line or "not used: -" in line for line in scene.warnings)


def test_a_name_that_looks_like_options_stays_a_name(tmp_path: Path) -> None:
    (tmp_path / "wood -o 1.png").write_bytes(_png(HALVES))
    assert len(_obj(tmp_path, "map_Kd wood -o 1.png").textures) == 1


def test_a_blank_behind_a_backslash(tmp_path: Path) -> None:
    scene = _obj(tmp_path, "Kd 1 1 1", QUAD + "f 1 2 \\ \n3\t4 \\\t\n\n")
    assert len(scene.triangles) == 2


@pytest.mark.parametrize("channel, left", [("r", 2), ("g", 2), ("m", 4), ("", 4)])
def test_a_channel_of_an_opacity_map(tmp_path: Path, channel: str, left: int) -> None:
    image = np.full((4, 4, 4), 255)
    image[:, :2, 0] = 0
    image[:, 2:, 1] = 0
    option = f"-imfchan {channel} " if channel else ""
    scene = _obj(tmp_path, f"map_d {option}t.png", t=image)
    if left == 4:
        assert scene.cutouts is None
    else:
        assert scene.cutouts is not None
        there = [channel == "g"] * 2 + [channel == "r"] * 2
        np.testing.assert_array_equal(scene.cutouts.images[0], [there] * 4)


def _with_light(folder: Path, light: dict[str, Any], **node: Any) -> Scene:
    file = File().mesh(SQUARE, ORDER)
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    file.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0, "znear": 0.1}}]
    file.json["nodes"][0] |= {"extensions": {"KHR_lights_punctual": {"light": 0}}, **node}
    return load_scene(str(file.gltf(folder / "a.gltf")))


def test_lights_and_cameras_that_make_no_sense_are_said(tmp_path: Path) -> None:
    spot = {"type": "spot", "spot": {"innerConeAngle": 1.0, "outerConeAngle": 0.5}}
    scene = _with_light(tmp_path, spot)
    (lamp,) = scene.lights
    assert isinstance(lamp, SpotLight)
    assert lamp.inner_angle == lamp.outer_angle == 0.5
    assert "inner cones of spots wider than the outer: the outer used (1)" in _said(scene)
    ranged = _with_light(tmp_path, {"type": "point", "range": 2})
    assert "ranges of lights: they shine on beyond them (1)" in _said(ranged)
    assert "cameras with" not in _said(ranged)
    flat = _with_light(tmp_path, {"type": "point"}, camera=0)
    assert "cameras with a senseless field of view (1)" in _said(flat)
    assert "ranges" not in _said(flat)


@pytest.mark.parametrize("factor, said", [(1, True), (0, False)])
def test_layers_over_a_diffuse_base_are_said(tmp_path: Path, factor: float, said: bool) -> None:
    layers = {
        "KHR_materials_clearcoat": {"clearcoatFactor": factor},
        "KHR_materials_sheen": {"sheenColorFactor": [0, factor, 0]},
    }
    scene = _gltf(tmp_path, {"extensions": layers})
    for name in ("clearcoat", "sheen"):
        line = f"ignored: {name} of materials: surfaces are diffuse (1)"
        assert (line in scene.warnings) == said


def test_base64_in_capitals(tmp_path: Path) -> None:
    path = File().mesh(SQUARE, ORDER).gltf(tmp_path / "a.gltf")
    path.write_text(path.read_text().replace(";base64", ";charset=utf-8;BASE64"))
    assert len(load_scene(str(path)).triangles) == 2


def test_files_of_one_name_are_told_apart(tmp_path: Path) -> None:
    paths = []
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
        paths.append(str(tmp_path / folder / "room.obj"))
        Path(paths[-1]).write_text(QUAD + FACE)
    taken = str(tmp_path / "room-2.obj")
    Path(taken).write_text(QUAD + FACE)
    names = names_apart([*paths, taken, "cornell-box"])
    assert names == {paths[1]: "room-3", paths[2]: "room-4"}
    shared = Shared(tmp_path, 0, names=names)
    found = [shared.scene(path) for path in [*paths, taken]]
    assert [scene.name for scene in found] == ["room", "room-3", "room-4", "room-2"]
    assert "b/room.obj is called room-3, as another scene has its name" in found[1].warnings
    assert not any("is called" in line for line in found[0].warnings)
    assert names_apart([paths[0], paths[0], "cornell-box"]) == {}
    own = str(tmp_path / "cornell-box.obj")
    Path(own).write_text(QUAD + FACE)
    assert names_apart([own, "cornell-box"]) == {own: "cornell-box-2"}
    site = pickle.loads(pickle.dumps(Site(tmp_path, names=names)))
    assert site.moving().scene(paths[1]).name == "room-3"
