"""The commands from Python: as the page shows them, and the same whatever executor bakes."""

from __future__ import annotations

import inspect
import pickle
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import typer

import gibench
from gibench.cli.main import app, call
from gibench.device import list_devices as cl_devices
from gibench.errors import BadInput
from gibench.profiles import load_profile
from gibench.scene.builtin import build
from gibench.techniques.registry import find_technique, techniques
from gibench.work import Serial, Threads
from gibench.work.executors import ignore

PAGE = Path(__file__).parents[2] / "docs" / "python.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_the_page_s_examples_run(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(EXAMPLES[number], str(PAGE), "exec"), names)
    if number == 0:
        ran = names["ran"]
        assert isinstance(ran, gibench.commands.run.RunResult)  # type: ignore[attr-defined]
        assert ran.frames["ray_budget"].dropna().tolist() == [2000, 4000]
        for name in ("samples", "passes"):
            stored = pd.read_csv(tmp_path / "run" / f"{name}.csv")
            assert set(stored["ray_budget"].dropna()) == {2000, 4000}
        loaded = gibench.load_run(ran.folder)
        pd.testing.assert_frame_equal(loaded.frames, ran.frames)
        gi = ran.passes[ran.passes["stage"] == "gi"]
        assert set(gi["technique"]) == {"gibs"}
        assert (ran.frames["gi_ms"] > 0).tolist() == [True, True, False]
        assert (tmp_path / "run" / "report.html").stat().st_size > 10_000
        same = gibench.compare(ran.folder, ran.folder)
        assert same.error is None and set(same.table["ratio"]) == {1.0}
        assert gibench.make_report(ran.folder).text == (ran.folder / "report.md").read_text()
        with pytest.raises(BadInput, match="no run to report"):
            gibench.make_report(names["compared"].folder)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Letter:
    """What a worker is sent, ``content``, and the unit that it is about."""

    unit: Any
    content: bytes

    @property
    def name(self) -> str:
        return str(self.unit.name)


@dataclass(frozen=True)
class Posted:
    """Two threads that get all that a unit needs, and send its result, as other processes would."""

    def run(self, compute, common, units, done=ignore):
        def posted(given, letter, worker):
            task, common, unit = pickle.loads(letter.content)
            return pickle.dumps(task(common, unit, worker))

        def open_letter(letter, result):
            done(letter.unit, pickle.loads(result))

        letters = (Letter(one, pickle.dumps((compute, common, one))) for one in units)
        return [pickle.loads(one) for one in Threads(2).run(posted, None, letters, open_letter)]


BAKE = {"probes": 8, "settings": {"srp.transport_rays": 32, "srp.relight_samples": 32}}


def test_no_result_of_quality_depends_on_the_executor(tmp_path: Path) -> None:
    """What both need is baked anew by each."""
    tables, receivers = [], []
    for executor in (Serial(), Posted()):
        name = type(executor).__name__
        found = gibench.quality(
            technique=["srp", "direct"],
            receivers=300,
            sh_order=1,
            resolution=(32, 24),
            target_error=0.5,
            reference_paths=16,
            frames=16,
            out=tmp_path / name,
            cache_dir=tmp_path / f"cache-{name}",
            executor=executor,
            **BAKE,
        )
        assert found.error is None
        timed = ["time_ms", "gi_ms", "ms_to_rest", "bake_seconds"]
        tables.append(found.table.drop(columns=timed))
        receivers.append(found.receivers)
        for file in sorted((tmp_path / "Serial").rglob("images/**/*.png")):
            mine = tmp_path / name / file.relative_to(tmp_path / "Serial")
            assert mine.read_bytes() == file.read_bytes()
    pd.testing.assert_frame_equal(*tables)
    pd.testing.assert_frame_equal(*receivers)
    assert len(tables[0]) == 2 and np.isfinite(receivers[0]["srp g"]).all()


