"""What Mikkelsen's mikktspace.c gives for a mesh: writes tests/scene/mikktspace.json.

Usage: python mikktspace_reference.py FOLDER, which holds mikktspace.c and mikktspace.h (of
github.com/mmikk/MikkTSpace, or of pymikktspace's source).
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

DRIVER = r"""
#include "mikktspace.h"
typedef struct { int count; const float *p, *n, *t; float *out; } Mesh;
static int faces(const SMikkTSpaceContext *c) { return ((Mesh *)c->m_pUserData)->count; }
static int three(const SMikkTSpaceContext *c, const int f) { return 3; }
#define GET(NAME, FIELD, K) static void NAME(const SMikkTSpaceContext *c, float o[], const int f, \
    const int v) { Mesh *m = c->m_pUserData; for (int i = 0; i < K; ++i) \
    o[i] = m->FIELD[(3 * f + v) * K + i]; }
GET(position, p, 3)
GET(normal, n, 3)
GET(coordinate, t, 2)
static void set(const SMikkTSpaceContext *c, const float t[], const float s, const int f,
                const int v) {
    Mesh *m = c->m_pUserData;
    float *o = m->out + (3 * f + v) * 4;
    o[0] = t[0]; o[1] = t[1]; o[2] = t[2]; o[3] = s;
}
int run(int count, const float *p, const float *n, const float *t, float *out) {
    Mesh m = {count, p, n, t, out};
    SMikkTSpaceInterface i = {faces, three, position, normal, coordinate, set, 0};
    SMikkTSpaceContext c = {&i, &m};
    return genTangSpaceDefault(&c);
}
"""


def reference(folder: Path, positions: np.ndarray, normals: np.ndarray, uvs: np.ndarray):
    """The tangents (t, 3, 4) of the code in ``folder``."""
    with tempfile.TemporaryDirectory() as build:
        source = Path(build) / "driver.c"
        source.write_text(DRIVER)
        library = Path(build) / "mikktspace.so"
        files = [str(source), str(folder / "mikktspace.c")]
        command = ["gcc", "-O1", "-shared", "-fPIC", f"-I{folder}", *files, "-lm", "-o"]
        subprocess.run([*command, str(library)], check=True)
        run = ctypes.CDLL(str(library)).run
    arrays = [np.ascontiguousarray(a, np.float32) for a in (positions, normals, uvs)]
    out = np.zeros((len(positions), 3, 4), np.float32)
    pointers = [a.ctypes.data_as(ctypes.POINTER(ctypes.c_float)) for a in (*arrays, out)]
    assert run(len(positions), *pointers)
    return out


def sheet(rng: np.random.Generator, side: int = 6):
    """A wavy, smooth sheet with coordinates mirrored at x = 1/2; and loose triangles."""
    at = np.linspace(0, 1, side + 1)
    x, y = np.meshgrid(at, at)
    x = x + 0.05 * rng.normal(size=x.shape) * (x > 0) * (x < 1) * (np.abs(x - 0.5) > 0.01)
    points = np.stack((x, y, 0.2 * np.sin(5 * x + 3 * y)), axis=2).reshape(-1, 3)
    slope = 0.2 * np.cos(5 * points[:, 0] + 3 * points[:, 1])
    normals = np.stack((-5 * slope, -3 * slope, np.ones(len(points))), axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uvs = np.stack((np.abs(points[:, 0] - 0.5), points[:, 1] + 0.2 * points[:, 0]), axis=1)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    cut = [np.stack((first, first + 1, first + side + 2), 1)]
    cut += [np.stack((first, first + side + 2, first + side + 1), 1)]
    faces = np.concatenate(cut)
    loose = rng.normal(size=(6, 3, 3))
    flat = np.cross(loose[:, 1] - loose[:, 0], loose[:, 2] - loose[:, 0])
    own = np.repeat((flat / np.linalg.norm(flat, axis=1, keepdims=True))[:, None], 3, axis=1)
    return (
        np.concatenate((points[faces], loose)),
        np.concatenate((normals[faces], own)),
        np.concatenate((uvs[faces], rng.random((6, 3, 2)))),
    )


if __name__ == "__main__":
    made = [a.astype(np.float32).astype(float) for a in sheet(np.random.default_rng(3))]
    names = ("positions", "normals", "uvs", "tangents")
    values = (*made, reference(Path(sys.argv[1]), *made))
    held = {n: np.round(v.astype(float), 7).tolist() for n, v in zip(names, values, strict=True)}
    target = Path(__file__).parents[1] / "scene" / "mikktspace.json"
    target.write_text(json.dumps(held))
