"""The Dask executor: as the others, and with workers that die."""

from __future__ import annotations

import os
import pickle
import signal
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support import srp_setups
from support.tiny_scenes import room

import gibench
from gibench.bake import lightmap as lightmap_cache
from gibench.bake import store
from gibench.cli.main import call
from gibench.errors import BadInput, CannotRun
from gibench.reference import path_tracer, tiles
from gibench.reference.path_tracer import reference_irradiance
from gibench.study import quality
from gibench.work import Serial, Threads, Worker, cluster_worker, elsewhere, run_in_order
from gibench.work.cluster import Dask
from gibench.work.cluster_worker import Facts
from gibench.work.executors import ignore
from gibench.work.packing import LARGE, packed, unpacked

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

from gibench.work.open_cluster import open_cluster  # noqa: E402


def facts() -> Facts:
    return Facts((("code", "1"),), "a machine")


@dataclass(frozen=True)
class Number:
    value: int
    timed: bool = False

    @property
    def name(self) -> str:
        return f"number {self.value}"


NUMBERS = [Number(n) for n in range(20)]


@pytest.fixture(scope="module")
def two():
    """Two worker processes."""
    with open_cluster(facts, workers=2) as executor:
        yield executor


def tell(told, unit, result):
    told.append((unit.value, result))


def add(common, unit, worker):
    big, scale = common
    return unit.value * scale + float(big[unit.value]), os.getpid(), worker.may_time


