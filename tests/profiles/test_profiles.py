"""Device profiles: sound ones load, unsound ones are refused with what is wrong and where."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from gibench.errors import BadInput
from gibench.profiles import built_in_profiles, load_profile

IPHONE = built_in_profiles()["iphone7"]


@pytest.mark.parametrize("name", sorted(built_in_profiles()))
def test_built_in_profiles_are_sound_and_sourced(name: str) -> None:
    profile = load_profile(name)
    assert profile.name == name
    assert len(profile.figures) == 10
    assert all(len(figure.source) >= len("estimate") for figure in profile.figures.values())
    assert profile.workgroup_size_problem(profile.default_workgroup_size) is None
    limits = built_in_profiles()[name].partition("\n[machine]\n")[0]
    assert profile.content_hash == hashlib.sha256(limits.encode()).hexdigest()


def test_a_file_of_ones_own_works_by_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(IPHONE.replace('name = "iphone7"', 'name = "mine"'))
    assert load_profile(str(path)).name == "mine"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    (
        ("value = 1073741824", "value = -1", "memory_budget_bytes"),
        ("value = 1073741824", "value = 0", "memory_budget_bytes"),
        ("value = 1073741824", "value = 1.5", "whole"),
        ("value = 1073741824", "value = inf", "memory_budget_bytes"),
        ("value = 1073741824", "value = nan", "memory_budget_bytes"),
        ("value = 1073741824", 'value = "1 GB"', "not a number"),
        ("value = 1073741824", "value = true", "not a number"),
        ("value = 1073741824", "value = 1000", "max_buffer_bytes"),
        ("value = 512\n", "value = 128\n", "default_workgroup_size"),
        ("value = 256\n", "value = 100\n", "SIMD width"),
        ("schema_version = 1", "schema_version = 99", "99"),
        ("schema_version = 1", "", "schema_version"),
        ('name = "iphone7"', "", "'name'"),
        ("[simd_width]", "[simd_wdth]", "simd_wdth"),
        ("[dispatch_us]\nvalue = 10", "[dispatch_us]", "dispatch_us"),
        ('source = "estimate: 5 to 20 microseconds"', "", "no source"),
        ("[simd_width]", "[simd_width", "TOML"),
    ),
)
def test_an_unsound_profile_is_refused_by_name(
    old: str, new: str, told: str, tmp_path: Path
) -> None:
    assert old in IPHONE
    path = tmp_path / "bad.toml"
    path.write_text(IPHONE.replace(old, new))
    with pytest.raises(BadInput) as refused:
        load_profile(str(path))
    assert told in str(refused.value)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(BadInput, match="cannot be read as text"):
        load_profile(str(path))


def test_an_unknown_profile_names_those_there_are() -> None:
    with pytest.raises(BadInput, match="iphone7, mali-g78, r9-295x2"):
        load_profile("nokia3310")


@pytest.mark.parametrize(
    ("size", "told"),
    ((0, "multiple"), (-32, "multiple"), (33, "multiple"), (544, "512"), (32, None), (512, None)),
)
def test_work_group_sizes_bind(size: int, told: str | None) -> None:
    problem = load_profile("iphone7").workgroup_size_problem(size)
    assert problem is None if told is None else told in str(problem)
