"""What the transport's bake makes of receivers: rows of coefficients, and the rays they come of."""

from __future__ import annotations

from typing import NamedTuple

from gibench.arrays import Floats, Ints


class TransportRows(NamedTuple):
    """Uncompressed transport of m receivers.

    Attributes:
        probes: (k,) int32 probes any of them uses, ascending.
        matrix: (m * components, k * c) float32: alpha_ij of the probes' blocks of c coefficients,
            a receiver's components one after the other.
        valid: (m,) int32 valid samples of each receiver; 0 where no probe can be used, or where so
            few are valid that the receiver is left dark (``least_valid``).
    """

    probes: Ints
    matrix: Floats
    valid: Ints


class PrimaryRays(NamedTuple):
    """The primary rays of m receivers, s each: (m, s, 3) float32 origins and directions."""

    origins: Floats
    directions: Floats
