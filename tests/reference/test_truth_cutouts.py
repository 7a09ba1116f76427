"""The truth of masked leaves against that of the same holes cut in the mesh."""

from dataclasses import replace

import numpy as np
import pytest
from support.cut_scenes import CAMERA, floor_of, leaves
from support.reference_scenes import lightmap_of
from support.standard_errors import pooled

from gibench.reference.path_tracer import reference_image, reference_irradiance


def agree(one, other, sigmas=4.5):
    spread = np.hypot(pooled(one.stderr), pooled(other.stderr)) + 1e-6
    off = (one.value - other.value) / spread
    assert np.abs(off).max() < sigmas
    whole = (one.value - other.value).mean(axis=0) / (np.sqrt((spread**2).sum(axis=0)) / len(off))
    assert np.abs(whole).max() < 4
    assert one.relative_error < 0.05


@pytest.mark.parametrize(
    "light", [{}, {"lights": (), "glow": (3.0, 2.0, 1.0)}, {"lights": (), "sky": 1.0}],
    ids=["lamp", "glowing leaves", "sky"],
)  # fmt: skip
def test_irradiance_is_that_of_the_holes(rng, light):
    """Walls, and the leaves themselves: a lamp's shadows, leaves that are sampled as lights."""
    both = leaves(rng, count=6, **light)
    if "sky" in light:  # a room without a ceiling
        both = both._replace(
            masked=opened(both.masked), meshed=opened(both.meshed), leaf_of=(None, None)
        )
    found = []
    for scene, seed in ((both.masked, 1), (both.meshed, 2)):
        lightmap = lightmap_of(scene, [[triangle] for triangle in floor_of(scene)])
        found.append(reference_irradiance(scene, lightmap, target_error=0.03, seed=seed))
    agree(*found)


def opened(scene):
    """The scene without its ceiling, which is moved far below."""
    positions = scene.positions.copy()
    ceiling = scene.corners[:, :, 1].min(axis=1) > 1 - 1e-6
    positions[scene.triangles[ceiling].reshape(-1)] -= (0, 50, 0)
    return replace(scene, positions=positions.astype(np.float32))


def test_camera_images_agree(rng):
    both = leaves(rng, count=6, glow=(0.5, 0.2, 0.1))
    images = [
        reference_image(scene, CAMERA, 12, 12, paths=4096, seed=seed)
        for scene, seed in ((both.masked, 1), (both.meshed, 2))
    ]
    spread = np.hypot(*(pooled(image.stderr) for image in images)) + 1e-6
    assert (np.abs(images[0].value - images[1].value) / spread).max() < 5.5
