"""Placement by error as stages of a bake: what each place gives, in units, and the search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gibench.arrays import Doubles
from gibench.bake.stage import Arrays, Format, Keep, Stage, Unit, stage_key
from gibench.rays.embree import scene_tracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.placement import State, middles, place_by_error
from gibench.techniques.srp.bake.probes import (
    find_candidates,
    open_places,
    support_radius,
)
from gibench.techniques.srp.bake.sampling import sphere_directions
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.trial import (
    Lights,
    Offer,
    Trial,
    make_offers,
    make_trial,
)
from gibench.work import Worker

# Raised whenever what a stage computes, or how it is stored, changes.
OFFERS_VERSION = PLACEMENT_VERSION = 3

# Places to choose from for each probe: beside surfaces, and anywhere in the open; and those whose
# middle it is moved to first.
BESIDE, OPEN, FREE = 2, 6, 200
UNITS = 16
# Then each probe is tried at so many places about its own, so far off, in radii of its support.
MOVED, MOVES = 12, (0.2, 0.12, 0.07)


@dataclass(frozen=True)
class Placing:
    """What placement by error is computed from.

    Attributes:
        scene: the scene.
        lightmap: its receivers.
        settings: of the bake.
        seed: of every random choice.
    """

    scene: Scene = field(repr=False)
    lightmap: Lightmap = field(repr=False)
    settings: SrpBakeSettings
    seed: int


@dataclass(frozen=True)
class Ground:
    """What all units share, made anew in each process: the same for the same probes.

    Attributes:
        places: (c, 3) where probes may be, m: first those in the middle of the open space.
        radius: of their support there, m.
        trial: what they are judged by.
        lights: on the scene.
        held: another trial and its lights, which no place is chosen by.
    """

    places: Doubles = field(repr=False)
    radius: float
    trial: Trial = field(repr=False)
    lights: Lights = field(repr=False)
    held: tuple[Trial, Lights] = field(repr=False)


def placement_stages(
    scene: Scene,
    lightmap: Lightmap,
    settings: SrpBakeSettings,
    seed: int,
    start: Stage,
    stored: Format,
) -> tuple[Stage, Stage]:
    """What each place gives, kept until the bake is done, and the probes.

    Args:
        scene: the scene.
        lightmap: its receivers.
        settings: of the bake.
        seed: of every random choice.
        start: the stage of the published placement.
        stored: how probes are stored.
    """
    given = Placing(scene, lightmap, settings, seed)
    told = ("scene", scene.name), ("receivers", len(lightmap.receivers)), ("seed", seed)
    offers = Stage(
        name="srp-offers",
        key=stage_key(
            "srp-offers",
            OFFERS_VERSION,
            settings.order,
            settings.relight_samples,
            settings.least_valid,
            lightmap.receivers.albedo,
            _sky_shines(scene),
            needs=(start,),
        ),
        compute=_offers,
        given=given,
        needs=(start,),
        units=tuple(Unit(f"places-{index:02d}", index) for index in range(UNITS)),
        format=Format(_write_offers, _read_offers),
        keep=Keep.WHILE_NEEDED,
        title="Trying places for probes",
        made_from=told,
    )
    chosen = Stage(
        name="srp-placement",
        key=stage_key("srp-placement", PLACEMENT_VERSION, settings.overlap, needs=(offers,)),
        compute=_placement,
        given=given,
        needs=(start, offers),
        format=stored,
        made_from=told,
    )
    return offers, chosen


def _sky_shines(scene: Scene) -> bool:
    around = sphere_directions(64, np.random.default_rng(0)).astype(np.float32)
    return bool(np.any(scene.environment.radiance(around)))


def make_ground(given: Placing, start: ProbeSet) -> Ground:
    """The places, and what they are judged by."""
    scene, lightmap, tracer = given.scene, given.lightmap, scene_tracer(given.scene)
    wanted = len(start)
    rng = np.random.default_rng([given.seed, 10])
    beside = find_candidates(scene, tracer, wanted, rng)
    free = open_places(scene, tracer, beside, FREE * wanted, rng)
    trials = [
        make_trial(scene, lightmap, tracer, given.settings, start, free, given.seed + number)
        for number in range(2)
    ]
    sets = middles(start.positions.astype(np.float64), free, rng)
    middle = min(
        (_reaching(given, own) for own in sets), key=lambda own: error_on(given, trials[0], own)
    )
    places = [
        middle.positions.astype(np.float64),
        _some(beside, BESIDE * wanted, rng),
        _some(free, OPEN * wanted, rng),
    ]
    return Ground(np.concatenate(places), middle.radius, *trials[0], trials[1])


def _some(places: Doubles, count: int, rng: np.random.Generator) -> Doubles:
    return places[np.sort(rng.choice(len(places), min(len(places), count), replace=False))]


def _offers(given: Placing, needed: Sequence[Any], unit: Unit, worker: Worker) -> tuple[Offer, ...]:
    """What every so manieth place gives."""
    start: ProbeSet = needed[0]
    ground = worker.shared("srp placement", lambda: make_ground(given, start))
    own = ground.places[unit.index :: UNITS]
    return tuple(_given_by(given, ground.trial, ground.lights, own, ground.radius))


def _given_by(
    given: Placing, trial: Trial, lights: Lights, places: Doubles, radius: float
) -> list[Offer]:
    return make_offers(
        given.scene,
        given.lightmap,
        scene_tracer(given.scene),
        given.settings,
        trial,
        lights,
        places,
        radius,
        given.seed,
    )


def _placement(given: Placing, needed: Sequence[Any], unit: Unit, worker: Worker) -> ProbeSet:
    """Of the sets of probes on the way the one that errs least on the trial held back."""
    start: ProbeSet = needed[0]
    ground = worker.shared("srp placement", lambda: make_ground(given, start))
    sets = [start, *(_reaching(given, own) for own in _moved(given, ground, needed[1], len(start)))]
    return min(sets, key=lambda own: error_on(given, ground.held, own))


def _reaching(given: Placing, positions: Doubles) -> ProbeSet:
    places = positions.astype(np.float32)
    receivers = given.lightmap.receivers.position
    return ProbeSet(places, support_radius(places, receivers, given.settings.overlap))


def error_on(given: Placing, judged_by: tuple[Trial, Lights], probes: ProbeSet) -> float:
    """Squared relative L2 error of ``probes`` on a trial."""
    trial, lights = judged_by
    places = probes.positions.astype(np.float64)
    offers = _given_by(given, trial, lights, places, probes.radius)
    return float(State.of(trial, offers).error.sum())


def _moved(
    given: Placing, ground: Ground, found: Sequence[Sequence[Offer]], wanted: int
) -> Iterator[Doubles]:
    """Sets of probes (p, 3), m: in the middle of the open space, then moved far, then a little."""
    places = ground.places
    by_place = {
        index + UNITS * number: offer
        for index, own in enumerate(found)
        for number, offer in enumerate(own)
    }
    offers = [by_place[index] for index in range(len(places))]
    chosen = np.arange(wanted, dtype=np.int32)
    yield places[chosen]
    tracer, rng = scene_tracer(given.scene), np.random.default_rng([given.seed, 13])
    for number, size in enumerate((*MOVES, 0.0)):
        chosen, _ = place_by_error(ground.trial, offers, places, chosen, given.seed + number)
        yield places[chosen]
        if not size:
            return
        own = places[np.repeat(chosen, MOVED)]
        moves = rng.normal(size=own.shape) * (size * ground.radius)
        free = ~tracer.occluded(own.astype(np.float32), (1.05 * moves).astype(np.float32), 1.0)
        tried = (own + moves)[free]
        offers = [offers[i] for i in chosen]
        offers += _given_by(given, ground.trial, ground.lights, tried, ground.radius)
        places = np.concatenate([places[chosen], tried])
        chosen = np.arange(wanted, dtype=np.int32)


def _write_offers(offers: tuple[Offer, ...]) -> Arrays:
    return {
        "counts": np.array([len(offer.receivers) for offer in offers], np.int64),
        **{
            name: np.concatenate([getattr(offer, name) for offer in offers])
            for name in ("receivers", "weight", "light")
        },
    }


def _read_offers(unit: Unit, stored: Arrays) -> tuple[Offer, ...]:
    cuts = np.cumsum(stored["counts"])[:-1]
    parts = (np.split(stored[name], cuts) for name in ("receivers", "weight", "light"))
    return tuple(Offer(*own) for own in zip(*parts, strict=True))
