"""A job and a spec are plain data: they pickle, and a job goes to JSON and back."""

import json
import pickle
import re
from dataclasses import fields, replace
from pathlib import Path

import pytest

import gibench
from gibench.measure.compare.replicate import Place, request
from gibench.profiles import load_profile
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.job import AUTO, Job, Shot
from gibench.techniques.object_motion import MotionOptions
from gibench.techniques.registry import job_of, techniques

SPECS = techniques()
EACH = [(name, variant) for name, spec in SPECS.items() for variant in spec.variants]


def jobs(name, variant):
    spec, profile = SPECS[name], load_profile("iphone7")
    shot = Shot(24, 16, "front", FlightOptions("flight", 3, 5), MotionOptions("scene"))
    yield Job(name, spec.settings({}), variant, "cornell-box", profile, 64)
    yield Job(name, spec.settings({}), variant, "a/file.obj", profile, AUTO, 500, 7, shot)


@pytest.mark.parametrize(("name", "variant"), EACH)
def test_a_job_pickles_and_goes_to_json_and_back(name, variant):
    for job in jobs(name, variant):
        assert pickle.loads(pickle.dumps(job)) == job
        assert job_of(json.loads(json.dumps(job.record()))) == job


def test_anywhere_a_job_s_files_are_absolute_and_nothing_else_changes(tmp_path, monkeypatch):
    built_in, of_file = jobs("ddgi", "tuned")
    assert built_in.anywhere() == built_in
    shot = Shot(24, 16, "front", FlightOptions("fly.toml", 3, 5), MotionOptions("move.toml"))
    monkeypatch.chdir(tmp_path)
    named = replace(of_file, shot=shot).anywhere()
    assert named.scene == str(tmp_path / "a" / "file.obj")
    assert named.shot.flight.path == str(tmp_path / "fly.toml")
    assert named.shot.motion.path == str(tmp_path / "move.toml")
    assert replace(named, scene=of_file.scene, shot=of_file.shot) == of_file
    monkeypatch.chdir("/")
    assert named.anywhere() == named
    asked = json.loads(request(of_file, Place("cache", "kernels")))
    assert asked["place"] == {"cache_dir": "/cache", "kernel_root": "/kernels", "device": None}
    assert asked["job"]["scene"] == "/a/file.obj"


def test_settings_that_are_no_defaults_come_back_too():
    settings = SPECS["ddgi"].settings({"counts": "2x3x4", "rays": 50, "relocation": False})
    job = Job("ddgi", settings, "tuned", "hall", load_profile("vega56"), 32)
    assert job_of(json.loads(json.dumps(job.record()))).settings == settings


@pytest.mark.parametrize("name", sorted(SPECS))
def test_a_spec_pickles(name):
    assert pickle.loads(pickle.dumps(SPECS[name])) == SPECS[name]


def test_auto_is_a_value_of_the_job_and_begins_at_the_profile_s_size():
    first, second = jobs("direct", "tuned")
    assert first.group_size == first.workgroup_size == 64
    assert second.group_size == second.profile.default_workgroup_size


def test_one_job_and_no_other_form_of_it():
    gone = ("Request", "ReplicateSpec", "LoopOptions", "CreateContext")
    package = Path(gibench.__file__).parent
    found = {
        (file.name, name)
        for file in package.rglob("*.py")
        for name in gone
        if re.search(rf"\b{name}\b", file.read_text(encoding="utf-8"))
    }
    assert not found


def test_measuring_and_reporting_know_no_setting_or_count_of_a_technique():
    """Its columns come from what a technique declares."""
    package = Path(gibench.__file__).parent
    names = {item.name for spec in SPECS.values() for item in fields(spec.settings_type)}
    names |= {name for spec in SPECS.values() for name in spec.counts}
    # Words of the whole house, which some setting happens to be called.
    names -= {
        "rays",
        "scale",
        "origin",
        "spacing",
        "counts",
        "grid",
        "storage",
        "bounces",
        "update",
    }
    found = {
        (file.name, name)
        for room in ("measure", "report")
        for file in (package / room).rglob("*.py")
        for name in names
        if re.search(rf"[\"\']{name}[\"\']|\.{name}\b", file.read_text(encoding="utf-8"))
    }
    assert not found
