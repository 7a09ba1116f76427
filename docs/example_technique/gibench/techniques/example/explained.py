"""Where kernels do more than the work that passes declare: bounds of what Oclgrind counts over what
is declared, and why (tests/device/test_declared_work.py)."""

from __future__ import annotations

from typing import Final

# (variant or "", pass, quantity): least, most, why.
EXPLAINED: Final[dict[tuple[str, str, str], tuple[float, float, str]]] = {
    ("", "application", "flops"): (
        *(1.2, 1.6),
        "the direction to each pixel is computed, which this lookup does not need",
    ),
    ("", "application", "bytes_read"): (
        *(7.0, 10.0),
        "what all share counts for each pixel: the triangle's corners, the volume, the probes",
    ),
}
