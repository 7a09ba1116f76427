"""Statistics of samples, and work against time. No input or output here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gibench.techniques.technique import Work

NAN = float("nan")
REAL_TIME_MS = 33.3
"""A frame is real-time at 30 frames per second (Bennett 2019, section 1)."""


@dataclass(frozen=True)
class Summary:
    """What n times come down to, ms. ``stdev_ms`` is the sample's (n - 1); nan for one sample."""

    count: int
    mean_ms: float
    median_ms: float
    stdev_ms: float
    p95_ms: float
    p99_ms: float
    min_ms: float
    max_ms: float


@dataclass(frozen=True)
class Roofs:
    """What the executing machine does at most, measured on it.

    Attributes:
        read_gb_per_s: streaming read of one large buffer.
        triad_gb_per_s: STREAM triad, two buffers read and one written.
        fma_gflop_per_s: independent fused multiply-adds on the widest vectors.
        launch_us: wall time to enqueue an empty kernel and see it end, per launch, many in a row.
        mrays_per_s: incoherent closest-hit rays in a closed box; nan where not measured.
    """

    read_gb_per_s: float
    triad_gb_per_s: float
    fma_gflop_per_s: float
    launch_us: float
    mrays_per_s: float = NAN

    @property
    def gb_per_s(self) -> float:
        """The bandwidth roof: the faster of the two streams."""
        return max(self.read_gb_per_s, self.triad_gb_per_s)


def summarize(times_ms: Sequence[float] | npt.NDArray[np.floating]) -> Summary:
    """The summary of ``times_ms`` (n,); all nan when there are none."""
    times = np.asarray(times_ms, np.float64)
    if times.size == 0:
        return Summary(0, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
    return Summary(
        count=int(times.size),
        mean_ms=float(times.mean()),
        median_ms=float(np.median(times)),
        stdev_ms=float(times.std(ddof=1)) if times.size > 1 else NAN,
        p95_ms=float(np.percentile(times, 95)),
        p99_ms=float(np.percentile(times, 99)),
        min_ms=float(times.min()),
        max_ms=float(times.max()),
    )


def per_second(amount: float, time_ms: float, unit: float) -> float:
    """``amount`` in ``time_ms`` as a rate in ``unit`` per second; nan without work or time."""
    if not amount or not time_ms > 0:
        return NAN
    return amount / unit / (time_ms * 1e-3)


def least_ms(work: Work, roofs: Roofs) -> float:
    """The time the roofs allow for ``work``, ms: the slowest of its bytes, flops and rays.

    The roofline model (Williams, Waterman and Patterson, CACM 2009) with rays as a third roof; that
    roof counts where it was measured. nan when the pass declares no work.
    """
    bounds = [
        (work.bytes_read + work.bytes_written) / (roofs.gb_per_s * 1e6),
        work.flops / (roofs.fma_gflop_per_s * 1e6),
    ]
    if np.isfinite(roofs.mrays_per_s):
        bounds.append(work.rays / (roofs.mrays_per_s * 1e3))
    least = max(bounds)
    return least if least > 0 else NAN


def best_of(start: Roofs, end: Roofs) -> Roofs:
    """The roofs of a run measured twice: the most (for a launch, the least) it ever showed."""
    return Roofs(
        read_gb_per_s=max(start.read_gb_per_s, end.read_gb_per_s),
        triad_gb_per_s=max(start.triad_gb_per_s, end.triad_gb_per_s),
        fma_gflop_per_s=max(start.fma_gflop_per_s, end.fma_gflop_per_s),
        launch_us=min(start.launch_us, end.launch_us),
        mrays_per_s=float(np.fmax(start.mrays_per_s, end.mrays_per_s)),
    )


def moved(start: Roofs, end: Roofs, threshold: float = 0.10) -> dict[str, float]:
    """The roofs that differ by more than ``threshold``: end over start minus one, by name.

    The launch cost is left out: it is microseconds of Python and bounds no pass.
    """
    names = ("read_gb_per_s", "triad_gb_per_s", "fma_gflop_per_s", "mrays_per_s")
    changes = {name: getattr(end, name) / getattr(start, name) - 1 for name in names}
    return {name: change for name, change in changes.items() if abs(change) > threshold}
