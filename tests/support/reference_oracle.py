"""The reference kernels' formulas once more, in float64 NumPy and one element at a time."""

import numpy as np

MASK = 0xFFFFFFFF


def mix_bits(x):
    x ^= x >> 16
    x = x * 0x7FEB352D & MASK
    x ^= x >> 15
    x = x * 0x846CA68B & MASK
    return x ^ x >> 16


def pair(a, b):
    return mix_bits(a ^ (mix_bits(b) + 0x9E3779B9 & MASK))


def reverse(x):
    return int(f"{x:032b}"[::-1], 2)


def laine_karras(x, seed):
    x ^= x * 0x3D20ADEA & MASK
    x = x + seed & MASK
    x = x * (seed >> 16 | 1) & MASK
    x ^= x * 0x05526C56 & MASK
    return x ^ (x * 0x53A22864 & MASK)


def second_sobol(i):
    """Direction numbers v, v ^ v >> 1, ... (Sobol 1967: the polynomial x + 1)."""
    v, x = 1 << 31, 0
    for bit in range(32):
        if i >> bit & 1:
            x ^= v
        v ^= v >> 1
    return x


def unit(x):
    return (x >> 8) * 2.0**-24


def sample_1d(index, seed):
    i = reverse(laine_karras(reverse(index), seed))
    return unit(reverse(laine_karras(i, mix_bits(seed ^ 0x68BC21EB))))


def sample_2d(index, seed):
    i = reverse(laine_karras(reverse(index), seed))
    second = reverse(second_sobol(i))
    other = unit(reverse(laine_karras(second, mix_bits(seed ^ 0x02E5BE93))))
    return np.array((sample_1d(index, seed), other))


def seed_of(owner, round_seed, dimension):
    return pair(pair(owner, round_seed), dimension)


def unit_vector(v):
    return v / np.linalg.norm(v)


def direction(random, shading):
    """Cosine-distributed, in the frame of Duff et al. 2017."""
    x, y, z = shading
    s = np.copysign(1.0, z)
    a = -1 / (s + z)
    t = np.array((1 + s * x * x * a, s * x * y * a, -s * x))
    b = np.array((x * y * a, s + y * y * a, -y))
    r, angle = np.sqrt(random[0]), 2 * np.pi * random[1]
    return r * np.cos(angle) * t + r * np.sin(angle) * b + np.sqrt(1 - random[0]) * shading


def surface(scene, triangle, u, v):
    """Point, geometric and shading normal, texture coordinates."""
    ids = scene.triangles[triangle]
    w = np.array((1 - u - v, u, v), np.float64)
    a, b, c = scene.positions[ids].astype(np.float64)
    geometric = unit_vector(np.cross(b - a, c - a))
    shading = unit_vector(w @ scene.normals[ids].astype(np.float64))
    if shading @ geometric <= 0:
        shading = geometric
    return w @ np.array((a, b, c)), geometric, shading, w @ scene.uvs[ids].astype(np.float64)


def leave_surface(point, normal):
    """A float32 point moved by up to 256 units in the last place along ``normal``."""
    p, n = np.asarray(point, np.float32), np.asarray(normal, np.float32)
    step = (np.float32(256) * n).astype(np.int32)
    moved = (p.view(np.int32) + np.where(p < 0, -step, step)).view(np.float32)
    return np.where(np.abs(p) < 0.03125, p + np.float32(2**-16) * n, moved).astype(np.float64)


def texture(pixels, uv):
    height, width = pixels.shape[:2]
    x, y = uv[0] * width - 0.5, (1 - uv[1]) * height - 0.5
    i, j = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - i, y - j
    p = pixels.astype(np.float64)
    return (
        p[j % height, i % width] * (1 - fx) * (1 - fy)
        + p[j % height, (i + 1) % width] * fx * (1 - fy)
        + p[(j + 1) % height, i % width] * (1 - fx) * fy
        + p[(j + 1) % height, (i + 1) % width] * fx * fy
    )


def power(chosen, other):
    return chosen**2 / (chosen**2 + other**2)


def choose(table, x):
    """Interval of a cumulative table, and x within it."""
    i = min(int(np.searchsorted(table, np.float32(x), side="right")), len(table) - 1)
    low = float(table[i - 1]) if i else 0.0
    return i, min(max((x - low) / (float(table[i]) - low), 0.0), 0.99999994)
