"""Every technique's stages are plain data: they pickle, and the copies bake the same."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from support.tiny_scenes import room

from gibench.bake.run import run_bake
from gibench.bake.stage import Keep, Stage, stage_key
from gibench.techniques.registry import BakeContext, techniques
from gibench.techniques.srp import SPEC
from gibench.work import Serial

SMALL = {"probes": 6, "relight_samples": 64, "transport_rays": 32, "cluster_size": 32}


@pytest.mark.parametrize("name", sorted(techniques()))
def test_every_stage_and_unit_pickles(name: str, tmp_path: Path) -> None:
    spec = techniques()[name]
    context = BakeContext(*room(5), spec.settings_type(), tmp_path)
    stages = spec.stages(context)
    for stage in stages:
        copy = pickle.loads(pickle.dumps(stage))
        assert (copy.name, copy.key, copy.compute) == (stage.name, stage.key, stage.compute)
        for unit, twin in zip(stage.pieces, pickle.loads(pickle.dumps(stage.pieces)), strict=True):
            assert (unit.name, unit.index, unit.size) == (twin.name, twin.index, twin.size)
            assert np.array_equal(unit.data, twin.data)
    names = [stage.name for stage in stages]
    assert len(set(names)) == len(names)
    # Of its own, or shared by the techniques of a part.
    assert all(one.startswith((f"{name}-", "captured-")) for one in names)


def test_pickled_stages_of_srp_bake_the_same(tmp_path: Path) -> None:
    context = BakeContext(*room(5), SPEC.settings({**SMALL, "sh_order": 2}), tmp_path)
    stages = SPEC.stages(context)
    assert [stage.name for stage in stages] == [
        *("srp-probes", "srp-relight", "srp-visibility", "srp-transport", "srp-lowered"),
        "srp-bake",
    ]
    copies = pickle.loads(pickle.dumps(stages))
    one = run_bake(stages, tmp_path / "one")
    two = run_bake(copies, tmp_path / "two", Serial())
    assert np.array_equal(one.relight.texel, two.relight.texel)
    assert one.sh_order == two.sh_order == 2
    for x, y in zip(one.clusters, two.clusters, strict=True):
        for name in ("receivers", "probes", "projection", "reconstruction"):
            assert np.array_equal(getattr(x, name), getattr(y, name))


def test_orders_share_the_highest_orders_transport(tmp_path: Path) -> None:
    keys = []
    for order in (2, 5, 7):
        settings = SPEC.settings({**SMALL, "sh_order": order})
        stages = {one.name: one for one in SPEC.stages(BakeContext(*room(5), settings, tmp_path))}
        keys.append((stages["srp-transport"].key, stages["srp-bake"].key))
    assert len({transport for transport, _ in keys}) == 1
    assert len({whole for _, whole in keys}) == 3


def test_a_stage_is_stored_if_and_only_if_it_says_how() -> None:
    with pytest.raises(ValueError, match="has a format"):
        Stage("a", stage_key("a", 1), compute=len, given=None, keep=Keep.ALWAYS)


def test_a_stages_key_follows_its_version_its_parts_and_its_needs() -> None:
    a = Stage("a", stage_key("a", 1), compute=len, given=None, keep=Keep.NEVER)
    b = Stage("b", stage_key("b", 1), compute=len, given=None, keep=Keep.NEVER)
    keys = [
        stage_key("c", 1), stage_key("c", 2), stage_key("d", 1), stage_key("c", 1, 5),
        stage_key("c", 1, "5"), stage_key("c", 1, needs=[a]), stage_key("c", 1, needs=[b]),
        stage_key("c", 1, np.arange(4)), stage_key("c", 1, np.arange(4).reshape(2, 2)),
        stage_key("c", 1, np.arange(4.0)),
    ]  # fmt: skip
    assert len(set(keys)) == len(keys)
