"""The albedo of pieces of surface, textures averaged over them."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Doubles, Floats, Longs
from gibench.scene.lightmap.raster import clip
from gibench.scene.model import Scene

# A piece that covers more pixels than this at full resolution is averaged over halved images.
# Halved pixels blur across the piece's outline: at 64, one white-noise triangle in 240 came out
# further off than 0.02 + 0.3 / sqrt(pixels); at 256, none of 2160.
MOST_PIXELS = 256.0
# Samples along each side of a piece: one per pixel it covers, at most 16 x 16 = MOST_PIXELS.
SIDES = (1, 2, 4, 8, 16)


def mean_albedo(scene: Scene, triangle: Longs, barycentric: Doubles) -> Doubles:
    """Albedo (m, 3) averaged over pieces of the scene's triangles.

    Args:
        scene: the scene.
        triangle: (m,) triangle of each piece.
        barycentric: (m, 3, 3) each piece's corners in barycentric coordinates of its triangle.
    """
    base = np.array([m.base_color for m in scene.materials], np.float64)
    texture = np.array([m.texture for m in scene.materials], np.int64)
    material = scene.material_ids[triangle]
    albedo = base[material]
    for number, image in enumerate(scene.textures):
        own = np.flatnonzero(texture[material] == number)
        if len(own):
            uvs = scene.uvs[scene.triangles[triangle[own]]].astype(np.float64)
            albedo[own] *= mean_texture(image.pixels, barycentric[own] @ uvs)
    return np.asarray(albedo)


def mean_texture(pixels: Floats, uvs: Doubles) -> Doubles:
    """Mean (m, 3) of a repeated, bilinear image over triangles ``uvs`` (m, 3, 2) of it."""
    result = np.zeros((len(uvs), 3))
    # Half the square of the longest side: the area of a compact piece, but a sliver that crosses
    # many pixels counts for all it crosses.
    sides = (np.roll(uvs, 1, axis=1) - uvs) * [pixels.shape[1], pixels.shape[0]]
    covered = (sides**2).sum(axis=2).max(axis=1) / 2
    todo = np.arange(len(uvs))
    image = pixels.astype(np.float64)
    while len(todo):
        height, width = image.shape[:2]
        share = covered[todo] * (height * width) / (pixels.shape[0] * pixels.shape[1])
        last = height < 2 or width < 2
        now = share <= MOST_PIXELS if not last else np.ones(len(todo), np.bool_)
        side = np.searchsorted(np.square(SIDES[:-1]), share[now])
        for step, count in enumerate(SIDES):
            own = todo[now][side == step]
            for first in range(0, len(own), 1 << 17):
                some = own[first : first + (1 << 17)]
                result[some] = _sampled(image, uvs[some], count)
        todo = todo[~now]
        if len(todo):
            image = _halved(image)
    return result


def _halved(image: Doubles) -> Doubles:
    """The image at half its size, box filtered; an odd last row or column joins the one before."""
    for axis in (0, 1):
        size = image.shape[axis]
        edges = np.arange(0, size - 1, 2)
        counts = np.diff(np.append(edges, size))
        shape = [1, 1, 1]
        shape[axis] = len(edges)
        image = np.add.reduceat(image, edges, axis=axis) / counts.reshape(shape)
    return image


def _sampled(image: Doubles, uvs: Doubles, side: int) -> Doubles:
    """Mean over the centroids of ``side`` squared equal parts of each triangle."""
    total = np.zeros((len(uvs), 3))
    e, f = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    for i in range(side):
        for j in range(side - i):
            parts = [(i + 1 / 3, j + 1 / 3)]
            if i + j < side - 1:
                parts.append((i + 2 / 3, j + 2 / 3))
            for a, b in parts:
                total += bilinear(image, uvs[:, 0] + e * (a / side) + f * (b / side))
    return total / side**2


def bilinear(image: Doubles, uv: Doubles) -> Doubles:
    """The image (h, w, 3) at ``uv`` (m, 2), repeated; row 0 is v = 1."""
    height, width = image.shape[:2]
    x = uv[:, 0] * width - 0.5
    y = (1.0 - uv[:, 1]) * height - 0.5
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    columns, rows = (x0 % width, (x0 + 1) % width), (y0 % height, (y0 + 1) % height)
    top = image[rows[0], columns[0]] * (1 - fx) + image[rows[0], columns[1]] * fx
    bottom = image[rows[1], columns[0]] * (1 - fx) + image[rows[1], columns[1]] * fx
    return np.asarray(top * (1 - fy) + bottom * fy)


# Triangles that cover more texels than this are averaged by samples.
_MOST_EXACT = 1 << 22
# Twice the area over the square of the sides of what counts as a line in the image: clipping says
# nothing of it.
_FLAT = 1e-9
# Lines of an image that are averaged at once.
_LINES = 256


def covered_mean(pixels: Floats, uvs: Doubles) -> Doubles:
    """Mean (m, 3) of a repeated, bilinear image over triangles ``uvs`` (m, 3, 2): the integral.

    Between the centres of texels a bilinear image is a polynomial of second degree, whose mean over
    a triangle is that over the middles of its sides; so triangles are cut along lines through the
    centres. Those without an area in the image are averaged along their line; those that cover
    millions of texels over samples (:func:`mean_texture`).
    """
    height, width = pixels.shape[:2]
    image = pixels.astype(np.float64)
    at = np.stack((uvs[..., 0] * width - 0.5, (1.0 - uvs[..., 1]) * height - 0.5), axis=-1)
    spans = np.ptp(at, axis=1) + 1
    exact = spans.prod(axis=1) <= _MOST_EXACT
    sums, shares = np.zeros((len(uvs), 3)), np.zeros(len(uvs))
    chosen = np.flatnonzero(exact)
    for pieces in clip(at[chosen]):
        owner, b = chosen[pieces.triangle], pieces.barycentric
        e, f = b[:, 1, 1:] - b[:, 0, 1:], b[:, 2, 1:] - b[:, 0, 1:]
        share = np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])
        for i in range(3):
            middle = np.einsum("mc,mcx->mx", (b[:, i] + b[:, i - 1]) / 2, uvs[owner])
            np.add.at(sums, owner, bilinear(image, middle) * (share / 3)[:, None])
        np.add.at(shares, owner, share)
    # Of all, so that what clipping leaves out is like the rest.
    found = shares > 0.5
    result = np.empty((len(uvs), 3))
    result[found] = sums[found] / shares[found, None]
    a, b = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    flat = np.flatnonzero(exact & (~found | (area < _FLAT * (a**2 + b**2).sum(axis=1))))
    for part in np.array_split(flat, -(-len(flat) // _LINES)) if len(flat) else ():
        result[part] = _line_mean(image, uvs[part], spans[part].max())
    if not exact.all():
        result[~exact] = mean_texture(pixels, uvs[~exact])
    return result


def _line_mean(image: Doubles, uvs: Doubles, texels: float) -> Doubles:
    """Mean (m, 3) over triangles (m, 3, 2) that are a line in the image, or a point.

    The area over a stretch of the line rises from one end to the middle corner, then falls.
    """
    sides = uvs - np.roll(uvs, 1, axis=1)
    rows = np.arange(len(uvs))
    longest = (sides**2).sum(axis=2).argmax(axis=1)
    along, start = sides[rows, longest], uvs[rows, longest - 1]
    between = uvs[rows, longest - 2] - start
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    middle = np.clip((between * along).sum(axis=1) / square, 1e-9, 1 - 1e-9)[:, None]
    t = (np.arange(count := int(16 * texels) + 16) + 0.5)[None] / count
    weights = np.minimum(t / middle, (1 - t) / (1 - middle))
    at = start[:, None] + t[..., None] * along[:, None]
    values = bilinear(image, at.reshape(-1, 2)).reshape(len(uvs), count, -1)
    return np.asarray((values * weights[..., None]).sum(axis=1) / weights.sum(axis=1)[:, None])


def mean_emission(scene: Scene, triangle: Longs, barycentric: Doubles) -> Doubles:
    """Emitted radiance (m, 3) averaged over pieces of the scene's triangles, as
    :func:`mean_albedo`.
    """
    emission = np.array([m.emission for m in scene.materials], np.float64)
    found = emission[scene.material_ids[triangle]]
    if scene.glow is not None:
        rows = scene.glow.rows(len(scene.triangles))[triangle]
        mine = np.flatnonzero(rows >= 0)
        uvs = barycentric[mine] @ scene.glow.uvs[rows[mine]].astype(np.float64)
        image = scene.glow.image[rows[mine]]
        for number, pixels in enumerate(scene.glow.images):
            own = np.flatnonzero(image == number)
            if len(own):
                found[mine[own]] = covered_mean(pixels, uvs[own])
    return np.asarray(found)
