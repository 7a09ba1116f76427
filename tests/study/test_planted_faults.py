"""Every planted fault is found by the figure meant for it, and crosses no other's threshold.

The hole in the wall is one in a mesh: two closed rooms, a lamp in one, and a square of the wall
between them that the truth sees and the technique does not.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from support.fake_technique import Fake, held

from gibench.arrays import Doubles
from gibench.measure.plan.grid import grid
from gibench.measure.statistics.faults import FAULTS, Moments
from gibench.measure.statistics.worst import FEWEST, STUTTER, worst_frames
from gibench.profiles import load_profile
from gibench.reference.path_tracer import reference_irradiance
from gibench.report import faults
from gibench.scene import builtin
from gibench.scene.builtin import two_rooms
from gibench.scene.builtin.pieces import Piece, panel
from gibench.scene.lightmap import some_receivers
from gibench.scene.load import load_scene
from gibench.scene.model import Scene
from gibench.study import quality
from gibench.study.quality_rows import Group, QualityOptions, rows_of
from gibench.study.settle import SettleOptions, settle
from gibench.study.site import Site
from gibench.study.watched import Altered, Watch, not_told, taken_away
from gibench.techniques import registry
from gibench.techniques.job import Known, Shot
from gibench.techniques.registry import Follows, TechniqueSpec
from gibench.work import Worker


@dataclass(frozen=True)
class PlantedSettings:
    hole: bool = False
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
    holed: ClassVar[Any] = None  # (n, 3), that of the mesh with the hole

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
        own = self.planted
        light = (self.holed if own.hole else self.light) * self.level * self.there
        position = self.world.lightmap.receivers.position
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
    "a hole in the wall": Case({"hole": True}, frozenset({"leak"})),
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


def walled(settings) -> list[Piece]:
    """The two rooms, the wall between them with a square metre that is an object of its own, the
    last triangles of all: `plug`.
    """
    whole = two_rooms.parts(settings)
    made = [piece for piece in whole if piece.name not in ("lit right", "dark left")]
    _, height, depth = settings.geometry["rooms"]["size"]
    x, z = settings.geometry["rooms"]["wall"] / 2, depth / 2
    around = [
        (-z, HOLE[0][0], 0.0, height),
        (HOLE[0][1], z, 0.0, height),
        (*HOLE[0], 0.0, HOLE[1][0]),
        (*HOLE[0], HOLE[1][1], height),
    ]
    for name, squares in (("wall", around), ("plug", [(*HOLE[0], *HOLE[1])])):
        for left, right, low, high in squares:
            up, along = (0, high - low, 0), right - left
            made.append(panel(name, "lit right", (-x, low, left), (0, 0, along), up))
            made.append(panel(name, "dark left", (x, low, right), (0, 0, -along), up))
    return made


HOLE = (-0.5, 0.5), (0.6, 1.6)
"""Along z and y, m."""


def cut(scene: Scene) -> Scene:
    """``scene`` without its plug; what is left has the numbers that it had."""
    left = scene.object_ids != scene.object_names.index("plug")
    count = int(left.sum())
    assert left[:count].all() and 0 < count < len(left)
    return replace(
        scene,
        triangles=scene.triangles[left],
        material_ids=scene.material_ids[left],
        object_ids=scene.object_ids[left],
    )


def seen_with_hole(group: Group) -> Doubles:
    """Path-traced light (n, 3) of the mesh with the hole; on what was cut away the truth's."""
    fragments, light = group.lightmap.fragments, group.truth.value.copy()
    holed = cut(group.scene)
    gone = np.maximum.reduceat(fragments.triangle, fragments.start[:-1]) >= len(holed.triangles)
    there = np.flatnonzero(~gone)
    traced = reference_irradiance(
        holed, some_receivers(group.lightmap, there), paths=group.about["paths"]
    )
    light[there] = traced.value
    return light


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Figures of each case, from the run of a study."""
    site = Site(tmp_path_factory.mktemp("cache"))
    before = registry.techniques
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "techniques", lambda: {**before(), "planted": SPEC})
        patch.setitem(builtin._MAKERS, "two-rooms", walled)
        settings = [SPEC.settings(case.settings) for case in CASES.values()]
        (plain,) = grid([load_profile("iphone7")], [SPEC], scenes=("two-rooms",), receivers=(2500,))
        jobs = [replace(plain, settings=one) for one in settings]
        group = quality.group_of(plain, OPTIONS, site)
        Planted.light, Planted.holed = group.truth.value, seen_with_hole(group)
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


@pytest.mark.slow
def test_a_real_technique_s_hole_is_found(tmp_path, monkeypatch):
    """DDGI without the square metre of wall that the truth has, against DDGI with it."""
    monkeypatch.setitem(builtin._MAKERS, "two-rooms", walled)
    site, spec = Site(tmp_path), registry.find_technique("ddgi")
    (job,) = grid([load_profile("vega56")], [spec], scenes=("two-rooms",), receivers=(2500,))
    job = replace(job, shot=Shot(96, 54))
    options = replace(OPTIONS, settle=SettleOptions(frames=256))
    group = quality.group_of(job, options, site)
    crossed, leaks = [], []
    for shared in (site.standing(), Altered(site.standing(), cut)):
        watch = Watch.over(shared)
        settled = settle(
            job, options.settle, watch.shared, site.cl_device, Worker(), then=watch.observe
        )
        row = rows_of(settled, group, options, "ddgi")[0]
        crossed.append({fault.name for fault in FAULTS if row[fault.name] > fault.threshold})
        leaks.append(row["leak"])
    assert crossed[1] == crossed[0] | {"leak"}
    assert leaks[1] > leaks[0] + 0.05


def yard(folder, strength) -> str:
    """A floor and a wall under a sky, with a lamp of so many W/sr."""
    (folder / "yard.obj").write_text(
        "v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nv -2 3 -2\nv 2 3 -2\nf 1 4 3 2\nf 1 2 6 5\n"
    )
    path = folder / f"yard-{strength}.toml"
    path.write_text(
        'schema_version = 1\nname = "yard"\n[[mesh]]\nfile = "yard.obj"\n'
        '[environment]\ntype = "constant"\nradiance = [1.0, 1.0, 1.0]\n'
        '[[light]]\ntype = "point"\nposition = [0.0, 2.0, 0.0]\n'
        f"intensity = [{strength}, {strength}, {strength}]\n"
    )
    return str(path)


def test_a_light_that_makes_too_little_is_not_called_never(tmp_path):
    """Under a sky a lamp of a thousandth of its light cannot be seen to be followed; it is told
    which and how much, and a bright one that is not followed is never.
    """
    settled = Moments()
    for light in (np.full(4, 0.99), np.full(4, 1.01)):
        settled.add(light)
    told = {}
    for strength in (0.004, 6.0, 100.0):
        told[strength] = not_told(load_scene(yard(tmp_path, strength)), settled, np.ones(4))
    weak = r"1 point light makes about 0\.00\d+ % of the indirect light, too little .*"
    assert re.fullmatch(weak, told[0.004])
    assert told[6.0].endswith("less than its flicker hides")
    assert told[100.0] == ""
    reason = told[0.004]
    never = {fault.name: np.nan for fault in FAULTS} | {"result": "a", "technique": "srp"}
    never |= {"flicker_p50": 0.0, "dark_area": 0.5, "lag_light_reason": reason}
    table = pd.DataFrame([never, never | {"result": "b", "lag_light_reason": np.nan}])
    text = "\n".join(faults.told(table))
    assert (
        text.count("cannot tell") == 2
        and f"a: how long light takes cannot be told: {reason}." in text
    )
    assert "never" not in text
    out = Console(width=200, record=True, file=io.StringIO())
    faults.show_faults(out, table)
    assert out.export_text().count("cannot tell") == 2
    bars = {bar["name"]: bar for bar in faults.profile_of(never)}
    assert set(bars) == {"flicker p50", "light half", "light 95 %"}
    assert bars["light half"]["text"] == "cannot tell" and reason in bars["light half"]["meaning"]
    assert bars["light half"]["length"] == 0 and not bars["light half"]["bad"]


def test_a_technique_under_a_lamp_that_makes_too_little(tmp_path):
    """Through a whole study: neither a figure nor never, but why."""
    path = yard(tmp_path, 0.004)
    before = registry.techniques
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "techniques", lambda: {**before(), "planted": SPEC})
        (job,) = grid([load_profile("iphone7")], [SPEC], scenes=(path,), receivers=(60,))
        site, options = Site(tmp_path), replace(OPTIONS, target_error=0.5, reference_paths=64)
        Planted.light = np.ones_like(quality.group_of(job, options, site).truth.value)
        quiet = replace(job, settings=SPEC.settings({"deaf": True}))
        row = quality.compare([quiet], options, site).rows[0]
    assert np.isnan(row["lag_light_half"]) and np.isnan(row["lag_light_95"])
    assert row["lag_light_reason"].startswith("1 point light makes about 0.00")


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
