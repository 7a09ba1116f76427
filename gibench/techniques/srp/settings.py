"""What a user may set of SRP."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from gibench.errors import BadInput
from gibench.techniques.srp.bake.data import MAX_SH_ORDER
from gibench.techniques.srp.bake.settings import SrpBakeSettings

STORAGES = ("fp32", "fp16", "snorm16")
FRACTIONS = (1.0, 0.5, 0.25)


@dataclass(frozen=True)
class SrpSettings:
    """Settings of Sparse Radiance Probes; each field says what it trades for what."""

    sh_order: int = field(
        default=7,
        metadata={
            "help": "order of the probes' spherical harmonics, 0 to 7; (order + 1)^2 coefficients "
            "per probe: sharper indirect light for more time and memory "
            "(Silvennoinen and Lehtinen 2017: 7)",
            "unit": "",
        },
    )
    probes: int | None = field(
        default=None,
        metadata={
            "help": "probes to place, the scene's own number if unset: more detail for more time "
            "and memory",
            "unit": "probes",
        },
    )
    relight_samples: int = field(
        default=1024,
        metadata={
            "help": "relight rays per probe: less noise in the probes for a slower probe_update "
            "(Bennett 2019: 1024; Silvennoinen and Lehtinen 2017: 8000)",
            "unit": "rays",
        },
    )
    transport_rays: int = field(
        default=4096,
        metadata={
            "help": "rays per receiver in the bake: less noise in the transport for a slower bake "
            "(Bennett 2019: 4096)",
            "unit": "rays",
        },
    )
    storage: str = field(
        default="fp16",
        metadata={
            "help": "how transport matrices are stored: fp32, fp16 or snorm16; 16 bits take half "
            "the memory and time for a relative error of about 5e-4 "
            "(Silvennoinen and Lehtinen 2017: fp16)",
            "unit": "",
        },
    )
    probe_update_fraction: float = field(
        default=1.0,
        metadata={
            "help": "share of the probes updated in a frame, in turn: 1, 0.5 or 0.25; a faster "
            "probe_update for indirect light that lags behind",
            "unit": "",
        },
    )
    bounces: bool = field(
        default=True,
        metadata={
            "help": "feed the indirect light of the last frame back, for many bounces; off: one",
            "unit": "",
        },
    )
    overlap: float = field(
        default=10.0,
        metadata={
            "help": "mean number of probes that reach a receiver: smoother for more time and "
            "memory (Silvennoinen and Lehtinen 2017: 10)",
            "unit": "probes",
        },
    )
    cluster_size: int = field(
        default=1024,
        metadata={"help": "most receivers in a cluster (Bennett 2019: 1024)", "unit": "receivers"},
    )
    svd_vectors: int = field(
        default=32,
        metadata={
            "help": "most light basis vectors kept of a cluster: less compression error for more "
            "time and memory (Silvennoinen and Lehtinen 2017: 32)",
            "unit": "vectors",
        },
    )
    svd_threshold: float = field(
        default=0.005,
        metadata={
            "help": "relative error of the irradiance that compression may leave, under light "
            "from anywhere: smaller for more time and memory "
            "(Silvennoinen and Lehtinen 2017: 0.005)",
            "unit": "",
        },
    )
    interpolation: Literal["srp", "spatial", "visibility"] = field(
        default="srp",
        metadata={
            "help": "between probes: srp (mutual visibility), or for comparison spatial (by "
            "distance alone) or visibility (from the probes that a receiver sees)",
            "unit": "",
        },
    )

    def __post_init__(self) -> None:
        if not 0 <= self.sh_order <= MAX_SH_ORDER:
            raise BadInput(
                f"SH order is {self.sh_order}; 0 to {MAX_SH_ORDER} are there",
                mend=f"use --sh-order {MAX_SH_ORDER} or less"
                if self.sh_order > 0
                else "use --sh-order 0 or more",
            )
        if self.storage not in STORAGES:
            raise BadInput(f"storage is '{self.storage}'", mend=f"use {', '.join(STORAGES)}")
        if self.probe_update_fraction not in FRACTIONS:
            raise BadInput(
                f"probe_update_fraction is {self.probe_update_fraction}", mend="use 1, 0.5 or 0.25"
            )
        self.bake_settings()  # refuses what the bake refuses

    def bake_settings(self) -> SrpBakeSettings:
        """The part of the settings that the bake takes.

        Raises:
            BadInput: a value makes no sense.
        """
        return SrpBakeSettings(
            sh_order=self.sh_order,
            probes=self.probes,
            relight_samples=self.relight_samples,
            transport_rays=self.transport_rays,
            overlap=self.overlap,
            cluster_size=self.cluster_size,
            svd_vectors=self.svd_vectors,
            svd_threshold=self.svd_threshold,
            interpolation=self.interpolation,
        )
