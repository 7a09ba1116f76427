"""The papers' experiments by name."""

from __future__ import annotations

from gibench.errors import BadInput
from gibench.study.experiments import (
    convergence,
    defaults,
    equal,
    frame_times,
    interpolation,
    light_field,
    order_density,
    probe_density,
    probe_update,
    ray_budget,
    receiver_reduction,
    scaling,
    sh_order,
    srp_error,
    surfel_density,
    surfel_failures,
    surfel_gloss,
    surfel_links,
    surfel_spacing,
)
from gibench.study.experiments.common import Experiment

EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        frame_times.EXPERIMENT,
        sh_order.EXPERIMENT,
        probe_density.EXPERIMENT,
        probe_update.EXPERIMENT,
        scaling.EXPERIMENT,
        receiver_reduction.EXPERIMENT,
        interpolation.EXPERIMENT,
        ray_budget.EXPERIMENT,
        convergence.EXPERIMENT,
        surfel_links.LINKS,
        surfel_links.BANDS,
        surfel_links.FRAME,
        surfel_density.MEMORY,
        surfel_density.DENSITY,
        surfel_spacing.SPACING,
        surfel_gloss.GLOSS,
        surfel_failures.FAILURES,
        light_field.EXPERIMENT,
        defaults.EXPERIMENT,
        equal.EQUAL_TIME,
        equal.EQUAL_ERROR,
        srp_error.EXPERIMENT,
        order_density.EXPERIMENT,
    )
}


def find_experiment(name: str) -> Experiment:
    """The experiment called ``name``.

    Raises:
        BadInput: there is none.
    """
    if name not in EXPERIMENTS:
        raise BadInput(
            f"no experiment called '{name}'",
            mend=f"the experiments are {', '.join(EXPERIMENTS)}",
        )
    return EXPERIMENTS[name]
