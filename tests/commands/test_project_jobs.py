"""Which jobs are projected: those that ran, with the receivers that they ran with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import gibench
from gibench.cli.main import call
from gibench.commands import asked
from gibench.commands.project import ProjectedRun, jobs_of_record
from gibench.errors import BadInput
from gibench.measure.runfolder.axes import plain_settings
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.session.shared import Shared
from gibench.report.projected import COLUMNS, RATIO_COLUMNS, WHOLE_GI

GIVEN: dict[str, Any] = {
    "device_profile": ["iphone7", "vega56"],
    "scene": ["cornell-box", "glossy-box"],
    "technique": ["direct", "ddgi"],
    "variant": ["tuned"],
    "layout": None,
    "sh_order": None,
    "probes": None,
    "receivers": [300, 400],
    "workgroup_size": [64, "auto"],
    "settings": ["ddgi.rays=40", "ddgi.rays=50"],
    "resolution": "48x32",
}


def entries(jobs: list[Any], shared: Shared) -> list[dict[str, Any]]:
    return [
        {
            "configuration": n,
            "status": "ok",
            "technique": job.technique,
            "variant": job.variant,
            "layout": "simt",
            "profile": job.profile.name,
            "scene": shared.scene(job.scene).name,
            "workgroup_size": job.group_size,
            "auto_workgroup": job.workgroup_size == "auto",
            "settings": plain_settings(job.settings),
            "receivers_asked": job.receivers,
        }
        for n, job in enumerate(jobs, start=1)
    ]


def test_each_recorded_configuration_finds_its_own_job(tmp_path: Path) -> None:
    shared = Shared(tmp_path, 3)
    jobs = asked.jobs_of({**GIVEN, "seed": 3})
    assert len(jobs) == 48
    recorded = entries(jobs, shared)
    # A shard, from which a scene's techniques are left out and in which one could not run.
    kept = [one for one in recorded[10:40] if one["configuration"] % 3]
    kept[5]["status"] = "skipped"
    record = {"arguments": GIVEN, "seed": 3, "configurations": kept}
    found = jobs_of_record(record, tmp_path, shared)
    assert list(found) == [one["configuration"] for one in kept if one["status"] == "ok"]
    for number, job in found.items():
        wanted = jobs[number - 1]
        assert job.layout == "simt" and wanted.layout is None
        for name in ("technique", "settings", "scene", "profile", "workgroup_size", "receivers"):
            assert getattr(job, name) == getattr(wanted, name), (number, name)
    kept[0]["settings"] = {"other": 1}
    with pytest.raises(BadInput, match="cannot be made again"):
        jobs_of_record(record, tmp_path, shared)


def test_a_shard_and_a_run_with_fit_are_projected_as_they_ran(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def project_job(job: Any, profiles: Any, shared: Any, device: Any, fit: bool = False) -> Any:
        seen.append((job.workgroup_size, fit))
        return []

    monkeypatch.setattr("gibench.commands.project.project_job", project_job)
    out, cache = str(tmp_path / "out"), ("--cache-dir", str(tmp_path / "cache"))
    small = ("--resolution", "48x32", "-n", "1", "--warmup", "0", "--no-quality", "-q", *cache)
    run = ("run", "-t", "direct", "-w", "64", "-w", "128", "--shard", "2/2", "--fit", *small)
    assert call([*run, "--out", out, "--project", "vega56"]) == 0
    assert call(["project", out, "-d", "vega56", "-q", *cache]) == 0
    assert seen == [(128, True)] * 2
    assert pd.read_csv(tmp_path / "out" / "projected.csv").empty


def test_the_answers_of_a_run_have_what_was_projected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def project(folder: RunFolder, *_: object) -> ProjectedRun:
        row = dict.fromkeys(COLUMNS, "") | {"configuration": 1, "device": "iphone7"}
        row |= {"pass": WHOLE_GI, "projected_low_ms": 7.0, "projected_high_ms": 20.0}
        table = pd.DataFrame([row | {"verdict": "range"}], columns=list(COLUMNS))
        found = ProjectedRun(table, pd.DataFrame(columns=list(RATIO_COLUMNS)))
        found.write(folder)
        return found

    monkeypatch.setattr("gibench.commands.run._project", project)
    ran = gibench.run(
        technique="ddgi",
        receivers=200,
        resolution=(32, 24),
        frames=2,
        warmup=0,
        warmup_frames=0,
        quality=False,
        project="iphone7",
        out=tmp_path / "run",
        cache_dir=tmp_path / "cache",
    )
    (answer,) = ran.answers
    assert answer.table["projected"].tolist() == ["7.000 to 20.000 ms"]
    assert "does not fit: ddgi" in answer.projected
