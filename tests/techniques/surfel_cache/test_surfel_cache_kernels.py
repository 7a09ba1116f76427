"""Each pass of surfel caches against float64, at several work-group sizes."""

from dataclasses import replace

import numpy as np
import pytest
from support.launches import run_pass
from support.pairwise import few, pairwise
from support.shading_oracle import direct_irradiance, light_gain, pixel_directions
from support.surfel_oracle import (
    SHAPES,
    SMALL,
    VARIANTS,
    baked,
    create,
    dilated,
    gathered,
    halves,
    link_terms,
    lit_caches,
    lobe,
    random_caches,
    random_flux,
    read,
    spread,
    write,
)
from support.surfel_scenes import looking
from support.synthetic_bake import random_lightmap, random_scene
from support.tiny_scenes import room

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Turn
from gibench.techniques.surfel_cache.pack import node_sums, packed_directions
from gibench.techniques.surfel_cache.shared_exponent import LEAST_STEP, MOST, decode, encode
from gibench.techniques.surfel_cache.technique import map_places

SIZES = (1, 7, 64, 100)  # 7 and 100 divide none of the problems below


class Made:
    """A soup of triangles with every kind of light under a sky, and its bakes."""

    def __init__(self, folder):
        self.scene = random_scene(np.random.default_rng(5), 60)
        self.lightmap = random_lightmap(np.random.default_rng(1), self.scene, 50, 10, 10)
        self.folder, self.bakes = folder, {}

    def technique(self, variant="tuned", image=(24, 16), size=64, **settings):
        values = {**SMALL, **settings}
        key = tuple(sorted(values.items()))
        if key not in self.bakes:
            self.bakes[key] = baked(self.scene, self.lightmap, values, self.folder)
        return create(self.scene, self.lightmap, values, self.bakes[key], variant, size, image)


@pytest.fixture(scope="module")
def soup(tmp_path_factory):
    return Made(tmp_path_factory.mktemp("soup"))


def test_shared_exponents_round_to_the_nearest(rng):
    values = 10 ** rng.uniform(-9, 5.5, (500, 1)) * rng.uniform(0, 1, (500, 3))
    bits = encode(values)
    clipped = np.minimum(values, MOST)
    step = 2.0 ** ((bits >> 27).astype(int) - 24)
    assert (np.abs(decode(bits) - clipped) <= 0.5 * step[:, None] * (1 + 1e-12)).all()
    largest = clipped.max(axis=1)
    assert (step <= np.maximum(2 * largest / 511, LEAST_STEP)).all()  # no mantissa is wasted
    odd = np.array([[0, 0, 0], [np.inf, 1, 0], [np.nan, -1, 2], [1e9, 1e9, 1e9], [1e-30, 0, 0]])
    expected = [[0, 0, 0], [MOST, 0, 0], [0, 0, 2], [MOST, MOST, MOST], [0, 0, 0]]
    np.testing.assert_array_equal(decode(encode(odd)), expected)


@pytest.mark.parametrize("variant", SHAPES)
@pytest.mark.parametrize("size", few(SIZES))
def test_pull_sums_but_for_rounding(rng, soup, variant, size):
    """A level adds half a step, 2^-9 of the largest channel at most; what is too much stays the
    most there is, nothing stays nothing."""
    technique = soup.technique(variant)
    tree = technique.bake.hierarchy
    leaves = np.flatnonzero(tree.child < 0)
    values = 10 ** rng.uniform(-5, 2, (300, 1)) * rng.uniform(0, 1, (300, 3))
    values[rng.choice(300, 60, replace=False)] = 0.0
    bits = np.zeros(len(tree.child), np.uint32)
    bits[leaves] = encode(values)[tree.begin[leaves]]
    write(technique, "node_flux", bits)
    run_pass(technique, "pull", size)
    found = decode(read(technique, "node_flux"))
    exact = node_sums(tree, decode(encode(values)))
    height = np.ceil(np.log2(np.maximum(tree.end - tree.begin, 1)))
    depth = np.searchsorted(tree.level, np.arange(len(bits)), side="right")
    height = np.maximum(height, len(tree.level) - 1 - depth)
    bound = ((1 + 2.0**-9) ** height - 1) * exact.max(axis=1) + height * LEAST_STEP
    assert (np.abs(found - exact) <= bound[:, None] * (1 + 1e-6)).all()
    bits[leaves] = encode(np.full((300, 3), np.inf))
    write(technique, "node_flux", bits)
    run_pass(technique, "pull", size)
    assert (decode(read(technique, "node_flux")) == MOST).all()
    write(technique, "node_flux", np.zeros_like(bits))
    run_pass(technique, "pull", size)
    assert not read(technique, "node_flux").any()


