"""What a stored lightmap's name depends on."""

from __future__ import annotations

import ast
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from gibench.bake import lightmap as lightmap_module
from gibench.bake.lightmap import cached_lightmap, lightmap_key
from gibench.scene.builtin import build
from gibench.scene.environment import Environment
from gibench.scene.model import Scene, Texture
from gibench.study.frozen import frozen


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build("cornell-box")


def test_lights_and_all_else_that_unwrapping_does_not_see_are_left_out(scene: Scene) -> None:
    base = lightmap_key(scene, 300)
    unused = Texture("unused", np.ones((2, 2, 3), np.float32))
    for same in (
        frozen(scene, 12),
        replace(scene, lights=()),
        replace(scene, environment=Environment.constant((1.0, 2.0, 3.0))),
        replace(scene, cameras=()),
        replace(scene, probes=replace(scene.probes, count=3)),
        replace(scene, uvs=scene.uvs + 1.0),  # nothing is textured
        replace(scene, textures=(unused,)),
    ):
        assert lightmap_key(same, 300) == base


def test_whatever_ends_up_in_a_lightmap_is_in_its_name(scene: Scene) -> None:
    first, *rest = scene.materials
    texture = Texture("t", np.ones((2, 2, 3), np.float32))
    other = Texture("t", np.zeros((2, 2, 3), np.float32))
    textured = replace(scene, materials=(replace(first, texture=0), *rest), textures=(texture,))
    changed = [
        replace(scene, positions=scene.positions * 2),
        replace(scene, normals=-scene.normals),
        replace(scene, triangles=scene.triangles[::-1]),
        replace(scene, material_ids=scene.material_ids[::-1]),
        replace(scene, materials=(replace(first, base_color=(0.1, 0.2, 0.3)), *rest)),
        replace(scene, materials=(replace(first, emission=(9.0, 9.0, 9.0)), *rest)),
        replace(scene, lightmap_uvs=np.zeros((len(scene.positions), 2), np.float32)),
        textured,
        replace(textured, textures=(other,)),
        replace(textured, uvs=scene.uvs + 0.5),
    ]
    keys = [lightmap_key(scene, 300), lightmap_key(scene, 301)]
    keys += [lightmap_key(one, 300) for one in changed]
    assert len(set(keys)) == len(keys)


def test_code_in_a_folder_below_counts_too(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "atlas.py").write_text("one")
    (tmp_path / "below" / "raster.py").write_text("two")
    monkeypatch.setattr(lightmap_module, "files", lambda package: tmp_path)
    base = lightmap_key(scene, 300)
    assert lightmap_key(scene, 300) == base
    (tmp_path / "below" / "raster.py").write_text("three")
    assert lightmap_key(scene, 300) != base


def test_all_code_that_unwraps_lies_where_the_key_looks() -> None:
    """A module that moved out of the folder would drop out of the key."""
    # What a lightmap is made from, and what has no part in the result.
    known = {"gibench.scene.model", "gibench.arrays", "gibench.errors", "gibench.progress"}
    known.add("gibench.scene.cutouts")  # in the key by itself, where anything is cut out
    package = "gibench.scene.lightmap"
    folder = Path(str(files(package)))
    imported = {
        node.module
        for path in folder.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module
    }
    ours = {name for name in imported if name.startswith("gibench")}
    assert {name for name in ours if not name.startswith(package)} <= known
    for name in ours - known:
        found = find_spec(name)
        assert found is not None
        assert folder in Path(str(found.origin)).parents


def test_a_lightmap_is_unwrapped_once_and_again_when_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = build("cornell-box")
    first = cached_lightmap(scene, 300, tmp_path)
    (file,) = (tmp_path / "lightmaps").iterdir()

    import gibench.scene.lightmap.atlas as atlas

    calls = []
    unwrap = atlas.unwrap
    monkeypatch.setattr(atlas, "unwrap", lambda *a: calls.append(a) or unwrap(*a))
    again = cached_lightmap(scene, 300, tmp_path)
    assert not calls
    assert again.content_hash() == first.content_hash()
    assert again.requested == first.requested
    np.testing.assert_array_equal(again.receivers.area, first.receivers.area)

    file.write_bytes(file.read_bytes()[:-100])
    assert cached_lightmap(scene, 300, tmp_path).content_hash() == first.content_hash()
    assert len(calls) == 1
    cached_lightmap(replace(scene, lights=()), 300, tmp_path)
    assert len(calls) == 1  # lights have no part in it
    cached_lightmap(replace(scene, normals=-scene.normals), 300, tmp_path)
    assert len(calls) == 2  # other content, other file
