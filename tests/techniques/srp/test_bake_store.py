"""The store: resumed, damaged, killed, full, shared by two runs."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from support.srp_setups import bake
from support.tiny_scenes import room

from gibench.bake.run import BakeReport
from gibench.bake.store import BakeStore
from gibench.errors import BadInput, CannotRun
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import Given, srp_stages
from gibench.work import Serial, Threads


def same(a, b):
    assert np.array_equal(a.probes.positions, b.probes.positions)
    assert a.probes.radius == b.probes.radius
    assert np.array_equal(a.relight.texel, b.relight.texel)
    assert np.array_equal(a.relight.basis, b.relight.basis)
    assert len(a.clusters) == len(b.clusters)
    for x, y in zip(a.clusters, b.clusters, strict=True):
        for name in ("receivers", "probes", "projection", "reconstruction"):
            assert np.array_equal(getattr(x, name), getattr(y, name))
    assert (a.usable_share, a.overlap) == (b.usable_share, b.overlap)
    return True


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bake")
    return folder, bake(folder)


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/cluster-*.bin"))


def copy_of(baked, target: Path) -> Path:
    for file in baked[0].rglob("*"):
        if file.is_file():
            (target / file.parent.name).mkdir(parents=True, exist_ok=True)
            (target / file.parent.name / file.name).write_bytes(file.read_bytes())
    return target


def test_bake_holds_every_receiver_once(baked):
    result = baked[1]
    held = np.sort(np.concatenate([c.receivers for c in result.clusters]))
    assert np.array_equal(held, np.arange(len(room(5)[1].receivers)))
    assert len(result.probes) == 6
    assert result.coefficients == 9
    assert result.usable_share > 0.99
    assert all(c.projection.shape[1] == 9 * len(c.probes) for c in result.clusters)


def test_same_seed_same_bits_whatever_the_workers(baked, tmp_path):
    assert same(baked[1], bake(tmp_path / "serial", executor=Serial(), chunk_rays=500))
    assert same(baked[1], bake(tmp_path / "threads", executor=Threads(3), chunk_rays=700))
    other = bake(tmp_path, seed=1)
    assert not np.array_equal(other.relight.directions, baked[1].relight.directions)


def test_second_bake_computes_nothing(baked, tmp_path):
    report = BakeReport()
    assert same(baked[1], bake(copy_of(baked, tmp_path), report))
    assert sum(stage.baked for name, stage in report.stages.items() if name != "srp-bake") == 0
    assert report.stages["srp-transport"].loaded == len(files(baked[0])) >= 8


@pytest.mark.parametrize("damage", ["missing", "flipped", "truncated", "empty", "swapped"])
def test_damage_is_found_and_only_that_is_baked_again(baked, tmp_path, damage):
    folder = copy_of(baked, tmp_path)
    victim, neighbour = files(folder)[3:5]
    content = bytearray(victim.read_bytes())
    content[len(content) // 2] ^= 1
    if damage == "missing":
        victim.unlink()
    elif damage == "swapped":  # a sound file with another leaf's receivers
        victim.write_bytes(neighbour.read_bytes())
    else:
        kept = {"flipped": content, "truncated": content[:100], "empty": b""}[damage]
        victim.write_bytes(kept)
    report = BakeReport()
    assert same(baked[1], bake(folder, report))
    assert report.stages["srp-transport"].baked == 1


@pytest.mark.parametrize("name", ["srp-probes.bin", "srp-relight.bin"])
def test_damaged_probes_and_relight_samples_are_made_again(baked, tmp_path, name):
    folder = copy_of(baked, tmp_path)
    next(folder.glob(f"*/{name}")).write_bytes(b"GIBENCH1 not this")
    assert same(baked[1], bake(folder))


# A shell that starts pytest in the background has it ignore Ctrl-C, and what pytest starts too.
RUN = """
import json, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {tests!r})
from pathlib import Path
from support.srp_setups import bake
from gibench.bake.run import BakeReport
from gibench.work import Serial
report = BakeReport()
bake(Path(sys.argv[1]), report, executor=Serial(), **json.loads(sys.argv[2]))
told = report.stages["srp-transport"]
print(told.baked, told.loaded)
"""


SLOW = {"transport_rays": 8192}
"""Of a bake that takes so long that it can be stopped half way."""


def start(folder: Path, **changed) -> subprocess.Popen:
    code = RUN.format(tests=str(Path(__file__).parents[2]))
    return subprocess.Popen(
        [sys.executable, "-c", code, str(folder), json.dumps(changed)],
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_a_stopped_run_goes_on_where_it_was(tmp_path, how):
    run = start(tmp_path, **SLOW)
    deadline = time.monotonic() + 60
    while len(files(tmp_path)) < 2 and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    run.send_signal(how)
    run.wait(30)
    done = len(files(tmp_path))
    assert run.returncode != 0
    assert done >= 2
    leftovers = list(tmp_path.glob("*/*.tmp"))
    report = BakeReport()
    result = bake(tmp_path, report, **SLOW)
    assert report.stages["srp-transport"].loaded == done
    assert report.stages["srp-transport"].baked > 0
    assert not list(tmp_path.glob("*/*.tmp")), leftovers
    held = np.sort(np.concatenate([c.receivers for c in result.clusters]))
    assert np.array_equal(held, np.arange(len(room(5)[1].receivers)))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What one run bakes of ``SLOW``."""
    return bake(tmp_path_factory.mktemp("alone"), **SLOW)


