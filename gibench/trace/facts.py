"""What is known of a launch from its trace, as plain data."""

from __future__ import annotations

from dataclasses import dataclass, field

from gibench.arrays import Longs

SIMD_WIDTHS = (32, 64)
"""Lanes of a wave: NVIDIA's, Apple's and RDNA's; GCN's."""
CACHE_BYTES = tuple(1 << power for power in (14, 16, 18, 20, 22))
"""Caches that the reuse curve is read at: 16 KB to 4 MB."""


@dataclass(frozen=True)
class AccessFacts:
    """What one load, store or atomic of the kernel did, at one SIMD width.

    Attributes:
        buffer: the argument or local array that it touches.
        kind: ``LOAD``, ``STORE`` or ``ATOMIC``.
        nbytes: of a lane.
        requests: of waves, of at most 16 bytes a lane each.
        lines: cache lines touched.
        fewest_lines: that could hold the bytes asked for.
        cycles: of local memory's banks.
        fewest_cycles: without conflicts.
        stride: bytes between neighbouring lanes, None where they are scattered.
    """

    buffer: str
    kind: int
    nbytes: int
    requests: int
    lines: int
    fewest_lines: int
    cycles: int
    fewest_cycles: int
    stride: int | None


@dataclass(frozen=True)
class SimdFacts:
    """What the sampled groups do as waves of one width.

    Attributes:
        simd: lanes.
        lines_over_fewest: cache lines (64 bytes) touched over the fewest that could hold the bytes
            asked for; NaN where no global memory is touched.
        sectors_over_fewest: the same of sectors (32 bytes).
        efficiency: share of issued lanes that are active, weighted by instructions.
        bank_conflicts: cycles of local memory over the fewest; NaN where it is not touched.
        accesses: what each access did.
        lines_error: standard error of ``lines_over_fewest`` from runs of groups; NaN of one run.
        efficiency_error: of ``efficiency``.
        in_a_row: global loads that a wave waits for one after another, on average: each needs the
            last one's value, or a branch on it, or comes behind a barrier.
        batches: times that a wave has to wait for global loads, on average, where loops are not
            unrolled.
    """

    simd: int
    lines_over_fewest: float
    sectors_over_fewest: float
    efficiency: float
    bank_conflicts: float
    accesses: tuple[AccessFacts, ...] = field(repr=False)
    lines_error: float
    efficiency_error: float
    in_a_row: float = 0.0
    batches: float = 0.0


@dataclass(frozen=True)
class LaunchFacts:
    """What a launch does.

    Attributes:
        groups: of the launch.
        traced: groups that were.
        items: work-items of a group.
        local_bytes: of a group.
        simd: by width.
        flops: of the whole launch, scaled from the sample.
        instructions: issue slots of lanes of the whole launch, scaled from the sample.
        instructions_error: relative standard error of the two.
        dram_bytes: fetched and written back behind one cache of each of ``CACHE_BYTES`` (fully
            associative, LRU, 32-byte sectors) that one run of adjacent groups has to itself, scaled
            to the launch.
        requested_bytes: all sectors of all requests, scaled to the launch.
        atomics: of the whole launch, on global and local memory.
        atomics_per_address: the most on one address, of the sampled groups.
        private_per_item: accesses of an item to private memory that registers may not hold.
        outside: accesses of the sample that lie in no buffer.
        reuse: reuses (64,) by distance: fewer than 2^i sectors, and not fewer than half of that.
        cold: sectors of the sample that are touched for the first time.
        behind: the same as ``dram_bytes``, of the caches that were asked for besides.
    """

    groups: int
    traced: int
    items: int
    local_bytes: int
    simd: tuple[SimdFacts, ...]
    flops: float
    instructions: float
    instructions_error: float
    dram_bytes: tuple[float, ...]
    requested_bytes: float
    atomics: float
    atomics_per_address: int
    private_per_item: float
    outside: int
    reuse: Longs = field(repr=False)
    cold: int
    behind: tuple[float, ...] = ()
