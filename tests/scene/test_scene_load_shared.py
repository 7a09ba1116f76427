"""Every real scene file at hand: it loads, or says in one line why not."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gibench.errors import BadInput
from gibench.scene.load import load_scene
from gibench.scene.readers.viewpoint import is_interior

REPOSITORY = Path(__file__).resolve().parents[2]


def _folder() -> Path | None:
    named = os.environ.get("GIBENCH_SCENES")
    places = [Path(named)] if named else [
        Path("/work/shared/scenes"), REPOSITORY.parent / "shared" / "scenes",
    ]  # fmt: skip
    return next((place for place in places if place.is_dir()), None)


SCENES = _folder()
needs_scenes = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes (set GIBENCH_SCENES)"
)

# Files that are broken on purpose or hold no triangles, and what is said of them.
REFUSED = {
    "AllIndicesOutOfRange.gltf": "12 triangles with an index out of range",
    "NoScene.gltf": "no scene 0",
    "SceneWithoutNodes.gltf": "no triangles",
    "sceneWrongType.gltf": "not a sound glTF",
    "MissingBin/BoxTextured.gltf": "BoxTextured0.bin' is missing",
} | {f"Mesh_PrimitiveMode_{i:02}.gltf": "points or lines" for i in (0, 1, 2, 3, 7, 8, 9, 10)}


def _files() -> list[str]:
    if SCENES is None:
        return []
    kinds = {".gltf", ".glb", ".obj"}
    found = (p for p in SCENES.rglob("*") if p.suffix in kinds and p.name != "sponza.obj")
    return sorted(str(p.relative_to(SCENES)) for p in found)


@needs_scenes
@pytest.mark.parametrize("name", _files())
def test_every_file_loads_or_says_why(name: str) -> None:
    assert SCENES is not None
    says = next((text for end, text in REFUSED.items() if name.endswith(end)), None)
    if says is not None:
        with pytest.raises(BadInput, match=says) as caught:
            load_scene(str(SCENES / name))
        assert "\n" not in str(caught.value)
        return
    scene = load_scene(str(SCENES / name))
    corners = scene.corners.astype(float)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.isfinite(flat).all()
    assert (np.linalg.norm(flat, axis=1) > 0).all()
    assert (np.einsum("tcx,tx->tc", scene.normals[scene.triangles], flat) > -1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-5)
    assert scene.material_ids.max() < len(scene.materials)
    assert scene.cameras


@needs_scenes
def test_the_original_cornell_box() -> None:
    assert SCENES is not None
    scene = load_scene(str(SCENES / "cornell_box/mcguire/CornellBox-Original.obj"))
    low, high = scene.bounds
    np.testing.assert_allclose(low, [-1.02, 0, -1.04], atol=1e-6)
    np.testing.assert_allclose(high, [1, 1.99, 0.99], atol=1e-6)
    assert len(scene.triangles) == 36
    lamp = next(m for m in scene.materials if any(m.emission))
    assert lamp.emission == (17, 12, 4)
    camera = scene.cameras[0]  # before the missing wall, looking in
    assert camera.position[2] > high[2] > camera.target[2]


@needs_scenes
def test_sponza() -> None:
    assert SCENES is not None
    scene = load_scene(str(SCENES / "sponza_crytek/sponza.obj"))
    dropped = next(w for w in scene.warnings if "degenerate" in w)
    # 262 267 triangles in the file, of which these have exactly no area; FIELD-NOTES counts 425
    # with the three whose area is under 1e-10.
    assert dropped == "422 degenerate triangles dropped"
    # 116 lie wholly in the holes of alpha masks.
    assert len(scene.triangles) == 262_267 - 422 - 116
    assert len(np.unique(scene.object_ids)) == 25
    assert len(scene.textures) == 24
    # The file's positions are half floats times a scale: all 145 thousand come back exactly, but
    # for the corners of triangles that are moved off others in their plane.
    with (SCENES / "sponza_crytek/sponza.obj").open() as file:
        found = np.array(
            [line.split()[1:4] for line in file if line.startswith("v ")], np.float64
        ).astype(np.float32)
    ours = np.unique(scene.positions, axis=0)
    kept = np.isin(ours.view("f4,f4,f4"), np.unique(found, axis=0).view("f4,f4,f4"))[:, 0]
    moved = next(w for w in scene.warnings if "moved off them" in w)
    assert np.count_nonzero(~kept) <= 3 * int(moved.split()[0])
    away, _ = cKDTree(found).query(ours[~kept])
    assert away.max() < 1e-5 * np.ptp(found, axis=0).max()
    assert is_interior(scene)
    # As written in the file's material comments, computed by others.
    bricks = next(m for m in scene.materials if m.name == "bricks")
    np.testing.assert_allclose(
        scene.textures[bricks.texture].pixels.mean(axis=(0, 1)), [0.3198, 0.2841, 0.2145], atol=1e-4
    )
    assert scene.lights_at(0) != scene.lights_at(1)


@needs_scenes
def test_the_modern_hall_through_the_example_toml(tmp_path: Path) -> None:
    assert SCENES is not None
    for folder in ("models", "textures"):
        (tmp_path / folder).symlink_to(SCENES / "modern_hall" / folder)
    example = tmp_path / "modern-hall.example.toml"
    shutil.copy(REPOSITORY / "scenes" / example.name, example)
    scene = load_scene(str(example))
    glowing = np.array([any(m.emission) for m in scene.materials])[scene.material_ids]
    assert (~glowing).sum() == 28_479
    assert glowing.sum() == 5 * 64 + 8 * 2
    assert scene.probes.count == 108
    assert len(scene.textures) == 3
    # The large lamp of scene.xml: 4 x 6.49687 x 1.53215 (half sides of its matrix's columns).
    corners = scene.corners[glowing].astype(float)
    areas = (
        np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        / 2
    )
    window = 4 * 6.49687 * np.hypot(1.45785, 0.471223)
    assert any(abs(2 * area - window) < 1e-3 for area in areas)
    disk = np.pi * 0.104916**2
    assert areas[:64].sum() == pytest.approx(disk, rel=1e-3)