def surfel_positions(technique):
    return technique.bake.surfels.position.astype(np.float64)


@pytest.mark.parametrize("bounces", [True, False])
@pytest.mark.parametrize("size", few(SIZES, (7, 100)))
def test_surfel_lighting(rng, soup, bounces, size):
    technique = soup.technique(bounces=bounces, sh_bands=int(rng.integers(2, 5)))
    random_caches(technique, rng)
    frame = int(rng.integers(0, 200))
    technique.begin_frame(frame)
    run_pass(technique, "surfel_lighting", size)
    bake, atlas = technique.bake, technique.bake.caches.atlas
    tree = bake.hierarchy
    leaves = np.flatnonzero(tree.child < 0)
    flux = decode(read(technique, "node_flux"))[leaves[np.argsort(tree.begin[leaves])]]
    normal = spread(packed_directions(bake.surfels.shading))
    np.testing.assert_allclose(normal, bake.surfels.shading, atol=1e-4)
    position = surfel_positions(technique)
    lit = direct_irradiance(soup.scene, frame, position, normal, normal)
    irradiance, sure = lit.irradiance, lit.certain
    # A light almost in the triangle's plane meets the triangle or not as rounding will have it.
    for light in soup.scene.lights_at(frame):
        towards = light_gain(light, position)[0]
        sure &= np.abs(np.einsum("ij,ij->i", bake.surfels.normal, towards)) > 0.02
        sure &= (
            np.einsum("ij,ij->i", bake.surfels.normal, towards)
            * np.einsum("ij,ij->i", normal, towards)
            > 0
        )
    if bounces:
        uv = read(technique, "surfel_uv")
        place = np.stack([uv & 0xFFFF, uv >> 16], axis=1) / 65535 * [atlas.width, atlas.height]
        place[uv == 0xFFFFFFFF] = -1
        assert (place[:, 0] >= 0).mean() > 0.8
        light, decided = gathered(technique, place, position, lobe(technique, normal))
        irradiance, sure = irradiance + np.pi * light, sure & decided
    expected = np.pi * decode(encode(bake.emission)) + bake.albedo * irradiance
    assert sure.mean() > 0.5
    # Half a step of the flux and of the albedo, and what float32 is off.
    bound = expected.max(axis=1, keepdims=True) * 2.0**-9 + irradiance / 2046
    bound += LEAST_STEP / technique.frame.flux_scale + 1e-3 * expected + 2e-4
    off = np.abs(flux / technique.frame.flux_scale - expected)
    assert (off <= bound)[sure].all()


