"""How long `ab` warms up both of its sides: until both are at rest, for the same frames."""

from __future__ import annotations

from typing import Any

import pytest

from gibench.measure.compare.lockstep import _warm_up as warm_pair
from gibench.measure.plan.stopping import Patience


class Side:
    """A process of ``ab`` that rests after some frames."""

    def __init__(self, rests_after: int) -> None:
        self.rests_after, self.frames = rests_after, 0

    def ask(self, command: str) -> None:
        assert command == f"warm {self.frames}"
        self.frames += 1

    def answer(self) -> dict[str, Any]:
        waits = self.frames < self.rests_after
        warning = f"not at rest after {self.frames} frames" if waits else ""
        return {"waits": waits, "spent_ms": 10.0 * self.frames, "warning": warning}


@pytest.mark.parametrize(
    ("old", "new", "patience", "frames"),
    (
        (1, 1, Patience(), 4),
        (9, 30, Patience(), 30),
        (9, 10**6, Patience(frames=50), 50),
        (9, 10**6, Patience(seconds=0.4), 40),
    ),
)
def test_both_sides_of_ab_run_the_same_frames_until_both_rest(old, new, patience, frames) -> None:
    sides = {"OLD": Side(old), "NEW": Side(new)}
    found, told = warm_pair(sides, 4, patience)  # type: ignore[arg-type]
    assert found == frames == sides["OLD"].frames == sides["NEW"].frames
    assert told == ({} if new < 100 else {"NEW": f"not at rest after {frames} frames"})
