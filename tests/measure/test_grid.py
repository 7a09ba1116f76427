"""The grid of jobs: combinations, axes, values as typed, refusals."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any, Literal

import pytest
from support import fake_technique

from gibench.commands.asked import by_option, read_settings
from gibench.device.selection import list_devices
from gibench.errors import BadInput, CannotRun, GibenchError
from gibench.measure.plan.grid import grid, typed_value, with_layouts
from gibench.measure.runfolder.axes import TAKEN, axes_of, axis_values
from gibench.measure.runfolder.folder import (
    sample_columns,
)
from gibench.profiles import load_profile
from gibench.report.tables import frame_columns, pass_columns
from gibench.study.quality_rows import columns
from gibench.techniques.registry import declared_counts, find_technique

IPHONE, RADEON = load_profile("iphone7"), load_profile("radeon560")


def test_the_grid_is_the_product_without_repeats() -> None:
    specs = [fake_technique.SPEC, fake_technique.PLAIN]
    found = grid(
        [IPHONE, RADEON],
        specs,
        variants=("published", "tuned"),
        common={"sh_order": (1, 2, 1), "probes": (5,)},
        workgroup_sizes=(64, 128),
    )
    fakes = [job for job in found if job.technique == "fake"]
    plain = [job for job in found if job.technique == "plain"]
    assert len(fakes) == 2 * 2 * 2 * 2  # variants, orders, sizes, profiles
    assert len(plain) == 2 * 2  # sizes, profiles
    bakes = [(job.technique, repr(job.settings)) for job in found]
    changes = sum(a != b for a, b in itertools.pairwise(bakes))
    assert changes == len(set(bakes)) - 1  # those that share a bake are next to each other


def test_the_grid_takes_each_profiles_own_size() -> None:
    wide = replace(RADEON, name="wide", default_workgroup_size=64)
    found = grid([IPHONE, wide], [fake_technique.PLAIN])
    assert [c.workgroup_size for c in found] == [IPHONE.default_workgroup_size, 64]


@pytest.mark.parametrize(
    ("options", "error", "told"),
    (
        ({"receivers": (0,)}, BadInput, "--receivers"),
        ({"variants": ("fast",)}, BadInput, "fast"),
        ({"workgroup_sizes": (0,)}, BadInput, "--workgroup-size"),
        ({"workgroup_sizes": (3000, 2048)}, BadInput, "2048 is over the 512 of profile iphone7"),
        ({"workgroup_sizes": (48,)}, CannotRun, "multiple"),
        ({"settings": {"other": {"a": ("1",)}}}, BadInput, "other"),
    ),
)
def test_the_grid_refuses(options: dict[str, Any], error: type[GibenchError], told: str) -> None:
    with pytest.raises(error) as refused:
        grid([IPHONE], [fake_technique.SPEC], **options)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("sh_order", "probes", "told"),
    ((9, None, "0 to 7"), ((2, -1), None, "0 to 7"), (2, 0, "--probes")),
)
def test_settings_with_an_option_of_their_own_are_refused(
    sh_order: Any, probes: Any, told: str
) -> None:
    with pytest.raises(BadInput, match=told):
        grid([IPHONE], [find_technique("srp")], common=by_option(sh_order, probes))


def test_any_setting_is_an_axis() -> None:
    """Given twice it makes two jobs, and has a column: its own, or with its technique's name where
    a table has a column of that name already.
    """
    texts = ["gibs.ray_budget=50000", "gibs.ray_budget=100000", "ddgi.rays=64", "ddgi.rays=128"]
    specs = [find_technique("gibs"), find_technique("ddgi")]
    jobs = grid([IPHONE], specs, settings=read_settings(texts))
    axes = axes_of(jobs)
    assert [axis_values(job, axes) for job in jobs] == [
        {"sh_order": None, "ray_budget": 50000, "ddgi.rays": None},
        {"sh_order": None, "ray_budget": 100000, "ddgi.rays": None},
        {"sh_order": None, "ray_budget": None, "ddgi.rays": 64},
        {"sh_order": None, "ray_budget": None, "ddgi.rays": 128},
    ]
    mapped = {"gibs.ray_budget": [50000, 100000], "ddgi.rays": (64, 128)}
    assert grid([IPHONE], specs, settings=read_settings(mapped)) == jobs


def test_no_axis_takes_the_place_of_a_column() -> None:
    content: dict[str, Any] = {"axes": [], "counts": {}}
    fixed = {*pass_columns(content), *frame_columns(content), *columns(()), *sample_columns((), ())}
    assert not [name for name in fixed - TAKEN - set(declared_counts()) if not _is_figure(name)]


def _is_figure(name: str) -> bool:
    """Names that no setting will have: figures with a unit or of an error metric."""
    ends = ("_ms", "_per_s", "_noise", "_fraction", "_covered", "_open", "_mse", "_l2")
    return name.endswith(ends) or name.startswith("reference_")


@pytest.mark.parametrize(
    ("hint", "text", "value"),
    (
        (int, "12", 12),
        (float, "1e-3", 1e-3),
        (bool, "off", False),
        (bool, "TRUE", True),
        (str, "12", "12"),
        (int | None, "none", None),
        (int | None, "3", 3),
        (str | None, "None", None),
        (Literal["fp16", "fp32"], "fp16", "fp16"),
    ),
)
def test_values_take_their_type(hint: Any, text: str, value: Any) -> None:
    typed = typed_value(hint, text, "--set a.b")
    assert typed == value
    assert type(typed) is type(value)


@pytest.mark.parametrize(
    ("hint", "text"), ((int, "x"), (bool, "2"), (int | None, ""), (Literal["a"], "b"))
)
def test_values_of_another_type_are_refused(hint: Any, text: str) -> None:
    with pytest.raises(BadInput):
        typed_value(hint, text, "--set a.b")


def test_layouts_are_those_of_tuned() -> None:
    spec = fake_technique.SPEC
    found = grid([IPHONE], [spec], variants=("published", "tuned"), layouts=("simt", "wide"))
    shapes = [(job.variant, job.layout) for job in found]
    assert shapes == [("published", None), ("tuned", "wide"), ("tuned", "simt")]
    left = with_layouts(grid([IPHONE], [spec], variants=("published", "tuned")), list_devices()[0])
    assert [job.layout for job in left] == [None, "wide"]  # PoCL prefers vectors
    with pytest.raises(BadInput, match="no layout called 'narrow'"):
        grid([IPHONE], [spec], layouts=("narrow",))


def test_a_technique_without_settings_is_said_to_have_none() -> None:
    with pytest.raises(BadInput, match="technique direct has no setting 'x'; it has none"):
        find_technique("direct").settings({"x": 1})