def test_no_result_of_the_others_depends_on_the_executor(tmp_path: Path) -> None:
    """A run's keys and images, advice and an experiment whose later points need its first."""
    cache = {"cache_dir": tmp_path / "cache"}
    small = {"receivers": 300, "resolution": (32, 24), **cache}
    found: dict[str, list[pd.DataFrame]] = {"run": [], "advise": [], "experiment": []}
    files: list[dict[str, bytes]] = []
    for executor in (Serial(), Posted()):
        out = tmp_path / type(executor).__name__
        ran = gibench.run(
            technique=["direct", "srp"], sh_order=[0, 1], frames=2, warmup=0, save_images=True,
            quality=False, out=out / "run", executor=executor, **small, **BAKE,
        )  # fmt: skip
        found["run"].append(ran.samples.drop(columns=["time_ms", "frame_wall_ms"]))
        advised = gibench.advise(
            technique=["direct", "srp"], sh_order=[0, 1], budget_ms=1e6, frames=16,
            target_error=0.5, reference_paths=16, out=out / "advise", executor=executor,
            **small, **BAKE,
        )  # fmt: skip
        # Which are best depends on times.
        timed = ["time_ms", "gi_ms", "ms_to_rest", "bake_seconds", "pareto"]
        found["advise"].append(advised.table.drop(columns=timed))
        repeated = gibench.experiment(
            "sh-order", quick=True, target_error=1.0, reference_paths=16, out=out / "experiment",
            executor=executor, **cache,
        )  # fmt: skip
        found["experiment"].append(repeated.table.drop(columns="time_ms"))
        kept = [*out.rglob("run/images/**/*.png"), *out.rglob("experiment/irradiance/*.npy")]
        files.append({str(file.relative_to(out)): file.read_bytes() for file in kept})
    for name, (serial, posted) in found.items():
        assert len(serial) > 2, name
        pd.testing.assert_frame_equal(serial, posted)
    assert len(files[0]) > 8 and files[0] == files[1]
    assert "order 7" in set(found["experiment"][0]["against"])


# Commands whose Python call has another name, or several.
CALLED = {
    "bake": ("bake_ahead",),
    "conform": ("conform_device",),
    "devices": ("list_devices",),
    "gallery": ("make_gallery",),
    "history add": ("history_add",),
    "history check": ("history_check",),
    "history show": ("history_page",),
    "merge": ("merge_runs",),
    "profiles": ("list_profiles",),
    "profiles check": ("check_profile",),
    "profiles show": ("show_profile",),
    "project": ("project_run",),
    "report": ("make_report",),
    "scenes": ("list_scenes",),
    "techniques": ("list_techniques",),
    "validate-projection": ("validate_projection", "predict_validation", "check_orders"),
}
# Options and arguments that Python calls otherwise.
RENAMED = {
    "moving": "motion",
    "gallery files": "submissions",
    "conform kernels": "kernel_tree",
    "validate-projection predict": "folder",
    "validate-projection here": "runs",
}
# Where the command line shows or writes what Python returns; who bakes, Python gives as executor.
SHOWN = {"quiet", "markdown", "json", "scheduler", "scheduler_file", "workers"}
SHOWN |= {"profiles show toml", "calibrate out"}
# What Python cannot leave out: an experiment's name (alone, the command lists them), and the places
# of what the modes of 'validate-projection' are about.
GIVEN = {"experiment name", "validate-projection predict", "validate-projection here"}


def commands_of(group: Any, before: str = "") -> dict[str, Any]:
    """Every command by its words, with the function behind it; groups that do something, too."""
    found: dict[str, Any] = {}
    for name, one in group.commands.items():
        is_group = hasattr(one, "commands")
        if is_group:
            found |= commands_of(one, f"{before}{name} ")
        if not is_group or not one.no_args_is_help:
            found[f"{before}{name}"] = inspect.unwrap(one.callback)
    return found


COMMANDS = commands_of(typer.main.get_command(app))


def called_by(command: str) -> list[Any]:
    """The functions behind what Python calls for a command."""
    names = CALLED.get(command, (command,))
    assert set(names) <= set(gibench.__all__), f"'gibench {command}' has no Python call"
    texts = [getattr(gibench, name).__doc__ for name in names]
    homes = [re.search(r":func:`([\w.]+)\.(\w+)`", text) for text in texts]
    return [getattr(import_module(home[1]), home[2]) for home in homes if home is not None]


