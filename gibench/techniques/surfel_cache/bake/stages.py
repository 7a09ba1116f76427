"""The stages of the bake: surfels, hierarchy, the caches' map, caches, links.

Links are made of units, shares of the caches: so they are resumed and shared out. They are always
of four bands; fewer bands and the projection at run time are taken from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gibench.arrays import Floats
from gibench.bake.stage import Arrays, Format, Keep, Stage, Unit, stage_key
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.lightmap import Lightmap
from gibench.scene.lightmap.albedo import mean_albedo
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.model import Scene
from gibench.techniques.parts.probe_volume import Volume, fit_counts, fit_volume
from gibench.techniques.surfel_cache.bake.caches import place_caches
from gibench.techniques.surfel_cache.bake.data import (
    Atlas,
    Caches,
    Hierarchy,
    Links,
    SurfelBake,
    SurfelSet,
)
from gibench.techniques.surfel_cache.bake.hierarchy import hierarchy_of
from gibench.techniques.surfel_cache.bake.links import Linker
from gibench.techniques.surfel_cache.bake.surfels import (
    relax,
    sample_surface,
    surface_areas,
)
from gibench.techniques.surfel_cache.settings import SurfelCacheSettings, parse_grid
from gibench.work import Worker

# Raised whenever what a stage computes, or how it is stored, changes.
HIERARCHY_VERSION = ATLAS_VERSION = LINKS_VERSION = 1
CACHES_VERSION = 2
SURFELS_VERSION = 3

# Caches of a unit of links: some seconds of work at full size.
_UNIT_CACHES = 64
# The grid takes a tenth of the map's caches unless its size is set.
_GRID_SHARE = 10


@dataclass(frozen=True)
class Given:
    """What every stage is computed from.

    Attributes:
        scene: the scene.
        lightmap: its atlas of receivers: what is left of cut-outs, and the surfels' colours.
        settings: of the technique.
    """

    scene: Scene
    lightmap: Lightmap
    settings: SurfelCacheSettings


def volume_of(scene: Scene, settings: SurfelCacheSettings) -> Volume:
    """The grid's place: the scene's box cut into cells, a cache in the middle of each."""
    low, high = scene.bounds
    counts = parse_grid(settings.grid)
    if counts is None:
        counts = fit_counts(low, high, max(1, settings.caches // _GRID_SHARE))
    return fit_volume(low, high, counts)


def surfel_cache_stages(given: Given) -> tuple[Stage, ...]:
    """The stages of a bake; the last one's value is the :class:`SurfelBake`."""
    surfels = _surfel_stage(given)
    hierarchy = _hierarchy_stage(given, surfels)
    atlas = _atlas_stage(given)
    caches = _cache_stage(given, atlas)
    links = _link_stage(given, (surfels, hierarchy, caches))
    receivers = given.lightmap.receivers
    needs = (surfels, hierarchy, caches, links)
    whole = Stage(
        name="surfel-cache-bake",
        key=stage_key("surfel-cache-bake", 1, receivers.albedo, receivers.emission, needs=needs),
        compute=_assemble,
        given=given,
        needs=needs,
        keep=Keep.NEVER,
    )
    return surfels, hierarchy, atlas, caches, links, whole


def _made_from(given: Given, **settings: Any) -> tuple[tuple[str, Any], ...]:
    """What a stage's file says it was made from."""
    return tuple({"scene": given.scene.name, **settings}.items())


def _surfel_stage(given: Given) -> Stage:
    """Surfels spread over the surfaces."""
    scene, settings = given.scene, given.settings
    cut = () if scene.cutouts is None else (given.lightmap.fragments.area,)
    return Stage(
        name="surfel-cache-surfels",
        key=stage_key(
            "surfel-cache-surfels",
            SURFELS_VERSION,
            scene.geometry_hash(),
            scene.normals,
            *cut,
            settings.surfels,
            settings.relaxation,
        ),
        compute=_surfels,
        given=given,
        format=Format(_write_surfels, _read_surfels),
        made_from=_made_from(given, surfels=settings.surfels),
    )


def _hierarchy_stage(given: Given, surfels: Stage) -> Stage:
    """The tree over the surfels."""
    kind = given.settings.hierarchy
    return Stage(
        name="surfel-cache-hierarchy",
        key=stage_key("surfel-cache-hierarchy", HIERARCHY_VERSION, kind, needs=(surfels,)),
        compute=_hierarchy,
        given=kind,
        needs=(surfels,),
        format=Format(_write_hierarchy, _read_hierarchy),
        made_from=_made_from(given, hierarchy=kind),
    )


