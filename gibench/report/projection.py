"""Projected ranges in tables that cannot be taken for measured times."""

from __future__ import annotations

import pandas as pd

from gibench.report.terminal import number

PROJECTED = "projected.csv"
COLUMNS = (
    *("configuration", "technique", "variant", "scene", "profile", "device", "pass", "stage"),
    *("projected_low_ms", "projected_nominal_ms", "projected_high_ms"),
    *("bound_by", "driven_by", "verdict", "projection_reason"),
)
WARNING = (
    "Projected from traces and published figures, never measured: no such device was here. Each is "
    "a range from low to high; a time in it is given where the two are within 3 times."
)
_LAID_OUT = (
    "Kernels are those that ran here: `tuned` ones are laid out for this machine's vectors. What "
    "ranges can and cannot say: docs/projection.md of gibench."
)


def range_text(row: pd.Series) -> str:
    """A range in words: ``3.1 to 9.8 ms``; ``cannot tell`` where that is its verdict."""
    if pd.isna(row["projected_low_ms"]):
        return "cannot tell"
    low, high = number(row["projected_low_ms"], 3), number(row["projected_high_ms"], 3)
    middle = row["projected_nominal_ms"]
    text = f"{low} to {high} ms"
    if not pd.isna(middle):
        text += f" (about {number(middle, 3)})"
    return f"cannot tell ({text})" if row["verdict"] == "cannot tell" else text


def projected_section(table: pd.DataFrame) -> str:
    """The section of a report.

    Args:
        table: of ``projected.csv``.
    """
    head = ("configuration", "on", "pass", "PROJECTED range", "verdict", "bound by", "driven by")
    lines = [
        "## Projected, not measured",
        "",
        f"{WARNING} {_LAID_OUT}",
        "",
        "| " + " | ".join(head) + " |",
        "|" + " --- |" * len(head),
    ]
    for _, row in table.iterrows():
        cells = (
            f"{row['configuration']}: {row['technique']} {row['variant']} {row['scene']}",
            row["device"],
            row["pass"],
            range_text(row),
            row["verdict"],
            *("" if pd.isna(row[name]) else row[name] for name in ("bound_by", "driven_by")),
        )
        lines.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def show_projection(table: pd.DataFrame) -> None:
    """The ranges on the terminal."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.report.terminal import console

    out = console()
    shown = Table("configuration", "on", "pass", title="Projected, not measured",
                  title_justify="left")  # fmt: skip
    shown.add_column("PROJECTED range", justify="right")
    for name in ("verdict", "bound by", "driven by"):
        shown.add_column(name)
    for _, row in table.iterrows():
        shown.add_row(
            escape(f"{row['configuration']}: {row['technique']} {row['variant']}"),
            escape(str(row["device"])),
            escape(str(row["pass"])),
            range_text(row),
            row["verdict"],
            *(
                "" if pd.isna(row[name]) else escape(str(row[name]))
                for name in ("bound_by", "driven_by")
            ),
        )
    out.print(shown)
    out.print(WARNING, soft_wrap=True)
