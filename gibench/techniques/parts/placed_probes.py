"""A probe volume on a device: where its probes are, and which of them hold something."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Floats
from gibench.device import Argument, Buffer, BufferSpec, Device, reads
from gibench.device.build import Define
from gibench.techniques.parts.probe_volume import Volume

ACTIVE = 1
"""Of a probe's state: it casts all its rays."""
BLENDED = 2
"""Of a probe's state: its maps hold something."""
USABLE = ACTIVE | BLENDED

VOLUME_FLOATS = 12  # kernels_cl/parts/probe_volume.cl: the volume's nine, and what lookups take


@dataclass
class PlacedProbes:
    """The buffers that kernels_cl/parts/probe_volume.cl reads.

    Attributes:
        device: where they lie.
        volume: where the probes are now.
        table: (12,) float32, the volume and what lookups in it take.
        data: (p, 4) float32 offset in m and state of every probe.
    """

    device: Device
    volume: Volume
    table: Buffer
    data: Buffer

    @staticmethod
    def create(device: Device, volume: Volume, state: int = ACTIVE) -> PlacedProbes:
        """Probes on the grid, all in ``state``.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        held = device.allocate(
            PlacedProbes.buffers(volume.probes), PlacedProbes.contents(volume, state)
        )
        return PlacedProbes.of(device, volume, held)

    @staticmethod
    def buffers(probes: int) -> list[BufferSpec]:
        """The buffers that so many probes take."""
        return [
            BufferSpec.of("volume", VOLUME_FLOATS, np.float32),
            BufferSpec.of("probe_data", (probes, 4), np.float32),
        ]

    @staticmethod
    def contents(
        volume: Volume, state: int = ACTIVE, lengths: tuple[float, ...] = ()
    ) -> dict[str, Floats]:
        """What :meth:`buffers` hold at first: probes on the grid, all in ``state``.

        ``lengths`` are up to three that the technique's lookups take, m. They differ from scene to
        scene: as macros they would have the kernels compiled anew for each.
        """
        table = np.zeros(VOLUME_FLOATS, np.float32)
        table[: 9 + len(lengths)] = [*volume.table(), *lengths]
        return {"volume": table, "probe_data": probe_data(volume.probes, state)}

    @staticmethod
    def of(device: Device, volume: Volume, held: Mapping[str, Buffer]) -> PlacedProbes:
        """The probes whose buffers are among ``held``."""
        return PlacedProbes(device, volume, held["volume"], held["probe_data"])

    @property
    def args(self) -> tuple[Argument, ...]:
        """VOLUME_PARAMS of kernels_cl/parts/probe_volume.cl."""
        return reads("volume", self.table), reads("probe_data", self.data)

    @property
    def defines(self) -> dict[str, Define]:
        """Its macros."""
        return {**self.volume.defines, "PROBE_ACTIVE": ACTIVE, "PROBE_BLENDED": BLENDED}

    def scroll_to(self, centre: tuple[float, float, float]) -> None:
        """Move the volume by whole spacings towards ``centre``; probes that enter start anew."""
        moved = self.volume.scrolled(centre)
        steps = np.array(moved.scroll) - self.volume.scroll
        if not steps.any():
            return
        self.volume = moved
        counts = np.array(moved.counts)
        c = moved.coordinates
        entered = ((steps > 0) & (c >= counts - steps)) | ((steps < 0) & (c < -steps))
        data = self.device.read(self.data)
        data[entered.any(axis=1)] = probe_data(1, ACTIVE)
        self.device.write(self.data, data)
        self.device.write(self.table, moved.table())


def probe_data(count: int, state: int) -> Floats:
    """Data (count, 4) of probes on the grid in ``state``."""
    data = np.zeros((count, 4), np.float32)
    data[:, 3] = state
    return data
