"""Settled light that profiles share: by a key of all that decides it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gibench.errors import CannotRun
from gibench.measure.plan.grid import grid
from gibench.profiles import load_profile
from gibench.study import kept_light, run_errors
from gibench.study.kept_light import light_key, settled_light, within_limits
from gibench.study.run_errors import QuickTruth
from gibench.study.settle import Settled, SettleOptions, settled_remark
from gibench.study.site import Site
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique
from gibench.work import Worker

OPTIONS = SettleOptions(frames=4)


def job_for(profile: str = "iphone7", technique: str = "ddgi", **more: Any) -> Job:
    """A small job on the Cornell Box."""
    (job,) = grid(
        [load_profile(profile)],
        [find_technique(technique)],
        scenes=("cornell-box",),
        receivers=(300,),
        variants=("tuned",),
        layouts=("wide",),
        shot=Shot(32, 18),
    )
    return replace(job, **more)


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path)


def key_of(job: Job, site: Site, **more: Any) -> str:
    lightmap = site.standing().lightmap(job.scene, 300)
    return light_key(job, OPTIONS, site, lightmap, **more)


class Settler:
    """Stands for ``settle``: light of a value a call, and how often it was asked."""

    def __init__(self, rng: np.random.Generator, **made: Any) -> None:
        self.rng, self.made, self.asked = rng, {"settled": True, "unrested": ""} | made, 0

    def __call__(
        self, job: Job, options: SettleOptions, shared: Any, *others: Any, **more: Any
    ) -> Settled:
        self.asked += 1
        lightmap = shared.lightmap(job.scene, job.receivers)
        light = self.rng.uniform(0.1, 1, (len(lightmap.receivers), 3))
        covered = self.rng.uniform(size=len(light)) < 0.9
        return Settled(
            job, {}, 7, lightmap, light, covered, 2, change=0.25, times=None, **self.made
        )  # type: ignore[arg-type]


@pytest.fixture
def planted(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> Callable[..., Settler]:
    def plant(**made: Any) -> Settler:
        settler = Settler(rng, **made)
        monkeypatch.setattr(kept_light, "settle", settler)
        return settler

    return plant


def test_profile_and_work_group_size_alone_are_not_in_the_key(site: Site) -> None:
    mine = job_for()
    key = key_of(mine, site)
    assert key == key_of(job_for("vega56"), site)
    assert key == key_of(replace(mine, workgroup_size=64), site)
    ddgi = mine.settings
    different = [
        replace(mine, settings=replace(ddgi, rays=ddgi.rays + 1)),
        replace(mine, variant="published", layout=None),
        replace(mine, layout="simt"),
        replace(mine, seed=1),
        replace(mine, shot=Shot(33, 18)),
        job_for(technique="gibs"),
    ]
    keys = {key, *(key_of(each, site) for each in different)}
    keys.add(key_of(mine, site, within=within_limits(mine)))
    keys.add(
        light_key(
            mine, replace(OPTIONS, frames=5), site, site.standing().lightmap("cornell-box", 300)
        )
    )
    keys.add(light_key(mine, OPTIONS, site, site.standing().lightmap("cornell-box", 200)))
    assert len(keys) == len(different) + 4
    assert within_limits(mine) != within_limits(job_for("vega56"))


def test_a_techniques_own_code_is_in_the_key_and_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """An edit of DDGI's kernels leaves GIBS' kept light alone; one of a part all depend on."""
    true = kept_light._sources
    edited, seen = "", set()

    def sources(folder: Any, without: set[str], prefix: str = "") -> Any:
        for name, content in true(folder, without, prefix):
            seen.add(name)
            yield name, content + b"//" if name == edited else content

    monkeypatch.setattr(kept_light, "_sources", sources)

    def codes() -> list[str]:
        kept_light._code.cache_clear()
        return [kept_light._code(name) for name in ("ddgi", "gibs")]

    before = codes()
    for edited, changed in (
        ("ddgi/application.cl", [True, False]),
        ("gibs/settings.py", [False, True]),
        ("common/bvh.cl", [True, True]),
        ("parts/surfels.py", [True, True]),
    ):
        assert [a != b for a, b in zip(before, codes(), strict=True)] == changed, edited
        assert edited in seen
    kept_light._code.cache_clear()


def test_it_is_settled_once_and_read_as_it_was(site: Site, planted: Callable[..., Settler]) -> None:
    settler = planted()
    first, _ = settled_light(job_for(), OPTIONS, site, Worker())
    again, _ = settled_light(job_for("vega56"), OPTIONS, site, Worker())
    assert settler.asked == 1 and again is first
    other = Site(site.cache_dir)
    read, _ = settled_light(job_for("radeon560"), OPTIONS, other, Worker())
    assert settler.asked == 1 and read is not first
    np.testing.assert_array_equal(read.irradiance, first.irradiance)
    np.testing.assert_array_equal(read.covered, first.covered)
    assert (read.frames, read.settled, read.change, read.memory_bytes) == (2, True, 0.25, 7)
    # The planted difference: one ray more.
    mine = job_for()
    settled_light(
        replace(mine, settings=replace(mine.settings, rays=mine.settings.rays + 1)),
        *(OPTIONS, site, Worker()),
    )
    assert settler.asked == 2
    (file, *_) = site.cache_dir.glob("light-*.npz")
    for file in site.cache_dir.glob("light-*.npz"):
        file.write_bytes(file.read_bytes()[:100])
    settled_light(job_for(), OPTIONS, Site(site.cache_dir), Worker())
    assert settler.asked == 3


@pytest.mark.parametrize(
    "made", [{"settled": False}, {"unrested": "not at rest after 2 frames"}], ids=["clock", "awake"]
)
def test_what_a_clock_ended_is_not_kept_for_the_next_run(
    site: Site, planted: Callable[..., Settler], made: dict[str, Any]
) -> None:
    settler = planted(**made)
    found, _ = settled_light(job_for(), OPTIONS, site, Worker())
    assert not found.ended_by_itself(OPTIONS)
    settled_light(job_for("vega56"), OPTIONS, site, Worker())
    assert settler.asked == 1
    settled_light(job_for(), OPTIONS, Site(site.cache_dir), Worker())
    assert settler.asked == 2
    assert found.ended_by_itself(replace(OPTIONS, frames=2))


def test_profiles_share_errors_and_other_settings_do_not(
    site: Site,
    planted: Callable[..., Settler],
    monkeypatch: pytest.MonkeyPatch,
    rng: np.random.Generator,
) -> None:
    settler = planted()
    value = rng.uniform(0.5, 1, (20, 3))
    everywhere = np.ones(20, np.bool_)
    truth = QuickTruth(np.arange(20), value, 0.01 * value, np.ones(20), everywhere)
    monkeypatch.setattr(run_errors, "quick_truth", lambda *given: truth)
    mine = job_for()
    more = replace(mine, settings=replace(mine.settings, rays=mine.settings.rays + 1))
    jobs = [mine, job_for("vega56"), more, job_for("radeon560")]
    rows = run_errors.run_errors(list(enumerate(jobs, 1)), site, Worker())
    assert settler.asked == 2
    one, two, three, four = ({k: v for k, v in row.items() if k != "configuration"} for row in rows)
    assert one["rel_l2"] == two["rel_l2"] == four["rel_l2"] != three["rel_l2"]
    assert [row["configuration"] for row in rows] == [1, 2, 3, 4]


def test_limits_are_found_where_they_are_asked_for(site: Site) -> None:
    """A profile that it does not fit refuses it, though another's light is kept."""
    mine = job_for()
    tight = replace(mine.profile, memory_budget_bytes=1000, content_hash="tight")
    settled_light(mine, OPTIONS, site, Worker(), within=within_limits(mine))
    with pytest.raises(CannotRun):
        other = replace(mine, profile=tight)
        settled_light(other, OPTIONS, site, Worker(), within=within_limits(other))


def test_remarks_on_light_that_did_not_settle() -> None:
    one = {"settled": False, "frames": 8, "unrested": "not at rest after 8 frames"}
    assert settled_remark(change=0.02, **one) == (
        "not settled after 8 frames: the mean irradiance still moved by +2 % while they doubled; "
        "not at rest after 8 frames"
    )
    few = settled_remark(change=float("nan"), **one)
    assert few == "not settled after 8 frames, too few to tell; not at rest after 8 frames"
    assert settled_remark(settled=True, frames=8, change=0.0, unrested="") == ""
