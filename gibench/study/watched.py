"""Faults that only further frames show: flicker, and how long light takes to follow.

Both are of a technique that has settled. Lights fall to a quarter of their strength and come back;
an object is taken away and put back. Frames are counted from then on: where light is to arrive is
known, as that is where it had settled before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.errors import BadInput, CannotRun
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.faults import (
    HALF,
    LEAST_CHANGE,
    NAN,
    NEARLY,
    NEVER,
    Moments,
    changes,
    flicker,
    frames_until,
    progress,
)
from gibench.progress import progress as progress_bar
from gibench.reference.luminance import luminance
from gibench.scene.colours import Colours
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import IDENTITY, Keyframes
from gibench.techniques.job import Job
from gibench.techniques.object_motion import SCENE, MotionOptions
from gibench.techniques.parts.reach import indirect_light
from gibench.techniques.registry import Follows, TechniqueSpec, find_technique
from gibench.work import Worker

FLICKER_FRAMES = 64
"""Their standard deviation is known to 9 %."""
AWAY_FRAMES = 96
"""Under the other light, or without the object: what follows at all has done most of it."""
FOLLOW_FRAMES = 256
"""At most, until 95 % are there: eight seconds at 30 frames per second."""
DIMMED = 0.25
"""Of the lights' strength."""
_AVERAGED = 8  # frames at the end of those away; noise then hardly counts
_SURELY = 2.0  # times what counts as a change: lamps' light is estimated to some 50 %
_LARGEST = 0.5  # of the scene's diagonal: what is larger is no object to be moved


@dataclass(frozen=True)
class Observed:
    """What further frames showed; nan where it was not looked for or does not apply, inf where
    light did not follow within ``FOLLOW_FRAMES``.

    Attributes:
        flicker_p50: standard deviation over frames of the median receiver, share of its mean.
        flicker_p99: of the receiver that 1 % flicker more than.
        lag_light_half: frames until half of a light that is switched on again is there.
        lag_light_95: until 95 % are.
        lag_object_half: frames until half of what an object that is put back changes is there.
        lag_object_95: until 95 % are.
        lag_light_reason: why no lag of a light can be told, where lights were switched; empty else.
    """

    flicker_p50: float = NAN
    flicker_p99: float = NAN
    lag_light_half: float = NAN
    lag_light_95: float = NAN
    lag_object_half: float = NAN
    lag_object_95: float = NAN
    lag_light_reason: str = ""


@dataclass
class Dial:
    """A scene's dimmer that is turned between frames.

    Attributes:
        level: share of the lights' strength.
    """

    level: float = 1.0

    def share(self, frame: int) -> float:
        """Share of the lights' strength, whatever the frame."""
        return self.level


class Altered(Shared):
    """What ``base`` shares, its scene changed in what no lightmap and no bake depends on."""

    def __init__(self, base: Shared, change: Callable[[Scene], Scene]) -> None:
        super().__init__(base.cache_dir, base.seed, base.executor)
        self._base, self._change = base, change
        self._changed: dict[str, Scene] = {}

    def scene(self, name_or_path: str) -> Scene:
        """The scene, changed (see :meth:`Shared.scene`)."""
        if name_or_path not in self._changed:
            self._changed[name_or_path] = self._change(self._base.scene(name_or_path))
        return self._changed[name_or_path]

    def lightmap(self, name_or_path: str, receivers: int) -> Lightmap:
        """That of ``base``."""
        return self._base.lightmap(name_or_path, receivers)

    def baked(
        self,
        spec: TechniqueSpec,
        settings: object,
        name_or_path: str,
        receivers: int,
        moving: npt.NDArray[np.bool_] | None = None,
    ) -> tuple[Lightmap, object]:
        """That of ``base``."""
        return self._base.baked(spec, settings, name_or_path, receivers, moving)


