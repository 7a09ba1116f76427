"""OpenDwarfs kernels of which only features are given: bounds, as there is nothing to trace.

The features count instructions, work-items and distinct addresses, but not which lanes touch which
lines nor what caches see again. So time is bounded: below by instructions at full rate and by each
address fetched once; above by every access waiting for a sector of DRAM of its own.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from gibench.profiles import Machine
from gibench.project.model import LAUNCH
from gibench.project.ranges import Total
from gibench.project.unknowns import kernel_points, machine_points
from gibench.resources import data

MEASURED = {
    "fury-x": "fiji-furyx",
    "firepro-s9150": "firepro-s9150",
    "gtx-1080": "gtx1080",
    "r9-295x2": "hawaii-r9-295x2",
    "tesla-k20c": "k20c",
    "hd-7970": "tahiti-hd7970",
    "titan-x-pascal": "titanx",
}
"""Columns of measured times (us) by the profile they are projected on; CPUs are left out."""
KEYS = ("application", "kernel", "size")
_WORD, _SECTOR = 4, 32
_ACCESSES = 0.35
"""Of a kernel's instructions, those that touch memory: an estimate."""
_LAUNCH = "the launch cost rules, and how much of it was recorded is not known"


def measured() -> pd.DataFrame:
    """Features and times (us) of every kernel and size."""
    tables = []
    for name in ("opendwarfs_features.csv", "opendwarfs_times.csv"):
        with data("validation").joinpath(name).open("rb") as file:
            tables.append(pd.read_csv(file))
    return tables[0].merge(tables[1], on=list(KEYS))


def bounded(row: pd.Series, machine: Machine) -> Total:
    """Times of a kernel at its bounds.

    Args:
        row: of :func:`measured`.
        machine: what it is projected on.
    """
    label = " ".join(str(row[name]) for name in KEYS)
    at, own = machine_points(machine), kernel_points(label, "")
    value = at.figures
    clock = value["clock_mhz"] * 1e3
    lanes = np.minimum(value["units"] * value["lanes"], float(row["workitems"]))
    instructions = float(row["total_instruction_count"])
    issue = instructions * own.figures["instructions"] / (lanes * clock)
    dram = value["dram_gb_per_s"] * value["dram_share"] * 1e6
    least = np.maximum(issue, float(row["total_memory_footprint"]) * _WORD / dram)
    most = np.maximum(issue, instructions * _ACCESSES * _SECTOR / dram)
    waiting = instructions / float(row["workitems"]) * _ACCESSES * value["dram_latency_ns"] * 1e-6
    most = np.maximum(np.maximum(most, waiting), least)
    # Either bound: where between them it lies is not a matter of chance.
    place = np.where(own.places["throughput"] < 0.5, 0.0, 1.0)
    place[0] = 0.5
    launch = value["launch_us"] * 1e-3
    times = least * (most / least) ** place + launch
    places = {**at.places, "place between the bounds": place}
    bound = LAUNCH if launch[0] > times[0] / 2 else "DRAM"
    return Total(times, bound, places, _LAUNCH if bound == LAUNCH else "")
