"""Unwrapping: from a scene to the lightmap with a wanted number of receivers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gibench.arrays import Doubles, Floats, Longs
from gibench.errors import BadInput
from gibench.progress import progress
from gibench.scene.lightmap import Fragments, Lightmap, Receivers
from gibench.scene.lightmap.albedo import mean_albedo, mean_emission
from gibench.scene.lightmap.charts import Charts, covered_count, flatten, pack, triangle_areas
from gibench.scene.lightmap.holes import kept_texels, without_holes
from gibench.scene.lightmap.raster import Pieces, clip
from gibench.scene.model import Scene

# The receiver count is met within 1 %; the search stops well inside that.
CLOSE_ENOUGH = 0.002
LONGEST_SECANT = 5
LONGEST_SEARCH = 16
# With cut-outs: how close is close enough, and how many times more the resolution is searched for.
HIT = 0.005
MOST_AIMS = 6
# Share of the resolution that the surface's area alone asks for, below which no search goes.
COARSEST = 0.01
# An atlas of more receivers than so many times those asked for is refused.
MOST_TIMES = 2.0
# Where a receiver's centroid lies off its surface: a fragment is a sliver below this share of the
# largest one, and the nearest point moves by this share towards the middle of its fragment.
SLIVER = 0.1
DRAWN_INWARDS = 0.5
PART = 1 << 20  # fragments worked on at a time


Packed = tuple[Floats, int, int, list[Pieces]]
"""A packed atlas, its width and height and what its texels cover."""


def unwrap(scene: Scene, receivers: int, *, padding: int = 1) -> Lightmap:
    """Flatten the scene into an atlas whose valid texels number ``receivers``, within 1 %.

    Charts come from the scene's lightmap coordinates or from xatlas; the resolution is searched
    for, then the charts are packed once. Fragments are exact: their areas add up to the surface.
    A very coarse atlas cannot have fewer texels than charts; it then has as few as it can, unless
    that is more than twice what was asked for. With cut-outs the number is met as closely as a few
    tries come.

    Args:
        scene: what to unwrap.
        receivers: number of valid texels to aim for.
        padding: free texels around each chart; 1 keeps the bilinear footprint of any point of one
            chart off the texels of another and gives each chart a border of its own to dilate into.

    Raises:
        BadInput: ``receivers`` or ``padding`` is out of range, the scene has no surface, or it
            falls into too many charts for so few receivers.
    """
    if receivers < 1:
        raise BadInput(f"{receivers} receivers asked for", where="receivers", mend="ask for >= 1")
    if padding < 0:
        raise BadInput(f"padding of {padding} texels", where="padding", mend="use 0 or more")
    surface = float(triangle_areas(scene.corners.astype(np.float64)).sum())
    if not surface > 0:
        raise BadInput("the scene has no surface", where=scene.name, mend="give it triangles")
    with progress(f"Unwrapping {scene.name}", 4) as advance:
        charts = flatten(scene, surface / receivers)
        advance(1)
        scale = _search(scene, charts, receivers)
        advance(1)
        if scene.cutouts is None:
            packed = _packed(scene, charts, scale, padding)
        else:
            packed = _with_as_many_left(scene, charts, scale, receivers, padding)
        uvs, width, height, pieces = packed
        advance(1)
        fragments, texel = _fragments(scene, pieces, width)
        found = _receivers(scene, pieces, fragments, texel)
        advance(1)
    return Lightmap(width, height, uvs, found, fragments, receivers)


def _with_as_many_left(
    scene: Scene, charts: Charts, scale: float, receivers: int, padding: int
) -> Packed:
    """The atlas of which ``receivers`` texels are left when holes are taken out.

    As :func:`_search`, by the secant method, then by bisection; of all that were tried, the best.
    """
    tried: list[tuple[float, float]] = []
    best, off = None, np.inf
    at = float(np.log(scale))
    while best is None or (off > HIT and len(tried) < MOST_AIMS):
        packed = _packed(scene, charts, float(np.exp(at)), padding)
        left = float(np.log(max(1, len(kept_texels(packed[3], packed[1]))) / receivers))
        tried.append((at, left))
        if abs(left) < off:
            best, off = packed, abs(left)
        below = [x for x, y in tried if y < 0]
        above = [x for x, y in tried if y > 0]
        if below and above and len(tried) > 2:
            at = (max(below) + min(above)) / 2
            continue
        slope = 1.8
        if len(tried) > 1:
            (x0, y0), (x1, y1) = tried[-2:]
            slope = float(np.clip((y1 - y0) / (x1 - x0 or 1.0), 0.5, 2.2))
        at -= left / slope
    return best


def _packed(scene: Scene, charts: Charts, scale: float, padding: int) -> Packed:
    uvs, width, height = pack(charts, scale, padding)
    pieces = list(clip(uvs.astype(np.float64)))
    if scene.cutouts is not None:
        pieces = [without_holes(scene.cutouts, one, len(scene.triangles)) for one in pieces]
    return uvs, width, height, pieces


def _search(scene: Scene, charts: Charts, receivers: int) -> float:
    """The texels per unit at which the charts cover ``receivers`` texels.

    The count grows as area times scale squared plus outline times scale; in its logarithm it is
    nearly straight, so the secant method needs a few evaluations. Where charts are few the count
    jumps as they gain a row; then bisection closes in on the jump. The best scale seen is kept.
    Below ``COARSEST`` of the first guess nothing but one texel per chart is left to find.
    """
    scale = float(np.log(np.sqrt(receivers / np.abs(_uv_areas(charts)).sum())))
    coarsest = scale + float(np.log(COARSEST))
    tried: list[tuple[float, float]] = []
    for step in range(LONGEST_SEARCH):
        count = covered_count(charts, float(np.exp(scale)))
        tried.append((scale, float(np.log(max(count, 1) / receivers))))
        if abs(count / receivers - 1) <= CLOSE_ENOUGH:
            break
        below = [x for x, y in tried if y < 0]
        above = [x for x, y in tried if y > 0]
        if step >= LONGEST_SECANT and below and above:
            scale = (max(below) + min(above)) / 2
            continue
        slope = 1.8
        if len(tried) > 1:
            (x0, y0), (x1, y1) = tried[-2:]
            slope = float(np.clip((y1 - y0) / (x1 - x0 or 1.0), 0.2, 2.2))
        if scale <= coarsest:
            break
        scale = max(scale - tried[-1][1] / slope, coarsest)
    best, off = min(tried, key=lambda point: abs(point[1]))
    if off > np.log(MOST_TIMES):
        least = round(receivers * float(np.exp(off)))
        raise BadInput(
            f"{receivers:,} receivers are too few for {charts.count:,} charts",
            where=scene.name,
            mend=f"ask for {least:,} or more",
        )
    return float(np.exp(best))


def _uv_areas(charts: Charts) -> Doubles:
    uvs = charts.uvs[charts.chart >= 0]
    e, f = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    return np.asarray((e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]) / 2)


def _fragments(scene: Scene, pieces: list[Pieces], width: int) -> tuple[Fragments, Longs]:
    """Fragments sorted by texel, and the texels that own them, ascending.

    ``pieces`` is sorted in place into one element, in the fragments' order.
    """
    texel = np.concatenate([p.y * width + p.x for p in pieces])
    order = np.argsort(texel, kind="stable")
    triangle = np.concatenate([p.triangle for p in pieces])[order]
    barycentric = np.concatenate([p.barycentric for p in pieces])
    pieces.clear()  # large meshes have millions of them
    barycentric = barycentric[order]
    texel = texel[order]
    pieces[:] = [Pieces(triangle, texel % width, texel // width, barycentric)]
    own, first = np.unique(texel, return_index=True)
    start = np.append(first, len(texel)).astype(np.int64)
    corners = np.empty((len(texel), 3, 3), np.float32)
    area = np.empty(len(texel), np.float32)
    for part in _parts(len(texel)):
        whole = scene.positions[scene.triangles[triangle[part]]].astype(np.float64)
        exact = barycentric[part] @ whole
        corners[part], area[part] = exact, triangle_areas(exact)
    return Fragments(start, corners, triangle.astype(np.int32), area), own


def _parts(count: int) -> Iterator[slice]:
    """Stretches of ``count`` rows, which keep what is computed of them on the way small."""
    return (slice(first, first + PART) for first in range(0, count, PART))


def _receivers(scene: Scene, pieces: list[Pieces], fragments: Fragments, texel: Longs) -> Receivers:
    """Averages over every texel's fragments, by area."""
    triangle, barycentric = pieces[0].triangle, pieces[0].barycentric
    corners = fragments.corners.astype(np.float64)
    start = fragments.start[:-1]
    owner = np.repeat(np.arange(len(texel)), np.diff(fragments.start))
    # Texels of hair-thin triangles can have no area in float64; their fragments then count alike.
    weight = fragments.area.astype(np.float64)
    area = np.add.reduceat(weight, start)
    weight = np.where((area > 0)[owner], weight, 1.0)
    total = np.add.reduceat(weight, start)[:, None]

    def mean(values: Doubles) -> Doubles:
        return np.asarray(np.add.reduceat(values * weight[:, None], start, axis=0) / total)

    shading = np.empty((len(triangle), 3))
    for part in _parts(len(triangle)):
        normals = scene.normals[scene.triangles[triangle[part]]]
        shading[part] = np.einsum("mk,mki->mi", barycentric[part].mean(axis=1), normals)
    return Receivers(
        texel=texel.astype(np.int32),
        position=_nearest(corners, mean(corners.mean(axis=1)), start, owner).astype(np.float32),
        normal=_unit(mean(shading), corners, weight, start, owner).astype(np.float32),
        albedo=mean(mean_albedo(scene, triangle, barycentric)).astype(np.float32),
        emission=mean(mean_emission(scene, triangle, barycentric)).astype(np.float32),
        area=area.astype(np.float32),
    )


