"""Every planted fault is found by the figure meant for it, and crosses no other's threshold."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from support.fake_technique import Fake, held

from gibench.measure.plan.grid import grid
from gibench.measure.statistics.faults import FAULTS
from gibench.measure.statistics.worst import FEWEST, STUTTER, worst_frames
from gibench.profiles import load_profile
from gibench.scene.load import load_scene
from gibench.study import quality
from gibench.study.quality_rows import QualityOptions
from gibench.study.settle import SettleOptions
from gibench.study.site import Site
from gibench.study.watched import taken_away
from gibench.techniques import registry
from gibench.techniques.job import Known
from gibench.techniques.registry import Follows, TechniqueSpec


@dataclass(frozen=True)
class PlantedSettings:
    hole: float = 0.0
    noise: float = 0.0
    black: int = 0
    uncovered: int = 0
    stays: float = 0.0
    stays_objects: float = 0.0
    deaf: bool = False
    waves: float = 0.0


class Planted(Fake):
    """The truth itself, with the fault that its settings say."""

    name: ClassVar[str] = "planted"
    light: ClassVar[Any] = None  # (n, 3), the truth
    at_dark: ClassVar[Any] = None  # (n,) how much of a hole in the wall reaches a dark receiver

    def __init__(self, device, job, world) -> None:
        super().__init__(device, job, world)
        self.planted, self.world = job.settings, world
        self.rng = np.random.default_rng(5)
        self.level = self.there = 1.0
        self.bright = self._strength(0)

    def _strength(self, frame: int) -> float:
        return sum(max(light.intensity) for light in self.world.scene.lights_at(frame))

    def begin_frame(self, frame: int) -> None:
        super().begin_frame(frame)
        wanted = self._strength(frame) / self.bright if not self.planted.deaf else 1.0
        self.level += (wanted - self.level) * (1 - self.planted.stays)
        motion = self.world.motion
        here = 1.0
        if motion is not None and not np.allclose(
            motion.transforms_in(frame), np.tile(np.eye(3, 4), (motion.objects, 1, 1))
        ):
            here = 0.5  # whatever is taken away halves the light
        self.there += (here - self.there) * (1 - self.planted.stays_objects)

    def indirect_irradiance(self):
        own, light = self.planted, self.light * self.level * self.there
        position = self.world.lightmap.receivers.position
        if own.hole:
            light = light + own.hole * self.at_dark[:, None] * self.light.mean()
        if own.waves:
            across = 2 * np.pi * position.sum(axis=1) / 3.0
            light = light * (1 + own.waves * np.sin(across))[:, None]
        if own.noise:
            light = light * (1 + own.noise * self.rng.normal(size=(len(light), 1)))
        light = light.copy()
        brightest = np.argsort(-self.light.sum(axis=1))
        light[brightest[: own.black]] = 0.0
        return light

    def covered(self):
        covered = np.ones(len(self.light), bool)
        covered[: self.planted.uncovered] = False
        return covered


def _buffers(known: Known):
    return [] if known.lightmap is None else held(known.receivers, 16)


SPEC = TechniqueSpec(
    name="planted",
    title="The truth with a fault",
    variants=("tuned",),
    settings_type=PlantedSettings,
    create=Planted,
    buffers=_buffers,
    follows=frozenset({Follows.DIRECT_LIGHT, Follows.INDIRECT_LIGHT}),
)
OPTIONS = QualityOptions(
    SettleOptions(frames=32), target_error=0.05, reference_paths=768, flip=False, watched=True
)
NOTHING = {"lag_light_half": 1, "lag_light_95": 1, "lag_object_half": 1, "lag_object_95": 1}


@dataclass(frozen=True)
class Case:
    """A fault, what it is planted by, and which figures must cross their thresholds: the one meant
    for it and those named beforehand.
    """

    settings: dict[str, Any]
    crosses: frozenset[str]
    figures: dict[str, float] = field(default_factory=dict)


CASES = {
    "none": Case({}, frozenset()),
    "a hole in the wall": Case({"hole": 1.0}, frozenset({"leak"})),
    "noise of 8 %": Case({"noise": 0.08}, frozenset({"flicker_p50", "flicker_p99"})),
    "a receiver left black": Case({"black": 1}, frozenset({"missing"})),
    "a receiver without a word": Case({"uncovered": 1}, frozenset({"missing"})),
    # Half way after ceil(ln 2 / -ln 0.95) = 14 frames, 95 % after 59.
    "a light that lags": Case(
        {"stays": 0.95},
        frozenset({"lag_light_half", "lag_light_95"}),
        {"lag_light_half": 14, "lag_light_95": 59},
    ),
    "objects that lag": Case(
        {"stays_objects": 0.95},
        frozenset({"lag_object_half", "lag_object_95"}),
        {"lag_object_half": 14, "lag_object_95": 59},
    ),
    "a light that is never followed": Case(
        {"deaf": True},
        frozenset({"lag_light_half", "lag_light_95"}),
        {"lag_light_half": np.inf, "lag_light_95": np.inf},
    ),
    "waves on the walls": Case({"waves": 0.15}, frozenset({"blotches"})),
}


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Figures of each case, from the run of a study."""
    site = Site(tmp_path_factory.mktemp("cache"))
    before = registry.techniques
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "techniques", lambda: {**before(), "planted": SPEC})
        settings = [SPEC.settings(case.settings) for case in CASES.values()]
        (plain,) = grid([load_profile("iphone7")], [SPEC], scenes=("two-rooms",), receivers=(2500,))
        jobs = [replace(plain, settings=one) for one in settings]
        group = quality.group_of(plain, OPTIONS, site)
        position = group.lightmap.receivers.position
        dark = group.truth.value.sum(axis=1) == 0
        Planted.light = group.truth.value
        # A round patch on the dark side of the wall between the rooms, and on the floor before it.
        near = np.linalg.norm(position - np.array([0.0, 1.0, 0.0]), axis=1)
        Planted.at_dark = np.where(dark & (position[:, 0] > 0), np.exp(-((near / 1.0) ** 2)), 0.0)
        found = quality.compare(jobs, OPTIONS, site)
    assert found.first_error is None
    rows = [row for row in found.rows if row["region"] == "whole"]
    return dict(zip(CASES, rows, strict=True))


