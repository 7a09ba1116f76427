"""The bake as kernels read it, and how large that is: every buffer is declared here, once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.device import BufferSpec, Define
from gibench.scene.model import DirectionalLight, Scene, SpotLight
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.recolouring import Shares
from gibench.techniques.surfel_cache.bake.data import (
    LINK_SCALE,
    Hierarchy,
    Links,
    SurfelBake,
)
from gibench.techniques.surfel_cache.settings import STORED, SurfelCacheSettings
from gibench.techniques.surfel_cache.shared_exponent import MOST, encode

Words = npt.NDArray[np.uint32]
Arrays = dict[str, npt.NDArray[Any]]

NO_PLACE: Final = 0xFFFFFFFF
"""In place of a surfel's place in the map, where it has none."""
LIT, DILATED = 1.0, 0.5
"""Marks of a texel of the map: there is a cache; its neighbours' mean stands there."""
MARK_MACROS: Final[Mapping[str, Define]] = {"CACHE_LIT": LIT, "CACHE_DILATED": DILATED}
"""Of every program that includes kernels_cl/surfel_cache/coefficients.cl."""
_Y0: Final = 0.28209479177387814
# The least half that is not subnormal; what is smaller is stored as 0.
_LEAST_HALF: Final = 2.0**-14
# Surfels beneath a subtree that one work-item pulls in the tuned variant, and how many there are.
_SUBTREE: Final = 64
_SUBTREES: Final = 1024
# For what it will take about: a map may hold more caches than it aims for, gutters of charts are
# empty texels, and links are padded to the widest vectors that devices prefer.
_MORE_CACHES: Final = 1.05
_TEXELS_PER_CACHE: Final = 3
_WIDEST_VECTOR: Final = 16


@dataclass(frozen=True)
class Sizes:
    """All that decides how much a frame holds.

    Attributes:
        surfels: in the hierarchy.
        triangles: of the scene.
        slots: caches that there is room for.
        links: of each, with those that fill the last vector up.
        coefficients: of a cache, per channel.
        stored: links hold coefficients; else directions.
        texels: of the caches' map.
        cells: of their grid.
        environment: whether caches see any.
        tuned: the variant.
        border: texels that are dilated.
        subtrees: that are pulled side by side in the tuned variant.
    """

    surfels: int
    triangles: int
    slots: int
    links: int
    coefficients: int
    stored: bool
    texels: int
    cells: int
    environment: bool
    tuned: bool
    border: int = 0
    subtrees: int = 1

    @staticmethod
    def of(bake: SurfelBake, settings: SurfelCacheSettings, tuned: bool, vector: int) -> Sizes:
        """What ``bake`` takes."""
        caches = bake.caches
        return Sizes(
            surfels=len(bake.surfels),
            triangles=len(caches.atlas.triangle_uvs),
            slots=max(caches.on_map + caches.in_grid, least_slots(settings)),
            links=padded_links(settings.links, tuned, vector),
            coefficients=settings.coefficients,
            stored=settings.projection == STORED,
            texels=caches.atlas.width * caches.atlas.height,
            cells=caches.volume.probes,
            environment=caches.environment is not None,
            tuned=tuned,
            border=len(border_of(bake)),
            subtrees=len(pull_order(bake.hierarchy)[1]) - 2,
        )

    @staticmethod
    def least(settings: SurfelCacheSettings, scene: Scene, cells: int, tuned: bool) -> Sizes:
        """The least that it takes, before anything is baked."""
        return Sizes(
            surfels=settings.surfels,
            triangles=len(scene.triangles),
            slots=least_slots(settings),
            links=settings.links,
            coefficients=settings.coefficients,
            stored=settings.projection == STORED,
            texels=least_slots(settings),
            cells=cells,
            environment=bool(np.asarray(scene.environment.pixels).any()),
            tuned=tuned,
        )

    @staticmethod
    def expected(settings: SurfelCacheSettings, scene: Scene, cells: int, tuned: bool) -> Sizes:
        """About what it takes, before anything is baked: every cache that is asked for, a little
        more than the map aims for, and gutters as wide as they come.
        """
        caches = math.ceil(_MORE_CACHES * settings.caches)
        return replace(
            Sizes.least(settings, scene, cells, tuned),
            slots=caches + cells,
            links=padded_links(settings.links, tuned, _WIDEST_VECTOR),
            texels=_TEXELS_PER_CACHE * caches,
            border=_TEXELS_PER_CACHE * caches if tuned else 0,
            subtrees=_SUBTREES,
        )

    def buffers(self) -> list[BufferSpec]:
        """What is held, scene and image apart."""
        of, u16, u32, i32, f32 = BufferSpec.of, np.uint16, np.uint32, np.int32, np.float32
        n, nodes, k = self.surfels, 2 * self.surfels - 1, self.coefficients
        links = (self.slots, self.links)
        found = [
            of("surfel_place", (n, 4), f32),
            *(of(f"surfel_{name}", n, u32) for name in ("normal", "albedo", "emission", "uv")),
            of("node_child", nodes, i32),
            of("node_flux", nodes, u32),
            of("link_node", links, i32),
        ]
        if self.stored:
            found.append(of("link_light", (*links, k), u16))
        else:
            found += [of("link_direction", links, u32), of("link_weight", links, u32)]
        if self.environment:
            found.append(of("cache_environment", (self.slots, k, 3), u16))
        if self.tuned:
            found += [
                of("pull_order", n - 1, i32),
                of("pull_starts", self.subtrees + 2, i32),
                of("cache_border", self.border, i32),
            ]
        return [
            *found,
            of("cache_place", self.slots, i32),
            of("cache_map", (self.texels, k, 4), u16),
            of("cache_grid", (self.cells, k, 4), u16),
            of("cache_uvs", (self.triangles, 6), f32),
            of("grid", (2, 3), f32),
        ]


