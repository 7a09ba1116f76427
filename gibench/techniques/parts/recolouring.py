"""Places whose material changes get its albedo and emission anew every frame: the pass, and what it
reads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Device,
    Launch,
    ProgramSpec,
    integer,
    reads,
    updates,
)
from gibench.scene.lightmap import Lightmap
from gibench.scene.lightmap.albedo import mean_albedo, mean_emission
from gibench.scene.model import Scene
from gibench.scene.motion.changing_materials import ChangingMaterials
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.technique import GEOMETRY, Pass, Work

RECOLOUR = "recolour"
"""The pass's name and its kernel's."""

# Of an entry: three channels of albedo and of emission, weighed and added.
_ENTRY_FLOPS = 12


@dataclass(frozen=True)
class Shares:
    """What places show of the rows of :class:`ChangingMaterials` (CSR over places).

    Attributes:
        places: (k,) int32 that show any that changes, ascending.
        starts: (k + 1,) int32.
        rows: (e,) int32 of the materials.
        shares: (e, 4) float32 what the row's albedo is multiplied with, by channel, and its
            emission.
        rest: (k, 2, 3) float32 albedo and emission of all else that a place shows.
    """

    places: Ints = field(repr=False)
    starts: Ints = field(repr=False)
    rows: Ints = field(repr=False)
    shares: Floats = field(repr=False)
    rest: Floats = field(repr=False)

    @staticmethod
    def of_receivers(scene: Scene, lightmap: Lightmap, changing: ChangingMaterials) -> Shares:
        """What the texels of a lightmap cover: areas, times the mean of an image over them."""
        fragments, receivers = lightmap.fragments, lightmap.receivers
        owner = np.repeat(np.arange(len(receivers)), np.diff(fragments.start))
        area = fragments.area.astype(np.float64)
        whole = np.bincount(owner, area, len(receivers))
        rows = changing.material_ids[fragments.triangle]
        chosen = np.flatnonzero(changing.changing[rows] & (whole[owner] > 0))
        triangle = fragments.triangle[chosen].astype(np.int64)
        corners = barycentric(scene, triangle, fragments.corners[chosen].astype(np.float64))
        share = area[chosen] / whole[owner[chosen]]
        albedo = mean_albedo(scene, triangle, corners)
        white = replace(
            scene, materials=tuple(replace(m, base_color=(1.0,) * 3) for m in scene.materials)
        )
        image = mean_albedo(white, triangle, corners)
        emitted = mean_emission(scene, triangle, corners)
        keyed = np.stack([changing.albedo_by, changing.emission_by], axis=1)[rows[chosen]] >= 0
        shares = (
            np.concatenate([np.where(keyed[:, :1], image, 0.0), keyed[:, 1:]], axis=1)
            * share[:, None]
        )
        own = (
            np.stack(
                [np.where(keyed[:, :1], albedo, 0.0), np.where(keyed[:, 1:], emitted, 0.0)], axis=1
            )
            * share[:, None, None]
        )
        pairs, entry = np.unique(
            np.stack([owner[chosen], rows[chosen]], axis=1), axis=0, return_inverse=True
        )
        pairs, entry = pairs.reshape(-1, 2), entry.reshape(-1)
        summed = np.zeros((len(pairs), 4))
        np.add.at(summed, entry, shares)
        places, counts = np.unique(pairs[:, 0], return_counts=True)
        rest = np.stack([receivers.albedo[places], receivers.emission[places]], axis=1)
        rest = rest.astype(np.float64)
        # How much of a place's colours is keyed: all of it leaves nothing, whatever rounding says.
        left = np.ones((len(receivers), 2))
        np.subtract.at(left, owner[chosen], keyed * share[:, None])
        np.subtract.at(rest, np.searchsorted(places, owner[chosen]), own)
        rest = np.where(left[places][:, :, None] > 1e-6, np.maximum(rest, 0.0), 0.0)
        return Shares(
            places.astype(np.int32),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            pairs[:, 1].astype(np.int32),
            summed.astype(np.float32),
            rest.astype(np.float32),
        )

    @staticmethod
    def of_triangles(
        scene: Scene,
        changing: ChangingMaterials,
        triangle: Ints,
        albedo: npt.NDArray[Any],
        emission: npt.NDArray[Any],
    ) -> Shares:
        """What points show, each of one triangle.

        A point's share is its albedo over its material's; where that has none, all.

        Args:
            scene: the scene at rest.
            changing: what changes in it.
            triangle: (n,) of every point; -1 for none.
            albedo: (n, 3) of every point at rest.
            emission: (n, 3) of every point at rest, W/m2/sr.
        """
        rows = np.where(triangle >= 0, changing.material_ids[np.maximum(triangle, 0)], 0)
        places = np.flatnonzero((triangle >= 0) & changing.changing[rows])
        rows = rows[places]
        colours = np.array([m.base_color for m in scene.materials], np.float64)
        textured = np.array([m.texture >= 0 for m in scene.materials])
        base, plain = colours[changing.material[rows]], ~textured[changing.material[rows]]
        share = np.divide(albedo[places], base, out=np.ones_like(base), where=base > 1e-6)
        share = np.minimum(share, 1.0)
        # Without an image it is the same in all channels: how much of the point is the material's.
        cover = np.where(plain, share.max(axis=1), 1.0)
        keyed = [by[rows] >= 0 for by in (changing.albedo_by, changing.emission_by)]
        rest = np.stack([albedo[places], emission[places]], axis=1).astype(np.float64)
        for n, mine in enumerate(keyed):
            rest[mine, n] = 0.0
        shares = np.concatenate([share * keyed[0][:, None], (cover * keyed[1])[:, None]], axis=1)
        return Shares(
            places.astype(np.int32),
            np.arange(len(places) + 1, dtype=np.int32),
            rows.astype(np.int32),
            shares.astype(np.float32),
            rest.astype(np.float32),
        )


def barycentric(scene: Scene, triangle: npt.NDArray[np.int64], points: Doubles) -> Doubles:
    """Weights (m, c, 3) of a triangle's corners at points (m, c, 3) in its plane."""
    corners = scene.corners[triangle].astype(np.float64)
    e, f = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, :1]
    ee, ef, ff = ((a * b).sum(axis=1)[:, None] for a, b in ((e, e), (e, f), (f, f)))
    pe, pf = (np.einsum("mcx,mx->mc", p, a) for a in (e, f))
    det = np.maximum(ee * ff - ef * ef, 1e-300)
    u, v = (pe * ff - pf * ef) / det, (pf * ee - pe * ef) / det
    return np.stack([1 - u - v, u, v], axis=2)


