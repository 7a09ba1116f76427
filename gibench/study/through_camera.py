"""Values of receivers as a camera sees them: the lightmap lookup of the forward pass."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Bools, Doubles
from gibench.rays.embree import scene_tracer
from gibench.reference.camera import image_plane
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene

Ints64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class View:
    """What a camera sees of the receivers.

    Attributes:
        seen: (h, w) pixels whose centre shows a front side with receivers.
        receivers: (k, 4) the receivers that each of the k seen pixels blends, row by row.
        weights: (k, 4) their shares, adding up to 1.
    """

    seen: Bools = field(repr=False)
    receivers: Ints64 = field(repr=False)
    weights: Doubles = field(repr=False)

    def of(self, values: npt.NDArray[Any]) -> Doubles:
        """The image (h, w, 3) of ``values`` (n, 3); black where nothing is seen."""
        image = np.zeros((*self.seen.shape, 3))
        image[self.seen] = np.einsum("kc,kcx->kx", self.weights, values[self.receivers])
        return image

    def error_of(self, stderr: npt.NDArray[Any]) -> Doubles:
        """The standard error (h, w, 3) of an image of values with independent ``stderr``."""
        image = np.zeros((*self.seen.shape, 3))
        squares = np.einsum("kc,kcx->kx", self.weights**2, stderr[self.receivers] ** 2)
        image[self.seen] = np.sqrt(squares)
        return image


def view(scene: Scene, lightmap: Lightmap, camera: Camera, width: int, height: int) -> View:
    """Look up the lightmap bilinearly at every pixel's centre, among texels with receivers.

    Raises:
        BadInput: the camera gives no image.
    """
    eye, forward, right, up = image_plane(camera, width, height)
    x = 2 * (np.arange(width) + 0.5) / width - 1
    y = 1 - 2 * (np.arange(height) + 0.5) / height
    directions = forward + x[None, :, None] * right + y[:, None, None] * up
    directions = directions.reshape(-1, 3)
    origins = np.broadcast_to(eye.astype(np.float32), directions.shape)
    hits = scene_tracer(scene).closest(
        np.ascontiguousarray(origins), np.ascontiguousarray(directions.astype(np.float32))
    )
    triangle = np.maximum(hits.triangle, 0)
    corners = scene.corners[triangle].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    front = (hits.triangle >= 0) & (np.einsum("nx,nx->n", normal, directions) < 0)
    share = np.stack([1.0 - hits.u.astype(np.float64) - hits.v, hits.u, hits.v], axis=1)
    at = np.einsum("nc,ncx->nx", share, lightmap.triangle_uvs[triangle].astype(np.float64))
    front &= np.isfinite(at).all(axis=1)
    at = np.where(front[:, None], at, 0.5) - 0.5
    low = np.floor(at).astype(np.int64)
    part = at - low
    table = lightmap.receiver_of_texel.reshape(lightmap.height, lightmap.width)
    receivers, weights = [], []
    for step_y in (0, 1):
        for step_x in (0, 1):
            column = np.clip(low[:, 0] + step_x, 0, lightmap.width - 1)
            row = np.clip(low[:, 1] + step_y, 0, lightmap.height - 1)
            found = table[row, column].astype(np.int64)
            weight = np.abs(1 - step_x - part[:, 0]) * np.abs(1 - step_y - part[:, 1])
            receivers.append(np.maximum(found, 0))
            weights.append(np.where(found >= 0, weight, 0.0))
    of_pixel = np.stack(weights, axis=1)
    total = of_pixel.sum(axis=1)
    seen = front & (total > 1e-6)
    return View(
        seen.reshape(height, width),
        np.stack(receivers, axis=1)[seen],
        of_pixel[seen] / total[seen, None],
    )
