"""The papers' published times: which rows are predicted, by a rule made before, and their launches.

The rule. A row is predicted where its time is that of passes whose kernel is ours and whose sizes
are published:

- Cluster projection and irradiance transport of Silvennoinen and Lehtinen 2017 (table 2): yes, by
  the sizes of table 1, stored in 16 bits (their memory says so), by our published kernels. Their
  kernels are not published; times that follow the clusters speak for a group each.
- Their lightmap and probe update: no. The first samples shadow maps, ours traces rays; the second
  is 6 to 12 times faster than a group per probe could be: another kernel.
- Growths of Bennett 2019 with SH order and probes: yes, as that of probe update, projection and
  transport, the passes that depend on them. How many probes reach a cluster is not published: three
  numbers of them are tried, and the range is that of all.
- Growths with receivers: no. The lightmap update grows too, and theirs samples shadow maps.
- Whole frames: no. Rasterisation is part of them.
- Ray casting of Ekberg 2022: no. It runs in the driver's own kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from gibench.arrays import Ints
from gibench.device import kernel_source
from gibench.profiles import DeviceProfile
from gibench.resources import data
from gibench.trace.request import TracedArgument, TraceRequest

_BOX_RECEIVERS, _BOX_ROWS, _BOX_CLUSTERS, _BOX_RAYS = 50784, 2272, 71, 1024
_REACH = {20: (8, 12, 20), 200: (12, 20, 40)}
"""Probes that reach a cluster, by probes of the scene: few, likely, many. An estimate."""
_GROUP = 256


@dataclass(frozen=True)
class Sizes:
    """Sizes of baked data.

    Attributes:
        probes: number of probes.
        coefficients: SH coefficients of a probe.
        rays: relight rays of a probe.
        receivers: number of receivers.
        clusters: number of clusters.
        rows: light basis vectors of all clusters.
        reach: probes that reach a cluster.
        half: whether matrices are stored in 16 bits.
    """

    probes: int
    coefficients: int
    rays: int
    receivers: int
    clusters: int
    rows: int
    reach: float
    half: bool


@dataclass(frozen=True)
class Row:
    """A published time and what is launched for it.

    Attributes:
        name: for tables.
        profile: of the device.
        ms: as published.
        added: launches whose time it is; several choices where sizes are not known.
        taken: launches whose time is taken off, one choice for each of ``added``.
    """

    name: str
    profile: str
    ms: float
    added: Sequence[Sequence[tuple[str, Sizes]]]
    taken: Sequence[Sequence[tuple[str, Sizes]]]


PROFILES = {
    "Titan X Pascal": "titan-x-pascal",
    "iPhone 7": "iphone7",
    "Radeon 560": "radeon560",
    "RX Vega 56": "vega56",
}


def rows() -> list[Row]:
    """The published rows that are predicted."""
    tables = [_read(name) for name in ("frame_times.csv", "srp_bakes.csv", "srp_scaling.csv")]
    times, bakes, scaling = tables
    found = []
    for _, each in times.iterrows():
        if each["pass"] not in ("cluster_projection", "irradiance_transport"):
            continue
        bake = bakes[bakes["scene"] == each["scene"]].iloc[0]
        sizes = Sizes(
            probes=int(bake["probes"]),
            coefficients=64,
            rays=8000,
            receivers=int(bake["receivers"]),
            clusters=int(bake["clusters"]),
            rows=round(bake["clusters"] * bake["vectors_per_receiver"]),
            reach=float(bake["probes_per_cluster"]),
            half=True,
        )
        name = f"{each['scene']}: {each['pass']}"
        launches = [[(str(each["pass"]), sizes)]]
        found.append(Row(name, PROFILES[each["device"]], float(each["time_ms"]), launches, [[]]))
    for _, each in scaling.iterrows():
        name = f"{each['scene']}: {each['range']}"
        if each["range"].startswith("SH order"):
            ends = [[_box(20, order, reach) for order in (2, 7)] for reach in _REACH[20]]
        elif each["range"].endswith("probes"):
            pairs = zip(_REACH[20], _REACH[200], strict=True)
            ends = [[_box(20, 7, few), _box(200, 7, many)] for few, many in pairs]
        else:
            continue
        taken, added = ([[*_passes(end[n])] for end in ends] for n in (0, 1))
        profile = PROFILES[each["device"]]
        found.append(Row(name, profile, float(each["growth_ms"]), added, taken))
    return found


def _read(name: str) -> pd.DataFrame:
    with data("published").joinpath(name).open("rb") as file:
        return pd.read_csv(file)


def _box(probes: int, order: int, reach: int) -> Sizes:
    return Sizes(
        *(probes, (order + 1) ** 2, _BOX_RAYS, _BOX_RECEIVERS, _BOX_CLUSTERS, _BOX_ROWS, reach),
        half=False,
    )


def _passes(sizes: Sizes) -> list[tuple[str, Sizes]]:
    names = ("probe_update", "cluster_projection", "irradiance_transport")
    return [(name, sizes) for name in names]


_COMPONENTS = 1
"""Of the light at a receiver: the papers' kernels have no more."""


