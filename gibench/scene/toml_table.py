"""Typed reading of TOML tables, with every fault as one clear line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gibench.arrays import Vec3
from gibench.errors import BadInput


class Table:
    """A TOML table whose keys are asked for by name and type.

    Args:
        entries: the table.
        label: what it is, for messages, like ``[[light]] 2``.
        where: the file.
        known: every key it may hold.

    Raises:
        BadInput: an unknown key; every method raises it for a wrong value.
    """

    def __init__(self, entries: Any, label: str, where: object, known: Sequence[str]) -> None:
        self.label = label
        self.where = where
        if not isinstance(entries, Mapping):
            raise BadInput(f"{label} is not a table", where=where)
        self.entries = entries
        if unknown := sorted(set(entries) - set(known)):
            raise BadInput(
                f"unknown key '{unknown[0]}' in {label}",
                where=where,
                mend=f"the keys are {', '.join(known)}",
            )

    def __contains__(self, key: str) -> bool:
        return key in self.entries

    def fail(self, key: str, expected: str) -> NoReturn:
        """Raise that ``key`` is not what was ``expected``."""
        found = f"is {self.entries[key]!r}" if key in self.entries else "is missing"
        raise BadInput(f"'{key}' in {self.label} {found}", where=self.where, mend=expected)

    def text(self, key: str, default: str | None = None) -> str:
        """A string that is not empty."""
        value = self.entries.get(key, default)
        if not isinstance(value, str) or not value.strip():
            self.fail(key, "give a text")
        return value

    def choice(self, key: str, choices: Sequence[str]) -> str:
        """One of ``choices``."""
        value = self.entries.get(key)
        if value not in choices:
            self.fail(key, f"give one of {', '.join(choices)}")
        return str(value)

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> float:
        """A finite number from ``low`` to ``high``."""
        value = self.entries.get(key, default)
        if not _is_number(value) or not low <= value <= high:
            self.fail(key, f"give a number{_range(low, high)}")
        return float(value)

    def whole(self, key: str, default: int | None = None, *, low: int = 0) -> int:
        """A whole number of at least ``low``."""
        value = self.entries.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < low:
            self.fail(key, f"give a whole number of at least {low}")
        return value

    def flag(self, key: str) -> bool:
        """True or false; false where it is missing."""
        value = self.entries.get(key, False)
        if not isinstance(value, bool):
            self.fail(key, "give true or false")
        return value

    def vector(self, key: str, default: Vec3 | None = None) -> Vec3:
        """Three finite numbers."""
        numbers = self.numbers(key, 3, default)
        return numbers[0], numbers[1], numbers[2]

    def color(self, key: str, default: Vec3 | None = None, *, high: float = math.inf) -> Vec3:
        """Three numbers from 0 to ``high``; one number stands for a grey."""
        value = self.entries.get(key, default)
        numbers = [value] * 3 if _is_number(value) else value
        if (
            not isinstance(numbers, list | tuple)
            or len(numbers) != 3
            or not all(_is_number(x) and 0 <= x <= high for x in numbers)
        ):
            self.fail(key, f"give red, green and blue{_range(0, high)}")
        return float(numbers[0]), float(numbers[1]), float(numbers[2])

    def numbers(self, key: str, count: int, default: Sequence[float] | None = None) -> list[float]:
        """``count`` finite numbers."""
        value = self.entries.get(key, default)
        if (
            not isinstance(value, list | tuple)
            or len(value) != count
            or not all(_is_number(x) for x in value)
        ):
            self.fail(key, f"give a list of {count} numbers")
        return [float(x) for x in value]

    def matrix(self, key: str) -> npt.NDArray[np.float64]:
        """An affine (4, 4) matrix, row-major: 4 lists of 4 numbers, or 16 numbers."""
        rows = self.entries[key]
        if isinstance(rows, list) and len(rows) == 4 and all(isinstance(r, list) for r in rows):
            rows = [x for row in rows for x in row]
        flat = Table({key: rows}, self.label, self.where, (key,)).numbers(key, 16)
        matrix = np.array(flat).reshape(4, 4)
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            self.fail(key, "its last row must be 0, 0, 0, 1 (row-major)")
        return matrix


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _range(low: float, high: float) -> str:
    if low == -math.inf and high == math.inf:
        return ""
    if high == math.inf:
        return f" of at least {low:g}"
    return f" from {low:g} to {high:g}"
