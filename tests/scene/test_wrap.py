"""Images of glTF that are clamped or mirrored give what their sampler would."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.mutants import glb

from gibench.errors import BadInput
from gibench.scene.lightmap.albedo import bilinear
from gibench.scene.load import load_scene
from gibench.scene.model import Scene

REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
WIDTH, HEIGHT = 7, 5


def _scene(
    folder: Path, codes: np.ndarray[Any, Any], uvs: np.ndarray[Any, Any], wrap: dict[str, int]
) -> Scene:
    """Two triangles with an image of ``codes`` (h, w, 4): colour, cut-out and emission."""
    encoded = io.BytesIO()
    Image.fromarray(codes, "RGBA").save(encoded, "png")
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
    blocks = [corners.tobytes(), uvs.astype("<f4").tobytes(), encoded.getvalue()]
    blocks.insert(2, np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes())
    starts = np.cumsum([0, *(len(block) for block in blocks)])
    views = [
        {"buffer": 0, "byteOffset": int(start), "byteLength": len(block)}
        for start, block in zip(starts, blocks, strict=False)
    ]
    slot = {"index": 0}
    file = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": int(starts[-1])}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "samplers": [wrap],
        "textures": [{"source": 0, "sampler": 0}],
        "materials": [
            {
                "alphaMode": "MASK",
                "emissiveFactor": [1, 1, 1],
                "emissiveTexture": slot,
                "pbrMetallicRoughness": {"baseColorTexture": slot},
            }
        ],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
                        "indices": 2,
                        "material": 0,
                    }
                ]
            }
        ],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    path = folder / "a.glb"
    path.write_bytes(glb(file, b"".join(blocks)))
    return load_scene(str(path))


def _texel(index: Any, size: int, mode: int) -> Any:
    """Which texel of ``size`` stands at any index (glTF 2.0, 5.26.3 and 5.26.4)."""
    if mode == CLAMP:
        return np.clip(index, 0, size - 1)
    if mode == MIRROR:
        index = index % (2 * size)
        return np.where(index < size, index, 2 * size - 1 - index)
    return index % size


def _sampled(image: Any, at: Any, modes: tuple[int, int]) -> Any:
    """Bilinear look up (n, c) at glTF's coordinates (n, 2), v downwards."""
    place = at * [WIDTH, HEIGHT] - 0.5
    low = np.floor(place).astype(int)
    share = place - low
    total = 0.0
    for right in (0, 1):
        for down in (0, 1):
            column = _texel(low[:, 0] + right, WIDTH, modes[0])
            row = _texel(low[:, 1] + down, HEIGHT, modes[1])
            weight = np.where(right, share[:, 0], 1 - share[:, 0])
            weight = weight * np.where(down, share[:, 1], 1 - share[:, 1])
            total = total + image[row, column] * weight[:, None]
    return total


def _linear(codes: Any) -> Any:
    x = codes / 255.0
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(
    "modes",
    [(CLAMP, CLAMP), (MIRROR, MIRROR), (CLAMP, MIRROR), (REPEAT, CLAMP), (MIRROR, REPEAT)],
)
@pytest.mark.parametrize("reach", [0.0, 0.3, 2.6])
def test_look_ups_are_the_samplers(
    tmp_path: Path, rng: np.random.Generator, modes: tuple[int, int], reach: float
) -> None:
    codes = rng.integers(0, 256, (HEIGHT, WIDTH, 4), np.uint8)
    codes[0, 0, 3], codes[0, 1, 3] = 0, 255
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
    uvs = (square - 0.5) * (1 + 2 * reach) + 0.5
    wrap = {"wrapS": modes[0], "wrapT": modes[1]}
    scene = _scene(tmp_path, codes, uvs, wrap)
    assert not any("clamped" in line for line in scene.warnings)
    weights = rng.dirichlet([1.0, 1.0, 1.0], 400)
    triangle = rng.integers(0, 2, 400)
    order = np.array([[0, 1, 2], [0, 2, 3]])
    at = np.einsum("nc,ncx->nx", weights, uvs.astype(np.float32)[order[triangle]])
    images = scene.textures[scene.materials[scene.material_ids[0]].texture]
    own = np.einsum("nc,ncx->nx", weights, scene.uvs[scene.triangles[triangle]].astype(float))
    right = _sampled(_linear(codes[:, :, :3]), at, modes)
    # A coordinate's float32 rounding, as steep as neighbouring texels may be.
    slack = 4 * 2.0**-24 * (1 + reach) * 2 * max(WIDTH, HEIGHT) + 1e-6
    np.testing.assert_allclose(bilinear(images.pixels, own), right, atol=slack)
    assert scene.glow is not None
    found = np.einsum("nc,ncx->nx", weights, scene.glow.uvs[triangle].astype(float))
    glow = scene.glow.images[scene.glow.image[0]]
    np.testing.assert_allclose(bilinear(glow, found), right, atol=slack)
    nearest = at * [WIDTH, HEIGHT]
    certain = (np.abs(nearest - np.round(nearest)) > 1e-4).all(axis=1)
    column = _texel(np.floor(nearest[:, 0]).astype(int), WIDTH, modes[0])
    row = _texel(np.floor(nearest[:, 1]).astype(int), HEIGHT, modes[1])
    assert scene.cutouts is not None
    there = scene.cutouts.there(
        triangle, weights[:, 1].astype(np.float32), weights[:, 2].astype(np.float32)
    )
    np.testing.assert_array_equal(there[certain], (codes[row, column, 3] >= 128)[certain])


def test_what_repeats_stays_as_it_is_and_far_clamps_are_said(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    codes = rng.integers(0, 256, (HEIGHT, WIDTH, 4), np.uint8)
    codes[0, 0, 3], codes[0, 1, 3] = 0, 255
    far = np.array([[-9, 0], [9, 0], [9, 1], [-9, 1]], np.float64)
    plain = _scene(tmp_path, codes, far, {})
    assert plain.textures[0].pixels.shape == (HEIGHT, WIDTH, 3)
    said = _scene(tmp_path, codes, far, {"wrapS": CLAMP})
    assert any("clamped images beyond 4 of their sides" in line for line in said.warnings)
    odd = _scene(tmp_path, codes, far, {"wrapS": 7})
    assert any("wrap mode 7" in line for line in odd.warnings)


def test_a_sampler_that_is_not_there(tmp_path: Path, rng: np.random.Generator) -> None:
    codes = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    scene = _scene(tmp_path, codes, np.zeros((4, 2)), {})
    assert scene.textures
    path = tmp_path / "a.glb"
    path.write_bytes(path.read_bytes().replace(b'"sampler": 0', b'"sampler": 9'))
    with pytest.raises(BadInput, match="there is no sampler 9"):
        load_scene(str(path))
