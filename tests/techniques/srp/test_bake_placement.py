"""Probes placed by what they do to the error."""

from __future__ import annotations

import numpy as np
import pytest
from support.srp_setups import SETTINGS, bake
from support.tiny_scenes import room

from gibench.bake.run import BakeReport, run_bake
from gibench.errors import BadInput
from gibench.rays.embree import EmbreeTracer
from gibench.techniques.srp.bake import placement, placement_stages
from gibench.techniques.srp.bake import trial as trial_module
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.placement import (
    TRIED_STARTS,
    State,
    amid,
    middles,
    place_by_error,
)
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import Given, srp_stages
from gibench.techniques.srp.bake.trial import (
    SUMS,
    Lights,
    Offer,
    Trial,
    make_offers,
    make_trial,
    random_lights,
)
from gibench.techniques.srp.bake.weights import spatial_weight

PLACES = np.array([[-0.6, 1.5, -0.7], [0.7, 0.4, 0.8], [0.0, 1.7, 0.1]])


def trial_of(rng, order=3, relight=128):
    scene, lightmap = room(4, open_top=True)
    tracer = EmbreeTracer(scene.corners, threads=1)
    start = ProbeSet(PLACES.astype(np.float32), 2.5)
    settings = SrpBakeSettings(sh_order=order, relight_samples=relight)
    seed = int(rng.integers(1000))
    trial, lights = make_trial(scene, lightmap, tracer, settings, start, PLACES, seed)
    given = scene, lightmap, tracer, settings, trial, lights
    return given, make_offers(*given, PLACES, 2.5, seed)


