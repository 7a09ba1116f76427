"""The inlined builtins (kernels_cl/common/builtins.cl) against NumPy."""

import numpy as np
import pyopencl as cl
import pytest

from gibench.device import list_devices
from gibench.device.source import kernel_source

COUNT = 200
SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 3.0, -3.0, 1e-30, 1e30, 2.0**23 + 1)


def length(v):
    return np.sqrt((v * v).sum(axis=1, keepdims=True))


def smoothstep(x, low, high):
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


# An expression of a, b, t (t in [0, 1]) and what it is in NumPy.
EACH = {
    "min(a, b)": lambda a, b, t: np.minimum(a, b),
    "max(a, b)": lambda a, b, t: np.maximum(a, b),
    "min(a, 0.25f)": lambda a, b, t: np.minimum(a, 0.25),
    "clamp(a, -1.0f, 2.0f)": lambda a, b, t: np.clip(a, -1, 2),
    "fmin(a, b)": lambda a, b, t: np.fmin(a, b),
    "fmax(a, b)": lambda a, b, t: np.fmax(a, b),
    "fmax(a, NAN)": lambda a, b, t: a,
    "fabs(a)": lambda a, b, t: np.abs(a),
    "floor(a)": lambda a, b, t: np.floor(a),
    "ceil(a)": lambda a, b, t: np.ceil(a),
    "sqrt(fabs(a))": lambda a, b, t: np.sqrt(np.abs(a)),
    "rsqrt(fabs(a) + 1e-20f)": lambda a, b, t: 1 / np.sqrt(np.abs(a) + 1e-20),
    "copysign(b, a)": lambda a, b, t: np.copysign(b, a),
    "mix(t, 1.0f - t, t)": lambda a, b, t: t + (1 - 2 * t) * t,
    "smoothstep((TYPE)(-1.0f), (TYPE)(2.0f), a)": lambda a, b, t: smoothstep(a, -1, 2),
    "select(a, b, a < b)": lambda a, b, t: np.where(a < b, b, a),
}
GEOMETRY = {
    "(TYPE)(dot(t, t))": lambda a, b, t: np.broadcast_to((t * t).sum(1, keepdims=True), t.shape),
    "(TYPE)(length(t))": lambda a, b, t: np.broadcast_to(length(t), t.shape),
    "(TYPE)(distance(t, 1.0f - t))": lambda a, b, t: np.broadcast_to(length(2 * t - 1), t.shape),
    "normalize(t)": lambda a, b, t: t / length(t),
    "normalize(0.0f * t)": lambda a, b, t: 0 * t,
}


def values(rng, width):
    """a and b (n, width) float32 with special values among them, t in [0, 1]."""
    a, b = rng.normal(scale=2, size=(2, COUNT, width))
    a[: len(SPECIAL)] = np.array(SPECIAL)[:, None]
    b[: len(SPECIAL)] = rng.permutation(SPECIAL)[:, None]
    return a.astype(np.float32), b.astype(np.float32), rng.random((COUNT, width), np.float32)


def computed(source, arrays, out):
    context = cl.Context([list_devices()[0]])
    queue = cl.CommandQueue(context)
    program = cl.Program(context, kernel_source("common/vec_width.cl") + source).build(["-w"])
    flags = cl.mem_flags
    held = [cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=a) for a in arrays]
    result = cl.Buffer(context, flags.READ_WRITE | flags.COPY_HOST_PTR, hostbuf=out)
    program.compute(queue, (COUNT,), None, *held, result)
    cl.enqueue_copy(queue, out, result)
    return out


@pytest.mark.parametrize("width", [1, 3, 8])
def test_builtins_equal_numpy(rng, width):
    expressions = dict(EACH) | (GEOMETRY if 2 <= width <= 4 else {})
    if width > 1:
        expressions.pop("min(a, 0.25f)") if width in (8, 16) else None
    a, b, t = values(rng, width)
    kind, load = ("float", "p[i]") if width == 1 else (f"float{width}", f"vload{width}(i, p)")
    store = "out[at] = v" if width == 1 else f"vstore{width}(v, at, out)"
    lines = [
        f"{{ const TYPE v = {text}; const size_t at = {k} * {COUNT}u + i; {store}; }}"
        for k, text in enumerate(expressions)
    ]
    source = f"""
    #define TYPE {kind}
    #define LOAD(p) {load.replace("p[", "(p)[").replace(", p)", ", (p))")}
    __kernel void compute(__global const float *pa, __global const float *pb,
                          __global const float *pt, __global float *out) {{
        const size_t i = get_global_id(0);
        const TYPE a = LOAD(pa), b = LOAD(pb), t = LOAD(pt);
        {" ".join(lines)}
    }}"""
    out = np.full((len(expressions), COUNT, width), np.nan, np.float32)
    computed(source, (a, b, t), out)
    doubles = a.astype(np.float64), b.astype(np.float64), t.astype(np.float64)
    for found, (text, wanted) in zip(out, expressions.items(), strict=True):
        expected = wanted(*doubles)
        np.testing.assert_allclose(found, expected, rtol=2e-6, atol=1e-37, err_msg=text)
        if text.startswith("copysign"):
            np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


