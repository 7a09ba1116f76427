"""``gibench advise``: what to choose for a budget of time and memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from gibench.errors import CannotRun
from gibench.measure.plan.grid import Settings, grid
from gibench.measure.runfolder.results import OK
from gibench.profiles import DeviceProfile
from gibench.report.limits import METRICS as LIMITED
from gibench.report.limits import Limit, front_of, in_limits, over
from gibench.scene.model import Scene
from gibench.study.errors import METRICS
from gibench.study.pareto import pareto_front
from gibench.study.regions import WHOLE
from gibench.techniques.job import Job, Known, Shot
from gibench.techniques.registry import TechniqueSpec

RECEIVER_SHARES = (1.0, 0.5, 0.25)
"""Numbers of receivers that are tried where none are asked for, as shares of the scene's own."""


def sweep(
    profile: DeviceProfile,
    specs: Sequence[TechniqueSpec],
    scene_name: str,
    scene: Scene,
    variants: Sequence[str],
    receivers: Sequence[int],
    asked: Mapping[str, Sequence[Any]],
    settings: Settings,
    shot: Shot,
    seed: int,
) -> list[Job]:
    """The jobs that are tried, those that share receivers next to each other.

    Every technique is tried with all its ``sweep`` declares; where the user names values of a
    setting (``asked``, ``settings``), those are tried instead. A technique whose memory does not
    depend on the receivers is tried with the first number of them alone.

    Raises:
        BadInput: a value is refused.
    """
    found: list[Job] = []
    for spec in specs:
        own = dict(spec.sweep(scene)) | {n: v for n, v in asked.items() if v}
        found += grid(
            [profile],
            [spec],
            scenes=(scene_name,),
            variants=variants,
            common=own,
            settings={spec.name: settings.get(spec.name, {})},
            receivers=_that_matter(spec, profile, scene, receivers),
            shot=shot,
            seed=seed,
        )
    return sorted(found, key=lambda job: -(job.receivers or 0))


def _that_matter(
    spec: TechniqueSpec, profile: DeviceProfile, scene: Scene, receivers: Sequence[int]
) -> tuple[int, ...]:
    job = Job(
        technique=spec.name,
        settings=spec.settings_type(),
        variant=spec.variants[0],
        scene=scene.name,
        profile=profile,
        workgroup_size=profile.default_workgroup_size,
    )
    declared = {tuple(spec.buffers(Known(job, scene, n))) for n in receivers}
    return tuple(receivers) if len(declared) > 1 else tuple(receivers[:1])


def advice(rows: pd.DataFrame, limits: Sequence[Limit]) -> pd.DataFrame:
    """The table of what was tried, best error first among what fits, then the rest by how far it is
    over.

    Three columns are added: ``passed_over`` (why it does not compete, as in ``gibench run``: it has
    no global illumination or has not settled; empty where it does), ``fits`` (it competes and meets
    all limits, and memory that of the profile, or it would not have run) and ``pareto`` (nothing
    else is better in all that the front is of).

    Args:
        rows: of ``quality.csv``; those of regions are left out.
        limits: to be met.
    """
    table = rows[rows["region"] == WHOLE].copy()
    for name in (*(one.column for one in LIMITED.values()), *METRICS):
        if name not in table:
            table[name] = float("nan")
        table[name] = pd.to_numeric(table[name])
    ran = (table["status"] == OK).to_numpy()
    table["passed_over"] = [_passed_over(row) for _, row in table.iterrows()]
    far = over(table, limits)
    table["fits"] = competing(table) & (far <= 1)
    costs = np.stack([metric.of(table) for metric in front_of(limits)], axis=1)
    known = np.isfinite(costs[ran]).any(axis=0) if ran.any() else np.ones(costs.shape[1], bool)
    table["pareto"] = pareto_front(costs[:, known])
    table["over"] = np.where(competing(table), far, np.inf)
    first = table[table["fits"]].sort_values("rel_l2", kind="stable")
    rest = table[~table["fits"]].sort_values("over", kind="stable")
    return pd.concat([first, rest], ignore_index=True).drop(columns="over")


def misfit(table: pd.DataFrame, limits: Sequence[Limit]) -> CannotRun | None:
    """What to say where no setting meets the limits: which comes nearest; None where one does."""
    if table["fits"].any():
        return None
    if not (table["status"] == OK).any():
        reason = table.iloc[0]["reason"] if len(table) else "nothing was tried"
        return CannotRun(f"nothing could run: {reason}")
    ran = table[competing(table)].reset_index(drop=True)
    if ran.empty:
        row = table[table["status"] == OK].iloc[0]
        return CannotRun(
            f"nothing with global illumination ran and settled: {in_words(row)}: "
            f"{row['passed_over']}",
            mend="raise --frames, or name other techniques",
        )
    far = over(ran, limits)
    nearest = int(np.argmin(far))
    row = ran.iloc[nearest]
    costs = ", ".join(limit.metric.told(limit.metric.of(ran)[nearest]) for limit in limits)
    return CannotRun(
        f"no setting meets {in_limits(limits)} on this machine; nearest is {in_words(row)} with "
        f"{costs}, {far[nearest]:.2f} times over",
        mend="raise a budget, or lower --resolution or --receivers",
    )


def competing(table: pd.DataFrame) -> npt.NDArray[np.bool_]:
    """Which rows (n,) of :func:`advice` ran and are not passed over."""
    return np.asarray((table["status"] == OK) & (table["passed_over"] == ""), np.bool_)


def _passed_over(row: pd.Series) -> str:
    if row["status"] != OK:
        return ""
    if row["gi_ms"] == 0:
        return "no global illumination"
    if str(row.get("settled", True)) == "False":
        return f"not settled after {int(row['frames'])} frames"
    return ""


def in_words(row: Mapping[str, Any] | pd.Series) -> str:
    """A row's technique, settings and receivers in words, for a message."""
    return f"{row['technique']} ({row['settings']}) at {int(row['receivers']):,} receivers"
