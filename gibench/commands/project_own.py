"""Kernels of one's own projected onto devices that are not here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands.project import ProjectedRun, machine_of, projected_columns
from gibench.commands.projected_ratios import Whole, ratio_table
from gibench.errors import GibenchError
from gibench.profiles import DeviceProfile
from gibench.project.model import launch_times
from gibench.project.ranges import Total, together
from gibench.report.projected import COLUMNS, WHOLE_LAUNCH
from gibench.trace.kept_streams import streams_of
from gibench.trace.request import TraceRequest
from gibench.trace.streams import WaveStreams


def project_own(
    requests: Sequence[TraceRequest], profiles: Sequence[DeviceProfile], cache: Path
) -> ProjectedRun:
    """Ranges of a launch of each kernel on every device, and of each over the fastest of them.

    Args:
        requests: the launches, labelled ``FILE:NAME``.
        profiles: devices, each with a machine part.
        cache: where traces are kept.

    Raises:
        CannotRun: the extra is missing.
    """
    widths = sorted({min(profile.simd_width, 64) for profile in profiles})
    rows: list[dict[str, Any]] = []
    wholes: list[Whole] = []
    for number, request in enumerate(requests, 1):
        file, _, kernel = request.label.rpartition(":")
        head = {"configuration": number, "technique": file, "variant": kernel}
        head |= dict.fromkeys(("layout", "scene", "profile"), "")
        found = _streams(request, widths, cache)
        for profile in profiles:
            total = _launch(found, profile)
            here = head | {"device": profile.name}
            launch = {"pass": WHOLE_LAUNCH, "stage": ""}
            rows.append(here | launch | projected_columns(total, profile))
            wholes.append(Whole(here, {WHOLE_LAUNCH: total}))
    return ProjectedRun(pd.DataFrame(rows, columns=list(COLUMNS)), ratio_table(wholes))


def _streams(
    request: TraceRequest, widths: Sequence[int], cache: Path
) -> dict[int, WaveStreams] | GibenchError:
    """What a launch does to memory, or why that is not known."""
    try:
        return streams_of(request, widths, cache)
    except GibenchError as error:
        return error


def _launch(
    found: dict[int, WaveStreams] | GibenchError, profile: DeviceProfile
) -> Total | GibenchError:
    """Its time on a device with the cost of launching it, or why nothing can be told."""
    if isinstance(found, GibenchError):
        return found
    return together([launch_times(found[min(profile.simd_width, 64)], machine_of(profile))])
