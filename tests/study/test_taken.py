"""Errors of an earlier run, taken instead of measured."""

from __future__ import annotations

import json
import pickle

import pytest

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.profiles import load_profile
from gibench.study.experiments import surfel_caches, surfel_links
from gibench.study.experiments.common import Context, Measuring
from gibench.study.experiments.taken import read_errors
from gibench.study.site import Site
from gibench.work import Worker

ARGUMENTS = {"experiment": "surfel-links", "scene": ["a.obj"], "target_error": 0.05}


def earlier_run(folder, rows, **more):
    """A folder with these rows, each of surfels, links, bias and status."""
    lines = ["surfels,links,bias,rel_l2,status,reason"]
    lines += [f"{n},{k},{bias:.6g},{2 * bias:.6g},{status}," for n, k, bias, status in rows]
    (folder / "surfel-links.csv").write_text("\n".join(lines) + "\n")
    record = {"arguments": {**ARGUMENTS, "frames": 1, **more}}
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def taken_from(folder, columns=("bias", "rel_l2"), **changed):
    arguments = {**ARGUMENTS, "frames": 30, "shard": "1/2", **changed}
    return read_errors(folder, "surfel-links", ("surfels", "links"), columns, arguments)


def test_a_point_takes_its_errors_and_is_not_measured(tmp_path, monkeypatch, rng):
    bias = rng.uniform(-0.2, 0.2)
    rows = [(1024, 32, bias, "ok"), (1024, 64, 0.5, "failed")]
    taken = taken_from(earlier_run(tmp_path, rows))
    assert pickle.loads(pickle.dumps(taken)) == taken
    context = Context((load_profile("iphone7"),), Site(tmp_path), quick=True, taken=taken)
    point = next(iter(surfel_links.LINKS.points(context)))

    def measured(*_):
        raise BadInput("measured")

    monkeypatch.setattr(surfel_caches, "compared", measured)

    def errors_at(surfels, links):
        unit = Measuring(type(point)({"surfels": surfels, "links": links}, point.job))
        return surfel_caches.errors_of(context, unit, Worker())

    found = errors_at(1024, 32)
    assert found["bias"] == pytest.approx(bias, rel=1e-5)
    assert found["rel_l2"] == pytest.approx(2 * bias, rel=1e-5)
    for lacking in ((1024, 64), (1024, 128)):
        with pytest.raises(BadInput, match="measured"):
            errors_at(*lacking)


def test_errors_of_another_run_are_refused(tmp_path, capsys):
    (tmp_path / "run").mkdir()
    folder = earlier_run(tmp_path / "run", [(1024, 32, 0.1, "ok")], target_error=0.02)
    with pytest.raises(BadInput, match="another target_error"):
        taken_from(folder)
    assert taken_from(folder, target_error=0.02).of({"surfels": 1024, "links": 32})
    with pytest.raises(BadInput, match="no run of 'surfel-links'"):
        taken_from(tmp_path)
    with pytest.raises(BadInput, match="no errors apart"):
        taken_from(folder, ())
    out = ["--out", str(tmp_path / "new")]
    assert call(["experiment", "surfel-links", "--errors-from", str(tmp_path), *out]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "no run of 'surfel-links'" in told
    assert not (tmp_path / "new").exists()
