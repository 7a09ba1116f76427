"""SRP's light in float64 on the host, step by step, so that a step can be replaced by another.

What the kernels of a frame compute (Silvennoinen and Lehtinen 2017, section 4.2): the probes take
in what the receivers send out, receivers take it from the probes, and what they reflect of it is
sent out in the next frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import pi

import numpy as np

from gibench.arrays import Doubles, Floats, Ints
from gibench.scene.environment import Environment
from gibench.scene.lightmap import Lightmap
from gibench.techniques.srp.bake.data import Cluster, RelightSamples
from gibench.techniques.srp.bake.relight import ESCAPED
from gibench.techniques.srp.bake.transport_rows import TransportRows

# Bounces until the rest is lost in float32: at an albedo of 0.9 the last is 1e-6 of the first.
MOST_BOUNCES = 128
SETTLED = 1e-6


def probe_radiance(
    relight: RelightSamples, lightmap: Lightmap, sent: Doubles, environment: Environment
) -> Doubles:
    """The probes' SH coefficients (p, c, 3), W/m2/sr.

    Args:
        relight: the probes' samples.
        lightmap: whose texels they hit.
        sent: (n, 3) radiance that the receivers send out, W/m2/sr.
        environment: where samples escape to.
    """
    sky = np.asarray(environment.radiance(relight.directions), np.float64)
    receiver = np.where(
        relight.texel >= 0, lightmap.receiver_of_texel[np.maximum(relight.texel, 0)], -1
    )
    basis = relight.basis.astype(np.float64)
    found = np.empty((len(receiver), basis.shape[1], 3))
    for own, texel, out in zip(receiver, relight.texel, found, strict=True):
        seen = np.where(own[:, None] >= 0, sent[np.maximum(own, 0)], 0.0)
        seen[texel == ESCAPED] = sky[texel == ESCAPED]
        out[:] = basis.T @ seen
    return found


def from_clusters(clusters: Iterable[Cluster], light: Doubles, receivers: int) -> Doubles:
    """Irradiance (n, 3) of compressed transport of order 0 under ``light`` (p, c, 3), W/m2."""
    found = np.zeros((receivers, 3))
    for cluster in clusters:
        if len(cluster.projection):
            own = light[cluster.probes].reshape(-1, 3)
            basis = cluster.projection.astype(np.float64) @ own
            found[cluster.receivers] = cluster.reconstruction.astype(np.float64) @ basis
    return found


def from_rows(
    rows: Iterable[tuple[Ints, TransportRows]], light: Doubles, receivers: int
) -> Doubles:
    """Irradiance (n, 3) of transport as it was before compression, W/m2."""
    found = np.zeros((receivers, 3))
    for members, own in rows:
        found[members] = own.matrix @ light[own.probes].reshape(-1, 3)
    return found


def settled(
    gather: Callable[[Doubles], Doubles], sent: Doubles, albedo: Floats, bounces: bool
) -> Doubles:
    """Irradiance (n, 3), W/m2, once the bounces have come together.

    Args:
        gather: irradiance of what receivers send out, (n, 3) to (n, 3).
        sent: what they send out without any indirect light, W/m2/sr.
        albedo: (n, 3) of the receivers.
        bounces: whether they reflect indirect light, too.
    """
    irradiance = gather(sent)
    for _ in range(MOST_BOUNCES if bounces else 0):
        before, irradiance = irradiance, gather(sent + albedo / pi * irradiance)
        if np.abs(irradiance - before).max() <= SETTLED * np.abs(irradiance).max():
            break
    return irradiance
