"""A camera's flight through a scene: it drives where surfels are placed and recycled."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from gibench.errors import BadInput
from gibench.scene.model import Camera, Scene
from gibench.techniques.gibs.look_around import FLIGHT_FOV, keyframes
from gibench.techniques.gibs.settings import FLIGHT, REST


@dataclass(frozen=True)
class CameraPath:
    """A camera's keyframes, evenly spaced in time, joined by monotone cubics (PCHIP), which never
    overshoot a keyframe and so never swing through a wall that the keyframes keep clear of.

    Attributes:
        positions: (k, 3) m, k at least 2.
        targets: (k, 3) m, the points looked at.
        fov_degrees: least vertical field of view on the way; None for the camera's own.
    """

    positions: npt.NDArray[np.float64] = field(repr=False)
    targets: npt.NDArray[np.float64] = field(repr=False)
    fov_degrees: float | None = None

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

    def at(self, share: float, camera: Camera) -> Camera:
        """``camera`` moved to ``share`` in [0, 1] of the path."""
        times = np.linspace(0.0, 1.0, len(self.positions))
        position, target = (
            tuple(float(v) for v in PchipInterpolator(times, points)(share))
            for points in (self.positions, self.targets)
        )
        x, y, z = position
        tx, ty, tz = target
        fov = max(camera.fov_degrees, self.fov_degrees or 0.0)
        return replace(camera, position=(x, y, z), target=(tx, ty, tz), fov_degrees=fov)


def built_in_flight(scene: Scene, camera: Camera) -> CameraPath:
    """From ``camera`` through the inside of the scene's bounds, past views that together show what
    it does not (see :mod:`gibench.techniques.gibs.look_around`), and back.
    """
    positions, targets = keyframes(scene, camera)
    return CameraPath(
        np.array([camera.position, *positions, camera.position]),
        np.array([camera.target, *targets, camera.target]),
        FLIGHT_FOV,
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


def camera_path(setting: str, scene: Scene, camera: Camera) -> CameraPath | None:
    """The path that the setting ``camera_path`` names; None for a camera at rest.

    Raises:
        BadInput: it names a file that is not a path.
    """
    if setting == REST:
        return None
    if setting == FLIGHT:
        return built_in_flight(scene, camera)
    return load_camera_path(Path(setting))


def camera_in(
    frame: int, camera: Camera, path: CameraPath | None, rest_frames: int, flight_frames: int
) -> Camera:
    """The camera in ``frame``: ``rest_frames`` at rest, then the flight, then at rest again."""
    if path is None or not rest_frames <= frame < rest_frames + flight_frames:
        return camera
    return path.at((frame - rest_frames) / max(flight_frames - 1, 1), camera)
