"""Standard errors of path-traced means, made fit to be compared with."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def pooled(stderr: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Standard errors (..., 3), none below the root mean square of all of a channel.

    Each comes from some eight rounds, and so is itself uncertain by a quarter: of hundreds one is
    by chance a third of what it should be, and a deviation looks three times as rare as it is.
    """
    every = tuple(range(stderr.ndim - 1))
    return np.maximum(stderr, np.sqrt((stderr**2).mean(axis=every)))
