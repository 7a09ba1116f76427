"""``gibench advise``: what to choose for a budget of time and memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from gibench.errors import CannotRun
from gibench.measure.plan.configuration import Configuration, Request, grid
from gibench.profiles import DeviceProfile
from gibench.scene.model import Scene
from gibench.study.errors import METRICS
from gibench.study.pareto import pareto_front
from gibench.study.regions import WHOLE
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
    settings: Mapping[str, Mapping[str, str]],
) -> list[Configuration]:
    """The configurations that are tried, those that share receivers next to each other.

    Every technique is tried with all its ``sweep`` declares; where the user names values of a
    setting (``asked``, ``settings``), those are tried instead. A technique whose memory does not
    depend on the receivers is tried with the first number of them alone.

    Raises:
        BadInput: a value is refused.
    """
    found: list[Configuration] = []
    for spec in specs:
        fixed = settings.get(spec.name, {})
        axes = {n: tuple(v) for n, v in spec.sweep(scene).items() if n not in fixed}
        axes |= {name: tuple(values) for name, values in asked.items() if values and name in axes}
        for chosen in product(*axes.values()):
            values = {**dict(zip(axes, chosen, strict=True))}
            typed = {name: str(value) for name, value in values.items() if name not in asked}
            request = Request(
                scenes=(scene_name,),
                variants=tuple(variants),
                sh_orders=(values["sh_order"],) if "sh_order" in values else (),
                probes=(values["probes"],) if values.get("probes") is not None else (),
                receivers=_that_matter(spec, scene, receivers),
                settings={spec.name: {**fixed, **typed}},
            )
            found += grid([profile], [spec], request)
    found.sort(key=lambda c: -(c.receivers or 0))
    return [_numbered(configuration, i) for i, configuration in enumerate(found, 1)]


def _that_matter(spec: TechniqueSpec, scene: Scene, receivers: Sequence[int]) -> tuple[int, ...]:
    floors = {spec.memory_floor(scene, n, spec.settings_type(), 1, 1) for n in receivers}
    return tuple(receivers) if len(floors) > 1 else tuple(receivers[:1])


def _numbered(configuration: Configuration, number: int) -> Configuration:
    return replace(configuration, number=number)


def advice(rows: pd.DataFrame, budget_ms: float) -> pd.DataFrame:
    """The table of what was tried, best error first among what fits, then the rest by time.

    Two columns are added: ``fits`` (the median frame is within the budget; memory always is, or it
    would not have run) and ``pareto`` (nothing else is better in time, memory and error).

    Args:
        rows: of ``quality.csv``; those of regions are left out.
        budget_ms: time a frame may take.
    """
    table = rows[rows["region"] == WHOLE].copy()
    for name in ("time_ms", "memory_bytes", *METRICS):
        if name not in table:
            table[name] = float("nan")
        table[name] = pd.to_numeric(table[name])
    table["fits"] = (table["status"] == "ok") & (table["time_ms"] <= budget_ms)
    table["pareto"] = pareto_front(
        table[["time_ms", "memory_bytes", "rel_l2"]].to_numpy(np.float64)
    )
    first = table[table["fits"]].sort_values("rel_l2", kind="stable")
    rest = table[~table["fits"]].sort_values("time_ms", kind="stable")
    return pd.concat([first, rest], ignore_index=True)


def check_fit(table: pd.DataFrame, budget_ms: float) -> None:
    """Refuse when nothing fits.

    Raises:
        CannotRun: no setting meets the budget; says which comes nearest.
    """
    if table["fits"].any():
        return
    ran = table[table["status"] == "ok"]
    if ran.empty:
        reason = table.iloc[0]["reason"] if len(table) else "nothing was tried"
        raise CannotRun(f"nothing could run: {reason}")
    nearest = ran.sort_values("time_ms").iloc[0]
    raise CannotRun(
        f"no setting meets {budget_ms:g} ms on this machine; nearest is {in_words(nearest)} with "
        f"{nearest['time_ms']:.1f} ms",
        mend="raise --budget-ms or lower --resolution or --receivers",
    )


def in_words(row: Mapping[str, Any] | pd.Series) -> str:
    """A row's technique, settings and receivers in words, for a message."""
    return f"{row['technique']} ({row['settings']}) at {int(row['receivers']):,} receivers"
