"""Where the paths of the path tracer start: on receivers, at the camera, along given rays."""

from __future__ import annotations

from dataclasses import dataclass

from gibench.arrays import Doubles
from gibench.reference.packed import PackedFragments


@dataclass(frozen=True)
class ReceiverStart:
    """Paths start on the receivers and estimate indirect irradiance over pi."""

    fragments: PackedFragments

    @property
    def owners(self) -> int:
        """Number of receivers."""
        return len(self.fragments.start) - 1


@dataclass(frozen=True)
class CameraStart:
    """Paths start at the camera and estimate radiance.

    Attributes:
        plane: (4, 3), see :func:`gibench.reference.camera.image_plane`.
        width: pixels.
        height: pixels.
        indirect_only: leave out emission seen directly and light straight from delta lights.
        plain: take albedo 1 at the visible surface: irradiance over pi.
    """

    plane: Doubles
    width: int
    height: int
    indirect_only: bool
    plain: bool

    @property
    def owners(self) -> int:
        """Number of pixels."""
        return self.width * self.height


@dataclass(frozen=True)
class RayStart:
    """Paths start along given rays, one each, and estimate the radiance that comes back.

    Attributes:
        origins: (n, 3) m, off the surface that they leave.
        directions: (n, 3) unit.
    """

    origins: Doubles
    directions: Doubles

    @property
    def owners(self) -> int:
        """Number of rays."""
        return len(self.origins)
