"""What normal maps make of a normal, in float64."""

from __future__ import annotations

import numpy as np

from gibench.scene.lightmap.albedo import bilinear
from gibench.scene.normal_maps import packed_normals, unpacked_normals


def mapped(scene, triangle, b, normal, geometric):
    """``mapped_normal`` of kernels_cl/common/normal_map.cl in float64 for one point."""
    maps = scene.normal_maps
    row = np.flatnonzero(maps.triangle == triangle)
    if not len(row):
        return normal
    r = row[0]
    pixels = maps.images[maps.image[r]]
    image = unpacked_normals(packed_normals(pixels)).reshape(pixels.shape)
    bent = bilinear(image, (b @ maps.uvs[r].astype(float))[None])[0]
    tangent = b @ maps.tangents[r, :, :3].astype(float)
    bitangent = maps.tangents[r, 0, 3] * np.cross(normal, tangent)
    found = maps.scale[r] * (bent[0] * tangent + bent[1] * bitangent) + bent[2] * normal
    return normal if found @ geometric <= 0 else found / np.linalg.norm(found)
