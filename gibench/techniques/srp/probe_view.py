"""A picture of the probes: little spheres that show the radiance each sees in every direction."""

from __future__ import annotations

import math

import numpy as np

from gibench.arrays import Floats
from gibench.rays.embree import scene_tracer
from gibench.scene.model import (
    Camera,
    Scene,
)
from gibench.techniques.parts.camera_table import camera_table
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.technique import FloatArray

# A sphere's radius over the scene's diagonal: small enough that 150 do not hide the scene.
_RADIUS_SHARE = 0.012
# A probe nearer to the eye than this many radii would hide the view and is left out.
_NEAREST_RADII = 8.0


def probe_view(
    frame: FloatArray, camera: Camera, scene: Scene, positions: Floats, radiance: Floats
) -> FloatArray:
    """Draw the probes over a frame.

    The point of a sphere with outward normal n shows the probe's radiance from direction n, so the
    colours of a wall appear on the side of the sphere that faces it.

    Args:
        frame: (h, w, 3) W/m2/sr, the image to draw over.
        camera: that it was rendered with.
        scene: what may hide a probe.
        positions: (p, 3) of the probes, m.
        radiance: (p, c, 3) their SH coefficients, W/m2/sr.
    """
    image = np.array(frame, np.float32)
    height, width = image.shape[:2]
    table = camera_table(camera, width, height).astype(np.float64).reshape(4, 3)
    eye, forward, right, up = table
    low, high = scene.bounds
    radius = _RADIUS_SHARE * float(np.linalg.norm(high - low))
    x = (np.arange(width) + 0.5) / width * 2 - 1
    y = 1 - (np.arange(height) + 0.5) / height * 2
    directions = forward + x[None, :, None] * right + y[:, None, None] * up
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    nearest = np.full((height, width), np.inf)
    owner = np.full((height, width), -1)
    focal = height / (2 * np.linalg.norm(up))
    for probe, position in enumerate(np.asarray(positions, np.float64)):
        to_probe = position - eye
        depth = float(to_probe @ forward)
        if depth <= _NEAREST_RADII * radius:
            continue
        # The window of pixels the sphere can cover, then the exact intersection within it.
        centre_x = float(to_probe @ right) / (right @ right) / depth
        centre_y = float(to_probe @ up) / (up @ up) / depth
        reach = math.ceil(1.5 * focal * radius / (depth - radius)) + 1
        column = int((centre_x + 1) / 2 * width)
        row = int((1 - centre_y) / 2 * height)
        window = np.s_[
            max(row - reach, 0) : max(row + reach + 1, 0),
            max(column - reach, 0) : max(column + reach + 1, 0),
        ]
        along = directions[window] @ to_probe
        inside = radius**2 - (to_probe @ to_probe - along**2)
        distance = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
        closer = distance < nearest[window]
        nearest[window] = np.where(closer, distance, nearest[window])
        owner[window] = np.where(closer, probe, owner[window])
    rows, columns = np.nonzero(owner >= 0)
    if len(rows) == 0:
        return image
    d, t, probes = directions[rows, columns], nearest[rows, columns], owner[rows, columns]
    origins = np.broadcast_to(eye, d.shape)
    hidden = scene_tracer(scene).occluded(
        origins.astype(np.float32), d.astype(np.float32), t.astype(np.float32)
    )
    rows, columns, d, t, probes = (a[~hidden] for a in (rows, columns, d, t, probes))
    normals = (eye + d * t[:, None] - positions[probes]) / radius
    order = math.isqrt(radiance.shape[1]) - 1
    shown = np.einsum("nc,nck->nk", sh_basis(order, normals), radiance[probes])
    image[rows, columns] = np.maximum(shown, 0.0)
    return image
