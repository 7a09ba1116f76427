"""Damaged scene files: small whole ones of every kind, and mutations of their bytes, tokens and
JSON nodes.
"""

from __future__ import annotations

import base64
import copy
import io
import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

Random = np.random.Generator


@dataclass(frozen=True)
class Whole:
    """A sound scene of one or more files.

    Attributes:
        entry: the file that is loaded.
        files: content by name.
    """

    entry: str
    files: dict[str, bytes]


def _png() -> bytes:
    out = io.BytesIO()
    pixels = np.arange(4 * 4 * 4, dtype=np.uint8).reshape(4, 4, 4) * 4
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


OBJ = b"""# a room
mtllib a.mtl
v 0 0 0 1 0 0
v 2 0 0 0 1 0
v 2 0 2 0 0 1
v 0 0 2
v 1 0 3
vt 0 0
vt 1 0
vt 1 1
vn 0 1 0
o floor
usemtl wall
f 1/1/1 4/2/1 3/3/1 2/1/1
g dent
usemtl leaf
f 1 5 3 4 2
f -1//1 -2//1 -3//1
"""
MTL = b"""newmtl wall
Kd 0.5 0.5 0.5
map_Kd -s 2 2 1 -o 0.5 0 0 a.png
Ke 1 1 1
map_Ke a.png
Pr 0.5
newmtl leaf
d 0.75
map_d a.png
norm a.png
"""
TOML = b"""schema_version = 1
name = "mutant"
receivers = 100
[[mesh]]
file = "a.obj"
scale = 2
rotate_degrees = [0, 90, 0]
translate = [1, 2, 3]
[[mesh]]
shape = "cube"
base_color = [0.5, 0.5, 0.5]
emission = 3
[[light]]
type = "spot"
position = [0, 3, 0]
direction = [0, -1, 0]
intensity = [1, 2, 3]
outer_degrees = 30
[environment]
type = "gradient"
zenith = 1
horizon = 0.5
ground = 0.1
[[camera]]
position = [0, 1, 5]
target = [0, 1, 0]
[probes]
positions = [[0, 1, 0], [1, 1, 1]]
[[motion]]
object = "cube"
axis = [0, 1, 0]
through = [1, 0, 0]
"""


def _gltf() -> tuple[dict[str, Any], bytes]:
    data = b""
    views: list[dict[str, Any]] = []

    def view(content: bytes) -> int:
        nonlocal data
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content)})
        data += content
        return len(views) - 1

    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2]], "<f4")
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "<f4")
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255]] * 2, "<u1")
    indices = np.array([0, 2, 1, 0, 3, 2], "<u2")
    accessors = [
        {"bufferView": view(a.tobytes()), "componentType": kind, "count": len(a), "type": name}
        for a, kind, name in (
            (corners, 5126, "VEC3"), (uvs, 5126, "VEC2"), (indices, 5123, "SCALAR"),
        )
    ]  # fmt: skip
    accessors.append(
        {
            "bufferView": view(colors.tobytes()),
            "componentType": 5121,
            "count": 4,
            "type": "VEC4",
            "normalized": True,
        }
    )
    sparse = {
        "count": 1,
        "indices": {"bufferView": view(b"\x01\0\0\0"), "componentType": 5121},
        "values": {"bufferView": view(np.array([3, 0, 0], "<f4").tobytes())},
    }
    accessors.append({**accessors[0], "sparse": sparse})
    image = view(_png())
    info = {"index": 0, "texCoord": 0}
    moved = {**info, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.5}}}
    primitive = {"attributes": {"POSITION": 4, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
    lights = [
        {"type": "point", "intensity": 5, "color": [1, 1, 1]},
        {"type": "spot", "intensity": 5, "spot": {"outerConeAngle": 0.5}},
    ]
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2, 3]}],
        "nodes": [
            {"mesh": 0, "scale": [1, -1, 1], "rotation": [0, 0.6, 0, 0.8], "children": [4]},
            {"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"extensions": {"KHR_lights_punctual": {"light": 1}}},
            {"camera": 0, "translation": [0, 1, 5]},
            {"mesh": 1, "translation": [0, 3, 0]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}],
        "meshes": [
            {"primitives": [primitive, {**primitive, "material": 1}]},
            {"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 3}, "mode": 5}]},
        ],
        "materials": [
            {
                "name": "sign",
                "pbrMetallicRoughness": {"baseColorTexture": moved, "roughnessFactor": 0.5},
                "emissiveFactor": [1, 1, 1],
                "emissiveTexture": info,
                "doubleSided": True,
                "normalTexture": info,
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}},
            },
            {
                "alphaMode": "BLEND",
                "extensions": {
                    "KHR_materials_pbrSpecularGlossiness": {
                        "diffuseFactor": [0.2, 0.1, 0.05, 0.9],
                        "diffuseTexture": info,
                    },
                    "KHR_materials_transmission": {"transmissionFactor": 0.1},
                },
            },
        ],
        "textures": [{"source": 0}],
        "images": [{"bufferView": image, "mimeType": "image/png"}],
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "extensionsUsed": ["KHR_lights_punctual"],
        "accessors": accessors,
        "bufferViews": views,
    }, data