def test_integers_halves_and_conversions(rng):
    ints = rng.integers(-9, 9, (COUNT, 16), np.int32)
    floats = rng.normal(scale=9, size=(COUNT, 16)).astype(np.float32)
    source = """
    __kernel void compute(__global const int *i, __global const float *f, __global float *out) {
        const size_t n = get_global_id(0);
        const int3 a = vload3(0, i + 16 * n), b = vload3(1, i + 16 * n);
        const float3 x = vload3(0, f + 16 * n), y = vload3(1, f + 16 * n);
        __global float *o = out + 74 * n;
        vstore3(convert_float3(clamp(a, (int3)(-3), b + 9)), 0, o);
        vstore3(convert_float3(min(a, b) + 20 * max(a, b)), 1, o);
        vstore3(convert_float3(convert_int3(x)), 2, o);
        vstore3(convert_float3(convert_int3_rtn(x)), 3, o);
        vstore3(cross(x, y), 4, o);
        o[15] = any(a < -5);
        o[16] = clz((uint)(a.x + 9));
        vstore16(convert_float16(vload16(n, i)), 0, o + 17);
        vstore8(convert_float8(convert_int8(vload8(2 * n, f))), 0, o + 33);
        __global half *h = (__global half *)(o + 41);
        vstore_half4((float4)(x, y.x), 0, h);
        vstore_half2(y.yz, 2, h);
        vstore4(vload_half4(0, h), 0, o + 44);
        vstore2(vload_half2(2, h), 0, o + 48);
        __global const short *s = (__global const short *)(i + 16 * n);
        const short4 words = (short4)(s[0], s[2], s[4], s[6]);
        const uint4 positive = (uint4)(a.x + 9, a.y + 9, a.z + 9, 0xffffff00u);
        vstore4(convert_float4(words), 0, o + 50);
        vstore4(convert_float4(convert_int4(words)), 0, o + 54);
        vstore4(convert_float4(positive), 0, o + 58);
        vstore2(convert_float2((uchar2)(a.x + 9, 255)), 0, o + 62);
        o += 64;
        vstore3(convert_float3(convert_int3_sat(x)), 0, o);
        vstore3(convert_float3(convert_int3_sat((float3)(3e9f, -3e9f, NAN))), 1, o);
        vstore_half(x.y, 0, h);
        vstore3(vload_half3(1, h), 2, o);
        o[9] = vload_half(0, h);
    }"""
    out = computed(source, (ints, floats), np.zeros((COUNT, 74), np.float32))
    a, b, x, y = ints[:, :3], ints[:, 3:6], floats[:, :3], floats[:, 3:6]
    pairs = {
        (0, 3): np.minimum(np.maximum(a, -3), b + 9),
        (3, 6): np.minimum(a, b) + 20 * np.maximum(a, b),
        (6, 9): np.trunc(x),
        (9, 12): np.floor(x),
        (15, 16): (a < -5).any(axis=1, keepdims=True),
        (16, 17): 32 - np.ceil(np.log2(a[:, :1] + 10.0)),
        (17, 33): ints,
        (33, 41): np.trunc(floats[:, :8]),
        (44, 50): floats[:, :6].astype(np.float16),
        (50, 58): np.tile(ints[:, :4], 2),
        (58, 62): np.column_stack([a + 9.0, np.full(COUNT, 2.0**32 - 256)]),
        (62, 64): np.column_stack([a[:, 0] + 9.0, np.full(COUNT, 255.0)]),
        (64, 67): np.trunc(x),
        (67, 70): np.tile([2.0**31, -(2.0**31), 0.0], (COUNT, 1)),
        (70, 73): y.astype(np.float16),
        (73, 74): x[:, 1:2].astype(np.float16),
    }
    for (first, last), expected in pairs.items():
        np.testing.assert_array_equal(out[:, first:last], expected.astype(np.float32))
    np.testing.assert_allclose(out[:, 12:15], np.cross(x.astype(float), y), rtol=1e-5, atol=1e-4)
