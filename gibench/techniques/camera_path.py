"""A camera's flight through a scene, the same for every technique that runs."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Vec3
from gibench.errors import BadInput
from gibench.scene.model import Camera, Scene
from gibench.techniques.look_around import FLIGHT_FOV, keyframes

REST: Final = "rest"
FLIGHT: Final = "flight"
AROUND: Final = "around"
BUILT_IN: Final = (REST, FLIGHT, AROUND)
"""Paths that are no files."""
_VIEWS: Final = 12  # of one turn around a scene
_AWAY: Final = 1.8  # from its middle, in half diagonals of its floor


@dataclass(frozen=True)
class CameraPath:
    """A camera's keyframes, evenly spaced in time, joined by monotone cubics (PCHIP), which never
    overshoot a keyframe and so never swing through a wall that the keyframes keep clear of.

    Attributes:
        positions: (k, 3) m, k at least 2.
        targets: (k, 3) m, the points looked at.
        fov_degrees: (k,) least vertical field of view; None for the camera's own.
    """

    positions: npt.NDArray[np.float64] = field(repr=False)
    targets: npt.NDArray[np.float64] = field(repr=False)
    fov_degrees: npt.NDArray[np.float64] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.positions.ndim != 2 or self.positions.shape[1] != 3 or len(self.positions) < 2:
            raise BadInput(
                f"a camera path with {len(self.positions)} point(s)",
                mend="give at least two positions of three numbers each",
            )
        if self.targets.shape != self.positions.shape:
            raise BadInput(
                f"a camera path with {len(self.positions)} positions and "
                f"{len(self.targets)} targets",
                mend="give one target of three numbers for every position",
            )
        if not (np.isfinite(self.positions).all() and np.isfinite(self.targets).all()):
            raise BadInput("a camera path with a number that is not finite")
        if (blind := np.flatnonzero((self.positions == self.targets).all(axis=1))).size:
            raise BadInput(
                f"a camera path that looks at where it is in its point {blind[0] + 1}",
                mend="move the target away from the position",
            )

    def seen_from(self, origin: Vec3) -> CameraPath:
        """The path in a space whose origin is at ``origin`` in the path's own."""
        if not any(origin):
            return self
        shift = np.asarray(origin)
        return replace(self, positions=self.positions - shift, targets=self.targets - shift)

    def at(self, share: float, camera: Camera) -> Camera:
        """``camera`` moved to ``share`` in [0, 1] of the path."""
        from scipy.interpolate import PchipInterpolator  # slow to load

        times = np.linspace(0.0, 1.0, len(self.positions))
        position, target = (
            tuple(float(v) for v in PchipInterpolator(times, points)(share))
            for points in (self.positions, self.targets)
        )
        x, y, z = position
        tx, ty, tz = target
        fov = camera.fov_degrees
        if self.fov_degrees is not None:
            fov = max(fov, float(PchipInterpolator(times, self.fov_degrees)(share)))
        return replace(camera, position=(x, y, z), target=(tx, ty, tz), fov_degrees=fov)


def built_in_flight(scene: Scene, camera: Camera) -> CameraPath:
    """From ``camera`` through the inside of the scene's bounds, past views that together show what
    it does not (see :mod:`gibench.techniques.look_around`), and back.
    """
    positions, targets = keyframes(scene, camera)
    return CameraPath(
        np.array([camera.position, *positions, camera.position]),
        np.array([camera.target, *targets, camera.target]),
        np.array([camera.fov_degrees, *[FLIGHT_FOV] * len(positions), camera.fov_degrees]),
    )


def around(scene: Scene, camera: Camera) -> CameraPath:
    """From ``camera`` out of the scene, once around it at the height of its middle, once around it
    from above, and back: what a flight through its inside does not show.
    """
    low, high = (bound.astype(np.float64) for bound in scene.bounds)
    middle, half = (low + high) / 2, (high - low) / 2
    away = _AWAY * max(float(np.hypot(half[0], half[2])), float(half[1]))
    angle = 2 * np.pi * np.arange(_VIEWS + 1) / _VIEWS
    ring = away * np.stack([np.cos(angle), np.zeros(len(angle)), np.sin(angle)], axis=1)
    level, above = (middle + ring + (0.0, up, 0.0) for up in (0.2 * half[1], away))
    looked_at = np.broadcast_to(middle, (2 * len(angle), 3))
    return CameraPath(
        np.array([camera.position, *level, *above, camera.position]),
        np.array([camera.target, *looked_at, camera.target]),
    )


def load_camera_path(path: Path) -> CameraPath:
    """The path in a TOML file with ``positions`` and ``targets``, lists of [x, y, z] in metres.

    Raises:
        BadInput: the file cannot be read, or is not a path.
    """
    try:
        table: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadInput(f"no camera path can be read from it ({error})", where=path) from error
    if missing := sorted({"positions", "targets"} - set(table)):
        raise BadInput(f"a camera path without {missing[0]}", where=path)
    try:
        points = [np.array(table[key], np.float64) for key in ("positions", "targets")]
    except (TypeError, ValueError) as error:
        raise BadInput(
            "positions and targets are not lists of three numbers each", where=path
        ) from error
    try:
        return CameraPath(points[0], points[1])
    except BadInput as error:
        raise BadInput(error.what, where=path, mend=error.mend) from error


@dataclass(frozen=True)
class Flight:
    """A camera's flight in a run: at rest, along its path, at rest again.

    Attributes:
        path: what is flown.
        rest_frames: at rest before it.
        flight_frames: it takes.
    """

    path: CameraPath
    rest_frames: int
    flight_frames: int

    def camera_in(self, frame: int, camera: Camera) -> Camera:
        """Where ``camera``, which is where it rests, is in ``frame``."""
        if not self.rest_frames <= frame < self.rest_frames + self.flight_frames:
            return camera
        return self.path.at((frame - self.rest_frames) / max(self.flight_frames - 1, 1), camera)


@dataclass(frozen=True)
class FlightOptions:
    """Which flight drives the camera: the same for every technique of a run.

    Attributes:
        path: ``rest``; ``flight`` and ``around``, built in for every scene; or a TOML file of
            positions and targets.
        rest_frames: at rest before the flight; after it the camera rests again.
        flight_frames: of the flight.

    Raises:
        BadInput: a number makes no sense.
    """

    path: str = REST
    rest_frames: int = 60
    flight_frames: int = 240

    def __post_init__(self) -> None:
        if self.rest_frames < 0 or self.flight_frames < 1:
            raise BadInput(
                f"a flight of {self.flight_frames} frames after {self.rest_frames} at rest",
                mend="give 1 or more frames of flight, and 0 or more at rest",
            )

    @property
    def frames(self) -> int:
        """Until the camera has come back to rest; 0 where it never leaves."""
        return 0 if self.path == REST else self.rest_frames + self.flight_frames

    def check(self) -> None:
        """Check a path's file before any long work.

        Raises:
            BadInput: it holds none.
        """
        if self.path not in BUILT_IN:
            load_camera_path(Path(self.path))

    def of(self, scene: Scene, camera: Camera) -> Flight | None:
        """The flight from ``camera`` through ``scene``; None for a camera at rest.

        Raises:
            BadInput: the path is a file that holds none.
        """
        if self.path == REST:
            return None
        if self.path == FLIGHT:
            path = built_in_flight(scene, camera)
        elif self.path == AROUND:
            path = around(scene, camera)
        else:
            path = load_camera_path(Path(self.path)).seen_from(scene.origin)
        return Flight(path, self.rest_frames, self.flight_frames)