def test_an_offer_is_the_direct_evaluation_in_float64(rng):
    """Weights by eq. 4.4 of Bennett 2019 where the probe sees the ray's end; radiance by its
    harmonics in the direction of that end; the state's irradiance by equation 2 of the paper.
    """
    (_, _, tracer, _, trial, lights), offers = trial_of(rng)
    count, rays = trial.valid.shape
    light = np.zeros((count, rays, lights.sent.shape[1]))
    total = np.zeros((count, rays))
    for place, offer in zip(PLACES, offers, strict=True):
        near = np.linalg.norm(trial.position - place, axis=1)
        assert np.array_equal(offer.receivers, np.flatnonzero(spatial_weight(near / 2.5) > 0))
        seen = offer.weight > 0
        own = offer.receivers
        assert (trial.valid[own] | ~seen).all()
        expected = spatial_weight(near[own] / 2.5)[:, None] * seen
        np.testing.assert_allclose(offer.weight, expected, rtol=1e-6)
        # A ray to the end meets nothing before it; one that was refused meets something.
        end = trial.place[own] - place * ~trial.escaped[own][..., None]
        limit = np.where(trial.escaped[own], np.inf, 0.999).astype(np.float32)
        rows = np.argwhere(seen)[:: max(1, seen.sum() // 40)]
        for r, s in rows:
            hit = tracer.closest(place[None].astype(np.float32), end[r, s][None].astype(np.float32))
            assert hit.triangle[0] < 0 or hit.distance[0] > limit[r, s] - 2e-3
        light[own] += offer.weight[..., None] * offer.light.astype(np.float64)
        total[own] += offer.weight
    state = State.of(trial, offers)
    seen = total > 0
    radiance = light / np.where(seen, total, 1.0)[..., None]
    found = np.pi * radiance.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)[:, None]
    error = (trial.weight * (found - trial.truth) ** 2).sum(axis=1)
    np.testing.assert_allclose(state.error, error, rtol=1e-3, atol=1e-9 + 1e-4 * error.max())
    without = State.of(trial, offers[:2])
    assert without.with_probe(offers[2]) == pytest.approx(state.error.sum(), rel=1e-3)


def test_receivers_that_are_left_dark_count_nothing(rng):
    """One probe of short reach at first: what it reaches counts if it sees the ends of a fifth of
    its rays, found here by rays the other way; all else does not.
    """
    scene, lightmap = room(4, open_top=True)
    tracer = EmbreeTracer(scene.corners, threads=1)
    at = PLACES[rng.integers(len(PLACES)), None] + rng.uniform(-0.05, 0.05, (1, 3))
    start = ProbeSet(at.astype(np.float32), 1.2)
    settings = SrpBakeSettings(sh_order=1, relight_samples=64, least_valid=0.2)
    trial, _ = make_trial(scene, lightmap, tracer, settings, start, PLACES, int(rng.integers(1000)))
    counts, place = trial.weight[:, 0] > 0, start.positions[0]
    own = np.linalg.norm(trial.position - place, axis=1) < 1.2
    assert 0 < counts.sum() < len(counts) and not counts[~own].any()
    end, escaped = trial.place[own], trial.escaped[own]
    origin = np.where(escaped[..., None], place, end).reshape(-1, 3)
    way = np.where(escaped[..., None], end, place - end).reshape(-1, 3)
    limit = np.where(escaped, np.inf, 1.0).astype(np.float32)
    seen = ~tracer.occluded(origin, way, limit.ravel()).reshape(limit.shape)
    plane = trial.plane[own]
    seen &= escaped | (plane[..., :3] @ place > plane[..., 3])
    share = (trial.valid[own] & seen).mean(axis=1)
    sure = np.abs(share - 0.2) > 0.03
    assert np.array_equal(counts[own][sure], share[sure] > 0.2)


def test_what_lights_send_along_a_ray(rng):
    """A lobe of the sky is the squared cosine about its axis; a black end is black."""
    (_, _, _, _, trial, lights), _ = trial_of(rng)
    directions = rng.normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    receiver = np.array([-1, -1, -1, 3, 7])
    escaped = np.array([True, True, False, False, False])
    seen = lights.seen(receiver, escaped, directions.astype(np.float32))
    lobes = np.maximum(directions[:2] @ lights.axis.T, 0) ** 2 * lights.sky
    expected = lobes @ lights.share
    np.testing.assert_allclose(seen[:2], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    assert not seen[2].any()
    np.testing.assert_array_equal(seen[3:], lights.sent[[3, 7]])
    assert np.isfinite(trial.truth).all() and (trial.weight > 0).all()


def test_sums_of_lights_are_the_sums_of_what_they_send(rng):
    lights = Lights(
        rng.random((9, 5)).astype(np.float32), rng.normal(size=(5, 3)), rng.random(5), np.eye(5)
    )
    share = rng.normal(size=(5, 3))
    directions = rng.normal(size=(6, 3)).astype(np.float32)
    receiver, escaped = np.array([2, -1, -1, 8, 0, -1]), np.array([0, 1, 0, 0, 0, 1], np.bool_)
    each = lights.seen(receiver, escaped, directions).astype(np.float64)
    summed = lights.summed(share).seen(receiver, escaped, directions)
    np.testing.assert_allclose(summed, each @ share, rtol=0, atol=1e-5 * np.abs(each).sum())


def test_an_error_under_the_sums_is_the_mean_of_all_lights_own(rng, monkeypatch):
    """A truth that is nothing: every light errs by all of itself, so that the whole is 1 but for
    the chance of the sums, whose squares are chi-squared with 2,000 degrees of freedom and fewer
    where lights are alike.
    """
    monkeypatch.setattr(trial_module, "SUMS", 2000)
    (_, _, _, _, trial, _), _ = trial_of(rng)
    assert float((trial.weight * trial.truth**2).sum()) == pytest.approx(1.0, abs=0.2)


def test_the_search_finds_the_place_that_sees_everything(rng):
    """Of places whose radiance is wrong by known factors, the true ones win, and the error told is
    the error left."""
    receivers, rays, lights = 12, 8, 3
    truth = rng.uniform(1, 2, (receivers, lights))
    radiance = np.repeat(truth[:, None] / np.pi, rays, axis=1)
    trial = Trial(
        rng.random((receivers, 3)),
        np.full((receivers, 1), 1.0 / (receivers * lights)),
        np.zeros((receivers, rays, 3), np.float32),
        np.zeros((receivers, rays, 4), np.float32),
        np.zeros((receivers, rays), np.bool_),
        np.ones((receivers, rays), np.bool_),
        truth,
    )
    every = np.arange(receivers, dtype=np.int32)
    factors = rng.permutation([1.0, 1.0, *rng.uniform(1.5, 3.0, 10)])
    weight = np.ones((receivers, rays), np.float32)
    offers = [Offer(every, weight, (f * radiance).astype(np.float16)) for f in factors]
    places = rng.random((12, 3))
    wrong = np.flatnonzero(factors > 1)[:2].astype(np.int32)
    chosen, told = place_by_error(trial, offers, places, wrong, seed=3)
    assert np.array_equal(chosen, np.flatnonzero(factors == 1))
    assert told[0] > 0.4 and told[-1] < 2e-3


def test_amid_open_space_probes_lie_like_a_lattice(rng, monkeypatch):
    """In a cube 8 probes near its middle go to the middles of its eighths, and of sets from random
    starts the ones that are tried lie no farther from all."""
    places = np.stack(np.meshgrid(*[np.linspace(-1, 1, 11)] * 3), axis=-1).reshape(-1, 3)
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    start = 0.4 * corners + rng.uniform(-0.05, 0.05, corners.shape)
    found, spread = amid(start, places)
    np.testing.assert_allclose(found, corners, atol=0.15)
    assert spread == pytest.approx(3 * 0.5**2 / 3, rel=0.3)
    monkeypatch.setattr(placement, "STARTS", 8)
    sets = middles(start, places, rng)
    assert len(sets) == 1 + TRIED_STARTS and all(own.shape == (8, 3) for own in sets)


def test_lights_leave_no_place_black_and_come_again(rng):
    (scene, lightmap, tracer, settings, trial, lights), _ = trial_of(rng)
    around = np.eye(3, dtype=np.float32)
    each = random_lights(scene, lightmap, tracer, PLACES, around, 0.1, rng)
    assert (each.sent >= 0).all() and (each.sent.max(axis=0) > 0).sum() > 20
    assert lights.sent.shape == (len(lightmap.receivers), SUMS) and lights.sent.any(axis=0).all()
    assert trial.truth.any(axis=0).all()
    again, _ = make_trial(
        scene, lightmap, tracer, settings, ProbeSet(PLACES.astype(np.float32), 2.5), PLACES, 5
    )
    twice, _ = make_trial(
        scene, lightmap, tracer, settings, ProbeSet(PLACES.astype(np.float32), 2.5), PLACES, 5
    )
    assert np.array_equal(again.truth, twice.truth)


def test_a_bake_places_by_error_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(placement_stages, "OPEN", 3)
    monkeypatch.setattr(trial_module, "RAYS", 24)
    monkeypatch.setattr(placement_stages, "FREE", 40)
    monkeypatch.setattr(placement, "STARTS", 8)
    report = BakeReport()
    made = bake(tmp_path, report, placement="error")
    published = bake(tmp_path)
    assert len(made.probes) == len(published.probes) == 6
    assert not np.array_equal(made.probes.positions, published.probes.positions)
    assert made.usable_share >= published.usable_share - 0.01
    assert report.stages["srp-offers"].baked == placement_stages.UNITS
    scene, lightmap = room(5)
    stages = srp_stages(Given(scene, lightmap, SrpBakeSettings(**SETTINGS, placement="error")))
    names = [stage.name for stage in stages]
    assert names[:3] == ["srp-probes", "srp-offers", "srp-placement"]
    assert not list(tmp_path.glob("srp-offers*/places-*"))  # of no use afterwards
    again = BakeReport()
    run_bake(stages, tmp_path, report=again)
    assert all(not stage.baked for name, stage in again.stages.items() if name != "srp-bake")
    with pytest.raises(BadInput, match="placement is 'best'"):
        SrpBakeSettings(placement="best")
