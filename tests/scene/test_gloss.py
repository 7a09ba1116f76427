"""Roughness and metalness at load, and as kernels read them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from PIL import Image
from support.gibs_surfels import any_size_device
from test_scene_load_gltf import File

from gibench.device import kernel_source
from gibench.device.build import macro_options
from gibench.errors import BadInput
from gibench.scene.gloss import GlossMaps, gloss_at, packed_gloss, unpacked_gloss
from gibench.scene.load import load_scene
from gibench.scene.model import Material, Scene
from gibench.scene.readers.gltf_gloss import metalness_of
from gibench.scene.readers.textures import resampled, srgb_to_linear
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.material_table import material_macros, material_table
from gibench.techniques.parts.split_sum import GLOSS_MACROS

SQUARE = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
UVS = np.float32([[0, 1], [1, 1], [1, 0], [0, 0]])  # glTF's v points down
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def png(pixels: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return out.getvalue()


def gltf(folder: Path, material: dict[str, Any], *images: bytes, **attributes: Any) -> Scene:
    file = File()
    own = {"TEXCOORD_0": UVS} | attributes
    file.mesh(SQUARE, [0, 1, 2, 0, 2, 3], material=0, **own)
    file.json |= {
        "images": [{"bufferView": file.view(image)} for image in images],
        "textures": [{"source": i} for i in range(len(images))],
        "materials": [material],
    }
    return load_scene(str(file.gltf(folder / "a.gltf")))


def glossy(specular: Any) -> dict[str, Any]:
    return {"extensions": {"KHR_materials_pbrSpecularGlossiness": specular}}


def obj(folder: Path, statements: str, face: str = FACE, **images: bytes) -> Scene:
    (folder / "a.mtl").write_text(f"newmtl m\n{statements}\n")
    for name, data in images.items():
        (folder / f"{name}.png").write_bytes(data)
    (folder / "a.obj").write_text("mtllib a.mtl\nusemtl m\n" + QUAD + face)
    return load_scene(str(folder / "a.obj"))


def maps(scene: Scene) -> GlossMaps:
    assert scene.gloss_maps is not None
    return scene.gloss_maps


def only(scene: Scene) -> Material:
    """The one material that triangles have."""
    (number,) = set(scene.material_ids.tolist())
    return scene.materials[number]


def test_a_gltf_image_has_roughness_in_green_and_metalness_in_blue(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    codes = rng.integers(0, 256, (4, 6, 3))
    pbr = {"roughnessFactor": 0.5, "metallicFactor": 0.25, "metallicRoughnessTexture": {"index": 0}}
    scene = gltf(tmp_path, {"pbrMetallicRoughness": pbr, "doubleSided": True}, png(codes))
    found = maps(scene)
    np.testing.assert_allclose(found.images[0], codes[..., 1:] / 255, atol=1e-6)
    assert found.triangle.tolist() == [0, 1, 2, 3]  # and the backs
    np.testing.assert_allclose(found.uvs, scene.corners[found.triangle][:, :, :2], atol=1e-6)
    assert (only(scene).roughness, only(scene).metalness) == (0.5, 0.25)
    assert "gloss and metal of 1 material not used but by what reads them" in str(scene.warnings)
    table = material_table(scene.materials)
    at = material_macros()
    row = table[scene.material_ids[0]]
    assert row[[at["MATERIAL_ROUGHNESS"], at["MATERIAL_METALNESS"]]].tolist() == [0.5, 0.25]


def test_a_gltf_image_at_coordinates_of_its_own(tmp_path: Path, rng: np.random.Generator) -> None:
    moved = {"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2.0, 3.0]}}
    info = {"index": 0, "texCoord": 1, "extensions": moved}
    own = rng.random((4, 2)).astype(np.float32)
    pbr = {"metallicRoughnessTexture": info}
    codes = rng.integers(0, 256, (2, 2, 3))
    scene = gltf(tmp_path, {"pbrMetallicRoughness": pbr}, png(codes), TEXCOORD_1=own)
    u, v = (own * (2, 3) + (0.5, 0.25)).T
    expected = np.stack((u, 1 - v), axis=1)[np.array([[0, 1, 2], [0, 2, 3]])]
    whole = maps(scene).uvs - expected
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-5)  # up to whole images
    np.testing.assert_allclose(np.ptp(whole, axis=1), 0, atol=1e-5)


@pytest.mark.parametrize(
    ("material", "roughness", "metalness"),
    [
        ({"pbrMetallicRoughness": {"metallicFactor": 0.0}}, 1.0, 0.0),
        ({"pbrMetallicRoughness": {}}, 1.0, 1.0),
        ({}, 1.0, 1.0),  # "all the default values MUST apply"
        (glossy({"specularFactor": [0.04] * 3, "glossinessFactor": 0.75}), 0.25, 0.0),
        (glossy({"specularFactor": [0.03] * 3, "glossinessFactor": 0}), 1.0, 0.0),
        # Gold and polished: nothing diffuse, so all metal.
        (glossy({"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.77, 0.34]}), 0.0, 1.0),
    ],
)
def test_factors(tmp_path: Path, material: Any, roughness: float, metalness: float) -> None:
    scene = gltf(tmp_path, material)
    assert only(scene).roughness == pytest.approx(roughness)
    assert only(scene).metalness == pytest.approx(metalness, abs=1e-6)
    assert scene.gloss_maps is None


def test_the_conversion_solves_for_what_both_reflect(rng: np.random.Generator) -> None:
    """Forth by glTF 2.0, appendix B.2, of greys, and back: the metalness is found again."""
    base, metal = rng.uniform(0.1, 0.9, (2, 500))
    specular = 0.04 * (1 - metal) + base * metal
    # What the extension keeps of the diffuse part is 1 - specular of it.
    diffuse = base * (1 - metal) * 0.96 / (1 - specular)
    found = metalness_of(np.tile(diffuse[:, None], 3), np.tile(specular[:, None], 3))
    np.testing.assert_allclose(found, metal, atol=1e-6)


def test_images_of_specular_colour_and_glossiness_are_converted(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    codes = rng.integers(0, 256, (3, 5, 4))
    albedo = rng.integers(0, 256, (6, 10, 3))
    own = {
        "diffuseFactor": [0.9, 0.8, 0.7, 1.0],
        "specularFactor": [0.6, 0.5, 0.4],
        "glossinessFactor": 0.5,
        "specularGlossinessTexture": {"index": 0},
        "diffuseTexture": {"index": 1},
    }
    scene = gltf(tmp_path, glossy(own), png(codes), png(albedo))
    found = maps(scene).images[0]
    np.testing.assert_allclose(found[..., 0], 1 - 0.5 * codes[..., 3] / 255, atol=1e-6)
    specular = srgb_to_linear(codes[..., :3] / 255) * (0.6, 0.5, 0.4)
    diffuse = srgb_to_linear(albedo / 255).reshape(3, 2, 5, 2, 3).mean(axis=(1, 3))
    expected = metalness_of(diffuse * (0.9, 0.8, 0.7), specular)
    np.testing.assert_allclose(found[..., 1], expected, atol=1e-5)
    assert (only(scene).roughness, only(scene).metalness) == (1.0, 1.0)


@pytest.mark.parametrize("value", [1.5, -0.25, float("nan"), float("inf")])
@pytest.mark.parametrize("factor", ["roughnessFactor", "metallicFactor", "glossinessFactor"])
def test_factors_that_make_no_sense_are_refused(tmp_path: Path, factor: str, value: float) -> None:
    wrong = {factor: value}
    own = glossy(wrong) if factor[0] == "g" else {"pbrMetallicRoughness": wrong}
    with pytest.raises(BadInput) as refused:
        gltf(tmp_path, own)
    assert factor in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("statement", ["Pr 1.01", "Pr -0.1", "Pm 2", "Pr nan"])
def test_numbers_of_mtl_that_make_no_sense_are_refused(tmp_path: Path, statement: str) -> None:
    with pytest.raises(BadInput) as refused:
        obj(tmp_path, statement)
    assert f".mtl: material 'm' has {statement.split()[0]}" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_images_of_mtl_are_one(tmp_path: Path, rng: np.random.Generator) -> None:
    rough, metal = rng.integers(0, 256, (4, 4)), rng.integers(0, 256, (2, 8))
    given = {"rough": png(rough), "metal": png(metal)}
    scene = obj(tmp_path, "Pr 0.5\nmap_Pr -s 2 2 rough.png\nmap_Pm -s 2 2 metal.png", **given)
    image = maps(scene).images[0]
    assert image.shape == (4, 8, 2)
    # Halved again, each is what it was but for the neighbours that were mixed in.
    expected = resampled(rough[:, :, None] / 255, 4, 8)[:, :, 0]
    np.testing.assert_allclose(image[..., 0], expected, atol=1e-6)
    expected = resampled(metal[:, :, None] / 255, 4, 8)[:, :, 0]
    np.testing.assert_allclose(image[..., 1], expected, atol=1e-6)
    assert maps(scene).uvs.max() == 2
    assert (only(scene).roughness, only(scene).metalness) == (0.5, 1.0)
    assert "options" not in str(scene.warnings)
    other = obj(tmp_path, "map_Pr rough.png\nmap_Pm -s 2 2 metal.png", **given)
    assert "-s, -o of map_Pm beside map_Pr" in str(other.warnings)
    alone = obj(tmp_path, "Pm 0.5\nmap_Pm metal.png", **given)
    np.testing.assert_allclose(maps(alone).images[0][..., 0], 1)
    assert (only(alone).roughness, only(alone).metalness) == (1.0, 0.5)


def test_an_image_without_coordinates_or_of_one_colour_is_its_mean(tmp_path: Path) -> None:
    image = png([[0, 51], [102, 255]])
    scene = obj(tmp_path, "Pr 0.5\nmap_Pr rough.png", "f 1 2 3 4\n", rough=image)
    assert scene.gloss_maps is None
    assert only(scene).roughness == pytest.approx(0.2)
    assert "images of roughness of 1 material without coordinates (m)" in str(scene.warnings)
    scene = obj(tmp_path, "Pr 0.5\nmap_Pr rough.png", rough=png(np.full((2, 2), 51)))
    assert scene.gloss_maps is None
    assert only(scene).roughness == pytest.approx(0.1)
    assert "coordinates" not in str(scene.warnings)
    scene = obj(tmp_path, "map_Pr none.png")
    said = "1 texture missing or unreadable (none.png): the material's own numbers used"
    assert said in str(scene.warnings)


def test_gloss_changes_no_result(tmp_path: Path, rng: np.random.Generator) -> None:
    images = {"rough": png(rng.integers(0, 256, (4, 4)))}
    plain, shiny = obj(tmp_path, ""), obj(tmp_path, "Pr .1\nPm 1\nmap_Pr rough.png", **images)
    assert plain.content_hash() == shiny.content_hash()
    other = obj(tmp_path, "map_Pr -s 2 2 rough.png", **images)
    assert maps(shiny).content_hash() != maps(other).content_hash()


def test_words_of_texels(rng: np.random.Generator) -> None:
    pixels = rng.random((9, 7, 2)).astype(np.float32)
    found = unpacked_gloss(packed_gloss(pixels)).reshape(pixels.shape)
    np.testing.assert_allclose(found, pixels, atol=0.6 / 65535)


LOOK_UP = """
__kernel void look_up(__global const int *material_ids, __global const float *materials GLOSS_PARAM,
                      __global const int *of, __global const float *uv, int count,
                      __global float *out)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    Hit hit;
    hit.triangle = of[i], hit.u = uv[2 * i], hit.v = uv[2 * i + 1];
    vstore2(gloss_at(material_ids, materials GLOSS_ARG, hit), i, out);
    vstore3(straight_reflectance((float3)(0.5f, 0.25f, 1.0f), uv[2 * i]), i, out + 2 * count);
}
"""


@pytest.mark.parametrize("group", [1, 24, 64])
@pytest.mark.parametrize("with_images", [False, True])
def test_the_kernels_look_up(rng: np.random.Generator, group: int, with_images: bool) -> None:
    count, triangles = 500, 40
    materials = [
        Material(f"{i}", roughness=float(r), metalness=float(m))
        for i, (r, m) in enumerate(rng.random((5, 2)))
    ]
    ids = rng.integers(0, 5, triangles).astype(np.int32)
    chosen = np.sort(rng.choice(triangles, 30, replace=False)).astype(np.int32)
    images = tuple(rng.random((h, w, 2)).astype(np.float32) for h, w in ((1, 1), (5, 8), (16, 3)))
    maps = GlossMaps(
        images=tuple(unpacked_gloss(packed_gloss(i)).reshape(i.shape).astype("f4") for i in images),
        triangle=chosen,
        image=rng.integers(0, 3, 30).astype(np.int32),
        uvs=rng.uniform(-2, 2, (30, 3, 2)).astype(np.float32),
    )
    of = rng.integers(0, triangles, count).astype(np.int32)
    weights = rng.dirichlet((1, 1, 1), count).astype(np.float32)
    device = any_size_device()
    defines = SCENE_MACROS | GLOSS_MACROS | ({"GLOSS_MAPS": 1} if with_images else {})
    source = kernel_source("common/gloss.cl") + kernel_source("common/ggx.cl") + LOOK_UP
    program = cl.Program(device.context, source).build([*macro_options({"WG": group, **defines})])
    out = device.empty("out", 5 * count, np.float32)
    table = material_table(materials)
    held = [device.upload("ids", ids), device.upload("materials", table)]
    if with_images:
        held.append(device.upload("maps", maps.packed(triangles)))
    held += [device.upload("of", of), device.upload("uv", weights[:, 1:].copy())]
    size = -(-count // group) * group
    arguments = [*(buffer.mem for buffer in held), np.int32(count), out.mem]
    cl.Kernel(program, "look_up")(device.queue, (size,), (group,), *arguments)
    found = device.read(out)
    factors = np.array([(m.roughness, m.metalness) for m in materials])[ids[of]]
    expected = gloss_at(maps, factors, of, weights) if with_images else factors
    # A place in an image of 16 texels, repeated at most twice to each side, is known to 16 * 2^-21;
    # from texel to texel values change by at most 1.
    np.testing.assert_allclose(found[: 2 * count].reshape(-1, 2), expected, atol=1e-4)
    metal = weights[:, 1:2].astype(float)
    base = np.array([0.5, 0.25, 1.0])
    mirror = 0.04 * (1 - metal) + base * metal
    np.testing.assert_allclose(found[2 * count :].reshape(-1, 3), mirror, atol=1e-6)
