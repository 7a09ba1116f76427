"""SRP's two matrix products at the size of the paper's Sponza, against three yardsticks.

Run with ``pytest tests/benchmarks/bench_srp.py --benchmark-enable -s``. In alternating rounds of
one run: the tuned passes, the published ones, the same products by NumPy in float32 on two
threads, and a large streaming read. The data is random and has the paper's sizes (Silvennoinen
and Lehtinen 2017, table 1 and section 5: 246 325 receivers, 150 probes, 935 clusters, 24.4 vectors
per receiver, 20 probes per cluster, order 7); speed does not depend on its values.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
import pyopencl as cl
import pytest
from support.made import made
from support.synthetic_bake import random_lightmap, random_scene, random_unit

from gibench.device import Device
from gibench.measure.session.enqueue import prepare_passes
from gibench.profiles import load_profile
from gibench.techniques.srp import SPEC
from gibench.techniques.srp.bake.data import Cluster, ProbeSet, RelightSamples, SrpBake

RECEIVERS, PROBES, CLUSTERS, REACH, COEFFICIENTS = 246_325, 150, 935, 20, 64
SIDE = 833  # texels of the lightmap's side
WORKGROUP = 256
ROUNDS = 15
PRODUCTS = ("cluster_projection", "irradiance_transport")


def sponza_sized(rng):
    """A bake and an atlas of the paper's sizes."""
    scene = random_scene(rng)
    # About as many charts as Sponza's atlas has (10 492), 5 x 5 texels each with a free row and
    # column between them.
    cells = rng.choice((SIDE // 6) ** 2, RECEIVERS // 25, replace=False)
    corner = (cells // (SIDE // 6) * SIDE + cells % (SIDE // 6)) * 6
    inside = np.add.outer(np.arange(5) * SIDE, np.arange(5)).reshape(-1)
    texel = np.sort(np.add.outer(corner, inside).reshape(-1)).astype(np.int32)
    lightmap = random_lightmap(rng, scene, RECEIVERS, SIDE, SIDE)
    lightmap = replace(lightmap, receivers=replace(lightmap.receivers, texel=texel))
    # Clusters are compact in space and so, piecewise, in the atlas: runs along 16 x 16 tiles.
    y, x = np.divmod(lightmap.receivers.texel, SIDE)
    order = np.lexsort((x, y, x // 16, y // 16)).astype(np.int32)
    sizes = np.full(CLUSTERS, RECEIVERS // CLUSTERS)
    sizes[: RECEIVERS % CLUSTERS] += 1
    # Vectors per cluster from 12 to 32 with a mean of 24.4.
    vectors = np.clip(np.rint(rng.normal(24.6, 6.0, CLUSTERS)), 12, 32).astype(int)
    clusters = []
    for members, rows in zip(np.split(order, np.cumsum(sizes)[:-1]), vectors, strict=True):
        first = int(rng.integers(0, PROBES - REACH))
        clusters.append(
            Cluster(
                members,
                np.arange(first, first + REACH, dtype=np.int32),
                rng.standard_normal((rows, REACH * COEFFICIENTS), dtype=np.float32),
                rng.standard_normal((len(members), rows), dtype=np.float32),
                0.0,
            )
        )
    samples = 1024
    texel = rng.choice(lightmap.receivers.texel, (PROBES, samples)).astype(np.int32)
    texel[rng.random((PROBES, samples)) < 0.2] = -1
    basis = rng.standard_normal((samples, COEFFICIENTS), dtype=np.float32) / samples
    relight = RelightSamples(random_unit(rng, samples), basis, texel)
    positions = rng.uniform(-1, 1, (PROBES, 3)).astype(np.float32)
    bake = SrpBake(7, ProbeSet(positions, 1.0), relight, tuple(clusters), 1.0, 10.0)
    return scene, lightmap, bake


@dataclass
class Prepared:
    technique: object
    passes: dict

    def milliseconds(self, name):
        """Event time of one pass."""
        queue = self.technique.device.queue
        events = [launch.enqueue(queue) for launch in self.passes[name].launches]
        queue.finish()
        return sum(event.profile.end - event.profile.start for event in events) * 1e-6


def prepare(case, variant, storage):
    scene, lightmap, bake = case
    device = Device(load_profile("vega56"))
    settings = SPEC.settings({"storage": storage})
    technique = made(
        *(SPEC, device, scene, lightmap, settings, bake, variant, WORKGROUP, 64, 64),
        scene.cameras[0],
    )
    passes = {one.name: one for one in prepare_passes(technique, WORKGROUP)}
    assert all(one.status == "ok" for one in passes.values()), passes
    for one in passes.values():
        for launch in one.launches:
            launch.enqueue(device.queue)
    return Prepared(technique, passes)


class Read:
    """A streaming read of 256 MiB by every vector lane the device has."""

    SOURCE = """
    __kernel void stream_read(__global const float16 *data, int per_item, __global float *out)
    {
        __global const float16 *mine = data + (size_t)get_global_id(0) * per_item;
        float16 a = 0.0f, b = 0.0f;
        for (int i = 0; i < per_item; i += 2) {
            a += mine[i];
            b += mine[i + 1];
        }
        a += b;
        out[get_global_id(0)] = a.s0 + a.s7 + a.sf;
    }
    """
    ITEMS, PER_ITEM = 4096, 1024

    def __init__(self, device):
        self.queue = device.queue
        self.kernel = cl.Kernel(cl.Program(device.context, self.SOURCE).build(), "stream_read")
        self.data = device.empty("stream", self.ITEMS * self.PER_ITEM * 16, np.float32)
        self.out = device.empty("stream_out", self.ITEMS, np.float32)
        self.kernel.set_args(self.data.mem, np.int32(self.PER_ITEM), self.out.mem)

    def gb_per_s(self):
        event = cl.enqueue_nd_range_kernel(self.queue, self.kernel, (self.ITEMS,), (64,))
        self.queue.finish()
        return self.data.nbytes / (event.profile.end - event.profile.start)


class NumPyProducts:
    """The same two products in float32; BLAS uses the machine's two cores."""

    def __init__(self, bake, radiance):
        self.clusters = bake.clusters
        self.radiance = radiance
        self.out = np.zeros((RECEIVERS, 3), np.float32)

    def milliseconds(self):
        begin = time.perf_counter()
        for cluster in self.clusters:
            light = self.radiance[cluster.probes].reshape(-1, 3)
            self.out[cluster.receivers] = cluster.reconstruction @ (cluster.projection @ light)
        return (time.perf_counter() - begin) * 1e3


@pytest.fixture(scope="module")
def case():
    return sponza_sized(np.random.default_rng(7))


@pytest.mark.parametrize("storage", ["fp16", "snorm16", "fp32"])
def test_products_in_one_run(case, storage):
    tuned, published = prepare(case, "tuned", storage), prepare(case, "published", storage)
    read = Read(tuned.technique.device)
    numpy_products = NumPyProducts(case[2], tuned.technique.variant.probe_radiance())
    times = {key: [] for key in ("read", "numpy", *((v, p) for v in "tp" for p in ALL))}
    for _ in range(ROUNDS):
        times["read"].append(read.gb_per_s())
        for key, variant in (("t", tuned), ("p", published)):
            for name in ALL:
                times[key, name].append(variant.milliseconds(name))
        times["numpy"].append(numpy_products.milliseconds())
    median = {key: float(np.median(values)) for key, values in times.items()}
    stored = sum(tuned.technique.sizes.__dict__[n] for n in ("projection", "reconstruction"))
    nbytes = stored * (4 if storage == "fp32" else 2)
    bound = nbytes / median["read"] * 1e-6
    both = {v: sum(median[v, p] for p in PRODUCTS) for v in "tp"}
    best = {v: sum(min(times[v, p]) for p in PRODUCTS) for v in "tp"}
    print(f"\n{storage}: {nbytes / 1e6:.1f} MB stored, read {median['read']:.1f} GB/s")
    for name in ALL:
        print(f"  {name:22s} tuned {median['t', name]:8.3f} published {median['p', name]:8.3f} ms")
    print(
        f"  products: tuned {both['t']:.2f} (best {best['t']:.2f}), published {both['p']:.2f}, "
        f"NumPy {median['numpy']:.2f} ms; bandwidth bound {bound:.2f} ms: "
        f"{bound / both['t']:.0%} of it, {both['p'] / both['t']:.1f} x published, "
        f"{median['numpy'] / both['t']:.1f} x NumPy"
    )
    a, b = (v.technique.variant.probe_radiance() for v in (tuned, published))
    np.testing.assert_allclose(a, b, rtol=0, atol=2e-6 * np.abs(a).max())


ALL = ("probe_update", *PRODUCTS)


@pytest.mark.parametrize("name", PRODUCTS)
def test_pass(benchmark, case, name):
    tuned = prepare(case, "tuned", "fp16")
    benchmark(tuned.milliseconds, name)
