"""The reference's sample sequences against their formulas and SciPy's Sobol points."""

import numpy as np
import pyopencl as cl
import pytest
from scipy.stats import qmc
from support import reference_oracle as oracle

from gibench.device.source import kernel_source
from gibench.reference import host_cl


@pytest.fixture(scope="module")
def draw():
    """sample_2d, sample_1d, the second Sobol dimension and cos_sin_turns, as kernels."""
    context = host_cl.host_program().device.context
    source = """
    __kernel void draw(__global const uint *index, uint seed, __global float *out) {
        const uint i = get_global_id(0);
        float x, y, c, s;
        sample_2d(index[i], seed, &x, &y);
        cos_sin_turns(unit_float(index[i] << 8), &c, &s);
        vstore4((float4)(x, y, c, s), i, out);
        out[4 * get_global_size(0) + i] = sample_1d(index[i], seed);
        out[5 * get_global_size(0) + i] = unit_float(reverse_bits(sobol_second_reversed(index[i])));
    }"""
    program = cl.Program(context, kernel_source("reference/sampler.cl") + source).build()
    kernel = cl.Kernel(program, "draw")

    def run(index, seed):
        host = host_cl.host_program()
        out, index = np.empty(6 * len(index), np.float32), np.asarray(index, np.uint32)
        held, given = host.share(out), host.share(index)
        kernel(host.queue, (len(index),), None, given.mem, np.uint32(seed), held.mem)
        host.queue.finish()
        n = len(index)
        return out[: 4 * n].reshape(n, 4), out[4 * n : 5 * n], out[5 * n :]

    return run


def test_samples_equal_the_formulas(rng, draw):
    index = rng.integers(0, 1 << 32, 200, dtype=np.uint32)
    seed = int(rng.integers(0, 1 << 32))
    pairs, single, second = draw(index, seed)
    turns = (index & 0xFFFFFF) * 2.0**-24
    assert pairs[:, 2] == pytest.approx(np.cos(2 * np.pi * turns), abs=1e-6)
    assert pairs[:, 3] == pytest.approx(np.sin(2 * np.pi * turns), abs=1e-6)
    for i, n in enumerate(index.tolist()):
        assert pairs[i, :2].tolist() == oracle.sample_2d(n, seed).tolist()
        assert single[i] == oracle.sample_1d(n, seed)
        assert second[i] == oracle.unit(oracle.second_sobol(n))


def test_the_second_dimension_is_sobols(draw):
    count = 1 << 10
    order = np.arange(count) ^ np.arange(count) >> 1  # SciPy goes by Gray code
    theirs = qmc.Sobol(2, scramble=False).random(count)[:, 1]
    assert draw(order, 0)[2] == pytest.approx(theirs, abs=1e-7)


def test_samples_are_stratified_and_scrambled(draw):
    """Any aligned 2^k samples have one point in each elementary interval of area 2^-k."""
    seen = []
    for seed in (1, 99, 0xDEADBEEF):
        pairs, single, _ = draw(np.arange(64) + 64 * (seed % 5), seed)
        for power in range(7):
            x = np.floor(pairs[:, 0] * (1 << power)).astype(int)
            y = np.floor(pairs[:, 1] * (64 >> power)).astype(int)
            assert len(set(zip(x.tolist(), y.tolist(), strict=True))) == 64
        assert len(set(np.floor(single * 64).astype(int).tolist())) == 64
        seen.append(pairs)
    assert abs(np.corrcoef(seen[0][:, 0], seen[1][:, 0])[0, 1]) < 0.5
    assert not np.allclose(seen[1], seen[2])
