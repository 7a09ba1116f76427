"""A lower order out of a higher bake is what baking the lower order gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.tiny_scenes import room

from gibench.bake.run import BakeReport, run_bake
from gibench.techniques.srp.bake.data import Cluster, SrpBake
from gibench.techniques.srp.bake.lower_order import lower_clusters
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import Given, srp_stages

SETTINGS = {"probes": 5, "relight_samples": 64, "transport_rays": 128, "overlap": 4.0}


def rows(bake: SrpBake, receivers: int) -> np.ndarray:
    """The transport (receivers, probes, coefficients) that the clusters stand for."""
    c = bake.coefficients
    out = np.zeros((receivers, len(bake.probes), c))
    for cluster in bake.clusters:
        product = cluster.reconstruction.astype(np.float64) @ cluster.projection
        out[np.ix_(cluster.receivers, cluster.probes)] = product.reshape(
            len(cluster.receivers), len(cluster.probes), c
        )
    return out


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bakes")


@pytest.mark.parametrize("order", [0, 2, 5])
def test_lower_order_is_that_orders_bake(store: Path, order: int) -> None:
    scene, lightmap = room(6)
    count = len(lightmap.receivers)
    given = Given(scene, lightmap, SrpBakeSettings(sh_order=7, **SETTINGS))
    high = run_bake(srp_stages(given), store)
    # Without any truncation, so that the difference below is all of the lowered bake's error.
    exact = SrpBakeSettings(sh_order=order, svd_vectors=count, svd_threshold=0.0, **SETTINGS)
    direct = run_bake(srp_stages(Given(scene, lightmap, exact)), store)
    low = run_bake(srp_stages(given, order), store)

    assert low.sh_order == order
    assert low.relight.basis.shape == direct.relight.basis.shape
    np.testing.assert_allclose(low.relight.basis, direct.relight.basis, atol=1e-6)
    np.testing.assert_array_equal(low.probes.positions, direct.probes.positions)
    truth, found = rows(direct, count), rows(low, count)
    for cluster in low.clusters:
        own, got = truth[cluster.receivers], found[cluster.receivers]
        # The bound holds up to float32 rounding of the two bakes.
        assert np.linalg.norm(got - own) <= (cluster.error + 1e-4) * np.linalg.norm(own)
        assert len(cluster.projection) <= 32
    # The low orders hold most of the energy: dropping the rest cannot blow the error up.
    assert np.linalg.norm(found - truth) / np.linalg.norm(truth) <= 1.2 * max(
        cluster.error for cluster in high.clusters
    )


def test_a_lower_order_is_stored_and_asks_for_nothing_else(store: Path) -> None:
    given = Given(*room(6), SrpBakeSettings(sh_order=7, **SETTINGS))
    first = run_bake(srp_stages(given, 3), store)
    report = BakeReport()
    again = run_bake(srp_stages(given, 3), store, report=report)
    assert list(report.stages) == ["srp-probes", "srp-relight", "srp-lowered", "srp-bake"]
    assert report.stages["srp-lowered"].baked == 0
    assert report.stages["srp-lowered"].loaded >= 1
    for x, y in zip(first.clusters, again.clusters, strict=True):
        for name in ("receivers", "probes", "projection", "reconstruction", "error"):
            np.testing.assert_array_equal(getattr(x, name), getattr(y, name))


def test_dark_clusters_stay_dark() -> None:
    nothing = np.zeros((0, 0), np.float32)
    dark = Cluster(
        np.arange(5, dtype=np.int32),
        np.zeros(0, np.int32),
        nothing,
        np.zeros((5, 0), np.float32),
        0.0,
    )
    (low,) = lower_clusters([dark], before=7, order=2, most=32, threshold=0.005)
    assert low.projection.shape == (0, 0)
    assert low.reconstruction.shape == (5, 0)
    assert low.error == 0.0


def test_a_higher_order_is_refused() -> None:
    given = Given(*room(3), SrpBakeSettings(sh_order=1, **SETTINGS))
    with pytest.raises(ValueError, match="order 2"):
        srp_stages(given, 2)
