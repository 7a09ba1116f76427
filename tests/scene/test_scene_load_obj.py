"""OBJ files made here, with known answers, and the cleaning of broken geometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from gibench.errors import BadInput
from gibench.scene.load import load_scene
from gibench.scene.model import Scene
from gibench.scene.readers.backs import STEP

SQUARE = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\n"


def _load(folder: Path, text: str) -> Scene:
    path = folder / "a.obj"
    path.write_text(text)
    return load_scene(str(path))


@pytest.mark.parametrize(
    "face",
    [
        "f 1 2 3 4",
        "f -4 -3 -2 -1",
        "f 1// 2// 3// 4//",
        "  f\t1 -3 \\\n 3 4 # a square",
        "f 1 2 3 -1",
    ],
)
def test_every_way_to_write_a_quad(tmp_path: Path, face: str) -> None:
    scene = _load(tmp_path, SQUARE + face + "\n")
    assert scene.corners.tolist() == [
        [[0, 0, 0], [2, 0, 0], [2, 1, 0]],
        [[0, 0, 0], [2, 1, 0], [0, 1, 0]],
    ]
    assert (scene.normals == [0, 0, 1]).all()


def test_negative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    text = "".join(
        f"v 0 0 {z}\nv 1 0 {z}\nv 0 1 {z}\nvt 0 {z}\nvn 0 0 1\nf -3/-1/-1 -2/-1/-1 -1/-1/-1\n"
        for z in range(3)
    )
    scene = _load(tmp_path, text)
    assert scene.corners[:, :, 2].tolist() == [[0] * 3, [1] * 3, [2] * 3]
    assert scene.uvs[scene.triangles][:, :, 1].tolist() == [[0] * 3, [1] * 3, [2] * 3]


@pytest.mark.parametrize(
    ("statement", "instead"),
    [
        ("map_Kd", "plain colours"),
        ("map_Ke", "plain colours"),
        ("map_d", "the material's own opacity"),
        ("norm", "the geometric normal"),
        ("map_Pm", "the material's own numbers"),
    ],
)
def test_what_there_is_instead_of_a_missing_image_is_said(
    tmp_path: Path, statement: str, instead: str
) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl m\nKd 0.5 0.5 0.5\n{statement} gone.png\n")
    scene = _load(tmp_path, f"mtllib a.mtl\n{SQUARE}usemtl m\nf 1 2 3 4\n")
    said = [line for line in scene.warnings if "gone.png" in line]
    assert len(said) == 1
    assert said[0].endswith(f"1 texture missing or unreadable (gone.png): {instead} used")


def test_groups_materials_and_textures(tmp_path: Path) -> None:
    Image.fromarray(np.uint8([[[255, 255, 255]]])).save(tmp_path / "White One.bmp")
    Image.fromarray(np.uint8([[[255, 0, 0], [0, 0, 0]]])).save(tmp_path / "red.tga")
    (tmp_path / "a.mtl").write_text(
        "newmtl wall # a comment\nKd 0.5 0.25 0.125 # brown\nmap_Kd -s 2 2 white one.bmp\n"
        "newmtl red\nmap_Kd red.tga\nmap_d white one.bmp\n"
        "newmtl lamp\nKd 0.1 0.1 0.1\nKe 17 12 4\n"
        "newmtl gone\nKd 0.3 0.3 0.3\nmap_Kd nowhere.png\n"
    )
    faces = "".join(
        f"g {group}\nusemtl {name}\nf 1/1 2/2 3/3\n"
        for group, name in (
            ("a", "wall"), ("b", "red"), ("b", "lamp"), ("c", "gone"), ("a", "unknown"),
        )
    )  # fmt: skip
    scene = _load(
        tmp_path, "mtllib a.mtl\nmtllib none.mtl\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\n" + faces
    )
    assert len(scene.triangles) == 5
    by_name = {m.name: m for m in scene.materials}
    assert by_name["wall"].base_color == (0.5, 0.25, 0.125)
    assert (scene.textures[by_name["wall"].texture].pixels == 1).all()
    assert scene.textures[by_name["red"].texture].pixels.tolist() == [[[1, 0, 0], [0, 0, 0]]]
    assert by_name["red"].base_color == (1, 1, 1)
    assert by_name["lamp"].emission == (17, 12, 4)
    assert (by_name["gone"].texture, by_name["gone"].base_color) == (-1, (0.3, 0.3, 0.3))
    assert by_name["unknown"].base_color == (0.8, 0.8, 0.8)
    objects = {
        scene.materials[m].name: o
        for m, o in zip(scene.material_ids, scene.object_ids, strict=True)
    }
    assert objects["wall"] == objects["unknown"]
    assert objects["red"] == objects["lamp"]
    assert len(set(objects.values())) == 3
    said = " | ".join(scene.warnings)
    for words in ("1 texture missing", "nowhere.png", "'none.mtl' not found", "(unknown)"):
        assert words in said
    assert not scene.lights


def test_broken_triangles_are_dropped_and_counted(tmp_path: Path) -> None:
    scene = _load(
        tmp_path,
        SQUARE + "v nan 0 0\nv 0 -inf 0\nv 1e300 0 0\nv 4 0 0\n"
        "f 1 2 3\nf 1 2 5\nf 1 6 3\nf 1 2 7\nf 1 2 8\nf 1 1 2\nf 1 2 9\nf 0 1 2\nf 1 2\nl 1 2\n",
    )
    assert scene.corners.tolist() == [[[0, 0, 0], [2, 0, 0], [2, 1, 0]]]
    assert len(scene.positions) == 3
    for line in (
        "3 triangles with a NaN or infinite vertex dropped",
        "2 degenerate triangles dropped",
        "2 faces with an index out of range dropped",
        "1 face with fewer than three corners dropped",
        "1 line of points, lines or curves ignored",
    ):
        assert line in scene.warnings


def test_an_edge_of_three_triangles_is_noted(tmp_path: Path) -> None:
    scene = _load(tmp_path, SQUARE + "v 0 0 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n")
    assert len(scene.triangles) == 3
    assert "1 edge shared by more than two triangles: kept" in scene.warnings


def test_a_normal_on_the_back_is_replaced_for_that_corner_only(tmp_path: Path) -> None:
    scene = _load(
        tmp_path, SQUARE + "vn 0 0 5\nvn 0 1 -1\nvn 3 0 3\nf 1//1 2//2 3//3\nf 1//1 3//3 4//1\n"
    )
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        scene.normals[scene.triangles],
        [[[0, 0, 1], [0, 0, 1], [half, 0, half]], [[0, 0, 1], [half, 0, half], [0, 0, 1]]],
        atol=1e-7,
    )
    assert any(line.startswith("1 shading normal of 6 ") for line in scene.warnings)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no triangles"),
        (b"# nothing\n", "no triangles"),
        (SQUARE.encode(), "no triangles"),
        (b"\x7fELF\0\0\1", "binary"),
        (b"\xff\xfe\x80garbage\xff", "no triangles"),
        (b"v 1 2\nf 1 1 1\n", "line 1: 'v' with 2 numbers"),
        (b"v 1 2 x\nv 1 2 3\nv 3 4 5\nf 1 2 3\n", "not a sound OBJ"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 three\n", "line 4: face index 'three'"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 4 5 6\n", "1 face with an index out of range"),
        (b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "no triangles left after dropping 1 triangle"),
        (b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "1 degenerate triangle"),
    ],
)
def test_broken_files_say_why_in_one_line(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(data)
    with pytest.raises(BadInput, match=says) as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.text("vtnfogusem l0123456789/-.#\\\t", max_size=20).map(lambda s: s + "\n"), max_size=12
    )
)
def test_nonsense_never_gives_a_traceback(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str]
) -> None:
    path = tmp_path_factory.mktemp("obj") / "a.obj"
    path.write_text(SQUARE + "".join(lines))
    try:
        load_scene(str(path))
    except BadInput as error:
        assert "\n" not in str(error)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 60),
    relative=st.booleans(),
    groups=st.integers(1, 4),
)
def test_a_random_mesh_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int, relative: bool, groups: int
) -> None:
    rng = np.random.default_rng(seed)
    positions = (rng.normal(size=(20, 3)) * 10 ** rng.uniform(-3, 3)).astype(np.float32)
    uvs = rng.normal(size=(7, 2)).astype(np.float32)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uvs]
    triangles = np.array([rng.permutation(20)[:3] for _ in range(count)])
    uv_indices = rng.integers(7, size=(count, 3))
    group = np.sort(rng.integers(groups, size=count))
    for i in range(count):
        if i == 0 or group[i] != group[i - 1]:
            lines.append(f"o part {group[i]}")
        v, t = (
            (triangles[i] - 20, uv_indices[i] - 7)
            if relative
            else (triangles[i] + 1, uv_indices[i] + 1)
        )
        lines.append("f " + " ".join(f"{a}/{b}" for a, b in zip(v, t, strict=True)))
    path = tmp_path_factory.mktemp("mesh") / "a.obj"
    path.write_text("\n".join(lines))
    scene = load_scene(str(path))
    # But for triangles that lie in one another back to back, which are moved a hair apart.
    hair = 2 * STEP * np.abs(positions).max() if "in one plane" in str(scene.warnings) else 0.0
    np.testing.assert_allclose(scene.corners, positions[triangles], rtol=0, atol=hair)
    assert np.array_equal(scene.uvs[scene.triangles], uvs[uv_indices])
    assert np.array_equal(scene.object_ids, np.unique(group, return_inverse=True)[1])
