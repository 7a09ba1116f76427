"""Figure 12 of Silvennoinen and Lehtinen 2017: a secondary light too sharp for the probes."""

from __future__ import annotations

import numpy as np
import pytest

from gibench.profiles import load_profile
from gibench.study.experiments.common import Context
from gibench.study.quality import group_of
from gibench.study.settle import settle
from gibench.study.site import Site
from gibench.work import Worker

PATCH = np.array([1.2, 0.22, -0.6])
"""Middle of what the spot lights, m."""


@pytest.mark.slow
def test_the_failure_is_beside_the_patch_and_leaves_the_rest(tmp_path):
    """On the floor within half a metre of the patch less than half of the green light arrives (a
    quarter to a third when this was written); beyond two metres more than two thirds do (four
    fifths).
    """
    context = Context(
        (load_profile("vega56"),), Site(tmp_path), target_error=0.2, reference_paths=256
    )
    job = context.srp("sharp-bounce", context.profiles[0], receivers=1000, transport_rays="128")
    group, shared = group_of(job, context.quality(), context.site), context.site.standing()
    options = context.quality().settle
    light = settle(job, options, shared, context.site.cl_device, Worker()).irradiance
    receivers, truth = group.lightmap.receivers, group.truth.value
    distance = np.linalg.norm(receivers.position - PATCH, axis=1)
    floor = (receivers.position[:, 1] < 1e-3) & (receivers.position[:, 0] < 1.2)

    def share(chosen):
        area = receivers.area[chosen]
        return (area @ light[chosen, 1]) / (area @ truth[chosen, 1])

    near = floor & (distance < 0.5)
    assert truth[near, 1].mean() > 5 * np.median(truth[:, 1])
    assert share(near) < 0.5
    assert share(distance > 2) > 0.67