@dataclass
class Watch:
    """Further frames of a technique under lights that can be dimmed.

    Attributes:
        shared: scenes to open it on.
    """

    shared: Shared
    _dial: Dial = field(default_factory=Dial, repr=False)

    @staticmethod
    def over(base: Shared) -> Watch:
        """Of scenes whose lights stand still."""
        dial = Dial()
        return Watch(Altered(base, lambda scene: replace(scene, dimmer=dial)), dial)

    def observe(self, session: Session, first: int) -> Observed:
        """Flicker and the lag of a light, of a session on ``shared`` that has settled.

        Args:
            session: prepared.
            first: number of the next frame.
        """
        lights = session.world.scene.lights
        most = FLICKER_FRAMES + (AWAY_FRAMES + FOLLOW_FRAMES if lights else 0)
        with progress_bar(f"watching {session.job.technique}", most) as advance:
            frames = _Frames(session, first, advance)
            settled = frames.moments(FLICKER_FRAMES)
            half, nearly, reason = NAN, NAN, ""
            if lights and settled.mean.any():
                self._dial.level = DIMMED
                frames.run(AWAY_FRAMES - _AVERAGED)
                away = frames.moments(_AVERAGED)
                self._dial.level = 1.0
                followed = frames.follow(away, settled)
                if followed is None:
                    area = session.world.lightmap.receivers.area.astype(np.float64)
                    reason = not_told(session.world.scene, settled, area)
                    followed = (NAN, NAN) if reason else (NEVER, NEVER)
                half, nearly = followed
        p50, p99 = flicker(settled)
        return Observed(p50, p99, half, nearly, lag_light_reason=reason)


@dataclass
class _Frames:
    """Frames of a session, one after the other."""

    session: Session
    number: int
    advance: Callable[[int], None]

    def light(self) -> Doubles:
        """Luminance (n,) at the receivers after one more frame."""
        self.run(1)
        return luminance(self.session.irradiance())

    def run(self, count: int) -> None:
        for _ in range(count):
            self.session.frame(self.number)
            self.number += 1
            self.advance(1)

    def moments(self, count: int) -> Moments:
        found = Moments()
        for _ in range(count):
            found.add(self.light())
        return found

    def follow(self, away: Moments, settled: Moments) -> tuple[float, float] | None:
        """Frames from now until light is half and 95 % of the way back to what had settled; None
        where it never was away.
        """
        old, new = away.mean, settled.mean
        area = self.session.world.lightmap.receivers.area.astype(np.float64)
        if not changes(old, new, area, settled.deviation):
            return None
        shares: list[float] = []
        while len(shares) < FOLLOW_FRAMES and (not shares or max(shares) < NEARLY):
            shares.append(progress(self.light(), old, new, area))
        return frames_until(shares, HALF), frames_until(shares, NEARLY)


def not_told(scene: Scene, settled: Moments, area: Doubles) -> str:
    """Why light that did not change with its lamps says nothing of how it follows them: by geometry
    they make too little of it, or less than its own flicker hides. Empty where it should have
    changed.

    Args:
        scene: whose lights were dimmed to ``DIMMED``.
        settled: light (n,) before.
        area: (n,) of the receivers, m2.
    """
    light, of_lamps = indirect_light(scene)
    if not light.any():
        return "by geometry nothing makes any indirect light"
    share = float(of_lamps.sum() / light.sum())
    change = (1 - DIMMED) * float(np.sqrt((of_lamps**2).sum() / (light**2).sum()))
    makes = "makes" if len(scene.lights) == 1 else "make"
    who = f"{_lamps(scene)} {makes} about {100 * share:.2g} %"
    if change < _SURELY * LEAST_CHANGE:
        return f"{who} of the indirect light, too little to see it follow"
    noise = float((area * settled.deviation**2).sum() / (area * settled.mean**2).sum())
    if change < 2 * np.sqrt(2 * noise):
        return f"{who} of the indirect light, less than its flicker hides"
    return ""


def _lamps(scene: Scene) -> str:
    """The lights by kind, as in "2 point lights and 1 directional light"."""
    kinds = [type(light).__name__.removesuffix("Light").lower() for light in scene.lights]
    counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
    return " and ".join(f"{n} {kind} light{'s' * (n > 1)}" for kind, n in counts.items())


