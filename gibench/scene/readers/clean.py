"""Turn the parts of mesh files into the arrays of a Scene, dropping and mending what is broken.

What is harmless is dropped or mended and counted in a warning; a mesh of which nothing is left is
an error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Array, Doubles, Floats, Ints, unique_rows
from gibench.errors import BadInput
from gibench.scene.readers.content import Content, Part, counted, of_corners
from gibench.scene.readers.tangents import tangents

# A triangle is degenerate when its height over its longest edge is below this share of the edge:
# double the rounding of float32 positions, below which not even its normal's direction is known.
DEGENERATE_RATIO = 2.0**-23


@dataclass(frozen=True)
class CleanMesh:
    """The geometry of a Scene; see there for shapes and units.

    Attributes:
        warnings: what was dropped or mended, one line each, with counts.
        cutouts: (t,) int32 image that cuts each triangle out, -1 for a whole one; None where all
            are whole.
        cutout_uvs: (v, 2) float32 coordinates in those images, or None.
        glow: (t,) int32 image that each triangle emits by, -1 for none; None where none does.
        glow_uvs: (t, 3, 2) float64 coordinates of its corners in those images, or None.
        bump: (t,) int32 normal map of each triangle, -1 for none; None where none has one.
        bump_uvs: (t, 3, 2) float64 coordinates of its corners in it, or None.
        bump_tangents: (t, 3, 4) float64 its corners' unit tangents and bitangents' signs, or None.
        gloss: (t,) int32 image of roughness and metalness, -1 for none; None where none has one.
        gloss_uvs: (t, 3, 2) float64 coordinates of its corners in it, or None.
    """

    positions: Floats
    normals: Floats
    uvs: Floats
    triangles: Ints
    material_ids: Ints
    object_ids: Ints
    lightmap_uvs: Floats | None
    warnings: tuple[str, ...]
    cutouts: Ints | None = None
    cutout_uvs: Floats | None = None
    glow: Ints | None = None
    glow_uvs: Doubles | None = None
    bump: Ints | None = None
    bump_uvs: Doubles | None = None
    bump_tangents: Doubles | None = None
    gloss: Ints | None = None
    gloss_uvs: Doubles | None = None


def clean(content: Content, where: object) -> CleanMesh:
    """Join and clean all parts of ``content``.

    Args:
        content: what was read.
        where: the file, for messages.

    Returns:
        Triangles that are finite, of positive area and in range, with unit normals on the side
        that their winding faces.

    Raises:
        BadInput: no usable triangle is left.
    """
    dropped: dict[str, int] = {}
    mesh = _join([_in_range(part, dropped) for part in content.parts])
    _drop(mesh, _not_finite(mesh), "triangle with a NaN or infinite vertex", dropped)
    _drop(mesh, _degenerate(mesh), "degenerate triangle", dropped)
    if not len(mesh.triangles):
        raise BadInput(
            _nothing_left(dropped), where=where, mend="the file must hold triangles with an area"
        )
    notes = [_dropped_line(kind, count) for kind, count in dropped.items() if count]
    mirrored = sum(1 for part in content.parts if part.mirrored and len(part.triangles))
    if mirrored:
        notes.append(f"{counted(mirrored, 'mirrored part')}: winding turned")
    _mend_normals(mesh, notes)
    _compact(mesh)
    bad_edges = _edges_of_many(mesh)
    if bad_edges:
        notes.append(f"{counted(bad_edges, 'edge')} shared by more than two triangles: kept")
    return CleanMesh(
        positions=mesh.positions,
        normals=mesh.normals.astype(np.float32),
        uvs=mesh.uvs.astype(np.float32),
        triangles=mesh.triangles.astype(np.int32),
        material_ids=mesh.material_ids.astype(np.int32),
        object_ids=mesh.object_ids.astype(np.int32),
        lightmap_uvs=_sound_lightmap_uvs(mesh, notes),
        warnings=tuple(notes),
        cutouts=mesh.cutouts.astype(np.int32) if mesh.cut_out else None,
        cutout_uvs=mesh.cutout_uvs.astype(np.float32) if mesh.cut_out else None,
        glow=mesh.glow.astype(np.int32) if mesh.glows else None,
        glow_uvs=mesh.glow_uvs if mesh.glows else None,
        bump=mesh.bump.astype(np.int32) if mesh.bumps else None,
        bump_uvs=mesh.bump_uvs if mesh.bumps else None,
        bump_tangents=_tangents(mesh) if mesh.bumps else None,
        gloss=mesh.gloss.astype(np.int32) if mesh.glossy else None,
        gloss_uvs=mesh.gloss_uvs if mesh.glossy else None,
    )


@dataclass
class _Mesh:
    """All parts in one set of arrays, worked on in place."""

    positions: Floats
    normals: npt.NDArray[np.float64]  # rows without a normal are NaN
    uvs: Array
    lightmap_uvs: Array  # rows without are NaN
    triangles: npt.NDArray[np.int64]
    material_ids: npt.NDArray[np.int64]
    object_ids: npt.NDArray[np.int64]
    had_normals: npt.NDArray[np.bool_]  # per triangle
    cutouts: npt.NDArray[np.int64]
    cutout_uvs: Array  # without rows where nothing is cut out
    glow: npt.NDArray[np.int64]
    glow_uvs: Array  # of corners; (t, 0) where nothing glows by an image
    bump: npt.NDArray[np.int64]
    bump_uvs: Array  # of corners; (t, 0) where nothing has a normal map
    bump_tangents: Array  # of corners, NaN where the file has none; (t, 0) as well
    gloss: npt.NDArray[np.int64]
    gloss_uvs: Array  # of corners; (t, 0) where no image has roughness

    @property
    def cut_out(self) -> bool:
        """Whether any triangle is."""
        return bool((self.cutouts >= 0).any())

    @property
    def glows(self) -> bool:
        """Whether any triangle does by an image."""
        return bool((self.glow >= 0).any())

    @property
    def bumps(self) -> bool:
        """Whether any triangle has a normal map."""
        return bool((self.bump >= 0).any())

    @property
    def glossy(self) -> bool:
        """Whether any triangle has an image of roughness and metalness."""
        return bool((self.gloss >= 0).any())


def _in_range(part: Part, dropped: dict[str, int]) -> Part:
    inside = ((part.triangles >= 0) & (part.triangles < len(part.positions))).all(axis=1)
    kind = "triangle with an index out of range"
    dropped[kind] = dropped.get(kind, 0) + int((~inside).sum())
    if inside.all():
        return part
    materials = None if part.materials is None else part.materials[inside]
    cutouts = None if part.cutouts is None else part.cutouts[inside]
    glow = None if part.glow is None else part.glow[inside]
    bump = None if part.bump is None else part.bump[inside]
    gloss = None if part.gloss is None else part.gloss[inside]
    return replace(
        part,
        triangles=part.triangles[inside],
        materials=materials,
        cutouts=cutouts,
        glow=glow,
        bump=bump,
        gloss=gloss,
    )


def _join(parts: list[Part]) -> _Mesh:
    def stack(arrays: list[Array], width: int, dtype: Any) -> Array:
        return np.concatenate([np.empty((0, width), dtype), *arrays]).astype(dtype, copy=False)

    def column(name: str, width: int, missing: float) -> Array:
        rows = []
        for part in parts:
            values = getattr(part, name)
            rows.append(
                np.full((len(part.positions), width), missing) if values is None else values
            )
        return stack(rows, width, np.float64)

    def images(name: str) -> npt.NDArray[np.int64]:
        rows = [getattr(part, name) for part in parts]
        given = [
            np.full(len(part.triangles), -1) if row is None else row
            for part, row in zip(parts, rows, strict=True)
        ]
        return np.concatenate([np.empty(0), *given]).astype(np.int64)

    def at_corners(name: str, image: str, width: int = 2) -> Array:
        """Values (t, 3, width) of the triangles' corners; (t, 0) where no part has the image."""
        if all(getattr(part, image) is None for part in parts):
            return np.empty((sum(len(part.triangles) for part in parts), 0))
        rows = []
        for part in parts:
            values = None if getattr(part, image) is None else getattr(part, name)
            none = np.zeros((len(part.triangles), 3, width))
            rows.append(none if values is None else of_corners(part, values))
        return np.concatenate(rows)

    starts = np.cumsum([0, *(len(part.positions) for part in parts)])
    sizes = [len(part.triangles) for part in parts]
    cut_out = any(part.cutouts is not None for part in parts)
    with np.errstate(over="ignore", invalid="ignore"):
        positions = stack([part.positions.astype(np.float32) for part in parts], 3, np.float32)
    return _Mesh(
        positions=positions,
        normals=column("normals", 3, np.nan),
        uvs=column("uvs", 2, 0.0),
        lightmap_uvs=column("lightmap_uvs", 2, np.nan),
        triangles=stack(
            [part.triangles + start for part, start in zip(parts, starts, strict=False)],
            3,
            np.int64,
        ),
        material_ids=np.concatenate(
            [
                np.full(size, part.material) if part.materials is None else part.materials
                for part, size in zip(parts, sizes, strict=True)
            ]
        ).astype(np.int64),
        object_ids=np.repeat([part.object_id for part in parts], sizes).astype(np.int64),
        had_normals=np.repeat([part.normals is not None for part in parts], sizes).astype(bool),
        cutouts=images("cutouts"),
        cutout_uvs=column("opacity_uvs", 2, 0.0) if cut_out else np.empty((0, 2)),
        glow=images("glow"),
        glow_uvs=at_corners("emission_uvs", "glow"),
        bump=images("bump"),
        bump_uvs=at_corners("normal_uvs", "bump"),
        bump_tangents=at_corners("tangents", "bump", width=4),
        gloss=images("gloss"),
        gloss_uvs=at_corners("gloss_uvs", "gloss"),
    )


