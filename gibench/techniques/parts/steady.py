"""Whether a figure that is looked at again and again stands still. No I/O here."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Steady:
    """Compares the mean of the last looks with the mean of as many before.

    It stands still once they are within ``within`` of each other, and again moves only where they
    come to differ by more than twice that, so that noise at the threshold does not tell twice.

    Attributes:
        within: relative change that counts as none.
        window: looks per mean.
    """

    within: float
    window: int = 1
    _values: list[float] = field(default_factory=list, repr=False)
    _still: bool = field(default=False, repr=False)

    def takes(self, value: float) -> bool:
        """Take the figure as it is now, and tell whether it stands still."""
        self._values = [*self._values, value][-2 * self.window :]
        if len(self._values) < 2 * self.window:
            return False
        before = sum(self._values[: self.window]) / self.window
        now = sum(self._values[self.window :]) / self.window
        allowed = self.within * (2 if self._still else 1)
        self._still = abs(now - before) <= allowed * abs(before)
        return self._still
