"""The folder of small scenes after public reports (CASES.md in it), each with its right value.

The same kinds are built from scratch in ``test_files_of_people.py``; this is read where it lies.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from gibench.errors import BadInput
from gibench.scene.load import load_scene
from gibench.scene.model import Scene

REPOSITORY = Path(__file__).resolve().parents[2]


def _folder() -> Path | None:
    named = os.environ.get("GIBENCH_CASES")
    places = [Path(named)] if named else [
        Path("/work/shared/cases"), REPOSITORY.parent / "shared" / "cases",
    ]  # fmt: skip
    return next((place for place in places if place.is_dir()), None)


CASES = _folder()
pytestmark = pytest.mark.skipif(CASES is None, reason="no folder of cases (set GIBENCH_CASES)")

WHITE, RED, GREEN = (0.7, 0.7, 0.7), (0.8, 0.1, 0.1), (0.1, 0.8, 0.1)
PLAIN = (0.8, 0.8, 0.8)
LINEAR_64 = ((64 / 255 + 0.055) / 1.055) ** 2.4
LINEAR_16384 = ((16384 / 65535 + 0.055) / 1.055) ** 2.4
RIGHT_ROOM = (20.0, [WHITE, RED, GREEN])
# Case: (area, albedo of each used material in the order of the faces).
GEOMETRY = {
    "obj-bom/room.obj": RIGHT_ROOM,
    "obj-bom-vertex/room.obj": (20.0, [PLAIN] * 3),
    "obj-comment-backslash/room.obj": (20.0, [PLAIN] * 3),
    "obj-concave/chevron.obj": (3.0, [PLAIN]),
    "obj-concave/l.obj": (5.0, [PLAIN]),
    "obj-continuation/room.obj": RIGHT_ROOM,
    "obj-dissolve/room.obj": (12.0, [WHITE]),
    "obj-hash-names/room.obj": RIGHT_ROOM,
    "obj-hash-nospace/room.obj": RIGHT_ROOM,
    "obj-latin1/room.obj": (20.0, [(0.3, 0.2, 0.1), GREEN, PLAIN]),
    "obj-lib-comment/room.obj": RIGHT_ROOM,
    "obj-lib-spaces/my room.obj": RIGHT_ROOM,
    "obj-mac-cr/room.obj": RIGHT_ROOM,
    "obj-mtl-badline/room.obj": RIGHT_ROOM,
    "obj-mtl-bom/room.obj": RIGHT_ROOM,
    "obj-mtl-case/room.obj": (20.0, [WHITE, PLAIN, PLAIN]),
    "obj-two-libs/room.obj": RIGHT_ROOM,
    "obj-utm/room.obj": RIGHT_ROOM,
    "obj-vertex-colours/room.obj": (20.0, [(1.0, 0.0, 0.0)] * 3),
    "obj-img/g8_png.obj": (4.0, [(LINEAR_64,) * 3]),
    "obj-img/g16_png.obj": (4.0, [(LINEAR_16384,) * 3]),
    "obj-img/f32_tiff.obj": (4.0, [(0.25,) * 3]),
    "obj-img/t_webp.obj": (4.0, [(0.2159,) * 3]),
    "obj-img/cmyk_jpg.obj": (4.0, [(0.2159,) * 3]),
    "gltf-img/grey16.glb": (4.0, [(LINEAR_16384,) * 3]),
    "gltf-img/webp.glb": (4.0, [(0.2159,) * 3]),
    "gltf-img/cmyk.glb": (4.0, [(0.5776, 0.0452, 0.0130)]),
    "gltf-img/basisu-used.glb": (4.0, [(1.0, 1.0, 1.0)]),
    "gltf-specgloss/room.glb": (20.0, [(0.2, 0.1, 0.05)]),
    "gltf-specgloss/room-texture.glb": (20.0, [(0.1878, 0.0452, 0.0130)]),
    "gltf-vertex-colours/v.glb": (4.0, [(1.0, 0.0, 0.0)]),
    "gltf-container/bom.glb": (4.0, [(0.5,) * 3]),
    "gltf-container/bom.gltf": (4.0, [(0.5,) * 3]),
    "gltf-container/extra-chunk.glb": (4.0, [(0.5,) * 3]),
    "gltf-container/pct-uri.gltf": (4.0, [(0.5,) * 3]),
    "gltf-container/trailing.glb": (4.0, [(0.5,) * 3]),
    "gltf-container/unpadded.glb": (4.0, [(0.5,) * 3]),
    "gltf-interleaved/i.glb": (4.0, [(0.5,) * 3]),
    "gltf-percent/a.gltf": (4.0, [(0.5,) * 3]),
    "gltf-scenes/first-empty.glb": (4.0, [(0.5,) * 3]),
    "gltf-sparse/s.glb": (4.0, [(0.5,) * 3]),
    "gltf-quantised/q.glb": (32.0, [(0.3643, 0.3643, 0.0130)]),
    "gltf-window/none.glb": (22.0, [WHITE]),
    "gltf-window/transmission.glb": (22.0, [WHITE]),
    "gltf-window/blend.glb": (22.0, [WHITE]),
}
# Case: words of a warning that must be there.
SAID = {
    "obj-dissolve/room.obj": "let more light through than they stop left out (red, green)",
    "obj-map-options/clampoff.obj": "options of texture maps not used: -clamp on",
    "obj-utm/room.obj": "far from the origin: 448262, 120, -5411932 m subtracted",
    "gltf-alpha-leaves/blend.glb": "let more light through than they stop left out (material 1)",
    "gltf-animated/a.glb": "animations",
    "gltf-img/basisu-used.glb": "textures without a readable source",
    "gltf-lights/odd.glb": "lights of type 'ambient'",
    "gltf-unlit/room.glb": "unlit 1 material",
    "gltf-window/transmission.glb": "left out (glass)",
    "gltf-window/blend.glb": "left out (glass)",
    "gltf-scenes/first-empty.glb": "scenes without a mesh",
}
# Case: words of the refusal.
REFUSED = {
    "obj-decimal-comma/room.obj": "line 1: '-1,0' is no number; write numbers with a point",
    "gltf-container/trailing-comma.gltf": "not a glTF file",
    "gltf-container/utf16.gltf": "glTF is JSON in UTF-8",
    "gltf-img/basisu-required.glb": "KHR_texture_basisu",
    "gltf-meshopt/required.glb": "EXT_meshopt_compression",
    "gltf-meshopt/draco-not-required.glb": "compressed with KHR_draco_mesh_compression",
}


def _load(case: str) -> Scene:
    assert CASES is not None
    return load_scene(str(CASES / case))


def _areas(scene: Scene) -> np.ndarray:
    corners = scene.corners.astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    return np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2


@pytest.mark.parametrize("case", GEOMETRY)
def test_geometry_and_albedo(case: str, recwarn: pytest.WarningsRecorder) -> None:
    area, albedos = GEOMETRY[case]
    scene = _load(case)
    assert _areas(scene).sum() == pytest.approx(area, rel=1e-6)
    found = []
    for number in dict.fromkeys(scene.material_ids.tolist()):
        material = scene.materials[number]
        image = scene.textures[material.texture].pixels if material.texture >= 0 else np.ones(3)
        found.append(np.multiply(material.base_color, image.reshape(-1, 3).mean(axis=0)))
    np.testing.assert_allclose(found, albedos, atol=1e-4)
    assert not recwarn.list


@pytest.mark.parametrize("case", SAID)
def test_what_is_said(case: str) -> None:
    assert SAID[case] in " | ".join(_load(case).warnings)


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(case: str) -> None:
    with pytest.raises(BadInput) as caught:
        _load(case)
    assert REFUSED[case] in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("case", "corner", "far"),
    [("plain", 0.0, 0.5), ("scale", 0.0, 1.0), ("offset", 0.5, 1.0), ("clampoff", 0.0, 0.5)],
)
def test_scale_and_offset_of_texture_maps(case: str, corner: float, far: float) -> None:
    uvs = _load(f"obj-map-options/{case}.obj").uvs
    assert uvs[:, 0].min() == corner
    assert uvs[:, 0].max() == far


def test_a_map_of_emission_alone_glows() -> None:
    scene = _load("obj-mapke-only/q.obj")
    (number,) = set(scene.material_ids.tolist())
    assert max(scene.materials[number].emission) > 0.5
    assert not scene.lights


@pytest.mark.parametrize("case", ["mtl-subfolder", "win-path", "map-quoted"])
def test_textures_are_found_where_people_put_them(case: str) -> None:
    scene = _load(f"obj-{case}/q.obj")
    assert len(scene.textures) == 1
    assert not any("missing" in line or "not found" in line for line in scene.warnings)


@pytest.mark.parametrize("far", ["off100km", "off450km"])
def test_a_room_far_off_is_the_room_at_the_origin_bit_for_bit(far: str) -> None:
    scene, near = _load(f"gi-far/{far}.glb"), _load("gi-far/off0.glb")
    assert near.origin == (0, 0, 0)
    assert scene.origin == (float(far[3:6]) * 1000, 0, 0)
    for name in ("positions", "normals", "triangles"):
        np.testing.assert_array_equal(getattr(scene, name), getattr(near, name))
    np.testing.assert_allclose(scene.lights[0].position, near.lights[0].position, atol=1e-9)
    np.testing.assert_allclose(scene.cameras[0].position, near.cameras[0].position, atol=1e-9)
    np.testing.assert_allclose(scene.cameras[0].target, near.cameras[0].target, atol=1e-9)


def test_every_other_case_loads() -> None:
    assert CASES is not None
    kinds = (".obj", ".glb", ".gltf", ".toml")
    files = (str(p.relative_to(CASES)) for p in CASES.rglob("*") if p.suffix in kinds)
    for case in sorted(set(files) - set(REFUSED)):
        assert len(_load(case).triangles), case
