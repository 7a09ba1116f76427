"""What SRP makes of every pixel, and the points of surfaces that the pixels show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.techniques.parts.conformance.shading import Surface, bilinear, surface
from gibench.techniques.parts.macros import SHOW_INDIRECT, TILE_SIDE
from support.launches import run_pass


@dataclass
class Pixels:
    """Of the pixels that show a surface's front.

    Attributes:
        triangle: (n,) that each shows, as the camera's pass kept it.
        weights: (n, 3) of its corners.
        found: the surface there.
        view: (n, 3) unit, towards the camera.
        signal: (n, 4, 3) what the lightmap holds there, black without a place in it.
        direct: (n, 3) what was drawn.
        indirect: (n, 3) what was drawn.
    """

    triangle: np.ndarray
    weights: np.ndarray
    found: Surface
    view: np.ndarray
    signal: np.ndarray
    direct: np.ndarray
    indirect: np.ndarray


def drawn(technique, size, values, frame=3) -> Pixels:
    """Draw a frame with the signal ``values`` (h, w, 4, 4) at the receivers."""
    technique.device.write(technique.indirect.map, values.reshape(-1, 4))
    technique.scene.begin_frame(frame)
    run_pass(technique, "camera", size)
    shown = technique._application
    kept = technique.device.read(shown.hits.buffer)
    direct = technique.device.read(technique.scene.image)
    technique.device.enqueue(shown.launch(SHOW_INDIRECT), size)
    indirect = technique.device.read(technique.scene.image)
    height, width = direct.shape[:2]
    places = tiled_places(width, height, len(kept))
    triangle = kept[:, 0].view(np.int32)
    seen = np.flatnonzero((triangle >= 0) & (places[:, 0] >= 0))
    triangle, (u, v) = triangle[seen], kept[seen, 1:3].T.astype(np.float64)
    weights = np.stack([1 - u - v, u, v], axis=1)
    scene, lightmap = technique.scene.scene, technique.receivers.lightmap
    uvs = lightmap.triangle_uvs[triangle].astype(np.float64)
    at = np.einsum("nk,nkd->nd", weights, uvs)
    placed = ~np.isnan(at[:, 0])
    x, y = np.nan_to_num(at).T - 0.5
    flat = values[..., :3].reshape(*values.shape[:2], 12).astype(np.float64)
    signal = bilinear(flat, x, y, wrap=False).reshape(-1, 4, 3)
    found = surface(scene, triangle, u, v)
    view = np.array(scene.cameras[0].position) - found.position
    x, y = places[seen].T
    return Pixels(
        triangle,
        weights,
        found,
        view / np.linalg.norm(view, axis=1, keepdims=True),
        np.where(placed[:, None, None], signal, 0),
        direct[y, x],
        indirect[y, x],
    )


def tiled_places(width, height, items):
    """Column and row (items, 2) of each item in the order of kernels_cl/common/pixels.cl; -1 where
    it lies outside of the image.
    """
    tile, within = np.divmod(np.arange(items), TILE_SIDE**2)
    row, column = np.divmod(tile, -(-width // TILE_SIDE))
    # Every other bit of the number within a tile is a bit of the column, the others of the row.
    bits = within[:, None] >> np.arange(6) & 1
    x, y = bits[:, ::2] @ (1, 2, 4), bits[:, 1::2] @ (1, 2, 4)
    places = np.stack([column * TILE_SIDE + x, row * TILE_SIDE + y], axis=1)
    places[(places[:, 0] >= width) | (places[:, 1] >= height)] = -1
    return places
