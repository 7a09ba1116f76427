"""What a user may set of an SRP bake."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from gibench.errors import BadInput
from gibench.techniques.srp.bake.data import MAX_SH_ORDER

INTERPOLATIONS = ("srp", "spatial", "visibility")


@dataclass(frozen=True)
class SrpBakeSettings:
    """Settings of an SRP bake.

    Attributes:
        sh_order: order of the probes' spherical harmonics, 0 to 7 (paper: 7).
        probes: how many to place; None takes the scene's own number or positions.
        relight_samples: relight rays per probe (thesis: 1024, paper: 8000).
        transport_rays: primary rays per receiver (thesis: 4096).
        overlap: mean number of probes that reach a receiver (paper: 10).
        cluster_size: most receivers in a cluster (thesis: 1024).
        svd_vectors: most vectors kept of a cluster (paper: 32).
        svd_threshold: error of a leaf's irradiance under expected light, relative to itself; the
            leaf is refined into clusters as small as meet it (paper: 0.005; see
            :func:`gibench.techniques.srp.bake.cpca.compress`). Three samples of 16 to 36 of
            Sponza's 347 leaves under ten single lights each, without bounces: 0.8 % and less
            for nine lights of ten, 1.0 to 1.4 % for the tenth.
        least_valid: share of valid samples below which a receiver counts as having none and stays
            dark. The mean over a handful of samples is noise, of full weight in the compression:
            in Sponza the 3 % of receivers below 1 %, nearly all inside walls, held a fifth of all
            transport's energy.
        visibility: ``cached`` decides most mutual visibility from tables of a few rays per probe
            and texel, and traces what they leave open; ``exact`` traces everything.
        interpolation: of radiance from the probes. ``srp`` reprojects and asks for mutual
            visibility (thesis eq. 4.6); ``spatial`` blends by distance alone, in the receiver's own
            direction (eq. 4.3); ``visibility`` is that from the probes the receiver sees. The
            latter two are there to be compared with.
        workers: clusters in flight at once; None: one per core.
        chunk_rays: primary rays traced at once by one worker; about 60 bytes of memory each.
    """

    sh_order: int = 7
    probes: int | None = None
    relight_samples: int = 1024
    transport_rays: int = 4096
    overlap: float = 10.0
    cluster_size: int = 1024
    svd_vectors: int = 32
    svd_threshold: float = 0.005
    least_valid: float = 0.01
    visibility: Literal["cached", "exact"] = "cached"
    interpolation: Literal["srp", "spatial", "visibility"] = "srp"
    workers: int | None = None
    chunk_rays: int = 1 << 19

    def __post_init__(self) -> None:
        at_least_one = (
            "relight_samples", "transport_rays", "cluster_size", "svd_vectors", "chunk_rays",
        )  # fmt: skip
        for name in at_least_one:
            if getattr(self, name) < 1:
                raise BadInput(f"{name} is {getattr(self, name)}", mend="use 1 or more")
        for name in ("probes", "workers"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise BadInput(f"{name} is {value}", mend="use 1 or more")
        if not 0 <= self.sh_order <= MAX_SH_ORDER:
            raise BadInput(f"sh_order is {self.sh_order}", mend=f"use 0 to {MAX_SH_ORDER}")
        if not self.overlap > 0:
            raise BadInput(f"overlap is {self.overlap}", mend="use more than 0")
        if not 0 <= self.svd_threshold < 1:
            raise BadInput(f"svd_threshold is {self.svd_threshold}", mend="use 0 to below 1")
        if not 0 <= self.least_valid < 1:
            raise BadInput(f"least_valid is {self.least_valid}", mend="use 0 to below 1")
        if self.visibility not in ("cached", "exact"):
            raise BadInput(f"visibility is '{self.visibility}'", mend="use cached or exact")
        if self.interpolation not in INTERPOLATIONS:
            raise BadInput(
                f"interpolation is '{self.interpolation}'", mend=f"use {', '.join(INTERPOLATIONS)}"
            )

    def key(self) -> str:
        """All that changes the result, as text; what only changes speed and memory is left out."""
        speed = ("workers", "chunk_rays")
        names = [field.name for field in fields(self) if field.name not in speed]
        return ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
