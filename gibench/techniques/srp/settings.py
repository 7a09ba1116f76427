"""What a user may set of SRP."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from gibench.errors import BadInput
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.storage import STORAGES, Storage
from gibench.techniques.srp.turns import PROBE_UPDATES, ProbeUpdate


@dataclass(frozen=True)
class SrpSettings(SrpBakeSettings):
    """Settings of Sparse Radiance Probes: the bake's, and those of a frame."""

    storage: Storage = field(
        default="fp16",
        metadata={
            "help": "how transport matrices are stored: fp32, fp16 or snorm16; 16 bits take half "
            "the memory and time for a relative error of about 5e-4 "
            "(Silvennoinen and Lehtinen 2017: fp16)",
            "unit": "",
        },
    )
    probe_update: ProbeUpdate = field(
        default="all",
        metadata={
            "help": "probes updated in a frame: all; half or quarter, in turn; or nearest, a "
            "quarter, those near the camera more often: a faster probe_update for indirect light "
            "that lags behind",
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

    normal_maps: bool = field(
        default=False,
        metadata={
            "help": "shade what the camera sees with the scene's normal maps; receiver_order 1 "
            "knows the indirect light there (Silvennoinen and Lehtinen 2017, section 5.1)",
            "unit": "",
        },
    )

    gloss: bool = field(
        default=False,
        metadata={
            "help": "glossy reflection of indirect light, taken for one light from afar: rough "
            "metals alone come near (Silvennoinen and Lehtinen 2017, section 5.1); needs "
            "receiver_order 1",
            "unit": "",
        },
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("normal_maps", "gloss"):
            if getattr(self, name) and not self.receiver_order:
                raise BadInput(
                    f"{name} needs light of order 1 at the receivers",
                    mend="add --set srp.receiver_order=1",
                )
        if self.storage not in STORAGES:
            raise BadInput(f"storage is '{self.storage}'", mend=f"use {', '.join(STORAGES)}")
        if self.probe_update not in PROBE_UPDATES:
            raise BadInput(
                f"probe_update is '{self.probe_update}'", mend=f"use {', '.join(PROBE_UPDATES)}"
            )

    def bake_settings(self) -> SrpBakeSettings:
        """The part of the settings that the bake takes."""
        return SrpBakeSettings(**{f.name: getattr(self, f.name) for f in fields(SrpBakeSettings)})
