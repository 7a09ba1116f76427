from __future__ import annotations

import re

import numpy as np
import pyopencl as cl
import pytest
from scipy.special import sph_harm_y
from support.vector_widths import widths

from gibench.device import kernel_source, list_devices
from gibench.techniques.parts.octahedral_maps import octahedral_decode
from gibench.techniques.srp.bake.sampling import sphere_directions, strata
from gibench.techniques.srp.bake.sh import sh_basis


def random_directions(count, seed):
    d = np.random.default_rng(seed).standard_normal((count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def test_basis_is_scipys_real_harmonics_without_condon_shortley():
    d = random_directions(500, 1)
    polar, azimuth = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
    basis = sh_basis(7, d)
    for degree in range(8):
        for m in range(-degree, degree + 1):
            y = sph_harm_y(degree, abs(m), polar, azimuth) * (-1.0) ** m  # undo the phase
            real = y.real if m == 0 else np.sqrt(2) * (y.real if m > 0 else y.imag)
            assert np.allclose(basis[:, degree * (degree + 1) + m], real, atol=1e-12), (degree, m)


def test_basis_is_orthonormal():
    # Gauss-Legendre in z and the trapezoid rule in azimuth are exact for these polynomials.
    z, weight = np.polynomial.legendre.leggauss(10)
    azimuth = 2 * np.pi * np.arange(20) / 20
    zz, aa = np.meshgrid(z, azimuth, indexing="ij")
    r = np.sqrt(1 - zz**2)
    d = np.stack([r * np.cos(aa), r * np.sin(aa), zz], axis=-1).reshape(-1, 3)
    w = np.repeat(weight, 20) * 2 * np.pi / 20
    basis = sh_basis(7, d)
    assert np.allclose(basis.T @ (w[:, None] * basis), np.eye(64), atol=1e-12)


def octahedral_cells(directions, grid):
    """The cell (row * grid + column) of each direction (n, 3)."""
    d = np.asarray(directions, np.float64)
    d = d / np.abs(d).sum(axis=1, keepdims=True)
    folded = (1.0 - np.abs(d[:, 1::-1])) * np.where(d[:, :2] >= 0, 1.0, -1.0)
    p = np.where((d[:, 2] >= 0)[:, None], d[:, :2], folded)
    at = np.clip(((p * 0.5 + 0.5) * grid).astype(np.int64), 0, grid - 1)
    return at[:, 1] * grid + at[:, 0]


@pytest.mark.parametrize("order", range(8))
def test_lower_orders_are_a_prefix(order):
    d = random_directions(20, 2)
    assert np.array_equal(sh_basis(order, d), sh_basis(7, d)[:, : (order + 1) ** 2])


PROBE = """
#include "common/sh.cl"
#include "common/octahedral.cl"
__kernel void basis(__global const float *d, __global const float *w, __global float *out,
                    __global int *cell)
{
    const int i = get_global_id(0);
    vfloat x = vec_load(0, d + 3 * VEC * i), y = vec_load(1, d + 3 * VEC * i);
    vfloat z = vec_load(2, d + 3 * VEC * i);
    vfloat sums[SH_COUNT];
    for (int j = 0; j < SH_COUNT; ++j)
        sums[j] = (vfloat)(0.0f);
    sh_accumulate(x, y, z, vec_load(i, w), sums);
    for (int j = 0; j < SH_COUNT; ++j)
        vec_store(sums[j], 0, out + (size_t)(i * SH_COUNT + j) * VEC);
    for (int k = 0; k < VEC; ++k) {
        __global const float *p = d + 3 * VEC * i + k;
        cell[i * VEC + k] = octahedral_cell((float3)(p[0], p[VEC], p[2 * VEC]), 37);
    }
}
"""


@pytest.mark.parametrize(("vector", "order"), widths((1, 2), (2, 0), (4, 5), (8, 6), (16, 7)))
def test_kernel_basis_and_cells(vector, order):
    source = re.sub(
        r'#include "([^"]+)"', lambda match: kernel_source(match.group(1)), PROBE, count=2
    )
    context = cl.Context([list_devices()[0]])
    queue = cl.CommandQueue(context)
    program = cl.Program(context, source).build(options=[f"-DVEC={vector}", f"-DSH_ORDER={order}"])
    items, count = 5, (order + 1) ** 2
    d = random_directions(items * vector, 3 + order).astype(np.float32)
    weight = np.random.default_rng(4).random(items * vector).astype(np.float32)
    layout = np.ascontiguousarray(d.reshape(items, vector, 3).transpose(0, 2, 1))
    flags = cl.mem_flags.COPY_HOST_PTR
    buffers = [
        cl.Buffer(context, flags, hostbuf=a)
        for a in (
            layout,
            weight,
            np.zeros((items, count, vector), np.float32),
            np.zeros(items * vector, np.int32),
        )
    ]
    cl.Kernel(program, "basis")(queue, (items,), (1,), *buffers)
    out = np.empty((items, count, vector), np.float32)
    cells = np.empty(items * vector, np.int32)
    cl.enqueue_copy(queue, out, buffers[2])
    cl.enqueue_copy(queue, cells, buffers[3])
    expected = sh_basis(order, d) * weight[:, None]
    got = out.transpose(0, 2, 1).reshape(-1, count)
    assert np.abs(got - expected).max() < 3e-6
    assert (cells == octahedral_cells(d, 37)).mean() > 0.98  # a cell's edge may round either way


def test_octahedral_map_round_trip():
    d = random_directions(2000, 5)
    grid = 64
    cells = octahedral_cells(d, grid)
    at = (np.stack([cells % grid, cells // grid], axis=1) + 0.5) / grid * 2 - 1
    # Half a cell, 1/64 each way, is at most sqrt(6)/64 off in space, seen from 1/sqrt(3) or more.
    furthest = np.sqrt(6.0) / grid * np.sqrt(3.0)
    assert (np.arccos((octahedral_decode(at) * d).sum(axis=1)) < furthest).all()


@pytest.mark.parametrize("count", [1, 7, 100, 1024, 1031, 8000])
def test_stratified_directions(count):
    d = sphere_directions(count, np.random.default_rng(6))
    assert d.shape == (count, 3)
    assert np.allclose(np.linalg.norm(d, axis=1), 1)
    if count >= 1000:
        # Stratification: far below the 1 / sqrt(count) of independent samples.
        gram = sh_basis(2, d).T @ sh_basis(2, d) * (4 * np.pi / count)
        assert np.abs(gram - np.eye(9)).max() < 0.02
    assert np.prod(strata(count)) == count
