"""The light that a volume's probes hold: without visibility it is that of probes that see all."""

from dataclasses import replace

import numpy as np
import pytest
from support.ddgi_oracle import create
from support.shading_oracle import open_device
from support.synthetic_bake import random_scene

from gibench.techniques.parts.octahedral_maps import OctahedralMaps


def gathered(technique, visibility):
    """Irradiance at random points, by the kernel with and without the test on distances."""
    rng = np.random.default_rng(4)
    device, count = technique.device, 300
    normal = rng.normal(size=(count, 3))
    buffers = (
        device.upload("gather_points", rng.uniform(-1.5, 1.5, (count, 3)).astype(np.float32)),
        device.upload(
            "gather_normals", (normal / np.linalg.norm(normal, axis=1)[:, None]).astype(np.float32)
        ),
        device.upload("gather_found", np.zeros((count, 3), np.float32)),
    )
    launch = technique._passes.receivers(*buffers)
    if not visibility:
        program = replace(launch.program, defines={**launch.program.defines, "PROBE_VISIBILITY": 0})
        args = [argument for argument in launch.args if argument.name != "distance_maps"]
        launch = replace(launch, program=program, args=args)
    device.enqueue(launch, 64)
    found = device.read(buffers[2])
    device.release(*buffers)
    return found


@pytest.mark.parametrize("variant", ["published", "tuned"])
def test_without_visibility_every_probe_sees_everything(rng, variant):
    technique = create(random_scene(rng), {"counts": "3x3x3", "storage": "fp32"}, variant)
    probes, device = technique.probes, technique.device
    data = device.read(probes.data)
    data[:, 3] = 3  # active, and its maps hold something
    device.write(probes.data, data)
    maps = rng.random(probes.irradiance.shape, np.float32)
    device.write(probes.irradiance, maps)
    # Nothing lies behind a mean distance of 100.
    device.write(probes.distance, np.full(probes.distance.shape, 100, np.float32))
    free = gathered(technique, visibility=False)
    assert (free > 0).any()
    np.testing.assert_allclose(gathered(technique, visibility=True), free, rtol=1e-5)
    near = rng.uniform(0.05, 0.2, probes.distance.shape).astype(np.float32)
    device.write(probes.distance, near)
    assert np.abs(gathered(technique, visibility=True) - free).max() > 0.01 * free.max()
    np.testing.assert_array_equal(gathered(technique, visibility=False), free)


@pytest.mark.parametrize("side", [2, 3, 4, 8, 17, 128])
@pytest.mark.parametrize(("channels", "storage"), [(4, "fp16"), (2, "fp16"), (2, "fp32")])
def test_borders_are_the_texels_across_the_edge(rng, side, channels, storage):
    device, maps = open_device(), OctahedralMaps(side, channels, storage)
    held = device.create(maps.buffer("maps", 3))
    values = rng.random(held.shape).astype(maps.dtype)
    device.write(held, values)
    device.enqueue(maps.border_copy(held), 64)
    inner = values[:, 1:-1, 1:-1]
    expected = values.copy()
    expected[:, 0, 1:-1], expected[:, -1, 1:-1] = inner[:, 0, ::-1], inner[:, -1, ::-1]
    expected[:, 1:-1, 0], expected[:, 1:-1, -1] = inner[:, ::-1, 0], inner[:, ::-1, -1]
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        expected[:, row, column] = inner[:, -1 - row, -1 - column]
    np.testing.assert_array_equal(device.read(held), expected)
    border = held.nbytes - inner.nbytes
    assert maps.border_bytes_of(3) == border