@pytest.mark.parametrize(
    ("variant", "projection", "bands"), pairwise(SHAPES, ["stored", "runtime"], [2, 3, 4])
)
def test_cache_lighting(rng, soup, variant, projection, bands):
    technique = soup.technique(variant, sh_bands=bands, projection=projection)
    caches = technique.bake.caches
    assert caches.environment is not None
    on_map = np.flatnonzero(halves(technique, "cache_map")[:, 0, 3] == 1)
    in_grid = np.flatnonzero(caches.grid_kept)
    for size in {2: (7, 64), 3: (1, 100), 4: (7, 100)}[bands]:
        if variant == "simt":  # its groups are as large as the technique is set up for
            technique = soup.technique(variant, size=size, sh_bands=bands, projection=projection)
        flux = random_flux(technique, rng)
        run_pass(technique, "cache_lighting_map", size)
        run_pass(technique, "cache_lighting_grid", size)
        expected = lit_caches(technique, flux, projection == "stored")
        found = np.concatenate(
            [halves(technique, "cache_map")[on_map], halves(technique, "cache_grid")[in_grid]]
        )
        assert (found[:, 0, 3] == 1).all() and not found[:, 1:, 3].any()
        # Halves of links and of the sums; at run time of the caps' solid angles, too.
        terms, node = link_terms(technique, projection == "stored")
        most = np.einsum("clk,clh->ckh", np.abs(terms), flux[node]) + np.abs(expected)
        bound = (2e-3 if projection == "stored" else 6e-3) * most + 2e-5
        bound += (0 if projection == "stored" else 2e-3) * most[:, :1]
        assert (np.abs(found[..., :3] - expected) <= bound).all()


