"""How evenly surfels lie (Jendersie et al. 2016, section 4.2 and figure 3)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.report.plots import new_figure, save
from gibench.scene.model import Scene
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.surfel_caches import TECHNIQUE
from gibench.techniques.surfel_cache.bake.data import SurfelSet
from gibench.techniques.surfel_cache.bake.surfels import (
    relax,
    sample_surface,
    spacing_of,
    surface_areas,
    surfels_at,
)
from gibench.work import Worker

_SURFELS: Final = 30_000
"""Those of figure 3."""
_STEPS: Final = {"random": 0, "Halton": 0, "Halton, relaxed": 10}
"""Steps of relaxation by distribution, in figure 3's order."""
_SIDE: Final = 0.25
"""Side of the piece of floor that is shown, of the room's."""


def _points(context: Context) -> Iterator[Point]:
    scene = context.scene_or("cornell-box")[0]
    surfels = 600 if context.quick else _SURFELS
    for name, steps in _STEPS.items():
        asked = {"surfels": surfels, "links": 1, "relaxation": steps}
        job = context.of(TECHNIQUE, scene, context.profiles[0], 1500, **asked)
        yield Point({"distribution": name}, job)


def _at_random(scene: Scene, areas: Doubles, count: int) -> SurfelSet:
    """Points at random, each standing for an equal share of the area."""
    rng = np.random.default_rng(1)
    triangle = rng.choice(len(areas), count, p=areas / areas.sum()).astype(np.int32)
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)[:, 1:]
    return surfels_at(scene, triangle, weights, float(areas.sum()) / count)


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job, name = unit.point.job, unit.point.key["distribution"]
    shared = context.site.standing()
    scene = shared.scene(job.scene)
    areas = surface_areas(scene, shared.lightmap(job.scene, job.receivers or scene.receivers))
    if name == "random":
        surfels = _at_random(scene, areas, job.settings.surfels)
    else:
        surfels = sample_surface(scene, areas, job.settings.surfels)
        surfels = relax(scene, surfels, scene_tracer(scene), job.settings.relaxation)
    spacing = spacing_of(surfels)
    row = {
        "surfels": len(surfels),
        "mean": spacing.mean,
        "variation": spacing.variation,
        "relative_radius": spacing.relative_radius,
    }
    return Found([row], arrays={name: _on_the_floor(scene, surfels)})


def _on_the_floor(scene: Scene, surfels: SurfelSet) -> Doubles:
    """Those (n, 3) on a square piece in the corner of the scene's floor, in sides of the piece."""
    low, high = scene.bounds
    side = _SIDE * float((high - low)[[0, 2]].min())
    at = (surfels.position.astype(np.float64) - low) / side
    lies = (surfels.normal[:, 1] > 0.9) & (at[:, 1] < 0.02)
    return np.asarray(at[lies & (at[:, 0] < 1) & (at[:, 2] < 1)])


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    names = [name for name in _STEPS if name in set(ok["distribution"])]
    figure = new_figure(3.6 * len(names), 4.0)
    for number, name in enumerate(names, 1):
        points = kept.array(name)
        where = figure.add_subplot(1, len(names), number)
        if points is not None:
            where.plot(points[:, 0], points[:, 2], ".", color="black", markersize=3)
        where.set(title=name, xlim=(0, 1), ylim=(0, 1), xticks=[], yticks=[], aspect="equal")
    figure.supxlabel("Surfels on a corner of the floor, seen from above.", fontsize=7)
    save(figure, kept.path / "surfel-spacing", vector=False)
    shown = ["distribution", "surfels", "mean", "variation", "relative_radius"]
    return "\n\n".join(
        (
            "`mean`: distance to the nearest neighbour on the same surface over the square root of "
            "the area per surfel, 0.5 of points at random (Clark and Evans 1954), 1.07 of a "
            "triangular lattice, the most there can be. `variation`: its standard deviation over "
            "its mean, 0.52 at random, 0 of a lattice. `relative_radius`: its first percentile "
            "over the lattice's, 0.65 to 0.85 of Poisson discs (Lagae and Dutre 2008).",
            markdown(ok[shown], dict.fromkeys(shown[2:], ".3f")),
            "![surfels](surfel-spacing.png)",
        )
    )


SPACING = Experiment(
    name="surfel-spacing",
    title="Surfel caches: how evenly surfels lie",
    source="figure 3 and section 4.2 of Jendersie et al. 2016",
    profiles=("iphone7",),
    keys=("distribution",),
    columns=("surfels", "mean", "variation", "relative_radius"),
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
)