def _unit(
    normal: Doubles, corners: Doubles, weight: Doubles, start: Longs, owner: Longs
) -> Doubles:
    """Normals made unit; where they cancel, the face normal of the texel's largest fragment."""
    length = np.linalg.norm(normal, axis=1)
    lost = np.flatnonzero(length < 1e-3)
    if len(lost):
        order = np.lexsort((-weight, owner))
        largest = corners[order[start[lost]]]
        normal[lost] = np.cross(largest[:, 1] - largest[:, 0], largest[:, 2] - largest[:, 0])
        length = np.linalg.norm(normal, axis=1)
        up = lost[length[lost] == 0]
        normal[up], length[up] = (0.0, 1.0, 0.0), 1.0
    return np.asarray(normal / length[:, None])


def _nearest(corners: Doubles, point: Doubles, start: Longs, owner: Longs) -> Doubles:
    """The point of every receiver's surface nearest to its centroid ``point`` (n, 3).

    The centroid of a curved, folded or holed patch lies off the patch, possibly inside a wall. The
    nearest point may then lie on the patch's outline, where a wall begins; it is drawn inwards.
    Slivers beside a larger fragment are passed over.
    """
    candidate = np.empty((len(owner), 3))
    for part in _parts(len(owner)):
        candidate[part] = closest_point(corners[part], point[owner[part]])
    distance = np.linalg.norm(candidate - point[owner], axis=1)
    area = triangle_areas(corners)
    largest = np.maximum.reduceat(area, start)[owner]
    sliver = (area < SLIVER * largest) & (distance > 0)
    best = np.lexsort((distance, sliver, owner))[start]
    size = np.sqrt(np.add.reduceat(area, start))
    off = distance[best] > 1e-4 * size
    inwards = corners[best].mean(axis=1) - candidate[best]
    return np.asarray(candidate[best] + np.where(off, DRAWN_INWARDS, 0.0)[:, None] * inwards)


def closest_point(corners: Doubles, point: Doubles) -> Doubles:
    """The point of each triangle (m, 3, 3) nearest to ``point`` (m, 3), shape (m, 3).

    The foot of the perpendicular where it falls inside, else the nearest point of the three edges.
    """
    e, f = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e, f)
    square = np.maximum((normal**2).sum(axis=1), 1e-300)
    to = point - corners[:, 0]
    v = (np.cross(to, f) * normal).sum(axis=1) / square
    w = (np.cross(e, to) * normal).sum(axis=1) / square
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    best = corners[:, 0] + v[:, None] * e + w[:, None] * f
    distance = np.where(inside, 0.0, np.inf)
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        along = b - a
        length = np.maximum((along**2).sum(axis=1), 1e-300)
        t = np.clip(((point - a) * along).sum(axis=1) / length, 0, 1)
        foot = a + t[:, None] * along
        far = ((foot - point) ** 2).sum(axis=1)
        nearer = far < distance
        best[nearer], distance[nearer] = foot[nearer], far[nearer]
    return np.asarray(best)