def request(name: str, sizes: Sizes, profile: DeviceProfile) -> TraceRequest:
    """The launch of a pass: our published kernel on made-up data of these sizes."""
    make = {"probe_update": _probe_update, "cluster_projection": _projection}.get(name, _transport)
    return make(sizes, profile)


def _request(
    file: str, kernel: str, defines: dict[str, int], args: list[TracedArgument], groups: int,
    profile: DeviceProfile,
) -> TraceRequest:  # fmt: skip
    items = min(_GROUP, profile.max_workgroup_size)
    return TraceRequest(
        source=kernel_source(file),
        defines=dict(defines),
        kernel=kernel,
        args=args,
        items=items,
        groups=(groups, 1),
        label=f"{file}: {kernel}",
    )


def _clusters(sizes: Sizes) -> tuple[Ints, Ints, Ints]:
    """Rows of ``clusters``, every light basis vector's cluster, every stored column's index."""
    per = np.diff(np.linspace(0, sizes.rows, sizes.clusters + 1).round()).astype(np.int32)
    reach = np.diff(np.linspace(0, sizes.reach * sizes.clusters, sizes.clusters + 1).round())
    reach = np.minimum(reach.astype(np.int32), sizes.probes)
    columns = reach * sizes.coefficients
    table = np.zeros((sizes.clusters, 5), np.int32)
    table[:, 0], table[:, 1] = np.cumsum(per) - per, per
    table[:, 2], table[:, 3] = np.cumsum(columns) - columns, columns
    table[:, 4] = np.cumsum(per.astype(np.int64) * columns) - per.astype(np.int64) * columns
    # Clusters that lie near each other are reached by the same probes.
    first = np.linspace(0, sizes.probes - reach.max(), sizes.clusters).astype(np.int32)
    index = [
        np.arange(start * sizes.coefficients, (start + count) * sizes.coefficients, dtype=np.int32)
        for start, count in zip(first.tolist(), reach.tolist(), strict=True)
    ]
    return table, np.repeat(np.arange(sizes.clusters, dtype=np.int32), per), np.concatenate(index)


