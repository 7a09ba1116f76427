"""Emission by images at load: which triangles, at which coordinates, and the means over them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from test_scene_load_gltf import File

from gibench.bake.lightmap import lightmap_key
from gibench.scene.glow import decoded, in_first_period, shared_exponents
from gibench.scene.lightmap.albedo import bilinear, covered_mean
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.load import load_scene

SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
UVS = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])  # glTF's v points down


def sampled_mean(pixels, uvs, side=400):
    """By a fine grid of points, in float64."""
    i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    inside = i + j < side
    places = [(i[inside] + 1 / 3, j[inside] + 1 / 3)]
    inside = i + j < side - 1
    places.append((i[inside] + 2 / 3, j[inside] + 2 / 3))
    b, c = (np.concatenate(x) / side for x in zip(*places, strict=True))
    at = np.outer(1 - b - c, uvs[0]) + np.outer(b, uvs[1]) + np.outer(c, uvs[2])
    return bilinear(pixels.astype(float), at).mean(axis=0)


def test_means_are_integrals(rng: np.random.Generator) -> None:
    pixels = (rng.random((7, 12, 3)) ** 6 * 1000).astype(np.float32)
    uvs = rng.uniform(-1.5, 1.5, (12, 3, 2))
    uvs[3] = uvs[3, :1]  # a point
    uvs[4, 2] = uvs[4, :2].mean(axis=0)  # a line
    uvs[5] /= 50  # within a texel
    found = covered_mean(pixels, uvs)
    for mean, corners in zip(found, uvs, strict=True):
        is_line = abs(np.linalg.det(corners[1:] - corners[0])) < 1e-9
        wanted = sampled_mean(pixels, corners)
        np.testing.assert_allclose(mean, wanted, rtol=5e-3 if is_line else 2e-4)
    half = np.zeros((64, 64, 3), np.float32)
    half[:, :32] = 1
    whole = covered_mean(half, np.array([[(0, 0), (1, 0), (1, 1)]], float))
    # The lower right half of the image, of which x < 1/2 is a quarter; less what bilinear blurs.
    np.testing.assert_allclose(whole, 0.25, atol=0.01)


def test_texels_of_shared_exponents(rng: np.random.Generator) -> None:
    pixels = (10 ** rng.uniform(-3, 6, (20, 30, 1)) * rng.random((20, 30, 3))).astype(np.float32)
    pixels[0] = 0
    pixels[1, :5] = 2.0 ** np.arange(5)[:, None] * 511 / 512
    words, scale = shared_exponents(pixels)
    found = decoded(words, scale).reshape(pixels.shape)
    largest = pixels.max(axis=2, keepdims=True)
    assert (np.abs(found - pixels) <= largest * 2.0**-9 * 1.01 + scale * 2.0**-24).all()
    assert not found[0].any()
    np.testing.assert_allclose(found[1, :5], pixels[1, :5], rtol=2e-3)


def png(pixels) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return out.getvalue()


def gltf(path: Path, image, uvs=UVS, **material):
    file = File()
    file.mesh(SQUARE, [0, 1, 2, 0, 2, 3], material=0, TEXCOORD_0=uvs)
    file.json |= {
        "images": [{"bufferView": file.view(png(image))}],
        "textures": [{"source": 0}],
        "materials": [
            {"emissiveFactor": [1, 0.5, 0.25], "emissiveTexture": {"index": 0}, **material}
        ],
    }
    return load_scene(str(file.gltf(path / "a.gltf")))


def test_a_sign_keeps_its_texels(tmp_path: Path, rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (6, 4, 3))
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 30.0}}
    scene = gltf(tmp_path, image, extensions=strength, doubleSided=True)
    glow = scene.glow
    assert glow is not None
    linear = np.where(image <= 10, image / 255 / 12.92, ((image / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(glow.images[0], linear * (30, 15, 7.5), rtol=1e-4)
    assert glow.triangle.tolist() == [0, 1, 2, 3]  # the backs glow as the fronts do
    place = scene.corners[glow.triangle][:, :, :2].astype(float)
    np.testing.assert_allclose(glow.uvs, place, atol=1e-5)
    for triangle in range(4):
        material = scene.materials[scene.material_ids[triangle]]
        mean = covered_mean(glow.images[0], glow.uvs[triangle : triangle + 1].astype(float))[0]
        np.testing.assert_allclose(material.emission, mean, rtol=2e-3)
    lightmap = unwrap(scene, 300)
    area = lightmap.receivers.area[:, None]
    np.testing.assert_allclose(
        (lightmap.receivers.emission * area).sum(axis=0) / area.sum(),
        sum(np.array(scene.materials[i].emission) for i in scene.material_ids) / 4,
        rtol=2e-3,
    )
    assert np.ptp(lightmap.receivers.emission[:, 0]) > 1
    other = gltf(tmp_path, np.roll(image, 1, axis=1), extensions=strength, doubleSided=True)
    assert lightmap_key(other, 300) != lightmap_key(scene, 300)
    assert other.content_hash() != scene.content_hash()


def test_dark_and_plain_images_need_no_texels(tmp_path: Path) -> None:
    half = np.zeros((8, 8, 3))
    half[:, 6:] = 255
    scene = gltf(tmp_path, half, uvs=UVS * (0.5, 1) + (0.1, 0))
    assert scene.glow is None
    assert not any(any(scene.materials[i].emission) for i in scene.material_ids)
    scene = gltf(tmp_path, np.full((8, 8, 3), 255))
    assert scene.glow is None
    assert scene.materials[0].emission == pytest.approx((1, 0.5, 0.25), rel=1e-6)


@pytest.mark.parametrize("kind", ["hdr", "exr"])
def test_images_of_floats_emit_as_they_stand(tmp_path: Path, kind: str) -> None:
    radiance = np.array([[(500, 1, 0), (2, 4, 8)]], np.float32)
    if kind == "exr":
        exr = pytest.importorskip("OpenEXR")
        with exr.File({}, {"RGB": radiance}) as file:
            file.write(str(tmp_path / "a.exr"))
    else:
        exponent = np.floor(np.log2(radiance.max(axis=2))) + 1
        codes = np.floor(radiance / 2 ** (exponent[..., None] - 8)).astype(np.uint8)
        rgbe = np.dstack([codes, (exponent + 128).astype(np.uint8)])
        head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n"
        (tmp_path / "a.hdr").write_bytes(head + rgbe.tobytes())
    (tmp_path / "a.mtl").write_text(f"newmtl m\nKe 2 2 2\nmap_Ke a.{kind}\nmap_Kd a.{kind}\n")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    scene = load_scene(str(tmp_path / "a.obj"))
    assert scene.glow is not None
    np.testing.assert_allclose(scene.glow.images[0], 2 * radiance, rtol=0.01, atol=2.1)
    assert scene.textures[0].pixels.max() == 1  # no surface reflects more than it gets
    assert not any("missing" in line for line in scene.warnings)


def test_coordinates_far_off_come_near() -> None:
    uvs = np.array([[(1e4 + 0.25, -7.5), (1e4 + 1.5, -7), (1e4 + 0.5, -6.25)]])
    near = in_first_period(uvs)
    np.testing.assert_allclose(near, [[(0.25, 0.5), (1.5, 1.0), (0.5, 1.75)]], atol=1e-6)
