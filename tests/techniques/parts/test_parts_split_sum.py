"""Glossy reflection (kernels_cl/common/ggx.cl) and the split sum's table against float64."""

from itertools import pairwise

import numpy as np
import pyopencl as cl
import pytest
from support.gibs_surfels import any_size_device, defines

from gibench.device import kernel_source
from gibench.device.build import macro_options
from gibench.scene.gloss import LEAST_ALPHA
from gibench.techniques.parts.split_sum import (
    GLOSS_MACROS,
    SPLIT_SUM_SIDE,
    hammersley,
    split_sum,
    split_sum_table,
)

TERMS = """
__kernel void terms(__global const float *n, __global const float *v, __global const float *l,
                    __global const float *roughness, __global const float *f0,
                    __global const float *split_sum, __global float *reflectance,
                    __global float *share)
{
    const int i = get_global_id(0);
    const float3 normal = load3(n, i), to_eye = load3(v, i);
    store3(reflectance, i, glossy_reflectance(normal, to_eye, load3(l, i), ggx_alpha(roughness[i]),
                                              load3(f0, i)));
    store3(share, i, glossy_share(split_sum, load3(f0, i), dot(normal, to_eye), roughness[i]));
}
"""


def reflectance(n, v, w, roughness, f0):
    """(n, 3) of light from w towards v, written from the formulas."""
    alpha = np.maximum(roughness**2, LEAST_ALPHA)
    h = v + w
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    n_v, n_l, n_h, v_h = (np.sum(a * b, axis=-1) for a, b in ((n, v), (n, w), (n, h), (v, h)))
    facets = alpha**2 / (np.pi * (n_h**2 * (alpha**2 - 1) + 1) ** 2)
    k = alpha / 2
    hidden = n_v / (n_v * (1 - k) + k) * n_l / (n_l * (1 - k) + k)
    fresnel = f0 + (1 - f0) * (1 - v_h)[..., None] ** 5
    found = fresnel * (facets * hidden / (4 * n_v * n_l))[..., None]
    return np.where(((n_v > 0) & (n_l > 0))[..., None], found, 0.0)


def integrated(n_v, roughness, nodes=200):
    """Scale and offset by Gauss's quadrature over the directions that light comes from, finer
    about the mirrored one.
    """
    mirrored = np.arccos(n_v)
    alpha = max(roughness**2, LEAST_ALPHA)
    x, x_w = np.polynomial.legendre.leggauss(nodes // 5)
    cuts = np.unique(
        np.clip(mirrored + alpha * np.array([-400, -8, -1, 0, 1, 8, 400]), 0, np.pi / 2)
    )
    polar = np.concatenate([(a + b) / 2 + (b - a) / 2 * x for a, b in pairwise(cuts)])
    weight = np.concatenate([(b - a) / 2 * x_w for a, b in pairwise(cuts)])
    # Half a turn is the other's mirror.
    s, around_w = np.polynomial.legendre.leggauss(nodes)
    s, around_w = (s + 1) / 2, around_w / 2
    around, around_w = np.pi * s**4, around_w * np.pi * 4 * s**3
    t, p = np.meshgrid(polar, around, indexing="ij")
    w = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    n = np.array([0.0, 0.0, 1.0])
    v = np.array([-np.sin(mirrored), 0.0, n_v])
    area = 2 * weight[:, None] * around_w * np.sin(t) * np.cos(t)
    both = [
        float((area * reflectance(n, v, w, np.float64(roughness), np.full(1, f0))[..., 0]).sum())
        for f0 in (0.0, 1.0)
    ]
    return both[1] - both[0], both[0]


@pytest.mark.parametrize("size", [1, 7, 64])
def test_terms(rng, size):
    count = 449
    drawn = rng.normal(size=(3, count, 3))
    n, v, w = drawn / np.linalg.norm(drawn, axis=2, keepdims=True)
    v = np.where(np.sum(n * v, axis=1)[:, None] < 0, -v, v)
    f0, roughness = rng.uniform(0, 1, (count, 3)), rng.uniform(0.15, 1, count)
    device = any_size_device()
    options = macro_options({**defines(1), **GLOSS_MACROS})
    program = cl.Program(device.context, kernel_source("common/ggx.cl") + TERMS).build([*options])
    given = [
        device.upload(f"given{i}", np.ascontiguousarray(a, np.float32))
        for i, a in enumerate((n, v, w, roughness, f0, split_sum_table()))
    ]
    found = [device.empty(name, (count, 3), np.float32) for name in ("reflectance", "share")]
    buffers = [b.mem for b in (*given, *found)]
    kernel = cl.Kernel(program, "terms")
    kernel(device.queue, (count // size * size,), (size,), *buffers)
    done = count // size * size
    n, v, w, f0, roughness = (
        a.astype(np.float32).astype(np.float64)[:done] for a in (n, v, w, f0, roughness)
    )
    expected = reflectance(n, v, w, roughness, f0)
    assert 0.3 < (expected > 0).mean() < 0.7
    got = device.read(found[0])[:done]
    # Where a direction grazes the surface rounding decides.
    sure = np.minimum(np.abs(np.sum(n * v, axis=1)), np.abs(np.sum(n * w, axis=1))) > 1e-4
    np.testing.assert_allclose(got[sure], expected[sure], rtol=3e-4, atol=1e-6)
    share = device.read(found[1])[:done]
    x = np.clip(np.sum(n * v, axis=1) * SPLIT_SUM_SIDE - 0.5, 0, SPLIT_SUM_SIDE - 1)
    y = np.clip(roughness * SPLIT_SUM_SIDE - 0.5, 0, SPLIT_SUM_SIDE - 1)
    i, j = (np.minimum(a.astype(int), SPLIT_SUM_SIDE - 2) for a in (x, y))
    table, a, b = split_sum_table().astype(np.float64), (x - i)[:, None], (y - j)[:, None]
    upper = (1 - a) * table[j, i] + a * table[j, i + 1]
    lower = (1 - a) * table[j + 1, i] + a * table[j + 1, i + 1]
    both = (1 - b) * upper + b * lower
    np.testing.assert_allclose(share, f0 * both[:, :1] + both[:, 1:], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.35, 0.5, 0.75, 1.0])
def test_table_against_numerical_integration(rng, roughness):
    """At a view drawn afresh, and at two that are steep and shallow."""
    for n_v in (0.95, 0.12, float(rng.uniform(0.1, 1))):
        expected = integrated(n_v, roughness)
        found = split_sum(np.array([n_v]), np.array([roughness]))[0]
        np.testing.assert_allclose(found, expected, atol=4e-3)
        assert 0 < found.sum() < 1 + 1e-6  # no surface sends out more than falls on it


def test_the_table_holds_its_cells_middles():
    table = split_sum_table()
    for row, column in ((0, 63), (20, 5), (63, 0)):
        middle = (np.array([column, row]) + 0.5) / SPLIT_SUM_SIDE
        np.testing.assert_allclose(
            table[row, column], split_sum(middle[:1], middle[1:])[0], rtol=1e-6
        )
    # A mirror seen straight reflects f0.
    np.testing.assert_allclose(table[0, 63], [1, 0], atol=1e-3)


def test_hammersley_points_are_the_published_ones():
    """Anonymous 2022, table 4.1."""
    np.testing.assert_array_equal(hammersley(8)[1:5, 1], [0.5, 0.25, 0.75, 0.125])
    points = hammersley(256)
    assert len(np.unique(np.floor(points * 16), axis=0)) == 256  # one in each cell