def test_results_are_in_order_and_large_arrays_go_once(two, rng):
    big = rng.normal(size=LARGE // 8)
    sent = two.tally.parts, two.tally.known
    for scale in (2.0, 3.0):
        told: list[tuple[int, object]] = []
        keep = partial(tell, told)
        results = two.run(add, (big, scale), iter(NUMBERS), keep)
        assert [value for value, _, _ in results] == [n * scale + big[n] for n in range(20)]
        assert dict(told) == dict(enumerate(results)) and len(told) == 20
        processes = {process for _, process, _ in results}
        assert os.getpid() not in processes and 1 <= len(processes) <= 2
        assert not any(may for _, _, may in results)
    assert (two.tally.parts - sent[0], two.tally.known - sent[1]) == (1, 1)


def refuse(common, unit, worker):
    if unit.value == 4:
        raise common
    return unit.value


def test_errors_are_as_those_of_threads(two):
    told: list[int] = []
    wrong = BadInput("no light", where="here", mend="add one")
    with pytest.raises(BadInput, match="here: number 4: no light; add one"):
        two.run(refuse, wrong, NUMBERS, lambda unit, result: told.append(unit.value))
    assert set(told) >= {0, 1, 2, 3} and len(told) < 20
    with pytest.raises(ZeroDivisionError) as caught:
        two.run(refuse, ZeroDivisionError("oh"), NUMBERS)
    assert caught.value.__notes__ == ["in number 4"]
    assert "refuse" in str(caught.value.__cause__)
    told.clear()
    run_in_order(two, add, (np.zeros(20), 1), NUMBERS, lambda unit, _: told.append(unit.value))
    assert told == list(range(20))


def spans(common, unit, worker):
    begin = time.monotonic()
    time.sleep(0.05)
    return begin, time.monotonic(), worker.may_time


def test_what_is_timed_is_timed_alone(two):
    units = [Number(n, timed=n % 3 == 0) for n in range(9)]
    found = two.run(spans, None, units)
    for number, (begin, end, may_time) in enumerate(found):
        assert may_time == units[number].timed
        for other, (b, e, _) in enumerate(found):
            if may_time and other != number:
                assert e <= begin or b >= end
    assert two.timed_on == "a machine"


def test_an_executor_that_is_sent_away_computes_there(two):
    assert isinstance(pickle.loads(pickle.dumps(two)), Serial)
    assert elsewhere(two) and not elsewhere(None)
    assert not elsewhere(Serial()) and not elsewhere(Threads(2))


def test_packed_is_what_it_was(rng):
    big = rng.normal(size=(200, 300))
    value = {"a": big, "b": np.asfortranarray(big), "again": big, "small": np.arange(3), "t": (1,)}
    found = packed(value)
    assert len(found.parts) == 2 and found.size > 2 * big.nbytes and len(found.body) < 2000
    back = unpacked(found.body, found.parts)
    assert back["a"] is back["again"] and back["b"].flags.f_contiguous
    for name in ("a", "b", "small"):
        assert np.array_equal(back[name], value[name])
    assert packed({"other": big.copy()}).parts.keys() <= found.parts.keys()


def die_once(common, unit, worker):
    """The first worker that computes it dies."""
    if unit.value == 3 and not Path(common).exists():
        Path(common).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return unit.value, float(unit.value)


def test_a_worker_that_dies_costs_nothing_but_time(two, tmp_path):
    told: list[int] = []
    found = two.run(die_once, str(tmp_path / "died"), NUMBERS, lambda u, _: told.append(u.value))
    assert (tmp_path / "died").exists()
    assert found == [(n, float(n)) for n in range(20)]
    assert sorted(told) == list(range(20))  # none lost, none twice


def of_this_process() -> Facts:
    return Facts((("numpy", str(os.getpid())),), "here")


def test_workers_of_other_code_are_refused(two):
    with pytest.raises(CannotRun, match=r"runs numpy .* instead of"):
        Dask(two._client, of_this_process).check_workers()


def test_what_is_asked_wrongly_is_one_line(capsys, tmp_path, monkeypatch):
    bake = ["bake", "-t", "srp", "--cache-dir", str(tmp_path)]
    assert call([*bake, "--scheduler", "tcp://127.0.0.1:1", "--workers", "2"]) == 2
    assert "give one of" in capsys.readouterr().err
    assert call([*bake, "--scheduler-file", str(tmp_path / "none")]) == 2
    assert "no such file" in capsys.readouterr().err
    monkeypatch.setattr("gibench.work.open_cluster._CONNECT_SECONDS", 1)
    assert call([*bake, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    told = capsys.readouterr().err
    assert "no Dask scheduler answers" in told and told.count("\n") == 1
    monkeypatch.setattr("gibench.work.open_cluster.find_spec", lambda name: None)
    assert call([*bake, "--workers", "2"]) == 2
    assert "pip install 'gibench[cluster]'" in capsys.readouterr().err


def bins(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*.bin"))}


def test_a_bake_has_the_same_bytes(two, tmp_path):
    srp_setups.bake(tmp_path / "serial", executor=Serial(), chunk_rays=2000)
    srp_setups.bake(tmp_path / "cluster", executor=two, chunk_rays=2000)
    found = bins(tmp_path / "cluster")
    assert len(found) > 8 and found == bins(tmp_path / "serial")


def test_a_truth_has_the_same_values(two, tmp_path):
    """With a target error, where more rounds are under way when it is met."""
    scene, lightmap = room(5)
    for asked in ({"paths": 64}, {"target_error": 0.2, "paths": 512}):
        mine = reference_irradiance(scene, lightmap, seed=3, **asked)
        theirs = reference_irradiance(
            scene, lightmap, seed=3, store_dir=tmp_path, executor=two, **asked
        )
        assert np.array_equal(mine.value, theirs.value)
        assert np.array_equal(mine.stderr, theirs.stderr)
        assert (mine.rounds, mine.rays, mine.paths) == (theirs.rounds, theirs.rays, theirs.paths)
        again = reference_irradiance(scene, lightmap, seed=3, store_dir=tmp_path, **asked)
        assert np.array_equal(again.value, mine.value) and again.seconds == theirs.seconds


ROOM = """v 0 0 0\nv 2 0 0\nv 2 0 2\nv 0 0 2\nv 0 2 0\nv 2 2 0\nv 0 2 2
f 1 4 3 2\nf 1 2 6 5\nf 1 5 7 4
"""
MINE = """schema_version = 1
name = "mine"
receivers = 200
[[mesh]]
file = "mine.obj"
[[light]]
type = "point"
position = [1.0, 1.0, 1.0]
intensity = [1.0, 1.0, 1.0]
[[camera]]
name = "front"
position = [1.8, 1.0, 1.8]
target = [0.2, 0.5, 0.2]
"""


class NotShared(Serial):
    """Whose workers do not see the cache folder; sends all as bytes."""

    def run(self, compute, common, units, done=ignore):
        results = []
        for unit in units:
            content = packed((compute, common))
            there, given = unpacked(content.body, content.parts)
            results.append(there(given, pickle.loads(pickle.dumps(unit)), Worker()))
            done(unit, results[-1])
        return results

    def shares(self, folder):
        return False


def test_without_shared_storage_all_travels(tmp_path, monkeypatch):
    """No worker loads a scene's file, unwraps, bakes or traces anything again."""
    monkeypatch.setattr(cluster_worker, "mkdtemp", lambda prefix: str(tmp_path / "there"))
    scene = tmp_path / "mine.toml"
    scene.write_text(MINE)
    (tmp_path / "mine.obj").write_text(ROOM)
    asked = {"technique": ["srp"], "sh_order": 1, "receivers": 200, "resolution": (32, 24)}
    asked |= {"settings": {"srp.transport_rays": 16, "srp.relight_samples": 16}, "frames": 2}
    asked |= {"target_error": 1.0, "reference_paths": 16, "scene": str(scene)}
    here = gibench.quality(
        out=tmp_path / "a", cache_dir=tmp_path / "cache", executor=Serial(), **asked
    )

    @dataclass(frozen=True)
    class Sent:
        """As bytes, after which nothing of the parent's is there."""

        def run(self, compute, common, units, done=ignore):
            if isinstance(common, quality._Study):
                scene.unlink()
                monkeypatch.setattr(lightmap_cache, "_save", None)
                monkeypatch.setattr(tiles, "Wavefront", None)
                monkeypatch.setattr(path_tracer, "Wavefront", None)
                monkeypatch.setattr(store.BakeStore, "save", None)
            return NotShared().run(compute, common, units, done)

        def shares(self, folder):
            return False

        def __reduce__(self):
            return Serial, ()

    there = gibench.quality(
        out=tmp_path / "b", cache_dir=tmp_path / "cache", executor=Sent(), **asked
    )
    assert here.error is None and there.error is None
    assert list((tmp_path / "there").rglob("*.bin"))
    times = ["time_ms", "gi_ms", "ms_to_rest", "bake_seconds"]
    pd.testing.assert_frame_equal(
        here.table.drop(columns=times), there.table.drop(columns=times), check_dtype=False
    )
