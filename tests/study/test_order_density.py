"""Errors at equal bytes."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from gibench.study.experiments.order_density import at_equal_bytes, levels


def test_between_an_order_s_points_along_a_power_law(rng):
    """Sizes and errors that are powers of the number of probes come out exactly, in any order of
    the rows; orders whose points do not reach the level are left out."""
    rows = []
    for order, scale in ((7, 60.0), (4, 20.0), (1, 2.0)):
        for probes in (9, 27, 109):
            size, error = scale * probes**0.5, 0.9 / scale * probes**-0.4
            rows.append((probes, order, size, error, np.log(probes)))
    columns = ["probes", "sh_order", "bytes_per_receiver", "rel_l2", "bias"]
    table = pd.DataFrame(rows, columns=columns).sample(frac=1, random_state=rng.integers(100))
    level = 190.0
    found = at_equal_bytes(table, level).set_index("sh_order")
    assert set(found.index) == {7, 4}
    for order, scale in ((7, 60.0), (4, 20.0)):
        probes = (level / scale) ** 2
        assert found.loc[order, "probes"] == pytest.approx(probes, rel=1e-9)
        assert found.loc[order, "rel_l2"] == pytest.approx(0.9 / scale * probes**-0.4, rel=1e-9)
        assert found.loc[order, "bias"] == pytest.approx(np.log(probes), rel=1e-9)


def test_levels_are_powers_of_two_among_the_sizes():
    np.testing.assert_allclose(
        levels(pd.Series([25.0, 300.0, 1111.0])), [32, 64, 128, 256, 512, 1024]
    )
    np.testing.assert_allclose(levels(pd.Series([64.0, 128.0])), [64, 128])
    (only,) = levels(pd.Series([40.0, 50.0]))
    assert only == pytest.approx(np.sqrt(40 * 50))
