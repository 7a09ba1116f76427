"""The sky apart from the probes: one more of them, which sees nothing else and lies nowhere.

A probe's spherical harmonics blur a bright sky over the walls before it, and receivers take that
for the walls' own light. With ``sky=receivers`` the probes are black where they see the sky; one
more, whose relight rays all escape, holds the environment, and a receiver's rays that escape take
from it alone. What a receiver stores of it is its own visibility of the sky in spherical harmonics
(Sloan et al. 2002). To all that comes after it is a probe like the others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.techniques.srp.bake.data import ProbeSet, RelightSamples
from gibench.techniques.srp.bake.relight import BLACK, ESCAPED
from gibench.techniques.srp.bake.visibility import HIDDEN, VISIBLE, VisibilityTables
from gibench.techniques.srp.bake.weights import Nearby


def with_sky(probes: ProbeSet) -> ProbeSet:
    """``probes`` and the sky, which is put in their middle."""
    middle = probes.positions.mean(axis=0, keepdims=True)
    return ProbeSet(np.concatenate([probes.positions, middle]), probes.radius, sky=True)


def sky_apart(relight: RelightSamples) -> RelightSamples:
    """``relight`` of probes that are black where they saw the sky, and of the sky."""
    texel = np.where(relight.texel == ESCAPED, BLACK, relight.texel)
    sky = np.full((1, texel.shape[1]), ESCAPED)
    return replace(relight, texel=np.concatenate([texel, sky]).astype(np.int32))


def tables_with_sky(tables: VisibilityTables) -> VisibilityTables:
    """``tables`` with a column for the sky; :func:`settle_sky` says what holds for it."""
    return VisibilityTables(tables.grid, np.pad(tables.states, ((0, 0), (0, 1))))


def settle_sky(
    states: npt.NDArray[np.uint8], pairs: Nearby, sky: int, triangle: Ints, directions: Floats
) -> None:
    """Write into ``states`` (q, s) what the sky gives: rays that escape, and these alone.

    Args:
        states: mutual visibility of pairs and rays.
        pairs: of receivers and probes.
        sky: the probe that stands for it.
        triangle: (m, s) that the receivers' rays meet, -1 for none.
        directions: (m, s, 3) of the rays, zero for those that start into their own surface.
    """
    escaped = triangle < 0
    usable = escaped & (np.einsum("msx,msx->ms", directions, directions) > 0.5)
    of_sky = pairs.probe == sky
    states[of_sky] = np.where(usable, VISIBLE, HIDDEN)[pairs.receiver[of_sky]]
    others = np.flatnonzero(~of_sky)
    states[others] = np.where(escaped[pairs.receiver[others]], HIDDEN, states[others])
