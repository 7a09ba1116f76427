"""Files of millions of triangles: what replaces the ways of small ones does the same as they."""

from __future__ import annotations

import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.large_scenes import grid, write_glb, write_obj

from gibench.arrays import unique_rows
from gibench.errors import BadInput
from gibench.scene.builtin import build
from gibench.scene.lightmap import charts
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.lightmap.projected import projected_charts
from gibench.scene.lightmap.raster import doubled_areas
from gibench.scene.load import load_scene
from gibench.scene.readers import backs, obj
from gibench.scene.readers.clean import CleanMesh
from gibench.scene.readers.defaults import size_remarks
from gibench.scene.readers.obj_blocks import blocks
from gibench.scene.readers.obj_colors import vertex_colors

ODD_LINES = (
    "# a comment",
    "",
    "v 1 2 3 # a comment",
    "v 1 \\\n 2 3",
    "f 1 2 \\\nv 3",
    "f 1//1 2 3/1",
    "f 1/1/1 2//1 3/1",
    "f -1 -2 -3",
    "f -3//-1 -2//-1 -1//-1",
    "f 0 1 2",
    "f 1 2 999999",
    "f 1 2",
    "o thing",
    "usemtl b",
    "g one two",
    "vt 0.5",
    "v 1e3 -2.5e-1 +3.",
    "p 1",
    "F 1 2 3",
)
UNSOUND = ("v 1 2", "v 1 2 x", "v 1,5 2 3", "v 1-2 3 4", "f 1 / 2 3", "f 1/2/3/4 2 3", "v 1 2 nan")


def _text(rng: np.random.Generator, unsound: bool) -> str:
    """Stretches of lines of every kind, with odd ones between them."""
    lines = []
    for _ in range(12):
        count = int(rng.integers(1, 40))
        kinds = ["v", "v color", "v alpha", "v w", "vt", "vn", "f", "f/", "f//", "f///", "quad"]
        kind = rng.choice(kinds)
        numbers = np.round(rng.normal(size=(count, 7)), 3)
        number = rng.integers(1, 60, (count, 4)) * (1 if rng.random() < 0.8 else -1)
        for row, at in zip(numbers.tolist(), number.tolist(), strict=True):
            widths = {"v": 3, "v color": 6, "v alpha": 7, "v w": 4, "vt": 2, "vn": 3}
            width = widths.get(str(kind))
            if width:
                lines.append(" ".join([str(kind).split()[0], *map(str, row[:width])]))
            else:
                forms = {"f": "{0}", "f/": "{0}/{0}", "f//": "{0}//{0}", "quad": "{0}/{0}/{0}"}
                form = forms.get(str(kind), "{0}/{0}/{0}")
                corners = at if kind == "quad" or rng.random() < 0.02 else at[:3]
                lines.append("f " + "\t".join(form.format(index) for index in corners) + " ")
        lines.append(str(rng.choice(ODD_LINES)))
    if unsound:
        lines.insert(int(rng.integers(len(lines))), str(rng.choice(UNSOUND)))
    return "\n".join(lines) + ("\n" if rng.random() < 0.5 else "")


def _read(text: str, whole_blocks_from: int) -> object:
    try:
        plain = obj._plain(text, Path("x.obj"), whole_blocks_from)
    except BadInput as error:
        return str(error)
    arrays = {name: rows.array() for name, rows in plain.numbers.items()}
    triangles = {
        key: obj._triangles(faces, arrays["v"])[0].tolist() for key, faces in plain.faces.items()
    }
    numbers = {name: rows.tolist() for name, rows in arrays.items()}
    colors, said = vertex_colors(plain.colors, len(arrays["v"]))
    others = (plain.out_of_range, plain.not_faces, plain.ignored_lines, plain.unread, said)
    return numbers, triangles, None if colors is None else colors.tolist(), others


@pytest.mark.parametrize("unsound", [False, True])
def test_whole_stretches_are_read_as_line_by_line(rng: np.random.Generator, unsound: bool) -> None:
    whole = 0
    for _ in range(40):
        text = _text(rng, unsound)
        assert repr(_read(text, 0)) == repr(_read(text, 1 << 60)), text  # NaN is not itself
        found = list(blocks(text))
        assert "".join(block.text for block in found) == text
        whole += sum(block.content is not None for block in found)
    assert whole > 100


def test_unique_rows_are_those_of_a_lexicographic_sort(rng: np.random.Generator) -> None:
    rows = rng.integers(-(2**31), 2**31, (50, 3)).astype(np.int32)[rng.integers(0, 50, 400)]
    rows[::7, 1] = 0
    first, number = unique_rows(rows)
    order = np.lexsort(rows.T)
    new = np.append(True, (np.diff(rows[order], axis=0) != 0).any(axis=1))
    assert (first == order[new]).all()
    assert (rows[first][number] == rows).all()
    assert unique_rows(rows[:0])[1].shape == (0,)