@dataclass(frozen=True)
class Recolouring:
    """The pass that gives places their colours of the frame (kernels_cl/parts/recolour.cl).

    Attributes:
        materials: (r, MATERIAL_FLOATS) float32 of the frame.
        program: that holds ``store_colours``.
        store: STORE_PARAMS.
        stored_bytes: that a place takes there.
        stored_flops: that it takes to store it.
        held: what :class:`Shares` says, by name.
    """

    materials: Buffer
    program: ProgramSpec
    store: Sequence[Argument]
    stored_bytes: int
    held: dict[str, Buffer] = field(repr=False)
    stored_flops: int = 0

    @staticmethod
    def create(
        device: Device,
        shares: Shares,
        materials: Buffer,
        program: ProgramSpec,
        store: Sequence[Argument],
        stored_bytes: int,
        stored_flops: int = 0,
    ) -> Recolouring | None:
        """The pass for ``shares``; None where no place changes.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        if not (specs := Recolouring.buffers(shares)):
            return None
        data: dict[str, npt.NDArray[Any]] = {
            "recoloured_places": shares.places,
            "recoloured_starts": shares.starts,
            "recoloured_rows": shares.rows,
            "recoloured_shares": shares.shares,
            "recoloured_rest": shares.rest.reshape(-1, 6),
        }
        held = device.allocate(specs, data)
        return Recolouring(materials, program, store, stored_bytes, held, stored_flops)

    @staticmethod
    def buffers(shares: Shares) -> list[BufferSpec]:
        """The buffers that it takes; none where no place changes."""
        of, count, entries = BufferSpec.of, len(shares.places), len(shares.rows)
        if not count:
            return []
        return [
            of("recoloured_places", count, np.int32),
            of("recoloured_starts", count + 1, np.int32),
            of("recoloured_rows", entries, np.int32),
            of("recoloured_shares", (entries, 4), np.float32),
            of("recoloured_rest", (count, 6), np.float32),
        ]

    @staticmethod
    def of_receivers(
        scene: FrameScene, receivers: FrameLightmap, motion: MovingObjects | None
    ) -> Recolouring | None:
        """The pass for a lightmap's receivers.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        if motion is None or motion.materials is None:
            return None
        return Recolouring.create(
            scene.device,
            Shares.of_receivers(scene.scene, receivers.lightmap, motion.materials),
            scene.surfaces.materials,
            ProgramSpec("parts/recolour_receivers.cl", SCENE_MACROS),
            (updates("albedo", receivers.albedo), updates("emission", receivers.emission)),
            stored_bytes=24,
        )

    def passes(self) -> list[Pass]:
        """The pass."""
        count, entries = (
            self.held["recoloured_places"].shape[0],
            self.held["recoloured_rows"].shape[0],
        )
        work = Work(
            flops=entries * _ENTRY_FLOPS + count * self.stored_flops,
            bytes_read=count * (4 + 4 + 24) + entries * (4 + 16),
            bytes_written=count * self.stored_bytes,
        )
        return [Pass(RECOLOUR, self._launches, work, stage=GEOMETRY)]

    def _launches(self) -> Sequence[Launch]:
        count = self.held["recoloured_places"].shape[0]
        args = (
            reads("materials", self.materials),
            reads("places", self.held["recoloured_places"]),
            reads("starts", self.held["recoloured_starts"]),
            reads("rows", self.held["recoloured_rows"]),
            reads("shares", self.held["recoloured_shares"]),
            reads("rest", self.held["recoloured_rest"]),
            integer("count", count),
            *self.store,
        )
        return [Launch(self.program, RECOLOUR, args, items=count)]
