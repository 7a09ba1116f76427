"""The random words of the kernels (kernels_cl/common/random.cl) against their published definition.

Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", JCGT 9(3), listing of pcg3d.
"""

import numpy as np
import pyopencl as cl
import pytest
from support.gibs_surfels import any_size_device, defines

from gibench.device import kernel_source
from gibench.device.build import macro_options

WORDS = """
__kernel void words(__global const uint *in, __global uint *out, __global float *unit)
{
    const int i = get_global_id(0);
    const uint3 v = random_words(in[3 * i], in[3 * i + 1], in[3 * i + 2]);
    out[3 * i] = v.x, out[3 * i + 1] = v.y, out[3 * i + 2] = v.z;
    unit[i] = unit_float(in[3 * i]);
}
"""

# Worked out in Python's whole numbers, modulo 2^32.
KNOWN = {
    (0, 0, 0): (0x9BAFD7C6, 0xA8E88A6B, 0x3F15482C),
    (1, 2, 3): (0xFA9F79A6, 0x48F2F44C, 0x596F5AB1),
    (0xFFFFFFFF, 0x80000000, 0x12345678): (0x835177F7, 0x80D9F894, 0xFED61E69),
}


def pcg3d(v: np.ndarray) -> np.ndarray:
    """(n, 3) uint32 to the same, NumPy's arithmetic being modulo 2^32."""
    v = v * np.uint32(1664525) + np.uint32(1013904223)
    x, y, z = v.T.copy()
    for turn in range(2):
        x += y * z
        y += z * x
        z += x * y
        if turn == 0:
            x, y, z = (w ^ (w >> np.uint32(16)) for w in (x, y, z))
    return np.stack([x, y, z], axis=1)


def on_device(words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the kernels make of (n, 3) words: three words each, and the first as a float."""
    device = any_size_device()
    program = cl.Program(device.context, kernel_source("common/random.cl") + WORDS).build(
        [*macro_options(defines(1))]
    )
    given = device.upload("in", words)
    found = device.empty("out", words.shape, np.uint32)
    unit = device.empty("unit", len(words), np.float32)
    cl.Kernel(program, "words")(device.queue, (len(words),), None, given.mem, found.mem, unit.mem)
    return device.read(found), device.read(unit)


def test_known_answers():
    given = np.array(list(KNOWN), np.uint32)
    expected = np.array(list(KNOWN.values()), np.uint32)
    np.testing.assert_array_equal(pcg3d(given), expected)
    np.testing.assert_array_equal(on_device(given)[0], expected)


def test_every_bit_of_many_words(rng):
    given = rng.integers(0, 2**32, (4096, 3), dtype=np.uint32)
    given[:96] = np.concatenate([np.eye(3, dtype=np.uint32) << n for n in range(32)])
    words, unit = on_device(given)
    np.testing.assert_array_equal(words, pcg3d(given))
    # The 24 upper bits, which float32 holds exactly: below 1 for every word.
    np.testing.assert_array_equal(unit, ((given[:, 0] >> 8) / 2.0**24).astype(np.float32))


@pytest.mark.parametrize(("word", "expected"), [(0, 0.0), (0xFF, 0.0), (2**31, 0.5),
                                                (2**32 - 1, 1 - 2.0**-24)])  # fmt: skip
def test_unit_floats(word, expected):
    assert on_device(np.array([[word, 0, 0]], np.uint32))[1][0] == expected