def least_slots(settings: SurfelCacheSettings) -> int:
    """Caches that there is room for whatever is baked: three quarters of those that the map aims
    for, so that what cannot fit is refused before. Seldom are more than a quarter inside geometry.
    """
    return -(-3 * settings.caches // 4)


def padded_links(links: int, tuned: bool, vector: int) -> int:
    """Room for a cache's links: whole vectors in the tuned variant."""
    return -(-links // vector) * vector if tuned else links


def arrays_of(bake: SurfelBake, scene: Scene, sizes: Sizes, motion: MovingObjects | None) -> Arrays:
    """The content of every buffer of ``sizes`` that does not begin as zeros."""
    caches, tree = bake.caches, bake.hierarchy
    leaves = np.flatnonzero(tree.child < 0)
    node = np.empty(sizes.surfels, np.int32)
    node[tree.begin[leaves]] = leaves
    place = np.empty((sizes.surfels, 4), np.float32)
    place[:, :3] = bake.surfels.position
    place[:, 3] = node.view(np.float32)
    uvs = np.nan_to_num(caches.atlas.triangle_uvs, nan=-1.0).astype(np.float32)
    if motion is not None:
        uvs[motion.triangles] = -1.0
    uvs = uvs.reshape(-1, 6)
    own = np.concatenate([np.flatnonzero(caches.map_kept), np.flatnonzero(caches.grid_kept)])
    on_map = caches.on_map
    where = np.zeros(sizes.slots, np.int32)
    where[:on_map] = caches.atlas.texel[own[:on_map]]
    where[on_map : len(own)] = own[on_map:]
    marks = np.zeros((sizes.texels, sizes.coefficients, 4), np.float16)
    marks[border_of(bake), 0, 3] = DILATED
    marks[where[:on_map], 0, 3] = LIT
    cells = np.zeros((sizes.cells, sizes.coefficients, 4), np.float16)
    cells[own[on_map:], 0, 3] = LIT
    volume = caches.volume
    found: Arrays = {
        "surfel_place": place,
        "surfel_normal": packed_directions(bake.surfels.shading),
        "surfel_albedo": packed_albedo(bake.albedo),
        "surfel_emission": encode(bake.emission),
        "surfel_uv": packed_uv(bake, uvs),
        "node_child": tree.child.astype(np.int32),
        "cache_place": where,
        "cache_map": marks.view(np.uint16),
        "cache_grid": cells.view(np.uint16),
        "cache_uvs": uvs,
        "grid": np.array([volume.origin, volume.spacing], np.float32),
        **link_arrays(bake.links, tree, sizes),
    }
    if caches.environment is not None:
        light = np.zeros((sizes.slots, sizes.coefficients, 3), np.float16)
        light[: len(own)] = caches.environment[:, : sizes.coefficients]
        found["cache_environment"] = light.view(np.uint16)
    if sizes.tuned:
        found["pull_order"], found["pull_starts"] = pull_order(tree)
        found["cache_border"] = border_of(bake)
    return found


def link_arrays(links: Links, tree: Hierarchy, sizes: Sizes) -> Arrays:
    """The links as a variant reads them: by link, or by coefficient where tuned."""
    count, own = links.node.shape
    node = np.zeros((sizes.slots, sizes.links), np.int32)
    node[:count, :own] = links.node
    if sizes.stored:
        light = np.zeros((sizes.slots, sizes.links, sizes.coefficients), np.float16)
        light[:count, :own] = without_subnormals(links.coefficients[:, :, : sizes.coefficients])
        if sizes.tuned:
            light = np.ascontiguousarray(light.transpose(0, 2, 1))
        return {"link_node": node, "link_light": light.view(np.uint16).reshape(*node.shape, -1)}
    direction, weight = run_time_links(links, tree)
    directions = np.zeros(node.shape, np.uint32)
    directions[:count, :own] = direction
    weights = np.zeros((*node.shape, 2), np.float16)
    weights[:count, :own] = without_subnormals(weight)
    if sizes.tuned:
        weights = np.ascontiguousarray(weights.transpose(0, 2, 1))
    return {
        "link_node": node,
        "link_direction": directions,
        "link_weight": weights.reshape(-1).view(np.uint32).reshape(node.shape),
    }


def run_time_links(links: Links, tree: Hierarchy) -> tuple[Words, npt.NDArray[np.float16]]:
    """Packed directions (c, l) of the links, and (c, l, 2) the first coefficient over y_0 and the
    solid angle, sr (Jendersie et al. 2016, section 4.6).

    All from the stored coefficients: the second band's are the mean direction.
    """
    c = links.coefficients[:, :, :4].astype(np.float64)
    towards = c[:, :, [3, 1, 2]]
    length = np.linalg.norm(towards, axis=2, keepdims=True)
    unit = np.where(length > 0, towards / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])
    first = c[:, :, 0] / _Y0
    surfels = (tree.end - tree.begin)[links.node]
    solid = np.minimum(first * surfels * (np.pi / LINK_SCALE), 4 * np.pi)
    packed = packed_directions(unit.reshape(-1, 3)).reshape(links.node.shape)
    return packed, np.stack([first, solid], axis=2).astype(np.float16)


def without_subnormals(values: npt.NDArray[np.float16]) -> npt.NDArray[np.float16]:
    """The halves with subnormal ones set to 0, as some kernels expand them by their bits."""
    return np.where(np.abs(values) < np.float16(_LEAST_HALF), np.float16(0), values)


def packed_directions(directions: npt.NDArray[Any]) -> Words:
    """Unit directions (n, 3) as two snorm16 of the octahedral map, (n,)."""
    d = np.asarray(directions, np.float64)
    p = d[:, :2] / np.abs(d).sum(axis=1, keepdims=True)
    folded = (1 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1.0, -1.0)
    p = np.where(d[:, 2:] >= 0, p, folded)
    q = np.rint(p * 32767).astype(np.int64) & 0xFFFF
    return np.asarray(q[:, 0] | q[:, 1] << 16, np.uint32)


def packed_albedo(albedo: Floats) -> Words:
    """Albedos (n, 3) as three times 10 bits, (n,)."""
    q = np.rint(np.clip(albedo.astype(np.float64), 0, 1) * 1023).astype(np.uint32)
    return np.asarray(q[:, 0] | q[:, 1] << 10 | q[:, 2] << 20)


def packed_uv(bake: SurfelBake, uvs: Floats) -> Words:
    """The surfels' places in the map (n,), two unorm16 over its size; NO_PLACE without one."""
    atlas, surfels = bake.caches.atlas, bake.surfels
    corners = uvs[surfels.triangle].astype(np.float64).reshape(-1, 3, 2)
    u, v = surfels.barycentric.astype(np.float64).T[:, :, None]
    at = corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v
    q = np.rint(np.clip(at / [atlas.width, atlas.height], 0, 1) * 65535).astype(np.uint32)
    packed = q[:, 0] | q[:, 1] << 16
    none = (corners[:, 0, 0] < 0) | (packed == NO_PLACE)
    return np.where(none, np.uint32(NO_PLACE), packed).astype(np.uint32)


def border_of(bake: SurfelBake) -> Ints:
    """Texels (k,) of the map without a lit cache that have one among their eight neighbours."""
    atlas = bake.caches.atlas
    padded = np.zeros((atlas.height + 2, atlas.width + 2), np.bool_)
    rows, columns = np.divmod(atlas.texel[bake.caches.map_kept], atlas.width)
    padded[rows + 1, columns + 1] = True
    near = np.zeros((atlas.height, atlas.width), np.bool_)
    for dy in range(3):
        for dx in range(3):
            near |= padded[dy : dy + atlas.height, dx : dx + atlas.width]
    return np.flatnonzero(near & ~padded[1:-1, 1:-1]).astype(np.int32)


def pull_order(tree: Hierarchy) -> tuple[Ints, Ints]:
    """The inner nodes subtree by subtree, children first, then those above all subtrees; and where
    each subtree begins, where those above begin, and the end.
    """
    size = (tree.end - tree.begin).astype(np.int64)
    most = max(_SUBTREE, int(size[0]) // _SUBTREES)
    inner = np.flatnonzero(tree.child >= 0)
    root = np.full(len(size), -1, np.int64)
    for node in inner.tolist():  # parents stand before their children
        own = root[node]
        if own < 0 and size[node] <= most:
            own = root[node] = node
        if own >= 0:
            root[tree.child[node]] = root[tree.child[node] + 1] = own
    group = np.where(root[inner] >= 0, root[inner], len(size))
    order = inner[np.lexsort((-inner, group))]
    found = np.sort(group)
    starts = np.flatnonzero(np.diff(found, prepend=-1))
    if not len(found) or found[-1] != len(size):
        starts = np.append(starts, len(found))
    return order.astype(np.int32), np.append(starts, len(found)).astype(np.int32)


def flux_scale(scene: Scene, surfels: int, area: float, albedo: Floats, emission: Floats) -> float:
    """The power of two by which radiosities' sums are stored, so that the root's never overflows.

    All light that lights and environment can bring, and what surfaces emit, reflected by the
    brightest albedo for ever.

    Args:
        scene: the scene.
        surfels: their number.
        area: of one, m2.
        albedo: (n, 3) of the surfels.
        emission: (n, 3) of the surfels, W/m2/sr.
    """
    total = surfels * area
    light = np.zeros(3)
    for one in scene.lights:
        if isinstance(one, DirectionalLight):
            light += np.asarray(one.irradiance)
        else:
            cone = 4 * np.pi
            if isinstance(one, SpotLight):
                cone = 2 * np.pi * (1 - math.cos(one.outer_angle))
            light += np.asarray(one.intensity) * (cone / total)
    light += np.pi * np.asarray(scene.environment.pixels, np.float64).max(axis=(0, 1))
    own = np.pi * np.asarray(emission, np.float64).mean(axis=0)
    kept = 1 / (1 - min(0.95, float(albedo.max(initial=0.0))))
    most = float((own + light).max()) * kept * surfels
    return 2.0 ** math.floor(math.log2(MOST / most)) if most > 0 else 1.0


def surfel_shares(scene: Scene, bake: SurfelBake, motion: MovingObjects | None) -> Shares | None:
    """What the surfels show of materials that change; None where none does."""
    if motion is None or motion.materials is None:
        return None
    changing = motion.materials
    return Shares.of_triangles(scene, changing, bake.surfels.triangle, bake.albedo, bake.emission)


def most_colours(bake: SurfelBake, motion: MovingObjects | None) -> tuple[Floats, Floats]:
    """Albedo and emission (n, 3) of the surfels, the most that they ever have."""
    if motion is None or motion.materials is None:
        return bake.albedo, bake.emission
    changing = motion.materials
    rows = changing.material_ids[bake.surfels.triangle]
    albedo = np.where((changing.albedo_by[rows] >= 0)[:, None], np.float32(1.0), bake.albedo)
    emission = np.maximum(bake.emission, changing.brightest()[rows])
    return albedo.astype(np.float32), emission.astype(np.float32)


def node_sums(tree: Hierarchy, of_leaves: Doubles) -> Doubles:
    """Sums over every node's leaves of values (n, ...) in the leaves' order."""
    sums = np.concatenate([np.zeros((1, *of_leaves.shape[1:])), np.cumsum(of_leaves, axis=0)])
    return np.asarray(sums[tree.end] - sums[tree.begin])