def test_run_time_projection_is_similar_to_the_stored(rng, soup):
    """ "Not equal but similar": the diffuse light of a cap and of what is seen of a sender."""
    technique = soup.technique(sh_bands=4)
    tree = technique.bake.hierarchy
    flux = np.repeat((tree.end - tree.begin)[:, None].astype(float), 3, axis=1)
    normals = rng.normal(size=(8, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    both = [lit_caches(technique, flux, stored) for stored in (True, False)]
    np.testing.assert_allclose(both[0][:, 0], both[1][:, 0], rtol=2e-3, atol=1e-4)
    found = [np.einsum("nk,ckh->cnh", lobe(technique, normals), light) for light in both]
    off = np.sqrt(((found[0] - found[1]) ** 2).mean() / (found[0] ** 2).mean())
    assert 1e-6 < off < 0.05


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("size", SIZES)
def test_dilation(rng, soup, variant, size):
    technique = soup.technique(variant, sh_bands=int(rng.integers(2, 5)))
    random_caches(technique, rng)
    atlas = technique.bake.caches.atlas
    shape = (atlas.height, atlas.width, technique.sizes.coefficients, 4)
    before = halves(technique, "cache_map").reshape(shape)
    run_pass(technique, "dilation", size)
    after = halves(technique, "cache_map").reshape(shape)
    mark = before[:, :, 0, 3]
    border, mean = dilated(before)
    assert border.sum() > 20 and (mark[border] == 0.5).all() and (mark == 0.5).sum() == border.sum()
    np.testing.assert_allclose(after[border][..., :3], mean, rtol=1e-3, atol=1e-4)
    np.testing.assert_array_equal(after[~border], before[~border])
    np.testing.assert_array_equal(after[border][..., 3], before[border][..., 3])


def pixels_of(technique):
    """What the camera sees: per pixel with a surface its row, hit, albedo."""
    kept = technique.device.read(technique.frame.hits.buffer)
    width, height = technique.scene.width, technique.scene.height
    tiles = -(-width // 8)
    code = np.arange(64)
    even = (code & 1) | (code >> 1 & 2) | (code >> 2 & 4)
    odd = (code >> 1 & 1) | (code >> 2 & 2) | (code >> 3 & 4)
    item = np.arange(len(kept))
    tile, inside = np.divmod(item, 64)
    x, y = tile % tiles * 8 + even[inside], tile // tiles * 8 + odd[inside]
    triangle = kept[:, 0].view(np.int32)
    shown = (x < width) & (y < height) & (triangle >= 0)
    return (y * width + x)[shown], triangle[shown], kept[shown, 1:3].astype(float), kept[shown, 3:]


@pytest.mark.parametrize("exponent", [0.0, 1.0, 20.0])
@pytest.mark.parametrize("variant", VARIANTS)
def test_forward_render(rng, soup, variant, exponent):
    size = int(rng.choice(SIZES))
    technique = soup.technique(
        variant, (48, 35), exponent=exponent, gloss=0.3, sh_bands=int(rng.integers(2, 5))
    )
    prepared = prepare_passes(technique, size)
    enqueue_frame(technique, prepared, 0)
    random_caches(technique, rng)
    found = technique.images()["indirect only"].reshape(-1, 3)
    row, triangle, uv, albedo = pixels_of(technique)
    assert len(row) > 50
    weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
    scene = soup.scene
    corners = scene.triangles[triangle]
    position = np.einsum("ij,ijk->ik", weights, scene.positions[corners].astype(float))
    normal = np.einsum("ij,ijk->ik", weights, scene.normals[corners].astype(float))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    uvs = read(technique, "cache_uvs").reshape(-1, 3, 2)[triangle].astype(float)
    place = np.einsum("ij,ijk->ik", weights, uvs)
    place[uvs[:, 0, 0] < 0] = -1
    expected = np.zeros_like(found, np.float64)
    light, sure = gathered(technique, place, position, lobe(technique, normal))
    expected[row] = albedo * light
    if exponent:
        seen = pixel_directions(scene.cameras[0], 48, 35)[row]
        mirrored = seen - 2 * (seen * normal).sum(axis=1, keepdims=True) * normal
        terms = lobe(technique, mirrored, exponent)
        expected[row] += 0.3 * gathered(technique, place, position, terms)[0]
    assert sure.mean() > 0.9
    expected[row[~sure]] = found[row[~sure]]
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=3e-4 * expected.max())


@pytest.mark.parametrize("size", SIZES)
def test_receivers_look_up_where_they_lie(rng, tmp_path_factory, size):
    """In a room, where charts are whole: a receiver's place is that of its texel's surface."""
    scene, lightmap = room()
    folder = tmp_path_factory.getbasetemp() / "receivers"
    scene = looking(scene)
    technique = create(scene, lightmap, SMALL, baked(scene, lightmap, SMALL, folder), size=size)
    random_caches(technique, rng)
    found = technique.indirect_irradiance()
    receivers = lightmap.receivers
    uvs = read(technique, "cache_uvs").reshape(-1, 3, 2)
    place = map_places(scene, lightmap, uvs).astype(float)
    assert (place[:, 0] >= 0).mean() > 0.9
    corners, rows = scene.corners.astype(float), lightmap.fragments.triangle[::2]
    # Back from the map to the surface, by the two triangles' linear maps.
    for i in rng.choice(len(receivers), 20):
        uv, xyz = uvs[rows[i]].astype(float), corners[rows[i]]
        weights = np.linalg.lstsq(np.c_[uv, np.ones(3)].T, np.r_[place[i], 1.0], rcond=None)[0]
        if abs(np.linalg.det(uv[1:] - uv[0])) > 0.5:
            np.testing.assert_allclose(weights @ xyz, receivers.position[i], atol=0.02)
    terms = lobe(technique, receivers.normal)
    light, sure = gathered(technique, place, receivers.position, terms)
    expected = np.pi * light[sure]
    assert sure.mean() > 0.9
    np.testing.assert_allclose(found[sure], expected, rtol=2e-3, atol=1e-3 * expected.max())


def test_variants_agree_within_rounding(soup):
    found = []
    for variant in VARIANTS:
        for projection in ("stored", "runtime"):
            technique = soup.technique(variant, projection=projection, exponent=20.0)
            prepared = prepare_passes(technique, 64)
            for frame in range(4):
                enqueue_frame(technique, prepared, frame)
            found.append({**technique.images(), "receivers": technique.indirect_irradiance()})
    for published, tuned in (found[::2], found[1::2]):
        for title, image in published.items():
            np.testing.assert_allclose(tuned[title], image, rtol=0, atol=4e-3 * image.max())


def test_what_moves_is_lit_by_the_grid(rng, soup):
    scene = replace(soup.scene, object_names=("all",))
    motion = MovingObjects.of(scene, [Turn("all", (0.0, 1.0, 0.0))])
    soup.technique()
    bake = next(iter(soup.bakes.values()))
    technique = create(scene, soup.lightmap, SMALL, bake, motion=motion)
    assert (read(technique, "cache_uvs") == -1).all()
    assert (read(technique, "surfel_uv") == 0xFFFFFFFF).all()
