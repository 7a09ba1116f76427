"""Which frame of the scene a frame shows. No device is involved."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Clock:
    """Tells where lights, camera and objects are in a frame.

    It is held while a technique is waited for until it rests, so that configurations whose wait
    differs show the same frames of the scene after it. What is drawn by chance goes by the number
    of the frame, which runs on meanwhile.

    Attributes:
        begun: number of the frame that shows the scene's frame 0; None while it is held there.
    """

    begun: int | None = 0

    def hold(self) -> None:
        """Show the scene's frame 0 until :meth:`begin`."""
        self.begun = None

    def begin(self, frame: int) -> None:
        """Show the scene's frame 0 in ``frame``, and run on from there."""
        self.begun = frame

    def shows(self, frame: int) -> int:
        """The scene's frame that ``frame`` shows."""
        return 0 if self.begun is None else max(frame - self.begun, 0)
