"""How much of what launches ask for goes to DRAM behind caches of several sizes."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from gibench.report.plots import COLORS, new_figure, save
from gibench.trace.facts import CACHE_BYTES

NAME = "reuse"
_MOST = 12
"""Launches that are drawn: those that ask for the most bytes."""


def write_reuse(folder: Path, table: pd.DataFrame) -> bool:
    """Draw the reuse curve of every launch as ``reuse.png`` and ``reuse.svg``; whether there was
    any.

    Args:
        folder: where it goes.
        table: rows of ``explain.csv``.

    Raises:
        GibenchError: the disk refuses.
    """
    if "requested_bytes" not in table:
        return False
    shown = table[(table["status"] == "ok") & (table["requested_bytes"] > 0)]
    if shown.empty:
        return False
    shown = shown.nlargest(_MOST, "requested_bytes")
    figure = new_figure(10.0, 5.0)
    axes = figure.add_subplot()
    x = [size / 1024 for size in CACHE_BYTES]
    for number, (_, row) in enumerate(shown.iterrows()):
        y = [row[f"dram_bytes_{size >> 10}k"] / row["requested_bytes"] for size in CACHE_BYTES]
        label = " ".join(str(row[name]) for name in ("technique", "variant", "pass", "kernel"))
        style = ("-", "--", ":")[number // len(COLORS)]
        axes.plot(x, y, style, marker="o", color=COLORS[number % len(COLORS)], label=label)
    axes.set_xscale("log", base=2)
    axes.set(
        xlabel="cache, KB",
        ylabel="bytes of DRAM over bytes asked for",
        title="What caches keep from DRAM (traced, not timed)",
    )
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    save(figure, folder / NAME)
    return True
