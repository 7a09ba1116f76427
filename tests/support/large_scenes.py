"""Files of very many triangles: displaced grids, half of them one terrain, half many objects.

Usage: python tests/support/large_scenes.py TRIANGLES FILE.obj|FILE.glb
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
PER_OBJECT = 4000
COLORS = [(0.3 + 0.15 * i, 0.5, 0.8 - 0.15 * i) for i in range(4)]


def meshes(triangles: int, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Vertices (v, 3), m, and corners (t, 3) of each object; about ``triangles`` in all."""
    side = max(1, int((triangles / 4) ** 0.5))
    u, v = np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1))
    height = 2 * np.sin(9 * u) * np.cos(7 * v) + 16 / side * rng.standard_normal(u.shape)
    found = [(np.stack([200 * u - 100, height, 100 - 200 * v], axis=-1).reshape(-1, 3), grid(side))]
    side = int((PER_OBJECT / 2) ** 0.5)
    for _ in range(triangles // 2 // PER_OBJECT):
        a, b = np.meshgrid(np.linspace(0, 2 * np.pi, side + 1), np.linspace(0.01, 3.13, side + 1))
        radius = 1.5 + 0.1 * np.sin(6 * a) * np.sin(5 * b) + 0.01 * rng.standard_normal(a.shape)
        radius[:, -1] = radius[:, 0]
        x, y, z = np.cos(a) * np.sin(b), np.cos(b), -np.sin(a) * np.sin(b)
        centre = rng.uniform([-95, 5, -95], [95, 40, 95])
        ball = np.stack([radius * x, radius * y, radius * z], axis=-1) + centre
        found.append((ball.reshape(-1, 3), grid(side)))
    return found


def grid(side: int) -> Array:
    """Corners (2 side^2, 3) of a grid of ``side + 1`` squared vertices."""
    first = np.arange(side * (side + 1)).reshape(side, side + 1)[:, :side].ravel()
    a, b, c, d = first, first + 1, first + side + 2, first + side + 1
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def write_obj(path: Path, triangles: int) -> None:
    """An OBJ file and its materials."""
    library = path.with_suffix(".mtl")
    library.write_text(
        "".join(f"newmtl m{i}\nKd {r} {g} {b}\n" for i, (r, g, b) in enumerate(COLORS))
    )
    with path.open("w") as file:
        file.write(f"mtllib {library.name}\n")
        base = 1
        for number, (vertices, corners) in enumerate(meshes(triangles, np.random.default_rng(3))):
            file.write(f"o part{number}\nusemtl m{number % len(COLORS)}\n")
            np.savetxt(file, vertices, fmt="v %.5f %.5f %.5f")
            np.savetxt(file, corners + base, fmt="f %d %d %d")
            base += len(vertices)


def write_glb(path: Path, triangles: int) -> None:
    """A binary glTF file."""
    data = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    made = meshes(triangles, np.random.default_rng(3))
    for vertices, corners in made:
        bounds = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
        for values, kind, width, more in (
            (vertices.astype("<f4"), 5126, "VEC3", bounds),
            (corners.reshape(-1).astype("<u4"), 5125, "SCALAR", {}),
        ):
            view = {"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes}
            accessor = {"bufferView": len(views), "componentType": kind, "type": width, **more}
            views.append(view)
            accessors.append({**accessor, "count": len(values)})
            data += values.tobytes()
    count = len(made)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(count))}],
        "nodes": [{"mesh": i, "name": f"part{i}"} for i in range(count)],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 2 * i},
                        "indices": 2 * i + 1,
                        "material": i % len(COLORS),
                    }
                ]
            }
            for i in range(count)
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0}}
            for color in COLORS
        ],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    data += bytes(-len(data) % 4)
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(data), b"BIN\0") + data)


if __name__ == "__main__":
    target = Path(sys.argv[2])
    (write_obj if target.suffix == ".obj" else write_glb)(target, int(sys.argv[1]))
