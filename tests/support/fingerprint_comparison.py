"""Comparison of fingerprints (see ``fingerprints.py``): what differs, and by how much."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fingerprint_recording import Array, Figures, Recording, digest


@dataclass(frozen=True)
class Distance:
    """How far one thing is from another.

    Attributes:
        largest: of the absolute differences; infinite where shapes or texts differ.
        mean: of the absolute differences.
        relative: the largest difference over the value before, or over a thousandth of the largest
            value before, where that is more.
    """

    largest: float
    mean: float
    relative: float

    @property
    def same(self) -> bool:
        """Bit for bit."""
        return self.largest == 0.0

    def within(self, selves: Sequence[Distance], slack: float) -> bool:
        """No more than ``slack`` times the most of ``selves``, all in all."""
        if self.same:
            return True
        if not selves or not np.isfinite(self.largest):
            return False
        largest, mean = max(one.largest for one in selves), max(one.mean for one in selves)
        return self.largest <= slack * largest and self.mean <= slack * mean

    def __str__(self) -> str:
        if self.same:
            return "same"
        if not np.isfinite(self.largest):
            return "differs in shape, type or text"
        return f"differs by {self.largest:.3g} / {self.relative:.3g}"


NOWHERE_NEAR = Distance(np.inf, np.inf, np.inf)
SAME = Distance(0.0, 0.0, 0.0)


def distance(before: Array, after: Array) -> Distance:
    """Between arrays."""
    if digest(before) == digest(after):
        return SAME
    if (
        before.shape != after.shape
        or before.dtype != after.dtype
        or before.dtype.kind not in "fiub"
    ):
        return NOWHERE_NEAR
    old, new = (values.astype(np.float64) for values in (before, after))
    if not np.array_equal(np.isfinite(old), np.isfinite(new)):
        return NOWHERE_NEAR
    old, new = (values[np.isfinite(values)] for values in (old, new))
    apart = np.abs(old - new)
    # Same to the last figure and yet another hash: -0 for 0, or another NaN; told, as tiny.
    largest = max(float(apart.max(initial=0.0)), np.finfo(np.float64).tiny)
    floor = max(1e-3 * float(np.abs(old).max(initial=0.0)), np.finfo(np.float64).tiny)
    relative = float((apart / np.maximum(np.abs(old), floor)).max(initial=0.0))
    return Distance(largest, float(apart.mean()) if apart.size else 0.0, relative)


def figure_distance(before: float | str | None, after: float | str | None) -> Distance:
    """Between figures or texts."""
    if before == after:
        return SAME
    if isinstance(before, (int, float)) and isinstance(after, (int, float)):
        apart = abs(before - after)
        return Distance(apart, apart, apart / max(abs(before), np.finfo(np.float64).tiny))
    return NOWHERE_NEAR


@dataclass(frozen=True)
class Row:
    """One thing compared."""

    what: str
    before: str
    after: str
    apart: Distance
    selves: tuple[Distance, ...]
    verdict: str

    def __str__(self) -> str:
        own = max(self.selves, key=lambda one: one.largest, default=None)
        cells = (self.what, self.before, self.after, str(self.apart), own or "", self.verdict)
        return "| " + " | ".join(str(cell) for cell in cells) + " |"


class Comparison:
    """Rows, and what is told beside them."""

    def __init__(self, before: Recording, after: Recording, second: list[Recording], slack: float):
        self.before, self.after, self.second, self.slack = before, after, second, slack
        self.rows: list[Row] = []
        self.passes_changed: list[str] = []
        self.notes: list[str] = []

    def everything(self) -> None:
        """Compare all that both tried; what only one tried is a note."""
        tried = [set(one.seconds) for one in (self.before, self.after)]
        for name in sorted(tried[0] ^ tried[1]):
            self.notes.append(f"only recorded {'before' if name in tried[0] else 'after'}: {name}")
        self.both = tried[0] & tried[1]
        for key in ("device", "variables"):
            old, new = self.before.about.get(key), self.after.about.get(key)
            if old != new:
                self.notes.append(f"another {key}: {old} before, {new} after")
        for name in sorted(self.both):
            old, new = (one.failures.get(name) for one in (self.before, self.after))
            if old or new:
                apart = SAME if old and new else NOWHERE_NEAR
                cells = ("failed" if old else "ran", "failed" if new else "ran")
                self.add(f"{name}: runs", *cells, apart, ())
        self.arrays()
        self.figures()
        self.bakes()

    def add(
        self,
        what: str,
        before: str,
        after: str,
        apart: Distance,
        selves: Sequence[Distance],
        excused: str | None = None,
    ) -> None:
        """One row with its verdict."""
        if apart.same:
            verdict = "same"
        elif apart.within(selves, self.slack):
            verdict = "within its own"
        else:
            verdict = excused or "DIFFERS"
        self.rows.append(Row(what, before, after, apart, tuple(selves), verdict))

    def shared(self, name: str) -> bool:
        """Whether both recordings tried the scenario that an item is of."""
        return name.split(": ")[0] in self.both

    def arrays(self) -> None:
        """Pictures and receivers."""
        both = (self.before, self.after)
        baked = {item[4] for one in both for items in one.bakes.values() for item in items}
        names = {**self.before.arrays, **self.after.arrays}
        for name in (n for n in names if n not in baked and self.shared(n)):
            old, new = self.before.arrays.get(name), self.after.arrays.get(name)
            apart = NOWHERE_NEAR if old is None or new is None else distance(old, new)
            selves = [
                distance(old, one.arrays[name])
                for one in self.second
                if old is not None and name in one.arrays
            ]
            self.add(name, short(old), short(new), apart, selves)

    def figures(self) -> None:
        """Frames' sums and passes."""
        for name in (n for n in {**self.before.frames, **self.after.frames} if self.shared(n)):
            old, new = self.before.frames.get(name, {}), self.after.frames.get(name, {})
            for figure in {**old, **new}:
                what = f"{name}: {figure}"
                selves = self.own(lambda one, n=name: one.frames.get(n), old, figure)
                self.figure(what, old.get(figure), new.get(figure), selves)
        for name in (n for n in {**self.before.passes, **self.after.passes} if self.shared(n)):
            passes = self.before.passes.get(name, {}), self.after.passes.get(name, {})
            gone, come = (sorted(set(passes[i]) - set(passes[1 - i])) for i in (0, 1))
            if gone or come:
                told = f"gone: {', '.join(gone) or 'none'}; new: {', '.join(come) or 'none'}"
                self.passes_changed.append(f"{name}: {told}")
            for one in (n for n in passes[0] if n in passes[1]):
                for figure in passes[0][one]:
                    selves = self.own(
                        lambda r, n=name, p=one: r.passes.get(n, {}).get(p), passes[0][one], figure
                    )
                    old_value, new_value = (p[one].get(figure) for p in passes)
                    excused = None
                    if (gone or come) and self.sum_stays(name, figure):
                        excused = "moved to another pass"
                    what = f"{name}: {one}: {figure}"
                    self.figure(what, old_value, new_value, selves, excused)

    def sum_stays(self, name: str, figure: str) -> bool:
        """Whether a configuration's passes have in all what they had."""
        key = f"sum of {figure}"
        old, new = (one.frames.get(name, {}).get(key) for one in (self.before, self.after))
        return old is not None and old == new

    def own(self, of: Any, old: Figures, figure: str) -> list[Distance]:
        """How far the second recordings' figure is from the first's."""
        others = [of(one) for one in self.second]
        return [
            figure_distance(old.get(figure), one.get(figure)) for one in others if one is not None
        ]

    def figure(
        self,
        what: str,
        old: float | str | None,
        new: float | str | None,
        selves: list[Distance],
        excused: str | None = None,
    ) -> None:
        """A row of a figure."""
        self.add(what, shown(old), shown(new), figure_distance(old, new), selves, excused)

    def bakes(self) -> None:
        """Multisets of arrays; those without a twin are paired by name, shape and type."""
        for scenario in sorted(set(self.before.bakes) | set(self.after.bakes)):
            if scenario not in self.both:
                continue
            pairs = paired(self.before.bakes.get(scenario, []), self.after.bakes.get(scenario, []))
            others = [
                (one, dict(own_pairs(self.before.bakes.get(scenario, []), one.bakes[scenario])))
                for one in self.second
                if scenario in one.bakes
            ]
            for old, new in pairs:
                if old is None or new is None:
                    item = old or new
                    assert item is not None
                    cells = ("" if old is None else old[3][:10], "" if new is None else new[3][:10])
                    what = f"{scenario}: {item[0]} {item[1]} {item[2]}"
                    self.add(what, *cells, NOWHERE_NEAR, ())
                    continue
                apart = distance(self.before.arrays[old[4]], self.after.arrays[new[4]])
                selves = [
                    distance(self.before.arrays[old[4]], one.arrays[twins[old[4]]])
                    for one, twins in others
                    if old[4] in twins
                ]
                self.add(old[4], old[3][:10], new[3][:10], apart, selves)

    def failed(self) -> bool:
        """Whether anything differs that should not."""
        return any(row.verdict == "DIFFERS" for row in self.rows)

    def told(self, everything: bool) -> str:
        """The table, then what came and went, then counts."""
        rows = [row for row in self.rows if everything or row.verdict != "same"]
        lines = [
            "| what | before | after | max abs / max rel | before, again | verdict |",
            "|---|---|---|---|---|---|",
            *(str(row) for row in rows),
            "",
        ]
        if self.passes_changed:
            lines += ["Pass set changed:", "", *(f"- {one}" for one in self.passes_changed), ""]
        if self.notes:
            lines += ["Notes:", "", *(f"- {note}" for note in self.notes), ""]
        counts: dict[str, int] = defaultdict(int)
        for row in self.rows:
            counts[row.verdict] += 1
        lines.append(", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())))
        return "\n".join(lines)


def paired(
    before: list[list[str]], after: list[list[str]]
) -> list[tuple[list[str] | None, list[str] | None]]:
    """Equal arrays with equal, the rest in order by name, shape and type, then those left over."""
    pairs: list[tuple[list[str] | None, list[str] | None]] = []
    for length in (4, 3):
        waiting: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
        for item in after:
            waiting[tuple(item[:length])].append(item)
        left = []
        for item in before:
            twins = waiting[tuple(item[:length])]
            if twins:
                pairs.append((item, twins.pop(0)))
            else:
                left.append(item)
        before, after = left, [item for items in waiting.values() for item in items]
    return [*pairs, *((item, None) for item in before), *((None, item) for item in after)]


def own_pairs(before: list[list[str]], second: list[list[str]]) -> Iterator[tuple[str, str]]:
    """Keys of paired arrays."""
    for old, new in paired(before, second):
        if old is not None and new is not None:
            yield old[4], new[4]


def short(values: Array | None) -> str:
    """The first figures of a hash."""
    return "" if values is None else digest(values)[:10]


def shown(value: float | str | None) -> str:
    """A figure for the table."""
    return f"{value:.10g}" if isinstance(value, (int, float)) else str(value or "")