def test_faces_in_one_plane_are_found_in_any_portions(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    centre = rng.uniform(0, 40, (300, 1, 2))
    outlines = centre + rng.normal(size=(300, 3, 2)) * rng.choice([0.1, 0.5, 3.0], (300, 1, 1))
    front = rng.random(300) < 0.5
    at_once = backs._overlapping(outlines, front, 1e-6)
    monkeypatch.setattr(backs, "_PAIRS", 40)
    assert (backs._overlapping(outlines, front, 1e-6) == at_once).all()
    one, other = np.flatnonzero(front), np.flatnonzero(~front)
    i, j = (a.ravel() for a in np.meshgrid(one, other))
    hit = backs._overlap(outlines[i], outlines[j], 1e-6)
    expected = np.zeros(300, bool)
    expected[i[hit]] = expected[j[hit]] = True
    assert (at_once == expected).all()
    assert 0 < expected.sum() < 300


def _ramp(turns: float, steps: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """A spiral ramp that lies over itself seen from above."""
    angle = np.linspace(0, 2 * np.pi * turns, steps + 1)
    ring = np.stack([np.cos(angle), angle / 4, -np.sin(angle)], axis=1)
    scale = np.array([1.0, 1.0, 1.0]), np.array([2.0, 1.0, 2.0])
    positions = np.stack([ring * s for s in scale], axis=1).reshape(-1, 3)
    a = 2 * np.arange(steps)
    triangles = np.concatenate([np.stack([a, a + 1, a + 3], 1), np.stack([a, a + 3, a + 2], 1)])
    return positions.astype(np.float32), triangles.astype(np.int32)


def test_charts_by_projection_keep_fronts_and_lie_over_nothing(rng: np.random.Generator) -> None:
    side = 60
    u, v = np.meshgrid(np.linspace(0, 6, side + 1), np.linspace(0, 6, side + 1))
    terrain = np.stack([u, 0.05 * rng.standard_normal(u.shape), -v], axis=-1).reshape(-1, 3)
    noisy = projected_charts(terrain.astype(np.float32), grid(side).astype(np.int32), 0.1)
    assert noisy[2] < 40  # of 7200 triangles, hundreds of which lean over
    positions, triangles = _ramp(2.5)
    texel = 0.02
    uvs, chart, count = projected_charts(positions, triangles, texel)
    for found in (noisy[0], uvs):
        assert (doubled_areas(found) > 0).all()
    assert (np.unique(chart) == np.arange(count)).all()
    # The ramp rises by 1.6 m a turn: no chart holds two of them.
    middle = positions[triangles].mean(axis=1)
    cell = np.floor(uvs.mean(axis=1) / texel / 8).astype(np.int64)
    for key in np.unique(np.column_stack([chart, cell]), axis=0):
        mine = (chart == key[0]) & (cell == key[1:]).all(axis=1)
        assert np.ptp(middle[mine, 1]) < 0.8
    assert 2 <= count < 40


def test_a_large_scene_has_the_receivers_asked_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(charts, "MOST_UNFOLDED", 0)
    write_obj(tmp_path / "large.obj", 9000)
    for scene in (load_scene(str(tmp_path / "large.obj")), build("hall")):
        if scene.lightmap_uvs is not None:
            scene = replace(scene, lightmap_uvs=None)
        surface = charts.triangle_areas(scene.corners.astype(np.float64)).sum()
        lightmap = unwrap(scene, 6000)
        assert abs(len(lightmap.receivers) / 6000 - 1) < 0.01
        assert lightmap.fragments.area.sum(dtype=np.float64) == pytest.approx(surface, rel=1e-4)


def test_both_kinds_of_file_are_one_scene(tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", 9000)
    write_glb(tmp_path / "a.glb", 9000)
    one, other = (load_scene(str(tmp_path / name)) for name in ("a.obj", "a.glb"))
    assert len(one.triangles) == len(other.triangles) > 8000
    assert np.abs(one.corners - other.corners).max() < 2e-5


def _mesh(count: int) -> CleanMesh:
    rows = np.zeros((count, 3), np.int32)
    floats = np.zeros((3, 3), np.float32)
    column = np.zeros(count, np.int32)
    return CleanMesh(floats, floats, floats[:, :2], rows, column, column, None, ())


def test_what_large_scenes_need_is_said() -> None:
    assert size_remarks(_mesh(300_000)) == []
    (unwrapped,) = size_remarks(_mesh(300_001))
    assert "projection" in unwrapped
    said = size_remarks(_mesh(10_000_000))
    assert "16 GiB" in said[1]
    assert "MiB of tree" in said[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["big.obj", "big.glb"])
def test_two_million_triangles_run_in_4_gb(tmp_path: Path, name: str) -> None:
    (write_obj if name.endswith("obj") else write_glb)(tmp_path / name, 2_000_000)
    options = ["--technique", "direct", "--frames", "3", "--warmup", "1", "--quiet"]
    places = ["--out", str(tmp_path / "out"), "--cache-dir", str(tmp_path / "cache")]
    command = [
        sys.executable,
        "-m",
        "gibench",
        "run",
        "--no-quality",
        "--scene",
        str(tmp_path / name),
    ]
    subprocess.run([*command, *options, *places], check=True)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    assert peak * 1024 < 4e9
