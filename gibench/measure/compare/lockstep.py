"""Two fresh processes that take turns, frame by frame: how two kernel trees are timed.

Times of two processes started one after the other differ by tens of percent on a shared machine,
because the machine changes between them. Here both processes are alive at once and run the same
frame one right after the other, the order drawn anew for every frame, so that what the machine does
to one it does to the other; only the ratio of such a couple of frames is used. What remains between
processes (memory layout, threads' placement) is averaged over fresh pairs of processes (Mytkowicz,
Diwan, Hauswirth and Sweeney, ASPLOS 2009; Kalibera and Jones, ISMM 2013).
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.errors import CheckFailed, GibenchError
from gibench.measure.compare.replicate import Place, request
from gibench.measure.plan.stopping import Patience
from gibench.techniques.job import Job

FRAME = "frame"
"""Stands for the whole frame (wall time) beside the passes (device time)."""


class SideFailed(GibenchError):
    """One of the two processes could not be set up or died.

    Attributes:
        side: its name.
    """

    def __init__(self, side: str, what: str, code: int) -> None:
        super().__init__(f"{side}: {what}")
        self.side, self.exit_code = side, code


@dataclass(frozen=True)
class PairTimes:
    """Times of one pair of processes.

    Attributes:
        old: ms, for the frame and every pass, (frames,).
        new: likewise.
        warmup: frames that both ran first.
        rest: by side, what a reader must know where it was not at rest after them.
    """

    old: dict[str, npt.NDArray[np.float64]]
    new: dict[str, npt.NDArray[np.float64]]
    warmup: int = 0
    rest: dict[str, str] = field(default_factory=dict)

    def log_ratios(self) -> dict[str, float]:
        """For the frame and every pass, the median over frames of log(new / old).

        nan where a time is zero (a pass that had nothing to do).
        """
        found = {}
        for name, old in self.old.items():
            new = self.new[name]
            good = (old > 0) & (new > 0)
            found[name] = float(np.median(np.log(new[good] / old[good]))) if good.any() else np.nan
        return found


@dataclass
class Replicate:
    """A running process (see :mod:`gibench.measure.compare.replicate`)."""

    side: str
    process: subprocess.Popen[str]

    def ask(self, command: str) -> None:
        """Send a command."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(command + "\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # the answer tells why

    def answer(self) -> dict[str, Any]:
        """Wait for the next answer.

        Raises:
            SideFailed: it reports an error, or is gone.
        """
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            code = self.process.wait()
            raise SideFailed(self.side, f"its process ended unexpectedly with code {code}", 1)
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise SideFailed(self.side, answer["error"], answer["exit_code"])
        return answer


@contextlib.contextmanager
def replicates(job: Job, *sides: tuple[str, Place]) -> Iterator[list[Replicate]]:
    """Fresh processes with ``job`` set up side by side, ready to run frames; ended with the block.

    Raises:
        SideFailed: one cannot be set up.
    """
    running: list[Replicate] = []
    with tempfile.TemporaryFile("w+") as noise:  # what compilers print
        try:
            for side, place in sides:
                process = subprocess.Popen(
                    [sys.executable, "-m", "gibench.measure.compare.replicate"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=noise,
                    text=True,
                )
                running.append(Replicate(side, process))
                running[-1].ask(request(job, place))
            for one in running:
                one.answer()
            yield running
        finally:
            for one in running:
                assert one.process.stdin is not None and one.process.stdout is not None
                with contextlib.suppress(BrokenPipeError):
                    one.process.stdin.close()
                try:
                    one.process.wait(timeout=10)
                except subprocess.TimeoutExpired:
                    one.process.kill()
                    one.process.wait()
                one.process.stdout.close()


def time_pair(
    job: Job,
    old: Place,
    new: Place,
    *,
    frames: int,
    warmup: int,
    rng: np.random.Generator,
    keep: Path | None = None,
    patience: Patience | None = None,
) -> PairTimes:
    """Time one fresh pair of processes.

    Args:
        job: what both run.
        old: the baseline.
        new: what is judged.
        frames: measured, of each.
        warmup: run before them at least, of each, until both are at rest.
        rng: draws who goes first.
        patience: how long it is waited for that they are.
        keep: folder where ``OLD.npz`` and ``NEW.npz`` are left with what was computed.

    Raises:
        SideFailed: one side cannot run.
    """
    order = [("OLD", old), ("NEW", new)]
    if rng.random() < 0.5:  # who starts first is drawn too
        order.reverse()
    with replicates(job, *order) as running:
        by_side = {one.side: one for one in running}
        times: dict[str, list[dict[str, float]]] = {"OLD": [], "NEW": []}
        warmed, rest = _warm_up(by_side, warmup, patience or Patience())
        for frame in range(warmed, warmed + frames):
            for side in ("OLD", "NEW") if rng.random() < 0.5 else ("NEW", "OLD"):
                by_side[side].ask(f"frame {frame}")
                answer = by_side[side].answer()
                times[side].append({FRAME: answer["wall_ms"], **answer["pass_ms"]})
        if keep is not None:
            for side, one in by_side.items():
                one.ask(f"keep {keep / f'{side}.npz'}")
                one.answer()
    columns = {
        side: {name: np.array([row[name] for row in rows]) for name in rows[0]}
        for side, rows in times.items()
    }
    if columns["OLD"].keys() != columns["NEW"].keys():
        raise CheckFailed("OLD and NEW do not have the same passes")
    return PairTimes(columns["OLD"], columns["NEW"], warmed, rest)


def _warm_up(
    by_side: Mapping[str, Replicate], least: int, patience: Patience
) -> tuple[int, dict[str, str]]:
    """Run the same frames on both sides until both are at rest; how many, and what is to be said of
    a side that is not.
    """
    frames = 0
    told: dict[str, dict[str, Any]] = {
        side: {"waits": least > 0, "spent_ms": 0.0} for side in by_side
    }
    while frames < least or any(
        one["waits"] and not patience.over(frames, one["spent_ms"]) for one in told.values()
    ):
        for side in by_side:
            by_side[side].ask(f"warm {frames}")
            told[side] = by_side[side].answer()
        frames += 1
    return frames, {side: one["warning"] for side, one in told.items() if one.get("warning")}
