"""Projections held against measured times, on the terminal."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

_COLUMNS = {
    "rows": ("rows", "{:,.0f}"),
    "told": ("told", "{:.0%}"),
    "inside_told": ("inside", "{:.0%}"),
    "inside_all": ("inside of all", "{:.0%}"),
    "median_width": ("width", "{:.1f}"),
    "error": ("error", "{:.0%}"),
    "error_throughput": ("of throughput", "{:.0%}"),
    "rank": ("rank corr.", "{:.2f}"),
    "sure_pairs": ("sure", "{:,.0f}"),
    "sure_right": ("right", "{:.1%}"),
    "apart_pairs": ("apart", "{:,.0f}"),
    "apart_sure": ("called sure", "{:.0%}"),
}
LEGEND = (
    "told: rows with a range or an order of magnitude; inside: of those, measured times in the "
    "range; inside of all: 'cannot tell' counts as a miss; width: median of high over low; error: "
    "mean of nominal against measured, and of throughput-bound rows alone; sure, right: pairs of "
    "which one was called surely faster, and rightly so; apart: pairs whose measured times differ "
    "by over 1.5 times, and how many of them were called sure"
)


def shown(summary: pd.DataFrame) -> pd.DataFrame:
    """The summary as texts."""
    table = summary[["set", "device"]].copy()
    for name, (title, form) in _COLUMNS.items():
        table[title] = ["" if pd.isna(x) else form.format(x) for x in summary[name]]
    return table


def show_validation(summary: pd.DataFrame, best: pd.DataFrame, hashes: Mapping[str, str]) -> None:
    """Print the summary, and what the model's choice among convolutions costs."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.report.terminal import console

    out = console()
    texts = shown(summary)
    table = Table()
    for name in texts.columns:
        table.add_column(name, justify="left" if name in ("set", "device") else "right")
    for row in texts.itertuples(index=False):
        table.add_row(*(escape(str(each)) for each in row))
    out.print(table)
    out.print(LEGEND, soft_wrap=True)
    for each in best.itertuples(index=False):
        out.print(
            f"convolution on {each.device}: the model picks {each.picked}: "
            f"{each.over_best_of_sample:.2f} times the best of the sample, "
            f"{each.over_best_of_all:.2f} times the best of all",
            soft_wrap=True,
        )
    for name in ("predictions.csv", "points.npz"):
        out.print(f"frozen {name}: SHA-256 {hashes[name]}", soft_wrap=True)


_ORDERS = {
    "passes": ("passes", "{:,.0f}"),
    "orders": ("orders of magnitude", "{:.1f}"),
    "told": ("told", "{:.0%}"),
    "inside": ("inside", "{:.0%}"),
    "within_10": ("within 10 times", "{:.0%}"),
    "rank": ("rank corr.", "{:.2f}"),
    "variant_pairs": ("pairs of variants", "{:,.0f}"),
    "variants_right": ("right", "{:.0%}"),
    "technique_pairs": ("pairs of techniques", "{:,.0f}"),
    "techniques_right": ("right", "{:.0%}"),
}
ORDERS_LEGEND = (
    "orders of magnitude: that the measured times span; told: passes whose range has a verdict "
    "other than 'cannot tell'; inside: measured times in their range, whatever its verdict; within "
    "10 times: of the range's middle; pairs: measured over 1.1 times apart, and those that come "
    "out right: variants of a pass, techniques by their GI"
)


def show_orders(summary: pd.DataFrame) -> None:
    """Print how well projections keep the order of what was measured here."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.report.terminal import console

    out = console()
    table = Table(title="Projected onto the device that ran it: orders, no evidence for others",
                  title_justify="left")  # fmt: skip
    for name in ("runtime", "device"):
        table.add_column(name)
    for title, _ in _ORDERS.values():
        table.add_column(title, justify="right")
    for _, row in summary.iterrows():
        cells = ["" if pd.isna(row[n]) else form.format(row[n]) for n, (_, form) in _ORDERS.items()]
        table.add_row(escape(str(row["runtime"])), escape(str(row["device"])), *cells)
    out.print(table)
    out.print(ORDERS_LEGEND, soft_wrap=True)