@pytest.mark.parametrize("name", CASES)
def test_a_planted_fault_is_found_and_no_other(measured, name):
    case, row = CASES[name], measured[name]
    figures = {fault.name: row[fault.name] for fault in FAULTS}
    assert not any(np.isnan(value) for value in figures.values()), figures
    crossed = {fault.name for fault in FAULTS if figures[fault.name] > fault.threshold}
    assert crossed == case.crosses, figures
    for figure, wanted in {**NOTHING, **case.figures}.items():
        if figure in case.figures or figure not in case.crosses:
            assert figures[figure] == wanted
    assert row["dark_area"] > 0.2


def test_a_frame_of_three_times_the_length_is_told_by_stutter_alone():
    """Light does not know how long its frame took; a slow frame is the worst frames' figure."""
    times = np.full(200, 10.0)
    times[120] = 30.0
    worst = worst_frames(times, times, np.full(200, 2.5), 33.3)
    assert worst.stutter == pytest.approx(3.0)
    assert worst.stutter > STUTTER
    assert worst.longest_ms == 30.0 and worst.within_budget == 1.0
    assert (worst.pace, worst.budget) == ("stutters", "holds")
    steady = worst_frames(np.full(200, 10.0), np.full(200, 10.0), np.full(200, 2.5), 33.3)
    assert steady.stutter == 1.0 and len(times) > FEWEST


def test_what_is_taken_away_is_an_object_and_comes_back():
    scene = load_scene("cornell-box")
    (motion,) = taken_away(scene, 10, 20)
    assert motion.name == "tall box"
    bottom = float(scene.bounds[0][1])
    mine = np.isin(scene.object_ids, [scene.object_names.index("tall box")])
    top = float(scene.corners[mine][..., 1].max())
    for frame, gone in ((0, False), (9, False), (10, True), (19, True), (20, False), (400, False)):
        turn, shift = motion.pose(frame)
        assert np.allclose(turn, np.eye(3))
        assert (top + shift[1] < bottom) == gone
        assert gone or np.abs(shift).max() < 1e-12  # the curve's rounding
    names = {motion.name for motion in load_scene("hall").motions}
    assert {motion.name for motion in taken_away(load_scene("hall"), 10, 20)} == names
    nameless = replace(scene, object_names=())
    assert taken_away(nameless, 10, 20) == ()
