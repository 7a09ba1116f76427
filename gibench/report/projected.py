"""Projected ranges in tables that cannot be taken for measured times."""

from __future__ import annotations

import pandas as pd

from gibench.report.figures import number

PROJECTED = "projected.csv"
WHOLE_FRAME, WHOLE_GI, WHOLE_LAUNCH = "(frame)", "(GI)", "(launch)"
"""Stand for the pass in rows of a whole frame, of its global illumination, and of a launch of a
kernel that is no technique's."""
COLUMNS = (
    *("configuration", "technique", "variant", "layout", "scene", "profile", "device", "pass"),
    "stage",
    *("projected_low_ms", "projected_nominal_ms", "projected_high_ms"),
    *("bound_by", "driven_by", "verdict", "projection_reason"),
)
RATIOS = "ratios.csv"
RATIO_COLUMNS = (
    *("configuration", "technique", "variant", "layout", "scene", "profile", "device", "pass"),
    *("cheapest", "cheapest_technique", "cheapest_variant"),
    *("ratio_low", "ratio_nominal", "ratio_high", "verdict", "ratio_reason"),
)
"""Columns of the ratios of configurations to the cheapest of them."""
RATIO_HEAD = ("configuration", "on", "pass", "PROJECTED ratio", "to", "slower")
RATIO_WARNING = (
    "How many times as long as the configuration with the lowest nominal time; what both do not "
    "know of the device cancels, so these ranges are narrower than those of times. `sure`: it is "
    "slower at 97.5 % of the points; `likely`: at 80 %."
)
RANKED = (
    *("rank", "technique", "variant", "settings", "receivers", "number", "device"),
    *("projected_low_ms", "projected_nominal_ms", "projected_high_ms"),
    *("slower_than_last", "slower_than_first", "bound_by", "driven_by"),
    *("verdict", "projection_reason"),
)
"""Columns of what ``advise`` projects: the GI of a frame."""
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


def configuration_text(row: pd.Series) -> str:
    """Technique, variant and the layout that ran, if it has one."""
    layout = row.get("layout")
    named = f"{row['technique']} {row['variant']}"
    return named if layout is None or pd.isna(layout) or not layout else f"{named} {layout}"


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
            f"{row['configuration']}: {configuration_text(row)} {row['scene']}",
            row["device"],
            row["pass"],
            range_text(row),
            row["verdict"],
            *("" if pd.isna(row[name]) else row[name] for name in ("bound_by", "driven_by")),
        )
        lines.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def ratio_text(row: pd.Series) -> str:
    """A ratio in words: ``1.3 to 2.9 times``."""
    if pd.isna(row["ratio_low"]):
        return "cannot tell"
    text = f"{number(row['ratio_low'], 2)} to {number(row['ratio_high'], 2)} times"
    middle = row["ratio_nominal"]
    return text if pd.isna(middle) else f"{text} (about {number(middle, 2)})"


def ratio_cells(table: pd.DataFrame) -> list[list[str]]:
    """Rows of the ratios in words, under ``RATIO_HEAD``."""
    return [
        [
            f"{row['configuration']}: {configuration_text(row)} {row['scene']}",
            str(row["device"]),
            str(row["pass"]),
            ratio_text(row),
            f"{row['cheapest']}: {row['cheapest_technique']} {row['cheapest_variant']}",
            str(row["verdict"]),
        ]
        for _, row in table.iterrows()
    ]


def ratios_section(table: pd.DataFrame) -> str:
    """The section of a report; empty where nothing is compared.

    Args:
        table: of ``ratios.csv``.
    """
    if table.empty:
        return ""
    lines = [
        "## Projected ratios, not measured",
        "",
        RATIO_WARNING,
        "",
        "| " + " | ".join(RATIO_HEAD) + " |",
        "|" + " --- |" * len(RATIO_HEAD),
    ]
    for cells in ratio_cells(table):
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def ranking_section(table: pd.DataFrame) -> str:
    """The section of advice: settings by projected GI.

    Args:
        table: with columns ``RANKED``.
    """
    head = ("rank", "technique", "settings", "receivers", "PROJECTED GI", "than the last",
            "than the first", "verdict")  # fmt: skip
    lines = [
        f"## GI on {table['device'].iloc[0]}: projected, not measured",
        "",
        f"{WARNING} Each setting is slower than the one before it, and than the first: surely, "
        "likely, or it cannot be told.",
        "",
        "| " + " | ".join(head) + " |",
        "|" + " --- |" * len(head),
    ]
    lines += ["| " + " | ".join(cells) + " |" for cells in ranked_cells(table)]
    return "\n".join(lines) + "\n"


def ranked_cells(table: pd.DataFrame) -> list[list[str]]:
    """Rows of the ranking in words."""

    def text(value: object) -> str:
        return "" if pd.isna(value) else str(value)  # type: ignore[call-overload]

    return [
        [
            "" if pd.isna(row["rank"]) else f"{row['rank']:.0f}",
            *(text(row[name]) for name in ("technique", "settings")),
            f"{row['receivers']:,.0f}",
            range_text(row),
            *(text(row[name]) for name in ("slower_than_last", "slower_than_first", "verdict")),
        ]
        for _, row in table.iterrows()
    ]
