"""``gibench compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gibench.cli import comparing, options
from gibench.errors import BadInput, CheckFailed

if TYPE_CHECKING:
    from gibench.measure.compare.runs import Comparison, Timings


def compare(
    base: Annotated[Path, typer.Argument(metavar="BASE", help="The baseline.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="What is judged.")],
    threshold: comparing.Threshold = "5%",
    seed: options.Seed = 0,
    markdown: comparing.MarkdownFile = None,
    json: comparing.JsonFile = None,
    quiet: options.Quiet = False,
) -> None:
    """Compare recorded times, pass by pass, and fail only on an established slowdown.

    BASE and NEW are run folders, JSON files of pytest-benchmark, or folders that hold several of
    them, each one process: three or more processes a side let their spread be measured; with fewer
    it is assumed, and only large changes can be established. On a noisy machine use 'gibench ab',
    which times both sides in turns.

    Exit code 1: a frame or pass is slower beyond the threshold with 99 % confidence, or no longer
    runs. 2: a side is missing or damaged, or they are of different machines, scenes or settings.

    Examples:

      gibench compare results/runs/yesterday results/runs/today --threshold 10%

      gibench compare main.json pull-request.json --markdown comment.md
    """
    from gibench.commands import asked
    from gibench.measure.compare.runs import compare as compare_timings
    from gibench.measure.compare.runs import differences
    from gibench.measure.compare.timings import read_timings
    from gibench.report import comparison

    limit = asked.percentage(threshold)
    first, second = read_timings(base, "BASE"), read_timings(new, "NEW")
    if different := differences(first, second):
        more = f" and {len(different) - 3} more" if len(different) > 3 else ""
        raise BadInput(
            f"BASE and NEW cannot be compared, they differ in {'; '.join(different[:3])}{more}",
            mend="run both on one machine with the same scenes and settings",
        )
    compared = compare_timings(first, second, limit, seed)
    broken = [key for key in first.rows if key in second.failed]
    missing = _missing(first, second)
    slower = [one.key for one in compared if one.judged.verdict == "slower"]
    rows = [
        comparison.Row(*one.key, one.old_ms, one.new_ms, one.judged)
        for one in sorted(compared, key=lambda one: one.key[0])
    ]
    remarks = _remarks(compared, limit)
    remarks += [f"No longer runs: {_words(key)}: {second.failed[key]}." for key in broken]
    remarks += missing
    facts = {
        "schema_version": 1,
        "kind": "compare",
        "threshold": limit,
        "slower": [list(key) for key in slower],
        "broken": [list(key) for key in broken],
        "missing": missing,
    }
    title = f"gibench compare: {base.name} against {new.name}"
    comparing.write_comparison(
        markdown, comparison.markdown(rows, title, remarks), json, comparison.as_json(rows, facts)
    )
    if not quiet and json != Path("-") and markdown != Path("-"):
        comparison.show(rows, title, remarks)
    if slower:
        raise CheckFailed(f"slower by more than {threshold}: {'; '.join(map(_words, slower))}")
    if broken:
        raise CheckFailed(f"no longer runs: {'; '.join(map(_words, broken))}")
    if missing:
        raise BadInput(missing[0].rstrip("."), mend="nothing else was found slower")


def _missing(first: Timings, second: Timings) -> list[str]:
    """Rows that one side lacks: they were not compared, and that must not pass for a success."""
    found = []
    for side, other in ((first, second), (second, first)):
        rows = [key for key in other.rows if key not in side.rows and key not in side.failed]
        if rows:
            found.append(f"{side.name} has no {', no '.join(map(_words, rows))}.")
    never = [key for key in second.rows if key in first.failed]
    if never:
        found.append(f"BASE did not run {', '.join(map(_words, never))}.")
    if not found and not any(key in second.rows for key in first.rows):
        found.append("BASE and NEW have no row in common.")
    return found


def _remarks(compared: list[Comparison], limit: float) -> list[str]:
    from gibench.measure.compare.runs import DRAWS, PROCESS_SPREAD

    if not compared:
        return []
    remarks = [
        f"Ratios of medians; 99 % intervals by a hierarchical bootstrap of {DRAWS:,} draws over "
        f"processes and samples; threshold {100 * limit:.3g} %."
    ]
    if any(one.assumed for one in compared):
        counts = compared[0].processes
        remarks.append(
            f"With {counts[0]} and {counts[1]} processes their spread is not measured but assumed "
            f"({100 * PROCESS_SPREAD:.0f} % each): only large changes can be established. Give "
            "folders of three or more runs a side, or use 'gibench ab'."
        )
    return remarks


def _words(key: tuple[str, str]) -> str:
    return f"{key[1]} of {key[0]}" if key[0] else key[1]