def _drop(mesh: _Mesh, bad: npt.NDArray[np.bool_], kind: str, dropped: dict[str, int]) -> None:
    dropped[kind] = int(bad.sum())
    if not dropped[kind]:
        return
    for name in (
        "triangles", "material_ids", "object_ids", "had_normals", "cutouts", "glow", "glow_uvs",
        "bump", "bump_uvs", "bump_tangents", "gloss", "gloss_uvs",
    ):  # fmt: skip
        setattr(mesh, name, getattr(mesh, name)[~bad])


def _not_finite(mesh: _Mesh) -> npt.NDArray[np.bool_]:
    sound = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    return np.asarray(~sound[mesh.triangles].all(axis=1))


def _edges(mesh: _Mesh) -> tuple[Array, Array, Array]:
    corners = mesh.positions.astype(np.float64)[mesh.triangles]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return b - a, c - a, c - b


def _degenerate(mesh: _Mesh) -> npt.NDArray[np.bool_]:
    ab, ac, bc = _edges(mesh)
    twice_area = np.linalg.norm(np.cross(ab, ac), axis=1)
    longest = np.max([np.einsum("ij,ij->i", edge, edge) for edge in (ab, ac, bc)], axis=0)
    # The longest edge squared times the ratio is the parallelogram of the least height allowed.
    # An edge so short that its square has no float32 leaves no area for float32 code either.
    return np.asarray(
        (twice_area <= DEGENERATE_RATIO * longest) | (twice_area < np.finfo(np.float32).tiny)
    )