@pytest.mark.parametrize("command", COMMANDS)
def test_python_takes_what_the_command_line_takes(command: str) -> None:
    """By the same names, with the same defaults; but for what is shown, and who bakes."""
    mine: dict[str, inspect.Parameter] = {}
    for called in called_by(command):
        mine = {**inspect.signature(called).parameters, **mine}
    assert mine or not inspect.signature(COMMANDS[command]).parameters or command == "profiles"
    for name, one in inspect.signature(COMMANDS[command]).parameters.items():
        key = f"{command} {name}"
        if {name, key} & SHOWN or name == "context":
            continue
        wanted = RENAMED.get(key, RENAMED.get(name, name))
        assert wanted in mine, f"{command}: {name}"
        default = tuple(one.default) if isinstance(one.default, list) else one.default
        assert not isinstance(default, typer.models.OptionInfo)
        if key not in GIVEN:
            python = mine[wanted].default
            is_path = isinstance(default, Path)
            assert (Path(python) if is_path else python) == default, name


def test_every_python_call_has_a_command_but_for_those_named() -> None:
    called = {name for command in COMMANDS for name in CALLED.get(command, (command,))}
    alone = {"__version__", "cluster", "export_mitsuba", "load_run"}
    assert set(gibench.__all__) == called | alone
    page = PAGE.read_text(encoding="utf-8")
    assert [name for name in gibench.__all__ if f"gibench.{name}" not in page] == ["__version__"]


def test_what_there_is_as_tables() -> None:
    scenes = gibench.list_scenes().set_index("name")
    assert scenes.loc["cornell-box", "triangles"] == len(build("cornell-box").triangles)
    settings = gibench.list_techniques()
    assert set(settings["technique"]) == set(techniques())
    budget = settings.set_index(["technique", "setting"]).loc[("gibs", "ray_budget")]
    assert budget["option"] == "--set gibs.ray_budget="
    assert budget["default"] == find_technique("gibs").settings_type().ray_budget
    devices = gibench.list_devices()
    assert devices["number"].tolist() == list(range(len(cl_devices())))
    profiles = gibench.list_profiles().set_index("name")
    assert (
        profiles.loc["iphone7", "max_workgroup_size"] == load_profile("iphone7").max_workgroup_size
    )


def test_a_profile_shown_and_checked(tmp_path: Path) -> None:
    shown = gibench.show_profile("vega56")
    assert shown.machine is not None and (shown.machine["low"] <= shown.machine["high"]).all()
    assert shown.figures["source"].str.len().min() > 0
    checked = gibench.check_profile("vega56")
    assert not checked.faults and set(checked.spread) == set(shown.machine["figure"])
    (tmp_path / "bad.toml").write_text(shown.text.replace("[machine", "[machines"))
    bad = gibench.check_profile(str(tmp_path / "bad.toml"))
    assert bad.faults and all(isinstance(fault, BadInput) for fault in bad.faults)


def test_a_scene_is_written_for_mitsuba(tmp_path: Path) -> None:
    file = gibench.export_mitsuba("cornell-box", tmp_path / "m", resolution=(8, 6), camera=0)
    film = ET.parse(file).find("./sensor/film")
    assert film is not None
    size = {one.get("name"): one.get("value") for one in film.iter("integer")}
    assert (size["width"], size["height"]) == ("8", "6")
    (tmp_path / "file").touch()
    for options, told in (
        ({"camera": "nosuch"}, "has no camera 'nosuch'"),
        ({"resolution": "8"}, "not WxH"),
        ({"bounces": -1}, "--bounces -1 is out of range"),
        ({"out": tmp_path / "file"}, "cannot be written"),
    ):
        with pytest.raises(BadInput, match=re.escape(told)):
            gibench.export_mitsuba(**{"scene": "cornell-box", "out": tmp_path / "n", **options})