def object_lag(
    job: Job, base: Shared, cl_device: object, worker: Worker, frames: int
) -> tuple[float, float]:
    """Frames until half and until 95 % of what an object that is put back changes is there.

    nan where the technique's indirect light does not follow objects or it would have to be baked
    anew, where objects are held in a frame of their motion already, or where no object of the scene
    can be moved or changes the light; inf where it does not follow within ``FOLLOW_FRAMES``.

    Args:
        job: at rest.
        base: scenes whose lights stand still.
        cl_device: where to run.
        worker: who runs it.
        frames: that it takes to settle.

    Raises:
        GibenchError: a pass failed.
    """
    spec = find_technique(job.technique)
    if Follows.INDIRECT_LIGHT not in spec.follows or spec.bakes_what_rests:
        return NAN, NAN
    if job.shot.motion.moves:
        return NAN, NAN
    motions = taken_away(base.scene(job.scene), frames, frames + AWAY_FRAMES)
    if not motions:
        return NAN, NAN
    shared = Altered(base, lambda scene: replace(scene, motions=motions))
    moving = replace(job, shot=replace(job.shot, motion=MotionOptions(SCENE)))
    try:
        session = Session.open(moving, shared, cl_device)
    except CannotRun:  # it fits the profile at rest alone
        return NAN, NAN
    title = f"taking {motions[0].name} away and back, {job.technique}"
    most = frames + AWAY_FRAMES + FOLLOW_FRAMES
    with session, worker.alone(), progress_bar(title, most) as advance:
        session.prepare(whole=True)
        session.compile()
        run = _Frames(session, 0, advance)
        averaged = min(FLICKER_FRAMES, frames)
        run.run(frames - averaged)
        settled = run.moments(averaged)
        run.run(AWAY_FRAMES - _AVERAGED)
        away = run.moments(_AVERAGED)
        return run.follow(away, settled) or (NAN, NAN)


def taken_away(scene: Scene, gone: int, back: int) -> tuple[Keyframes, ...]:
    """Motions that take objects of ``scene`` away in frame ``gone`` and put them back in ``back``:
    those that the scene itself moves, else the one of most surface that is no wall or floor. It
    lies beneath the scene meanwhile. Empty where no object can be moved.
    """
    moving = [one.name for one in scene.motions if not isinstance(one, Colours)]
    names = dict.fromkeys(moving) or _by_surface(scene)
    bottom = float(scene.bounds[0][1])
    moved: list[Keyframes] = []
    for name in names:
        low, high = _bounds(scene, name)
        # Its top, and a tenth of its height to spare, beneath all else.
        down = (0.0, bottom - float(high[1]) - 0.1 * float(high[1] - low[1]) - 1e-3, 0.0)
        rest = (0.0, 0.0, 0.0)
        motion = Keyframes(
            name,
            (gone - 1, gone, back - 1, back),
            (rest, down, down, rest),
            (IDENTITY, IDENTITY, IDENTITY, IDENTITY),
        )
        try:
            MovingObjects.of(scene, (motion,))
        except BadInput:  # it shares vertices with another
            continue
        moved.append(motion)
        if not moving:
            break
    return tuple(moved)


def _by_surface(scene: Scene) -> list[str]:
    """Names of objects that are small enough to be moved, the one of most surface first."""
    diagonal = float(np.linalg.norm(scene.bounds[1] - scene.bounds[0]))
    edges = scene.corners[:, 1:].astype(np.float64) - scene.corners[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    found = {}
    for name in dict.fromkeys(filter(None, scene.object_names)):
        mine = _triangles(scene, name)
        if not mine.any():
            continue
        low, high = _bounds(scene, name)
        if float(np.linalg.norm(high - low)) <= _LARGEST * diagonal:
            found[name] = float(areas[mine].sum())
    return sorted(found, key=lambda name: -found[name])


def _bounds(scene: Scene, name: str) -> tuple[Doubles, Doubles]:
    corners = scene.corners[_triangles(scene, name)].reshape(-1, 3).astype(np.float64)
    return corners.min(axis=0), corners.max(axis=0)


def _triangles(scene: Scene, name: str) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    names = scene.object_names
    mine = [i for i, one in enumerate(names) if one == name]
    return np.asarray(np.isin(scene.object_ids, mine), np.bool_)
