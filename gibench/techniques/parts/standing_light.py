"""Whether the light that a technique keeps stands still. No I/O here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass
class StandingLight:
    """Compares all of the light as it is now with what it was before.

    Attributes:
        most: root mean square change, as a share of the light, that counts as none.
    """

    most: float
    _before: npt.NDArray[Any] | None = field(default=None, repr=False)

    def takes(self, now: npt.NDArray[Any]) -> bool:
        """Take the light as it is now, any shape, and tell whether it stands still; it does not
        where nothing was taken before.
        """
        before, self._before = self._before, now
        if before is None:
            return False
        wide = now.astype(np.float64)
        change = float(np.linalg.norm(wide - before))
        return change <= self.most * float(np.linalg.norm(wide))
