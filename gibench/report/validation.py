"""Projections held against measured times, on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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


def _print(
    summary: pd.DataFrame,
    keys: Sequence[str],
    columns: Mapping[str, tuple[str, str]],
    legend: str,
    title: str | None = None,
) -> None:
    """Print rows by their ``keys``, the figures of ``columns`` by title and form, and what those
    are.
    """
    from rich.markup import escape
    from rich.table import Table

    from gibench.report.terminal import console

    out, table = console(), Table(title=title, title_justify="left")
    for key in keys:
        table.add_column(key)
    for heading, _ in columns.values():
        table.add_column(heading, justify="right")
    for _, row in summary.iterrows():
        named = [escape(str(row[key])) for key in keys]
        figures = [(row[name], form) for name, (_, form) in columns.items()]
        table.add_row(*named, *("" if pd.isna(x) else form.format(x) for x, form in figures))
    out.print(table)
    out.print(legend, soft_wrap=True)


def show_validation(summary: pd.DataFrame, best: pd.DataFrame, hashes: Mapping[str, str]) -> None:
    """Print the summary, and what the model's choice among convolutions costs."""
    from gibench.report.terminal import console

    _print(summary, ("set", "device"), _COLUMNS, LEGEND)
    out = console()
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
    title = "Projected onto the device that ran it: orders, no evidence for others"
    _print(summary, ("runtime", "device"), _ORDERS, ORDERS_LEGEND, title)
