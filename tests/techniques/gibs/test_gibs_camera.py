"""What GIBS keeps of what the camera sees, traced ray by ray and in packets."""

from dataclasses import replace

import numpy as np
import pytest
from support.gibs_scenes import furnished, gibs

from gibench.techniques.parts.camera_pass import camera_launch, suits_packets
from gibench.techniques.registry import PUBLISHED, TUNED

WIDTH, HEIGHT = 51, 37


def camera_program(technique):
    (camera,) = (item for item in technique.passes() if item.name == "camera")
    (launch,) = camera.launches()
    return launch.program.path


def test_tuned_traces_packets_as_other_techniques_do(monkeypatch):
    technique = gibs(furnished(), TUNED, surfels=100, grid_cells=6)
    wide = suits_packets(technique.device)
    assert camera_program(technique) == f"parts/camera{'_packet' if wide else ''}.cl"
    for suits, name in ((True, "camera_packet"), (False, "camera")):
        monkeypatch.setattr("gibench.techniques.gibs.technique.suits_packets", lambda _, s=suits: s)
        assert camera_program(gibs(furnished(), TUNED, surfels=100, grid_cells=6)) == (
            f"parts/{name}.cl"
        )
        assert camera_program(gibs(furnished(), PUBLISHED, surfels=100, grid_cells=6)) == (
            "parts/camera.cl"
        )


def around(image, pick):
    """The least or the largest of the 3 x 3 pixels around each."""
    grown = np.pad(image, ((1, 1), (1, 1), (0, 0)), "edge")
    shifted = [grown[y : y + HEIGHT, x : x + WIDTH] for y in range(3) for x in range(3)]
    return pick(np.stack(shifted), axis=0)


@pytest.mark.parametrize("size", [7, 64, 100])
def test_packets_keep_the_same_surfaces(size, rng):
    """Where both rays meet the same plane of the same object, the same place on it within rounding;
    elsewhere the ray passes an edge, and what lies beyond shows in a pixel beside it.
    """
    scene = furnished()
    camera = scene.cameras[0]
    moved = tuple(np.array(camera.position) + rng.uniform(-0.2, 0.2, 3))
    scene = replace(scene, cameras=(replace(camera, position=moved),))
    technique = gibs(scene, TUNED, width=WIDTH, height=HEIGHT, surfels=100, grid_cells=6)
    technique.begin_frame(0)
    view, device = technique.view, technique.device
    found = []
    for packets in (False, True):
        for buffer in (view.position, view.normal, view.albedo, view.direct):
            device.write(buffer, np.full(buffer.shape, 99, np.float32))
        device.enqueue(camera_launch(technique.scene, view, view.direct, packets), size)
        read = [device.read(b).reshape(HEIGHT, WIDTH, -1) for b in
                (view.position, view.normal, view.albedo, view.direct)]  # fmt: skip
        found.append((read[0][..., 3].view(np.int32), read[0][..., :3], *read[1:]))
    (objects, places, normals, albedos, direct), packed = found
    assert len(np.unique(objects)) == 3 and objects.min() > 0
    same = (objects == packed[0]) & np.isclose(normals, packed[2], atol=1e-6).all(axis=2)
    np.testing.assert_allclose(packed[3][same], albedos[same], rtol=1e-6)
    sight = places.astype(np.float64) - moved
    distance = np.linalg.norm(sight, axis=2)
    cosine = np.abs((sight * normals[..., :3]).sum(axis=2)) / distance
    # A rounding of the ray or the plane moves a hit by so much along the ray, and the plane by
    # as much more as it is seen aslant; coordinates are of 4 m at most.
    allowed = 4 * 4 * 2.0**-23 * (1 + distance) / np.maximum(cosine, 1e-6)
    off = np.linalg.norm(places - packed[1], axis=2)
    assert (off[same] <= allowed[same]).all()
    for y, x in np.argwhere(~same):
        beside = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        there = (objects[beside] == packed[0][y, x]) & np.isclose(
            normals[beside], packed[2][y, x], atol=1e-6
        ).all(axis=2)
        assert there.any()
    room = 1e-3 * direct.max()
    assert (packed[4] >= around(direct, np.min) - room).all()
    assert (packed[4] <= around(direct, np.max) + room).all()