def wholes() -> dict[str, Whole]:
    """A sound scene of every kind, by name."""
    file, data = _gltf()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    text = {**file, "buffers": [{"byteLength": len(data), "uri": uri}]}
    beside = {"a.obj": OBJ, "a.mtl": MTL, "a.png": _png()}
    return {
        "obj": Whole("a.obj", beside),
        "toml": Whole("a.toml", {"a.toml": TOML, **beside}),
        "gltf": Whole("a.gltf", {"a.gltf": json.dumps(text).encode()}),
        "glb": Whole("a.glb", {"a.glb": glb(file, data)}),
    }


def glb(file: dict[str, Any], data: bytes) -> bytes:
    """A glb file of its JSON and its binary chunk."""
    data += b"\0" * (-len(data) % 4)
    text = json.dumps({**file, "buffers": [{"byteLength": len(data)}]}).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _bytes(content: bytes, rng: Random) -> bytes:
    """Some bytes changed, cut out, doubled, or the end cut off."""
    made = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        if not made:
            break
        at, to = sorted(rng.integers(0, len(made), 2).tolist())
        to = min(to, at + 40)
        kind = rng.integers(0, 5)
        if kind == 0:
            made[at] = int(rng.integers(256))
        elif kind == 1:
            del made[at:to]
        elif kind == 2:
            made[at:at] = made[at:to]
        elif kind == 3:
            made[at:at] = bytes(rng.integers(0, 256, 3).tolist())
        elif rng.random() < 0.2:
            del made[at:]
    return bytes(made)


_TOKENS = (
    b"0 -1 1 99999999999 -99999999999 1e38 1e39 1e308 -1e308 1e-45 nan inf -inf 0x10 1,5 - / // "
    b"1/ /1 1/2/3/4 # \\ \" ' [ ] { } = . true false \xff \x00 \xef\xbb\xbf f v vn usemtl newmtl"
).split(b" ")


def _tokens(content: bytes, rng: Random) -> bytes:
    """Some words changed, dropped, doubled or swapped."""
    words = re.split(rb"(\s+)", content)
    for _ in range(int(rng.integers(1, 5))):
        i, j = rng.integers(0, len(words), 2).tolist()
        kind = rng.integers(0, 4)
        if kind == 0:
            words[i] = _TOKENS[int(rng.integers(len(_TOKENS)))]
        elif kind == 1:
            words[i] = b""
        elif kind == 2:
            words[i] += b" " + words[i]
        else:
            words[i], words[j] = words[j], words[i]
    return b"".join(words)


_VALUES: list[Any] = [
    None, True, -1, 0, 1, 3, 2**31, -(2**63), 2**70, 0.5, -0.5, 1e38, 1e308, float("nan"),
    float("inf"), "", "x", "VEC3", "BLEND", "data:,", "../..", "\0", [], [0], [1, 2], [1, 2, 3],
    [None] * 3, ["a", "b", "c"], [1e308] * 16, {}, {"index": 0}, {"index": -1}, [[1, 2], [3]],
]  # fmt: skip


def _nodes(tree: Any) -> list[tuple[Any, Any]]:
    found = []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        found.append((tree, key))
        if isinstance(value, dict | list):
            found += _nodes(value)
    return found


def _json(file: dict[str, Any], rng: Random) -> dict[str, Any]:
    """Some nodes of a JSON tree changed, dropped, or replaced by another one."""
    made = copy.deepcopy(file)
    for _ in range(int(rng.integers(1, 4))):
        places = _nodes(made)
        if not places:
            break
        parent, key = places[int(rng.integers(len(places)))]
        kind = rng.integers(0, 4)
        if kind == 0:
            del parent[key]
        elif kind == 1:
            other, name = places[int(rng.integers(len(places)))]
            parent[key] = copy.deepcopy(other[name])
        else:
            parent[key] = copy.deepcopy(_VALUES[int(rng.integers(len(_VALUES)))])
    return made


def _json_text(content: bytes, rng: Random) -> bytes:
    if content[:4] != b"glTF":
        return json.dumps(_json(json.loads(content), rng)).encode()
    size = struct.unpack("<I", content[12:16])[0]
    file = json.loads(content[20 : 20 + size])
    return glb(_json(file, rng), content[28 + size :])


def write_mutant(folder: Path, seed: int) -> Path:
    """The scene file of mutant ``seed``, written into ``folder`` with what is beside it."""
    rng = np.random.default_rng(seed)
    kinds = wholes()
    kind = sorted(kinds)[int(rng.integers(len(kinds)))]
    whole = kinds[kind]
    mutations: list[Callable[[bytes, Random], bytes]] = [_bytes, _tokens]
    if kind in ("gltf", "glb"):
        mutations += [_json_text] * 4
    files = dict(whole.files)
    target = sorted(files)[int(rng.integers(len(files)))]
    files[target] = mutations[int(rng.integers(len(mutations)))](files[target], rng)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / whole.entry
