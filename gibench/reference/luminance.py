"""How bright a colour is."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles

# Rec. 709 luminance of linear RGB (ITU-R BT.709-6, item 3.2).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def luminance(rgb: npt.NDArray[Any]) -> Doubles:
    """Rec. 709 luminance (...) of linear RGB (..., 3)."""
    return np.asarray(np.asarray(rgb, np.float64) @ LUMINANCE)
