"""Launches of the device prefix sums in kernels_cl/parts/scan.cl."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gibench.device import (
    WIDE,
    Argument,
    Buffer,
    BufferSpec,
    Device,
    Launch,
    ProgramSpec,
    local,
    reads,
    updates,
    writes,
)
from gibench.errors import CannotRun

SCAN_ITEMS = 16
"""Values per work-item of the blocked scan."""
SCAN_MACROS = {"SCAN_ITEMS": SCAN_ITEMS}
"""Of every program that includes kernels_cl/parts/scan.cl."""
_MOST_STAGED = 8
"""Values per work-item in local memory at once: 11 KB of a group of 256."""


@dataclass(frozen=True)
class WaveScan:
    """Scratch of the wave-wise recursive scan (Ekberg 2022, section 4.2.2) over a fixed length.

    Attributes:
        device: where it runs.
        wave: work-items per wave.
        workgroup_size: work-items per group, a multiple of ``wave``.
        counts: number of values of each level, the values themselves first.
        totals: one buffer per level: the totals of its waves.
        lengths: (levels,) one-word buffers with ``counts``.
    """

    device: Device
    wave: int
    workgroup_size: int
    counts: tuple[int, ...]
    totals: tuple[Buffer, ...]
    lengths: tuple[Buffer, ...]

    @staticmethod
    def create(device: Device, name: str, length: int, workgroup_size: int) -> WaveScan:
        """Scratch for ``length`` values.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        wave = wave_of(device.profile.simd_width, workgroup_size)
        counts = wave_levels(length, wave)
        known = {
            f"{name}_length_{level}": np.array([n], np.uint32) for level, n in enumerate(counts)
        }
        held = device.allocate(WaveScan.buffers(name, length, wave), known)
        levels = range(len(counts))
        return WaveScan(
            device=device,
            wave=wave,
            workgroup_size=workgroup_size,
            counts=counts,
            totals=tuple(held[f"{name}_totals_{level}"] for level in levels),
            lengths=tuple(held[f"{name}_length_{level}"] for level in levels),
        )

    @staticmethod
    def buffers(name: str, length: int, wave: int) -> list[BufferSpec]:
        """The scratch for ``length`` values.

        Raises:
            CannotRun: a wave is a single work-item.
        """
        counts, of = list(enumerate(wave_levels(length, wave))), BufferSpec.of
        return [
            *(of(f"{name}_totals_{level}", -(-n // wave), np.uint32) for level, n in counts),
            *(of(f"{name}_length_{level}", 1, np.uint32) for level, _ in counts),
        ]

    def launches(self, values: Buffer, prefix: Buffer) -> list[Launch]:
        """Scan ``values`` (n,) uint32 into ``prefix`` (n,) uint32."""
        program = ProgramSpec("parts/scan.cl", {**SCAN_MACROS, "WAVE": self.wave})
        partial = local("partial", 8 * self.workgroup_size)
        sources = (values, *self.totals[:-1])
        targets = (prefix, *self.totals[:-1])
        result = [
            Launch(
                program,
                "scan_waves",
                (
                    reads("values", source),
                    reads("length", length),
                    writes("prefix", target),
                    writes("totals", totals),
                    partial,
                ),
                items=n,
                workgroup_size=self.workgroup_size,
            )
            for source, length, target, totals, n in zip(
                sources, self.lengths, targets, self.totals, self.counts, strict=True
            )
        ]
        for level in range(len(self.counts) - 2, -1, -1):
            args = (
                updates("prefix", targets[level]),
                reads("length", self.lengths[level]),
                reads("offsets", targets[level + 1]),
            )
            result.append(Launch(program, "scan_add", args, items=self.counts[level]))
        return result


def wave_of(simd_width: int, workgroup_size: int) -> int:
    """Work-items that are scanned at once: the profile's SIMD width where that divides the
    work-group, else the whole work-group.
    """
    whole = simd_width > 1 and workgroup_size % simd_width == 0
    return simd_width if whole else workgroup_size


def wave_levels(length: int, wave: int) -> tuple[int, ...]:
    """Number of values of each level of the recursion, the last within one wave."""
    if wave < 2:
        raise CannotRun(
            "the published prefix sum needs work-groups of at least two work-items",
            mend="use another --workgroup-size or --variant tuned",
        )
    counts = [length]
    while counts[-1] > wave:
        counts.append(-(-counts[-1] // wave))
    return tuple(counts)


@dataclass(frozen=True)
class BlockScan:
    """Scratch of the blocked scan over up to a given length.

    Attributes:
        device: where it runs.
        workgroup_size: work-items per group.
        sums: the blocks' sums.
    """

    device: Device
    workgroup_size: int
    sums: Buffer

    @staticmethod
    def create(device: Device, name: str, capacity: int, workgroup_size: int) -> BlockScan:
        """Scratch for up to ``capacity`` values.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        spec = BlockScan.buffer(name, capacity, workgroup_size)
        return BlockScan(device, workgroup_size, device.create(spec))

    @staticmethod
    def buffer(name: str, capacity: int, workgroup_size: int) -> BufferSpec:
        """The scratch for up to ``capacity`` values."""
        blocks = BlockScan.blocks(capacity, workgroup_size)
        return BufferSpec.of(f"{name}_sums", max(blocks, 1), np.uint32)

    @staticmethod
    def blocks(length: int, workgroup_size: int) -> int:
        """Number of blocks that ``length`` values fall into."""
        return -(-length // (workgroup_size * SCAN_ITEMS))

    def _staged(self) -> int:
        """Values per work-item that lie in local memory at once: in the layout ``simt`` as many as
        the profile has room for, none in ``wide`` nor on a CPU, where that is memory as any other.
        """
        wide = self.device.layout == WIDE or self.device.lanes_together > 1
        staged = 0 if wide else _MOST_STAGED
        while 4 * self.workgroup_size * (staged + 3) > self.device.profile.local_memory_bytes:
            staged //= 2
            if staged == 0:
                break
        return staged

    def launches(
        self, values: Buffer, length: Buffer, prefix: Buffer, count: int | Callable[[], int]
    ) -> list[Launch]:
        """Scan ``values`` (n,) uint32 into ``prefix`` (n + 1,) uint32, the total last.

        Args:
            values: what is scanned.
            length: buffer whose first word is n.
            prefix: where to; the total stands behind the n prefixes.
            count: n as the host knows it, or a function that tells it before every frame.
        """
        staged = self._staged()
        defines = {**SCAN_MACROS, **({"STAGED": staged} if staged else {})}
        program = ProgramSpec("parts/scan.cl", defines)
        partial = local("partial", 4 * self.workgroup_size * (2 + (staged + 1 if staged else 0)))

        def groups() -> int:
            return self.blocks(count() if callable(count) else count, self.workgroup_size)

        def launch(kernel: str, *args: Argument) -> Launch:
            return Launch(
                program,
                kernel,
                (*args, partial),
                groups=(lambda: min(groups(), 1)) if kernel == "scan_sums" else groups,
                workgroup_size=self.workgroup_size,
            )

        return [
            launch(
                "scan_block_sums",
                reads("values", values),
                reads("length", length),
                writes("sums", self.sums),
            ),
            launch("scan_sums", updates("sums", self.sums), reads("length", length)),
            launch(
                "scan_blocks",
                reads("values", values),
                reads("length", length),
                reads("sums", self.sums),
                writes("prefix", prefix),
            ),
        ]