def test_two_runs_at_once_share_the_work(baked, alone, tmp_path):
    runs = [start(tmp_path, **SLOW), start(tmp_path, **SLOW)]
    outputs = [run.communicate(timeout=120)[0].split() for run in runs]
    assert all(run.returncode == 0 for run in runs)
    counts = [(int(did), int(found)) for did, found in outputs]
    total = len(files(baked[0]))
    # Each leaf once, by one or the other, and each run ends with all of them.
    assert sum(did for did, _ in counts) == total
    assert all(did + found == total for did, found in counts)
    assert all(did > 0 for did, _ in counts)
    assert not list(tmp_path.glob("*/*.claim"))
    assert same(bake(tmp_path, **SLOW), alone)


def test_what_a_killed_run_had_claimed_goes_to_the_other(alone, tmp_path):
    runs = [start(tmp_path, **SLOW), start(tmp_path, **SLOW)]
    deadline = time.monotonic() + 60
    while len(files(tmp_path)) < 2 and runs[0].poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    runs[0].kill()
    runs[0].wait(30)
    kept = len(files(tmp_path))
    output = runs[1].communicate(timeout=120)[0].split()
    assert runs[1].returncode == 0
    assert kept >= 2
    assert int(output[0]) > 0
    assert same(bake(tmp_path, **SLOW), alone)


def test_full_disk_is_one_clear_error_and_leaves_nothing_behind(tmp_path, monkeypatch):
    store = BakeStore(tmp_path, "stage", "ab" * 20, {})

    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CannotRun, match="disk is full") as caught:
        store.save("cluster-00000", {"a": np.zeros(3)})
    assert "--cache-dir" in str(caught.value)
    assert not list(store.path.glob("*.tmp"))
    assert store.load("cluster-00000") is None


def test_a_folder_that_cannot_be_made_is_bad_input(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be stored"):
        BakeStore(tmp_path / "file" / "below", "stage", "ab" * 20, {})


def key_of(scene, lightmap, settings=None, seed=0, **changed):
    return srp_stages(Given(scene, lightmap, settings or SrpBakeSettings(), seed, **changed))[
        -1
    ].key


def test_key_follows_content_and_settings_but_not_speed():
    scene, lightmap = room(3)
    base = key_of(scene, lightmap)
    assert base == key_of(*room(3), chunk_rays=99)
    others = [
        key_of(scene, lightmap, SrpBakeSettings(transport_rays=4095)),
        key_of(scene, lightmap, seed=1),
        key_of(*room(4)),
        key_of(*room(3, open_top=True)),
    ]
    assert len({base, *others}) == 5


CHANGED = {
    "sh_order": 6, "probes": 7, "relight_samples": 99, "transport_rays": 98, "overlap": 9.0,
    "cluster_size": 97, "svd_vectors": 31, "svd_threshold": 0.25, "least_valid": 0.125,
    "visibility": "exact", "interpolation": "spatial", "receiver_order": 1, "sky": "receivers",
    "placement": "error",
}  # fmt: skip


def test_every_setting_is_in_the_key():
    scene, lightmap = room(3)
    assert set(CHANGED) == {item.name for item in fields(SrpBakeSettings)}
    keys = [key_of(scene, lightmap, SrpBakeSettings(**{n: v})) for n, v in CHANGED.items()]
    assert len({key_of(scene, lightmap), *keys}) == len(CHANGED) + 1


def test_a_bake_of_order_0_is_never_taken_for_one_of_order_1(baked, tmp_path):
    """And the other way round; probes serve both. What order 0 was baked from before there was any
    other is still told by the same key.
    """
    folder, report = copy_of(baked, tmp_path), BakeReport()
    one = bake(folder, report, receiver_order=1)
    zero_again, one_again = BakeReport(), BakeReport()
    assert (report.stages["srp-probes"].baked, report.stages["srp-probes"].loaded) == (0, 1)
    assert report.stages["srp-transport"].loaded == 0
    assert report.stages["srp-transport"].baked > len(files(baked[0]))
    assert (one.receiver_order, one.components) == (1, 4)
    for cluster in one.clusters:
        assert len(cluster.reconstruction) == 4 * len(cluster.receivers) <= 32
    assert same(baked[1], bake(folder, zero_again))
    assert same(one, bake(folder, one_again, receiver_order=1))
    for told in (zero_again, one_again):
        assert told.stages["srp-transport"].baked == 0
    settings = SrpBakeSettings()
    newer = "receiver_order", "sky", "placement"
    older = [item.name for item in fields(settings) if item.name not in newer]
    assert settings.everything == tuple(getattr(settings, name) for name in older)


def test_a_setting_of_the_transport_makes_no_probe_anew(baked, tmp_path):
    report = BakeReport()
    bake(copy_of(baked, tmp_path), report, transport_rays=16)
    did = {name: (stage.baked, stage.loaded) for name, stage in report.stages.items()}
    assert did["srp-probes"] == did["srp-relight"] == (0, 1)
    assert did["srp-visibility"] == (1, 0)
    assert did["srp-transport"] == (len(files(baked[0])), 0)


def test_tables_are_kept_only_while_they_are_needed(baked):
    assert list(baked[0].glob("srp-visibility-*"))
    assert not list(baked[0].glob("srp-visibility-*/*.bin"))


@pytest.mark.parametrize(
    "wrong",
    [
        {"sh_order": 8}, {"sh_order": -1}, {"probes": 0}, {"transport_rays": 0}, {"overlap": 0.0},
        {"svd_threshold": -0.1},
        {"least_valid": 1.0}, {"visibility": "perhaps"}, {"interpolation": "nearest"},
        {"receiver_order": 2}, {"receiver_order": -1},
    ],
)  # fmt: skip
def test_settings_out_of_range_are_bad_input(wrong):
    with pytest.raises(BadInput):
        SrpBakeSettings(**wrong)