def _nothing_left(dropped: dict[str, int]) -> str:
    reasons = [counted(count, kind, _plural(kind)) for kind, count in dropped.items() if count]
    return "no triangles" + (f" left after dropping {', '.join(reasons)}" if reasons else "")


def _plural(kind: str) -> str:
    return kind.replace("triangle", "triangles", 1)


def _dropped_line(kind: str, count: int) -> str:
    return f"{counted(count, kind, _plural(kind))} dropped"


def _mend_normals(mesh: _Mesh, notes: list[str]) -> None:
    """Give every corner a unit normal on the front side, splitting vertices where needed.

    Corners without a normal get their triangle's: the glTF 2.0 specification (3.7.2.1) asks for
    flat normals where a file has none. A normal that does not face the front is replaced too.
    """
    ab, ac, _ = _edges(mesh)
    flat = np.cross(ab, ac)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    with np.errstate(all="ignore"):
        lengths = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
        mesh.normals = mesh.normals / lengths
        of_corner = mesh.normals[mesh.triangles]
        facing = np.einsum("tcx,tx->tc", of_corner, flat) > 0  # False for NaN
    wrong = ~facing
    mended = int((wrong & mesh.had_normals[:, None]).sum())
    if mended:
        notes.append(
            f"{counted(mended, 'shading normal')} of {3 * int(mesh.had_normals.sum())} did not "
            "face the triangle's front: the triangle's normal is used"
        )
    if missing := int((~mesh.had_normals).sum()):
        notes.append(f"{counted(missing, 'triangle')} without normals: flat normals computed")
    if not wrong.any():
        return
    triangle, corner = np.nonzero(wrong)
    old = mesh.triangles[triangle, corner]
    # Corners of one vertex that get the same normal share one new vertex.
    keys = np.column_stack((old, flat[triangle].astype(np.float32).view(np.int32)))
    first, inverse = unique_rows(keys)
    start = len(mesh.positions)
    for name in ("positions", "uvs", "lightmap_uvs", *_cutout_uvs(mesh)):
        values = getattr(mesh, name)
        setattr(mesh, name, np.concatenate((values, values[old[first]])))
    mesh.normals = np.concatenate((mesh.normals, flat[triangle[first]]))
    mesh.triangles = mesh.triangles.copy()
    mesh.triangles[triangle, corner] = start + inverse


