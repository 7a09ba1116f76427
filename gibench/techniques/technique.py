"""What a technique is: baked once, then an ordered list of passes every frame.

A pass is declared once: its name, its launches (kernel, size, arguments) and its work. The same
name is kernel file label, timer label, table row and picture title. Nothing here measures: the
frame loop (``gibench.measure``) enqueues the launches and reads their events.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from gibench.device import Device, Launch

FloatArray = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Work:
    """The least a pass must do in one frame, counted from its sizes, not from its code.

    Attributes:
        flops: floating-point operations (a fused multiply-add is two).
        bytes_read: bytes that must come from global memory, each counted once.
        bytes_written: bytes that must go to global memory.
        rays: rays traced through the scene.
        atomics: atomic operations on global memory.
    """

    flops: float = 0.0
    bytes_read: float = 0.0
    bytes_written: float = 0.0
    rays: float = 0.0
    atomics: float = 0.0


LOOK_EVERY: Final = 8
"""Frames from one look of the harness at :class:`KnowsItsRest` to the next."""

Stage = Literal["camera", "geometry", "gi"]
"""What of a frame a pass belongs to (see the constants)."""
CAMERA: Final = "camera"
"""The camera's rays and the direct light on what they hit."""
GEOMETRY: Final = "geometry"
"""What puts the scene's objects in their place."""
GI: Final = "gi"
"""Indirect light, its lookup at the pixels too: what the technique costs."""


@dataclass
class Pass:
    """One pass of a frame: a row of the table.

    Attributes:
        name: the field's name for it, in snake_case.
        launches: what is enqueued, in order. Built by a function, so that a pass whose program
            cannot be built or whose sizes do not fit fails alone.
        work: the least it must do per frame, as far as that is known before any frame.
        counted: its work in the frame that was run last, where only a frame can tell: asked with a
            work-group size once all frames are run and their images taken, outside all timing. May
            overwrite the image and whatever the next frame makes anew.
        stage: what of the frame it belongs to.
    """

    name: str
    launches: Callable[[], Sequence[Launch]]
    work: Work = field(default_factory=Work)
    counted: Callable[[int], Work] | None = None
    stage: Stage = GI


@runtime_checkable
class Technique(Protocol):
    """A technique set up on a device for one scene and one configuration.

    Attributes:
        name: its name on the command line and in tables.
        device: where it runs.
    """

    name: ClassVar[str]
    device: Device

    def passes(self) -> Sequence[Pass]:
        """Its own passes of a frame, in order; those that move a scene's objects come before them
        (:func:`gibench.techniques.parts.frame_passes.frame_passes`).
        """
        ...

    def begin_frame(self, frame: int) -> None:
        """Upload what changes with the frame; called before the passes are enqueued."""
        ...

    def images(self) -> dict[str, FloatArray]:
        """Linear radiance images (h, w, 3) of the last frame by title, for ``--save-images``."""
        ...

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers in W/m2, in the lightmap's order."""
        ...

    def counts(self) -> dict[str, int]:
        """Sizes for the tables: probes, receivers, surfels; those that apply."""
        ...


@runtime_checkable
class HasNotes(Protocol):
    """A technique that has something to say for the report."""

    def notes(self) -> list[str]:
        """Facts that belong beside this configuration's figures, as phrases without a full stop."""
        ...


@runtime_checkable
class KnowsItsCover(Protocol):
    """A technique that may have nothing to say of a receiver, and calls it black."""

    def covered(self) -> npt.NDArray[np.bool_]:
        """Which receivers (n,) the last frame's ``indirect_irradiance`` speaks of."""
        ...


@runtime_checkable
class KnowsItsRest(Protocol):
    """A technique that says when it has become what it stays: filled, gathered, at its own cost.

    Of one that does not, times are taken once they have settled. What that moves keeps it from ever
    being at rest its ``SPEC`` says (``woken_by``).
    """

    def at_rest(self) -> bool:
        """Whether it is at rest, by what the last frame left on the device and by what it was when
        this was asked before: first when no frame has run, then every ``LOOK_EVERY`` frames until
        it is, and once more after the last frame. Asked between frames, outside all timing; changes
        nothing on the device. The docstring of each defines its figures and says their source.
        """
        ...