def _atlas_stage(given: Given) -> Stage:
    """The map that caches on surfaces lie in."""
    scene, settings = given.scene, given.settings
    own = np.empty(0, np.float32) if scene.lightmap_uvs is None else scene.lightmap_uvs
    return Stage(
        name="surfel-cache-atlas",
        key=stage_key(
            "surfel-cache-atlas",
            ATLAS_VERSION,
            scene.geometry_hash(),
            scene.normals,
            own,
            settings.caches,
        ),
        compute=_atlas,
        given=given,
        format=Format(_write_atlas, _read_atlas),
        made_from=_made_from(given, caches=settings.caches),
    )


def _cache_stage(given: Given, atlas: Stage) -> Stage:
    """The caches, on surfaces and in the grid, and the sky that they see."""
    volume = volume_of(given.scene, given.settings)
    return Stage(
        name="surfel-cache-caches",
        key=stage_key(
            "surfel-cache-caches",
            CACHES_VERSION,
            volume,
            given.settings.leave_out,
            given.scene.environment.pixels,
            needs=(atlas,),
        ),
        compute=_caches,
        given=given,
        needs=(atlas,),
        format=Format(_write_caches, _read_caches),
        made_from=_made_from(given, grid=volume.counts),
    )


def _link_stage(given: Given, needs: tuple[Stage, ...]) -> Stage:
    """The links from caches to nodes of the tree; ``needs`` surfels, hierarchy and caches."""
    settings = given.settings
    volume = volume_of(given.scene, settings)
    units = -(-(settings.caches + volume.probes) // _UNIT_CACHES)
    return Stage(
        name="surfel-cache-links",
        key=stage_key("surfel-cache-links", LINKS_VERSION, settings.links, units, needs=needs),
        compute=_links,
        given=given,
        needs=needs,
        units=tuple(Unit(f"links-{i:05d}", i, units) for i in range(units)),
        format=Format(_write_links, _read_links),
        title="Baking links",
        made_from=_made_from(given, links=settings.links),
    )


# What the stages compute


def _surfels(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> SurfelSet:
    scene, settings = given.scene, given.settings
    found = sample_surface(scene, surface_areas(scene, given.lightmap), settings.surfels)
    return relax(scene, found, scene_tracer(scene), settings.relaxation)


def _hierarchy(kind: str, needed: Sequence[Any], unit: Unit, worker: Worker) -> Hierarchy:
    (surfels,) = needed
    return hierarchy_of(surfels, kind)


def _atlas(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> Atlas:
    found = unwrap(given.scene, given.settings.caches)
    r = found.receivers
    return Atlas(found.width, found.height, found.triangle_uvs, r.texel, r.position, r.normal)


def _caches(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> Caches:
    (atlas,) = needed
    scene = given.scene
    volume = volume_of(scene, given.settings)
    return place_caches(
        scene,
        atlas,
        volume,
        scene_tracer(scene),
        surface_offset(scene),
        leave_out=given.settings.leave_out,
    )


def _linker(given: Given, surfels: SurfelSet, tree: Hierarchy) -> Linker:
    scene = given.scene
    ordered = surfels.taken(tree.leaf)
    return Linker(ordered, tree, scene_tracer(scene), scene.corners, surface_offset(scene))


def _links(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> Links:
    surfels, tree, caches = needed
    linker: Linker = worker.shared("linker", lambda: _linker(given, surfels, tree))
    positions, normals = caches.positions.astype(np.float32), _normals(caches)
    own = slice(*(len(positions) * i // unit.data for i in (unit.index, unit.index + 1)))
    on_map = slice(own.start, max(own.start, min(own.stop, len(normals))))
    in_grid = slice(max(own.start, len(normals)), max(own.stop, len(normals)))
    most = given.settings.links
    parts = [
        linker.links(positions[on_map], normals[on_map], most),
        linker.links(positions[in_grid], None, most),
    ]
    return joined(parts)


def _normals(caches: Caches) -> Floats:
    return caches.atlas.normal[caches.map_kept]


def joined(parts: Sequence[Links]) -> Links:
    """Links of several shares of the caches, one after the other."""
    return Links(
        np.concatenate([part.node for part in parts]),
        np.concatenate([part.coefficients for part in parts]),
        sum(part.rays for part in parts),
    )


def _assemble(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> SurfelBake:
    surfels, tree, caches, links = needed
    ordered: SurfelSet = surfels.taken(tree.leaf)
    albedo, emission = surface_colours(given.scene, given.lightmap, ordered)
    return SurfelBake(ordered, albedo, emission, tree, caches, joined(links))


def surface_colours(scene: Scene, lightmap: Lightmap, surfels: SurfelSet) -> tuple[Floats, Floats]:
    """Albedo and emission (n, 3) of surfels: the means over the receiver's texel that each lies in,
    so that textures are averaged; the material's own where there is none.
    """
    own = surfels.barycentric.astype(np.float64)
    weights = np.concatenate([1 - own.sum(axis=1, keepdims=True), own], axis=1)
    uvs = lightmap.triangle_uvs[surfels.triangle].astype(np.float64)
    at = np.einsum("ij,ijk->ik", weights, uvs)
    placed = np.isfinite(at).all(axis=1)
    place = np.where(placed[:, None], at, 0.0).astype(np.int64)
    x = np.clip(place[:, 0], 0, lightmap.width - 1)
    y = np.clip(place[:, 1], 0, lightmap.height - 1)
    receiver = lightmap.receiver_of_texel[y * lightmap.width + x]
    known = placed & (receiver >= 0)
    row = np.where(known, receiver, 0)
    albedo = lightmap.receivers.albedo[row].copy()
    emission = lightmap.receivers.emission[row].copy()
    if not known.all():
        rest = np.flatnonzero(~known)
        triangle = surfels.triangle[rest].astype(np.int64)
        corners = np.repeat(weights[rest, None, :], 3, axis=1)
        albedo[rest] = mean_albedo(scene, triangle, corners)
        emitted = np.array([material.emission for material in scene.materials], np.float32)
        emission[rest] = emitted[scene.material_ids[triangle]]
    return albedo, emission


# How it is stored

_SURFEL_ARRAYS = ("position", "normal", "shading", "triangle", "barycentric")
_TREE_ARRAYS = ("leaf", "begin", "end", "child", "level")
_ATLAS_ARRAYS = ("triangle_uvs", "texel", "position", "normal")


def _write_surfels(surfels: SurfelSet) -> Arrays:
    return {
        **{name: getattr(surfels, name) for name in _SURFEL_ARRAYS},
        "area": np.asarray(surfels.area, np.float64),
    }


def _read_surfels(unit: Unit, stored: Arrays) -> SurfelSet:
    return SurfelSet(**{n: stored[n] for n in _SURFEL_ARRAYS}, area=float(stored["area"]))


def _write_hierarchy(tree: Hierarchy) -> Arrays:
    return {name: getattr(tree, name) for name in _TREE_ARRAYS}


def _read_hierarchy(unit: Unit, stored: Arrays) -> Hierarchy:
    return Hierarchy(**{name: stored[name] for name in _TREE_ARRAYS})


def _write_atlas(atlas: Atlas) -> Arrays:
    size = np.array([atlas.width, atlas.height])
    return {"size": size, **{name: getattr(atlas, name) for name in _ATLAS_ARRAYS}}


def _read_atlas(unit: Unit, stored: Arrays) -> Atlas:
    width, height = (int(n) for n in stored["size"])
    return Atlas(width, height, **{name: stored[name] for name in _ATLAS_ARRAYS})


def _write_caches(caches: Caches) -> Arrays:
    v = caches.volume
    arrays = {f"atlas-{name}": array for name, array in _write_atlas(caches.atlas).items()}
    arrays |= {"map_kept": caches.map_kept, "grid_kept": caches.grid_kept}
    arrays |= {"grid": np.array([v.origin, v.spacing]), "counts": np.array(v.counts)}
    if caches.environment is not None:
        arrays["environment"] = caches.environment
    return arrays


def _read_caches(unit: Unit, stored: Arrays) -> Caches:
    mine = {name[6:]: array for name, array in stored.items() if name.startswith("atlas-")}
    atlas = _read_atlas(unit, mine)
    (ox, oy, oz), (sx, sy, sz) = (tuple(float(x) for x in row) for row in stored["grid"])
    nx, ny, nz = (int(n) for n in stored["counts"])
    volume = Volume((ox, oy, oz), (sx, sy, sz), (nx, ny, nz))
    kept = stored["map_kept"], stored["grid_kept"]
    return Caches(atlas, volume, *kept, environment=stored.get("environment"))


def _write_links(links: Links) -> Arrays:
    rays = np.asarray(links.rays)
    return {"node": links.node, "coefficients": links.coefficients, "rays": rays}


def _read_links(unit: Unit, stored: Arrays) -> Links:
    return Links(stored["node"], stored["coefficients"], int(stored["rays"]))