def _tangents(mesh: _Mesh) -> Doubles:
    """The tangents of the triangles with a normal map, (t, 3, 4): the file's where it has them for
    corners whose normals it has too (glTF 2.0, 3.7.2.1), else MikkTSpace's.
    """
    result = mesh.bump_tangents.astype(np.float64)
    length = np.linalg.norm(result[..., :3], axis=2, keepdims=True)
    sound = mesh.had_normals & (length[..., 0] > 0).all(axis=1)
    result[..., :3] /= np.where(length > 0, length, 1.0)
    result[..., 3] = np.where(result[..., 3] < 0, -1.0, 1.0)
    wanted = np.flatnonzero((mesh.bump >= 0) & ~sound)
    if len(wanted):
        corners = mesh.triangles[wanted]
        own = mesh.positions[corners], mesh.normals[corners], mesh.bump_uvs[wanted]
        result[wanted] = tangents(*own)
    return np.asarray(result)


def _compact(mesh: _Mesh) -> None:
    """Forget vertices that no triangle uses."""
    used = np.zeros(len(mesh.positions), bool)
    used[mesh.triangles] = True
    mesh.triangles = (np.cumsum(used) - 1)[mesh.triangles]
    for name in ("positions", "normals", "uvs", "lightmap_uvs", *_cutout_uvs(mesh)):
        setattr(mesh, name, np.ascontiguousarray(getattr(mesh, name)[used]))
    for name in ("uvs", "cutout_uvs"):
        sound = np.nan_to_num(getattr(mesh, name), nan=0.0, posinf=0.0, neginf=0.0)
        setattr(mesh, name, sound)


def _cutout_uvs(mesh: _Mesh) -> tuple[str, ...]:
    return ("cutout_uvs",) if len(mesh.cutout_uvs) else ()


def _edges_of_many(mesh: _Mesh) -> int:
    """Number of edges, by position, that more than two triangles share."""
    _, place = unique_rows((mesh.positions + np.float32(0)).view(np.int32))
    corner = place[mesh.triangles]
    pairs = np.concatenate((corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]))
    pairs.sort(axis=1)
    keys = np.sort(pairs[:, 0] * (int(place.max()) + 1) + pairs[:, 1])
    starts = np.flatnonzero(np.concatenate(([True], keys[1:] != keys[:-1])))
    return int((np.diff(np.append(starts, len(keys))) > 2).sum())


def _sound_lightmap_uvs(mesh: _Mesh, notes: list[str]) -> Floats | None:
    has = np.isfinite(mesh.lightmap_uvs).all(axis=1)
    if not has.any():
        return None
    if not has.all():
        notes.append("lightmap UVs ignored: not every triangle has them")
        return None
    if mesh.lightmap_uvs.min() < -1e-4 or mesh.lightmap_uvs.max() > 1 + 1e-4:
        notes.append("lightmap UVs ignored: they leave the unit square")
        return None
    return np.clip(mesh.lightmap_uvs, 0, 1).astype(np.float32)
