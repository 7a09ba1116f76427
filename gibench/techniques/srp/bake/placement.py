"""Probes placed by what they do to the error (Silvennoinen and Lehtinen 2017, section 5.2 and 6).

From the paper's own placement all probes are moved to the middle of the open space that is nearest
to each, as probes beside surfaces are near to some and far from most (:func:`amid`); so are some
random sets, and the one that errs least is gone on from. Each probe in turn is moved to the place
that leaves the least error on the trial (:mod:`gibench.techniques.srp.bake.trial`), of all that lie
near it and some that lie anywhere, until no move is worth it. What is chosen by a trial suits that
trial: of the sets on the way the one is taken that errs least on another, with other receivers and
lights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi

import numpy as np
from scipy.spatial import cKDTree

from gibench.arrays import Doubles, Floats, Ints
from gibench.techniques.srp.bake.trial import Offer, Trial

# Places that a probe is tried at in a sweep: the nearest to it, and others.
NEAREST, ANYWHERE = 48, 32
SWEEPS = 12
# A sweep that takes less than this share off the squared error is the last.
WORTH = 0.002
_MIDDLES = 32
# Random sets that the middles are looked for from, and those of them that are tried.
STARTS, TRIED_STARTS = 32, 6


def amid(start: Doubles, places: Doubles) -> tuple[Doubles, float]:
    """``start`` (p, 3), m, moved to the middle of the ``places`` (c, 3) nearest to each, again and
    again (Lloyd 1982), and in the end to the place nearest to there; and the mean squared distance
    of a place from the nearest of them, m2.
    """
    at = start.copy()
    for _ in range(_MIDDLES):
        nearest = cKDTree(at).query(places)[1]
        own = np.bincount(nearest, minlength=len(at))
        sums = np.stack([np.bincount(nearest, places[:, i], len(at)) for i in range(3)], axis=1)
        at = np.where(own[:, None] > 0, sums / np.maximum(own, 1)[:, None], at)
    spread = float(np.square(cKDTree(at).query(places)[0]).mean())
    return np.asarray(places[cKDTree(places).query(at)[1]]), spread


def middles(start: Doubles, places: Doubles, rng: np.random.Generator) -> list[Doubles]:
    """Sets of probes amid ``places`` (c, 3), m: that from ``start`` (p, 3), and of those from
    random places the ones that lie nearest to all.
    """
    others = [
        amid(places[rng.choice(len(places), len(start), replace=len(places) < len(start))], places)
        for _ in range(STARTS)
    ]
    others.sort(key=lambda found: found[1])
    return [amid(start, places)[0], *(found for found, _ in others[:TRIED_STARTS])]


@dataclass
class State:
    """The sums of a set of probes over the trial's rays.

    Attributes:
        trial: what is judged by.
        light: (m, s, k) float32 sum of weight times radiance.
        weight: (m, s) float32 sum of the weights.
        error: (m,) squared error of each receiver.
    """

    trial: Trial = field(repr=False)
    light: Floats = field(repr=False)
    weight: Floats = field(repr=False)
    error: Doubles = field(repr=False)

    @staticmethod
    def of(trial: Trial, offers: Sequence[Offer]) -> State:
        """The state of a set of probes."""
        m, s = trial.valid.shape
        light = np.zeros((m, s, trial.truth.shape[1]), np.float32)
        state = State(trial, light, np.zeros((m, s), np.float32), np.zeros(m))
        for offer in offers:
            state.change(offer, 1.0)
        state.error[:] = state.errors(np.arange(m, dtype=np.int32), light, state.weight)
        return state

    def change(self, offer: Offer, sign: float) -> None:
        """Add a probe, or take it away; its receivers' errors are not yet made anew."""
        own = offer.receivers
        self.light[own] += np.float32(sign) * offer.weight[..., None] * offer.light
        self.weight[own] += np.float32(sign) * offer.weight

    def errors(self, own: Ints, light: Floats, weight: Floats) -> Doubles:
        """Squared errors (r,) of receivers ``own`` with these sums: irradiance is pi times the mean
        over the rays that any probe sees the end of (Bennett 2019, eq. 5.6).
        """
        seen = weight > 1e-7
        inverse = np.divide(1.0, weight, out=np.zeros_like(weight), where=seen)
        count = np.maximum(seen.sum(axis=1), 1)[:, None]
        found = pi * np.einsum("rsk,rs->rk", light, inverse) / count
        off = (found - self.trial.truth[own]) ** 2
        return np.asarray((self.trial.weight[own] * off).sum(axis=1), np.float64)

    def with_probe(self, offer: Offer) -> float:
        """The error of all receivers if the probe were added."""
        own = offer.receivers
        light = self.light[own] + offer.weight[..., None] * offer.light
        changed = self.errors(own, light, self.weight[own] + offer.weight)
        return float(self.error.sum() - self.error[own].sum() + changed.sum())


def place_by_error(
    trial: Trial, offers: Sequence[Offer], places: Doubles, start: Ints, seed: int
) -> tuple[Ints, list[float]]:
    """The places that are chosen, as indices, and the relative L2 error at first and after each
    sweep.

    Args:
        trial: what they are judged by.
        offers: of each place.
        places: (c, 3), m.
        start: (p,) places to begin with.
        seed: of the order and of places tried.
    """
    rng = np.random.default_rng([seed, 12])
    chosen = start.copy()
    state = State.of(trial, [offers[i] for i in chosen])
    told = [float(np.sqrt(state.error.sum()))]
    for _ in range(SWEEPS):
        for probe in rng.permutation(len(chosen)):
            own = int(chosen[probe])
            state.change(offers[own], -1.0)
            _again(state, offers[own].receivers)
            free = np.setdiff1d(np.arange(len(places)), chosen)
            distance = np.linalg.norm(places[free] - places[own], axis=1)
            near = free[np.argsort(distance)[:NEAREST]]
            far = rng.choice(free, min(ANYWHERE, len(free)), replace=False)
            tried = [own, *sorted({*near.tolist(), *far.tolist()})]
            found = [state.with_probe(offers[i]) for i in tried]
            best = tried[int(np.argmin(found))]
            chosen[probe] = best
            state.change(offers[best], 1.0)
            _again(state, offers[best].receivers)
        # Sums of float32 that were added to and taken from: made anew.
        state = State.of(trial, [offers[i] for i in chosen])
        told.append(float(np.sqrt(state.error.sum())))
        if told[-1] ** 2 > (1.0 - WORTH) * told[-2] ** 2:
            break
    return np.sort(chosen), told


def _again(state: State, own: Ints) -> None:
    state.error[own] = state.errors(own, state.light[own], state.weight[own])