def _projection(sizes: Sizes, profile: DeviceProfile) -> TraceRequest:
    table, row_cluster, columns = _clusters(sizes)
    values = int((table[:, 1].astype(np.int64) * table[:, 3]).sum())
    kind = np.float16 if sizes.half else np.float32
    rows = len(row_cluster)
    args = [
        TracedArgument("clusters", table),
        TracedArgument("row_cluster", row_cluster),
        TracedArgument("columns", columns),
        TracedArgument("projection", np.zeros(values, kind)),
        TracedArgument("scale", np.ones(rows, np.float32)),
        TracedArgument("lambda", np.zeros((sizes.probes * sizes.coefficients, 3), np.float32)),
        TracedArgument("rows", np.int32(rows)),
        TracedArgument("basis", np.zeros((rows, 3), np.float32), 0, True),
    ]
    defines = {"STORAGE": _storage(sizes), "COMPONENTS": _COMPONENTS}
    file = "srp/published_transport.cl"
    return _request(file, "cluster_projection", defines, args, -(-rows // _GROUP), profile)


def _transport(sizes: Sizes, profile: DeviceProfile) -> TraceRequest:
    table, _, _ = _clusters(sizes)
    cluster = np.linspace(0, sizes.clusters, sizes.receivers, endpoint=False).astype(np.int32)
    per = table[cluster, 1]
    first = (np.cumsum(per.astype(np.int64)) - per).astype(np.int32)
    kind = np.float16 if sizes.half else np.float32
    args = [
        TracedArgument("clusters", table),
        TracedArgument("receiver_cluster", cluster),
        TracedArgument("reconstruction", np.zeros(int(per.sum()), kind)),
        TracedArgument("first_value", first),
        TracedArgument("texel", np.arange(sizes.receivers, dtype=np.int32)),
        TracedArgument("basis", np.zeros((sizes.rows, 3), np.float32)),
        TracedArgument("receivers", np.int32(sizes.receivers)),
        TracedArgument("indirect", np.zeros((sizes.receivers, 4), np.float32), 0, True),
    ]
    groups = -(-sizes.receivers // _GROUP)
    defines = {"STORAGE": _storage(sizes), "COMPONENTS": _COMPONENTS}
    return _request(
        "srp/published_transport.cl", "irradiance_transport", defines, args, groups, profile
    )


def _storage(sizes: Sizes) -> int:
    return 1 if sizes.half else 0


def _probe_update(sizes: Sizes, profile: DeviceProfile) -> TraceRequest:
    """Every ray meets a receiver somewhere in the map."""
    hits = sizes.probes * sizes.rays
    rng = np.random.default_rng(0)
    per_coefficient = 12 * min(_GROUP, profile.max_workgroup_size)
    chunk = max(1, min(sizes.coefficients, profile.local_memory_bytes // per_coefficient))
    starts = np.arange(sizes.probes + 1, dtype=np.int32)
    rays = np.tile(np.arange(sizes.rays, dtype=np.int32), sizes.probes)
    texels = rng.integers(0, sizes.receivers, hits).astype(np.int32)
    basis = np.zeros((sizes.rays, sizes.coefficients), np.float32)
    light = np.zeros((sizes.probes, sizes.coefficients, 3), np.float32)
    args = [
        TracedArgument(
            "updated", np.append(sizes.probes, np.arange(sizes.probes)).astype(np.int32)
        ),
        TracedArgument("hit_start", starts * sizes.rays),
        TracedArgument("hit_sample", rays),
        TracedArgument("hit_texel", texels),
        TracedArgument("miss_start", np.zeros_like(starts)),
        TracedArgument("miss_sample", np.zeros(1, np.int32)),
        TracedArgument("directions", np.zeros((sizes.rays, 3), np.float32)),
        TracedArgument("basis", basis),
        TracedArgument("coefficients", np.int32(sizes.coefficients)),
        TracedArgument("radiance", np.zeros((sizes.receivers, 4), np.float32)),
        *_environment(),
        TracedArgument("lambda", light, 0, True),
        TracedArgument("sums", None, chunk * per_coefficient),
    ]
    file = "srp/published_probes.cl"
    return _request(file, "probe_update", {"CHUNK": chunk}, args, sizes.probes, profile)


def _environment() -> list[TracedArgument]:
    return [
        TracedArgument("environment", np.zeros((1, 3), np.float32)),
        TracedArgument("environment_width", np.int32(1)),
        TracedArgument("environment_height", np.int32(1)),
    ]
