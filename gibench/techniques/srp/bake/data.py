"""What the SRP bake hands to the frame: probes, relight samples, compressed transport."""

from __future__ import annotations

from dataclasses import dataclass, field

from gibench.arrays import Floats, Ints

MAX_SH_ORDER = 7
MAX_RECEIVER_ORDER = 1


def sh_count(order: int) -> int:
    """Coefficients of spherical harmonics up to ``order``: (order + 1)^2."""
    return (order + 1) ** 2


@dataclass(frozen=True)
class ProbeSet:
    """The probes.

    Attributes:
        positions: (p, 3) float32, m.
        radius: support radius of every probe, m.
        sky: whether the last one stands for the sky (:mod:`gibench.techniques.srp.bake.sky`); its
            position means nothing.
    """

    positions: Floats = field(repr=False)
    radius: float
    sky: bool = False

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def placed(self) -> ProbeSet:
        """Those that lie somewhere: without the sky."""
        return ProbeSet(self.positions[:-1], self.radius) if self.sky else self


@dataclass(frozen=True)
class RelightSamples:
    """The fixed relight rays, one set of stratified directions shared by all probes.

    Attributes:
        directions: (s, 3) float32 unit.
        basis: (s, c) float32: SH basis in the sample's direction times 4 pi / s, index
            j = l (l + 1) + m.
        texel: (p, s) int32: flat lightmap texel the ray hits; -1 where it escapes to the
            environment; -2 where it hits a back face or a surface without a texel (black).
    """

    directions: Floats = field(repr=False)
    basis: Floats = field(repr=False)
    texel: Ints = field(repr=False)


@dataclass(frozen=True)
class Cluster:
    """One CPCA cluster: transport rows of its receivers as reconstruction @ projection.

    A receiver has a row for every component of its light (:class:`SrpBake`), one after the other.

    Attributes:
        receivers: (m,) int32 receiver indices; at most 1024 rows.
        probes: (k,) int32 probes that matter to any of them, ascending; the stored columns are
            these probes' blocks of c coefficients.
        projection: (n, k * c) float32, Sigma V^T; n is 0 when the whole cluster is dark.
        reconstruction: (m * components, n) float32, U.
        error: relative Frobenius error of the coefficients, of dropped probes and truncation.
    """

    receivers: Ints = field(repr=False)
    probes: Ints = field(repr=False)
    projection: Floats = field(repr=False)
    reconstruction: Floats = field(repr=False)
    error: float


@dataclass(frozen=True)
class SrpBake:
    """All that SRP computes ahead.

    The light at a receiver is irradiance at its own normal, W/m2, where its order is 0. Where it is
    1 it has four components: irradiance at the receiver's normal n as order 1 tells it, and a
    vector g, W/m2, of which any other normal m makes irradiance + g (m - n). These are radiance in
    spherical harmonics of order 1 (Silvennoinen and Lehtinen 2017, equation 8) convolved with the
    clamped cosine by the constants pi and 2 pi / 3 (Ramamoorthi and Hanrahan 2001): a quarter of
    the integral of radiance, plus half of the integral of radiance times direction along m.

    Attributes:
        sh_order: order of the probes' spherical harmonics.
        probes: the probes.
        relight: their relight samples.
        clusters: the clusters; together they hold every receiver exactly once.
        usable_share: share of receivers within reach of at least one probe they can use.
        overlap: mean number of probes that reach a receiver.
        receiver_order: order of the light at the receivers, 0 or 1.
    """

    sh_order: int
    probes: ProbeSet
    relight: RelightSamples
    clusters: tuple[Cluster, ...] = field(repr=False)
    usable_share: float
    overlap: float
    receiver_order: int = 0

    @property
    def coefficients(self) -> int:
        """SH coefficients per probe."""
        return sh_count(self.sh_order)

    @property
    def components(self) -> int:
        """Of the light at a receiver."""
        return sh_count(self.receiver_order)

    def transport_bytes(self, bytes_per_value: int) -> int:
        """Size of the projection and reconstruction matrices at a storage width."""
        return bytes_per_value * sum(
            c.projection.size + c.reconstruction.size for c in self.clusters
        )
