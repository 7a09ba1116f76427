"""The roofline plot of a run, as PNG and SVG in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gibench.report.plots import new_figure, save, technique_colors
from gibench.report.tables import run_roofs

NAME = "roofline"
_MARKERS = "osD^vPX*<>hp"


def write_roofline(folder: Path, passes: pd.DataFrame, record: Mapping[str, Any]) -> bool:
    """Draw every pass that declares bytes and flops under the machine's roofs (Williams, Waterman
    and Patterson, CACM 2009); whether there was any.

    Args:
        folder: the run's, where ``roofline.png`` and ``roofline.svg`` are written.
        passes: see :func:`gibench.report.tables.passes_table`.
        record: the content of ``run.json``.

    Raises:
        GibenchError: the disk refuses.
    """
    shown = passes[drawable(passes)]
    if shown.empty:
        return False
    roofs = run_roofs(record)
    intensity = (shown["flops"] / shown["bytes"]).to_numpy(float)
    ridge = roofs.fma_gflop_per_s / roofs.gb_per_s
    x = np.geomspace(min(intensity.min(), ridge) / 3, max(intensity.max(), ridge) * 3, 200)
    figure = new_figure(8.0, 5.0)
    axes = figure.add_subplot()
    axes.loglog(x, np.minimum(x * roofs.gb_per_s, roofs.fma_gflop_per_s), color="black")
    colors = technique_colors(shown["technique"])
    several = len(set(shown["configuration"])) > 1
    labelled = set()
    for at, (_, row) in zip(intensity, shown.iterrows(), strict=True):
        mine = list(dict.fromkeys(shown[shown["technique"] == row["technique"]]["pass"]))
        hollow = row["variant"] == "published"
        label = f"{row['technique']} {row['pass']}{' (published)' if hollow else ''}"
        axes.plot(
            *([at], [row["gflop_per_s"]], _MARKERS[mine.index(row["pass"]) % len(_MARKERS)]),
            color=colors[row["technique"]],
            markerfacecolor="none" if hollow else None,
            label=label if label not in labelled else None,
        )
        labelled.add(label)
        if several:
            place = (at, row["gflop_per_s"])
            number = str(row["configuration"])
            axes.annotate(number, place, (4, 4), textcoords="offset points", fontsize=6)
    axes.set(xlabel="flops per byte", ylabel="GFLOP/s", title="Declared work under the roofs")
    axes.legend(fontsize=7, ncols=2)
    axes.grid(alpha=0.3, which="both", linewidth=0.4)
    figure.supxlabel(
        f"Measured on {record['environment']['cpu']}: {roofs.fma_gflop_per_s:.0f} GFLOP/s, "
        f"{roofs.gb_per_s:.1f} GB/s; no time of the modelled device. "
        + ("Numbers: the configuration in run.json." if several else ""),
        fontsize=7,
        color="dimgrey",
    )
    save(figure, folder / NAME)
    return True


def drawable(passes: pd.DataFrame) -> pd.Series:
    """Which passes ran and declare bytes and flops."""
    figures = passes[["bytes", "flops", "median_ms"]].astype(float)
    out: pd.Series = (figures > 0).all(axis=1)
    return out
