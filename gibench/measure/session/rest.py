"""Frames that are run until a technique is at rest, by what it says itself between them."""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass

from gibench.measure.plan.stopping import Patience
from gibench.measure.runfolder.results import AT_REST
from gibench.measure.session.session import Session
from gibench.techniques.job import World
from gibench.techniques.registry import TechniqueSpec, Wakes, find_technique
from gibench.techniques.technique import LOOK_EVERY, KnowsItsRest


@dataclass
class RestWatch:
    """Looks at a session every ``LOOK_EVERY`` frames until its technique is at rest.

    A look reads from the device between frames, so that no frame's time has any of it.

    Attributes:
        session: what is watched.
        never: what keeps it from ever being at rest, in words; empty where nothing does.
        frames: run while it was watched.
        spent_ms: wall time of them together, looks left out.
        frames_to_rest: after so many it was found at rest; None as long as it was not.
        ms_to_rest: wall time of those, ms.
        woken_after: frames after which it was found not to be at rest any more, if ever.
    """

    session: Session
    never: str = ""
    frames: int = 0
    spent_ms: float = 0.0
    frames_to_rest: int | None = None
    ms_to_rest: float | None = None
    woken_after: int | None = None

    @staticmethod
    def over(session: Session, aside: Set[Wakes] = frozenset()) -> RestWatch:
        """Watch ``session``, of which no frame was run yet: what keeps nothing from frame to frame
        is at rest now.

        Args:
            session: prepared.
            aside: what moves in other frames than those that are run meanwhile.
        """
        spec = find_technique(session.job.technique)
        watch = RestWatch(session, kept_awake(spec, session.world, aside))
        watch._look()
        return watch

    @property
    def waits(self) -> bool:
        """Whether it may come to rest, and has not yet."""
        return self._may and self.frames_to_rest is None

    @property
    def waited(self) -> int | None:
        """Frames that it took to be at rest: 0 where it is not waited for, None while it is."""
        return None if self.waits else self.frames_to_rest or 0

    def ran(self, wall_ms: float) -> None:
        """Take note of a frame, and look where it is time to."""
        self.frames += 1
        self.spent_ms += wall_ms
        if self.frames % LOOK_EVERY == 0:
            self._look()

    def look_again(self, frames: int) -> None:
        """Find out after ``frames`` whether it has stayed at rest."""
        technique = self.session.technique
        rested = self._may and self.frames_to_rest is not None
        if rested and isinstance(technique, KnowsItsRest) and not technique.at_rest():
            self.woken_after = frames

    def in_words(self) -> str:
        """What a row says of it: empty where a technique does not tell."""
        if not isinstance(self.session.technique, KnowsItsRest):
            return ""
        if self.never:
            return f"never at rest: {self.never}"
        if self.woken_after is not None:
            return f"not at rest any more after {self.woken_after} frames"
        if self.waits:
            return f"not at rest after {self.frames} frames"
        return AT_REST

    def warning(self) -> str:
        """The same where a reader must know: frames were timed that are not those at rest."""
        return self.in_words() if self.waits or self.woken_after is not None else ""

    @property
    def _may(self) -> bool:
        told = isinstance(self.session.technique, KnowsItsRest)
        whole = all(item.status == "ok" for item in self.session.prepared)
        return told and whole and not self.never

    def _look(self) -> None:
        technique = self.session.technique
        if self.waits and isinstance(technique, KnowsItsRest) and technique.at_rest():
            self.frames_to_rest, self.ms_to_rest = self.frames, self.spent_ms


def kept_awake(spec: TechniqueSpec, world: World, aside: Set[Wakes] = frozenset()) -> str:
    """What of ``world``, but for ``aside``, moves that keeps ``spec`` from ever being at rest, in
    words; empty where nothing does.
    """
    motion = None if world.motion is None or world.motion.held is not None else world.motion
    moving = {
        Wakes.CAMERA: world.flight is not None,
        Wakes.OBJECTS: motion is not None and motion.moves,
        Wakes.LIGHTS: world.scene.lights_move
        or (motion is not None and motion.materials is not None),
    }
    waking = spec.woken_by - aside
    return " and ".join(one.value for one in Wakes if moving[one] and one in waking)


def warm_up(
    session: Session,
    least: int,
    patience: Patience,
    number_of: Callable[[int], int] = lambda frame: frame,
    aside: Set[Wakes] = frozenset(),
) -> RestWatch:
    """Run ``least`` frames of ``session``, and on until it is at rest or ``patience`` is over.

    Args:
        session: prepared, of which no frame was run yet.
        least: frames at least.
        patience: how long it is waited for.
        number_of: the number a frame is run with, by how many were run before.
        aside: what moves only in frames of other numbers.
    """
    watch = RestWatch.over(session, aside)
    while watch.frames < least or (watch.waits and not patience.over(watch.frames, watch.spent_ms)):
        watch.ran(session.frame(number_of(watch.frames)).wall_ms)
    return watch
