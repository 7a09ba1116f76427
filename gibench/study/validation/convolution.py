"""Kernel Tuner's convolution benchmark: a sample of its configurations as launches to trace."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from gibench.arrays import Floats
from gibench.resources import data
from gibench.trace.request import TracedArgument, TraceRequest

KEYS = (
    *("block_size_x", "block_size_y", "tile_size_x", "tile_size_y"),
    *("read_only", "use_padding", "use_shmem", "use_cmem"),
)
"""Columns of a configuration."""
MEASURED = {
    "a100-pcie-40gb": "a100_pcie_40gb_ms",
    "rtx-a6000": "rtx_a6000_ms",
    "radeon-pro-w6600": "radeon_pro_w6600_ms",
}
"""Columns of measured times, by the profile that they are projected on."""
SAMPLE, SEED = 160, 2026
"""Configurations that are traced, drawn at random before any was looked at."""
_SIDE = 4096
_FILTER = 15
KERNEL = "convolution.cl"


def measured() -> pd.DataFrame:
    """All configurations with their measured times."""
    with data("validation").joinpath("convolution.csv").open("rb") as file:
        return pd.read_csv(file)


def sample(table: pd.DataFrame) -> pd.DataFrame:
    """The configurations that are traced."""
    chosen = np.random.default_rng(SEED).choice(len(table), SAMPLE, replace=False)
    return table.iloc[np.sort(chosen)]


def request(
    row: Mapping[str, int], side: int = _SIDE, values: tuple[Floats, Floats] | None = None
) -> TraceRequest:
    """The launch of a configuration. ``read_only`` changes nothing in OpenCL C.

    Args:
        row: the configuration.
        side: outputs of a row and of a column.
        values: the image (side + 14, side + 14) and the filter (15, 15); zeros where they do not
            matter.
    """
    block_x, block_y, tile_x, tile_y = (int(row[name]) for name in KEYS[:4])
    across, down = block_x * tile_x, block_y * tile_y
    columns, rows = -(-side // across), -(-side // down)
    output = np.zeros((rows * down, columns * across), np.float32)
    edge = _FILTER - 1
    given = np.zeros((rows * down + edge, columns * across + edge), np.float32)
    weights = np.zeros((_FILTER, _FILTER), np.float32)
    if values is not None:
        given[: side + edge, : side + edge], weights = values
    return TraceRequest(
        source=data("validation").joinpath(KERNEL).read_text(encoding="utf-8"),
        defines={
            "BLOCK_X": block_x,
            "BLOCK_Y": block_y,
            "TILE_X": tile_x,
            "TILE_Y": tile_y,
            "WIDTH": side,
            "FILTER_X": _FILTER,
            "FILTER_Y": _FILTER,
            "PADDED": int(row["use_padding"]),
            "STAGED": int(row["use_shmem"]),
            "CONSTANT": int(row["use_cmem"]),
        },
        kernel="convolution",
        args=[
            TracedArgument("output", output, 0, True),
            TracedArgument("input", given),
            TracedArgument("filter", weights.reshape(-1)),
        ],
        items=block_x * block_y,
        groups=(columns * rows, 1),
        label=f"{KERNEL}: convolution",
    )
