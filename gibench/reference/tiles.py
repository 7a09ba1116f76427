"""A truth traced by an executor: tiles of rounds, computed anywhere and added in order.

A tile is what one wave traces of a round. Rounds are added in their order and only as many as it
takes, so that the result is that of tracing them one after another; what workers traced beyond that
is dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.reference import store
from gibench.reference.packed import pack_scene
from gibench.reference.starts import CameraStart, ReceiverStart
from gibench.reference.wavefront import Wavefront, Work, owners_at_once, wave_capacity
from gibench.scene.model import Scene
from gibench.work import Executor, Worker


@dataclass(frozen=True)
class Tracing:
    """What all tiles of a truth are traced from: plain data.

    Attributes:
        scene: the scene.
        frame: whose lights.
        normal_maps: whether they bend the receivers' normals.
        start: where paths start.
        bounces: at most; None for any number.
        samples: paths per owner and round.
    """

    scene: Scene = field(repr=False)
    frame: int
    normal_maps: bool
    start: ReceiverStart | CameraStart = field(repr=False)
    bounces: int | None
    samples: int


@dataclass(frozen=True)
class Tile:
    """A unit of work.

    Attributes:
        round: its number, counted from 0.
        first: of the owners that it holds.
        seed: of the round.
    """

    round: int
    first: int
    seed: int

    @property
    def name(self) -> str:
        """In messages."""
        return f"round {self.round + 1} of the truth from {self.first}"


@dataclass(frozen=True)
class Traced:
    """A tile's means (n, 3), and what they cost."""

    means: Doubles = field(repr=False)
    work: Work


def trace_tile(tracing: Tracing, tile: Tile, worker: Worker) -> Traced:
    """Trace one tile."""

    def wavefront() -> Wavefront:
        packed = pack_scene(tracing.scene, tracing.frame, tracing.normal_maps)
        tracer = scene_tracer(tracing.scene)
        return Wavefront(packed, tracer, tracing.start, tracing.bounces)

    made = worker.own("wavefront", wavefront)
    made.work = Work()
    means = made.tile(tile.first, tracing.samples, tile.seed)
    return Traced(means, made.work)


def traced_rounds(
    tracing: Tracing,
    rounds: store.Rounds,
    executor: Executor,
    *,
    seeds: Callable[[int], int],
    done: Callable[[], bool],
    most: int,
    keep: Callable[[bool], None],
    advance: Callable[[int], None],
) -> None:
    """Add rounds to ``rounds`` until they are ``done``, or ``most``.

    Args:
        tracing: what is traced.
        rounds: so far.
        executor: traces the tiles.
        seeds: of a round by its number.
        done: whether it is enough.
        most: rounds in all.
        keep: called after every round, and with True at the end, whatever ended it.
        advance: called with the number of paths of each tile.
    """
    owners = tracing.start.owners
    capacity = wave_capacity(pack_scene(tracing.scene, tracing.frame, tracing.normal_maps))
    at_once = owners_at_once(capacity, owners, tracing.samples)
    firsts = range(0, owners, at_once)
    open_rounds: dict[int, dict[int, npt.NDArray[np.float64]]] = {}
    works: dict[int, list[Work]] = {}
    enough = done()

    def tiles() -> Iterator[Tile]:
        number = rounds.count
        while number < most and not enough:
            for first in firsts:
                if enough:
                    return
                yield Tile(number, first, seeds(number))
            number += 1

    def take(tile: Tile, traced: Traced) -> None:
        nonlocal enough
        open_rounds.setdefault(tile.round, {})[tile.first] = traced.means
        works.setdefault(tile.round, []).append(traced.work)
        advance(len(traced.means) * tracing.samples)
        while not enough and len(open_rounds.get(rounds.count, ())) == len(firsts):
            number = rounds.count
            parts = open_rounds.pop(number)
            rounds.add(np.concatenate([parts[first] for first in firsts]))
            for work in works.pop(number):
                rounds.work.rays += work.rays
                rounds.work.ray_seconds += work.ray_seconds
                rounds.work.seconds += work.seconds
            enough = done()
            keep(False)

    try:
        executor.run(trace_tile, tracing, tiles(), take)
    finally:
        if rounds.count:
            keep(True)
