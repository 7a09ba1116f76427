"""A share of what is to be measured, for those who have no cluster engine: one of a Slurm array."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from gibench.errors import BadInput
from gibench.measure.plan.grid import job_label
from gibench.techniques.job import Job

T = TypeVar("T")


@dataclass(frozen=True)
class Shard:
    """One of several shares of neighbours, which together are the whole: neighbours share bakes.

    Attributes:
        index: which, counted from 1.
        of: how many there are.
    """

    index: int
    of: int

    @staticmethod
    def parse(text: str | None) -> Shard | None:
        """The shard that ``3/16`` is; None for None.

        Raises:
            BadInput: it is none.
        """
        if text is None:
            return None
        match = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text)
        if match is None or not 1 <= int(match[1]) <= int(match[2]):
            raise BadInput(
                f"'{text}' is no shard", where="--shard", mend="give for instance 1/4, up to 4/4"
            )
        return Shard(int(match[1]), int(match[2]))

    def positions(self, total: int) -> range:
        """Of ``total`` things those of this shard, counted from 0.

        Raises:
            BadInput: nothing is left for some shard.
        """
        if total < self.of:
            raise BadInput(
                f"{total} {'thing' if total == 1 else 'things'} cannot be shared by {self.of}",
                where="--shard",
                mend=f"divide by {total} at most",
            )
        return range((self.index - 1) * total // self.of, self.index * total // self.of)

    def share(self, whole: Sequence[T]) -> list[T]:
        """Of ``whole`` what is this shard's.

        Raises:
            BadInput: nothing is left for some shard.
        """
        return [whole[position] for position in self.positions(len(whole))]

    def record(self, labels: Sequence[str], **more: Any) -> dict[str, Any]:
        """For the record: by this ``merge`` tells what belongs together.

        Args:
            labels: of all that is shared, in order.
            more: what joining needs to know beside it.
        """
        positions = self.positions(len(labels))
        whole = hashlib.sha256("\n".join(labels).encode()).hexdigest()
        return {
            "index": self.index,
            "of": self.of,
            "total": len(labels),
            "first": positions.start + 1,
            "last": positions.stop,
            "whole": whole[:32],
            **more,
        }


def labels_of(jobs: Sequence[Job]) -> list[str]:
    """What tells a job from others wherever its scene's file lies."""
    return [
        f"{job_label(job, Path(job.scene).name)} {job.receivers} {job.seed} {job.settings!r}"
        for job in jobs
    ]
