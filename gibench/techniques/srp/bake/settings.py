"""What a user may set of an SRP bake."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Literal, get_args

from gibench.errors import BadInput
from gibench.techniques.srp.bake.data import (
    MAX_RECEIVER_ORDER,
    MAX_SH_ORDER,
    sh_count,
)

Visibility = Literal["cached", "exact"]
Interpolation = Literal["srp", "spatial", "visibility"]
Sky = Literal["probes", "receivers"]
Placement = Literal["published", "error"]

USUAL_ORDERS = (7, 4)
"""SH order of the probes by the receivers' (Silvennoinen and Lehtinen 2017, sections 5 and 5.1)."""


@dataclass(frozen=True)
class SrpBakeSettings:
    """Settings of an SRP bake; each field says what it trades for what.

    Attributes:
        svd_threshold: :func:`gibench.techniques.srp.bake.cpca.compress` says what it is an error
            of. Three samples of 16 to 36 of Sponza's 347 leaves under ten single lights each,
            without bounces: 0.8 % and less for nine lights of ten, 1.0 to 1.4 % for the tenth.
        least_valid: the mean over a handful of samples is noise, of full weight in the compression:
            in Sponza the 3 % of receivers below 1 %, nearly all inside walls, held a fifth of all
            transport's energy.
        interpolation: of radiance from the probes. ``srp`` reprojects and asks for mutual
            visibility (Bennett 2019, eq. 4.6); ``spatial`` blends by distance alone, in the
            receiver's own direction (eq. 4.3); ``visibility`` is that from the probes the receiver
            sees. The latter two are there to be compared with.
        sh_order: never None once made.
    """

    sh_order: int | None = field(
        default=None,
        metadata={
            "help": "order of the probes' spherical harmonics, 0 to 7; (order + 1)^2 coefficients "
            "per probe: sharper indirect light for more time and memory; if unset 7, or 4 where "
            "receiver_order is 1 (Silvennoinen and Lehtinen 2017)",
            "unit": "",
            "axis": True,
            "title": "SH order",
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
    least_valid: float = field(
        default=0.01,
        metadata={
            "help": "share of its rays that must meet what a probe sees, or the receiver stays "
            "dark: fewer noisy receivers for more dark ones",
            "unit": "",
        },
    )
    visibility: Visibility = field(
        default="cached",
        metadata={
            "help": "in the bake: cached settles most of it by tables of a few rays per probe and "
            "texel and traces the rest, exact traces everything and is slower",
            "unit": "",
        },
    )
    interpolation: Interpolation = field(
        default="srp",
        metadata={
            "help": "between probes: srp (mutual visibility), or for comparison spatial (by "
            "distance alone) or visibility (from the probes that a receiver sees)",
            "unit": "",
        },
    )
    receiver_order: int = field(
        default=0,
        metadata={
            "help": "order of the light at the receivers: 0 is irradiance at their own normal, 1 "
            "is irradiance at any normal, for normal maps and gloss, for four times the values of "
            "a receiver (Silvennoinen and Lehtinen 2017, section 5.1)",
            "unit": "",
        },
    )

    sky: Sky = field(
        default="probes",
        metadata={
            "help": "where the light of the sky is kept: in the probes, which blur it over what "
            "stands before it (Silvennoinen and Lehtinen 2017), or apart, seen by every receiver "
            "through its own visibility, for more memory",
            "unit": "",
        },
    )

    placement: Placement = field(
        default="published",
        metadata={
            "help": "of the probes: published, thinned evenly beside surfaces (Silvennoinen and "
            "Lehtinen 2017, section 4.1), or error, moved from there to where the irradiance under "
            "random lights errs least, for a longer bake",
            "unit": "",
        },
    )

    def __post_init__(self) -> None:
        if not 0 <= self.receiver_order <= MAX_RECEIVER_ORDER:
            raise BadInput(f"receiver_order is {self.receiver_order}", mend="use 0 or 1")
        if self.sh_order is None:
            object.__setattr__(self, "sh_order", USUAL_ORDERS[self.receiver_order])
        for name in ("relight_samples", "transport_rays", "cluster_size", "svd_vectors"):
            if getattr(self, name) < 1:
                raise BadInput(f"{name} is {getattr(self, name)}", mend="use 1 or more")
        if self.probes is not None and self.probes < 1:
            raise BadInput(f"probes is {self.probes}", mend="use 1 or more")
        if not 0 <= self.order <= MAX_SH_ORDER:
            raise BadInput(
                f"SH order is {self.order}; 0 to {MAX_SH_ORDER} are there",
                mend=f"use --sh-order {MAX_SH_ORDER} or less"
                if self.order > 0
                else "use --sh-order 0 or more",
            )
        if not self.overlap > 0:
            raise BadInput(f"overlap is {self.overlap}", mend="use more than 0")
        if not 0 <= self.svd_threshold < 1:
            raise BadInput(f"svd_threshold is {self.svd_threshold}", mend="use 0 to below 1")
        if not 0 <= self.least_valid < 1:
            raise BadInput(f"least_valid is {self.least_valid}", mend="use 0 to below 1")
        for name, known in (
            ("visibility", Visibility),
            ("interpolation", Interpolation),
            ("sky", Sky),
            ("placement", Placement),
        ):
            if getattr(self, name) not in get_args(known):
                raise BadInput(
                    f"{name} is '{getattr(self, name)}'", mend=f"use {', '.join(get_args(known))}"
                )

        if self.sky == "receivers" and self.interpolation != "srp":
            raise BadInput(
                f"sky=receivers is not for interpolation={self.interpolation}",
                mend="use interpolation=srp, or sky=probes",
            )

    @property
    def order(self) -> int:
        """Order of the probes' spherical harmonics."""
        assert self.sh_order is not None
        return self.sh_order

    @property
    def components(self) -> int:
        """Of the light at a receiver."""
        return sh_count(self.receiver_order)

    @property
    def placed_by(self) -> tuple[object, ...]:
        """What the published place of the probes depends on."""
        return self.probes, self.overlap

    @property
    def everything(self) -> tuple[object, ...]:
        """What the compressed transport depends on: all there is. What is as it was before there
        was a setting for it is left out, so that older bakes are still found.
        """
        names = [item.name for item in fields(SrpBakeSettings)]
        if not self.receiver_order:
            names.remove("receiver_order")
        if self.sky == "probes":
            names.remove("sky")
        if self.placement == "published":
            names.remove("placement")
        return tuple(getattr(self, name) for name in names)