def test_what_is_wrong_is_told_before_anything_long(tmp_path: Path) -> None:
    for options, what in (
        ({"settings": {"gibs.nosuch": 1}, "technique": "gibs"}, "no setting 'nosuch'"),
        ({"settings": {"gibs": 1}}, "not technique.setting=value"),
        ({"workgroup_size": "big"}, "--workgroup-size 'big'"),
        ({"resolution": "64"}, "not WxH"),
        ({"technique": []}, "nothing is asked for"),
    ):
        with pytest.raises(BadInput, match=re.escape(what)):
            gibench.run(out=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_setting_given_twice_is_an_axis_on_the_command_line(tmp_path: Path) -> None:
    code = call(
        [
            *("run", "-t", "gibs", "-t", "direct", "--set", "gibs.ray_budget=1000"),
            *("--set", "gibs.ray_budget=3000", "--set", "gibs.surfels=500", "--receivers", "300"),
            *("--frames", "2", "--warmup", "0", "--resolution", "32x24", "-q", "--no-quality"),
            *("--out", str(tmp_path / "run"), "--cache-dir", str(tmp_path / "cache")),
        ]
    )
    assert code == 0
    tables = {
        name: pd.read_csv(tmp_path / "run" / f"{name}.csv")
        for name in ("samples", "passes", "frames")
    }
    for name, table in tables.items():
        mine = table[table["technique"] == "gibs"]
        assert sorted(set(mine["ray_budget"])) == [1000, 3000], name
        assert table[table["technique"] == "direct"]["ray_budget"].isna().all(), name
    assert len(tables["frames"]) == 3
    report = (tmp_path / "run" / "report.md").read_text(encoding="utf-8")
    assert "ray budget 3000" in report and "| SH order | ray budget |" in report


def test_bakes_and_checks_from_python(tmp_path: Path) -> None:
    small = {
        "receivers": 300,
        "settings": ["srp.transport_rays=32", "srp.relight_samples=32"],
        "cache_dir": tmp_path / "cache",
    }
    serial, again = (
        gibench.bake_ahead(sh_order=[1, 2], executor=executor, **small)
        for executor in (Serial(), Threads(2))
    )
    assert [one.settings.sh_order for one in serial] == [1, 2]
    assert [one.receivers for one in again] == [one.receivers for one in serial]
    assert all(one.seconds < max(serial[0].seconds, 1.0) for one in again)  # from the cache
    tree = str(Path(__file__).parents[2] / "kernels_cl")
    checked = gibench.ab(
        tree, tree, technique="direct", receivers=300, resolution="32x24", replicates=1,
        frames=2, cache_dir=tmp_path / "cache",
    )  # fmt: skip
    assert checked.table["row"].tolist() == ["frame", "camera"]
    assert checked.error is None
    assert "Old and new are the same kernels." in checked.remarks
    assert checked.markdown.startswith("### gibench ab: direct (tuned) on cornell-box, 32 x 24")


def test_the_other_commands_are_there_too(tmp_path: Path) -> None:
    """Each comes as far as its first look at what it is given."""
    nowhere = tmp_path / "nowhere"
    for called, told in (
        (lambda: gibench.calibrate("nosuch"), "no device profile called 'nosuch'"),
        (lambda: gibench.conform_device(kernel_tree=nowhere), "no such folder"),
        (lambda: gibench.explain(technique="nosuch"), "no technique called 'nosuch'"),
        (lambda: gibench.make_gallery([nowhere], out=tmp_path / "page.html"), "nowhere"),
        (lambda: gibench.merge_runs([nowhere], tmp_path / "out"), "nowhere"),
        (lambda: gibench.project_run(nowhere, "vega56"), "nowhere"),
        (lambda: gibench.submit(nowhere), "nowhere"),
        (lambda: gibench.validate_projection(predictions=nowhere), "nowhere"),
    ):
        with pytest.raises(BadInput, match=re.escape(told)):
            called()
    for name in gibench.__all__:  # no folder of the package takes a function's place
        assert name == "__version__" or inspect.isfunction(getattr(gibench, name)), name
