"""``gibench compare``, and :func:`gibench.compare`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.errors import BadInput, CheckFailed, GibenchError
from gibench.measure.compare.recorded import (
    DRAWS,
    PROCESS_SPREAD,
    ComparedRow,
    RowKey,
    Timings,
    compare_recorded,
    differences,
    other_versions,
)
from gibench.measure.compare.timings import read_timings
from gibench.report.comparison import Comparison, Row


@within_bounds
def compare(
    base: str | Path,
    new: str | Path,
    threshold: str = "5%",
    seed: int = 0,
) -> Comparison:
    """Compare recorded times, as ``gibench compare`` does; its help says what everything is.

    Raises:
        BadInput: a side is missing or damaged, or they are of different machines, scenes or
            settings.
    """
    limit = asked.percentage(threshold)
    base, new = Path(base), Path(new)
    first, second = read_timings(base, "BASE"), read_timings(new, "NEW")
    if different := differences(first, second):
        more = f" and {len(different) - 3} more" if len(different) > 3 else ""
        raise BadInput(
            f"BASE and NEW cannot be compared, they differ in {'; '.join(different[:3])}{more}",
            mend="run both on one machine with the same scenes and settings",
        )
    compared = compare_recorded(first, second, limit, seed)
    broken = {key: second.failed[key] for key in first.rows if key in second.failed}
    missing = _missing(first, second)
    slower = [one.key for one in compared if one.judged.verdict == "slower"]
    remarks = _remarks(compared, limit)
    versions = other_versions(first, second)
    if versions:
        pairs = (f"{name} {old} against {later}" for name, (old, later) in versions.items())
        remarks.append(f"Versions differ: {'; '.join(pairs)}.")
    remarks += [f"No longer runs: {_words(key)}: {reason}." for key, reason in broken.items()]
    return Comparison(
        title=f"gibench compare: {base.name} against {new.name}",
        rows=[
            Row(*one.key, one.old_ms, one.new_ms, one.judged)
            for one in sorted(compared, key=lambda one: one.key[0])
        ],
        remarks=remarks + missing,
        facts={
            "schema_version": 1,
            "kind": "compare",
            "threshold": limit,
            "slower": [list(key) for key in slower],
            "broken": [list(key) for key in broken],
            "missing": missing,
            "versions": {name: list(pair) for name, pair in versions.items()},
        },
        error=_verdict(threshold, slower, broken, missing),
    )


def _verdict(
    threshold: str, slower: Sequence[RowKey], broken: Mapping[RowKey, str], missing: Sequence[str]
) -> GibenchError | None:
    if slower:
        return CheckFailed(f"slower by more than {threshold}: {'; '.join(map(_words, slower))}")
    if broken:
        return CheckFailed(f"no longer runs: {'; '.join(map(_words, broken))}")
    if missing:
        return BadInput(missing[0].rstrip("."), mend="nothing else was found slower")
    return None


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


def _remarks(compared: Sequence[ComparedRow], limit: float) -> list[str]:
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


def _words(key: RowKey) -> str:
    return f"{key[1]} of {key[0]}" if key[0] else key[1]
