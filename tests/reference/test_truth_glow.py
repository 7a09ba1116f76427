"""The truth's light of surfaces that emit by images, against closed forms and quadrature."""

from dataclasses import replace

import numpy as np
import pytest
from support.glow_scenes import PLAIN, checkers, glowing, sign
from support.reference_scenes import box, lightmap_of, patch, random_scene, scene_of
from support.standard_errors import pooled

from gibench.reference.glow_pieces import glow_pieces
from gibench.reference.lights import emitter_table, luminance, triangle_areas
from gibench.reference.path_tracer import reference_image, reference_irradiance
from gibench.scene.lightmap.albedo import bilinear, covered_mean
from gibench.scene.model import Camera, Material


def rectangle(x0, x1, y0, y1, z):
    """Form factor of a patch at the origin that faces z to a rectangle at height z (Howell, A
    Catalog of Radiation Heat Transfer, B-3, corners by inclusion and exclusion).
    """

    def corner(a, b):
        x, y = a / np.hypot(a, z), b / np.hypot(b, z)
        first = x * np.arctan2(b, np.hypot(a, z))
        return (first + y * np.arctan2(a, np.hypot(b, z))) / (2 * np.pi)

    return corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)


POINTS = [(0.0, 0.0), (0.4, 0.1), (-0.45, 0.45), (0.9, -0.2)]


@pytest.mark.parametrize("count, fine", [(2, 64), (4, 32)])
def test_a_wall_beside_a_checkered_sign(count, fine):
    """Each field's form factor times what it emits; blurred edges even out."""
    pixels, is_bright = checkers(count, fine)
    others = [patch((x, y, 0.0), (0, 0, 1)) for x, y in POINTS]
    height = 0.6
    scene = sign(pixels, (-0.5, 0.5, height), (1, 0, 0), (0, -1, 0), others,
                 uvs=[(0, 1), (1, 1), (1, 0), (0, 0)])  # fmt: skip
    lightmap = lightmap_of(scene, range(len(POINTS)))
    found = reference_irradiance(scene, lightmap, paths=1 << 12, seed=3)
    for (x, y), value, error in zip(POINTS, found.value, found.stderr, strict=True):
        expected = np.zeros(3)
        for i in range(count):
            for j in range(count):
                low = np.array((j, i)) / count - 0.5 - (x, y)
                high = low + 1 / count
                bright = is_bright[pixels.shape[0] - 1 - i * fine, j * fine]
                color = np.array((4.0, 2.0, 1.0) if bright else (0.1, 0.2, 0.4))
                factor = rectangle(low[0], high[0], low[1], high[1], height)
                expected += np.pi * factor * color
        assert (np.abs(value - expected) < 4.5 * error + 0.003 * expected).all()
        np.testing.assert_allclose(value, expected, rtol=0.02)


def quadrature(scene, point, normal, side=600):
    """Irradiance at a point from the two triangles of a sign, by points of a fine grid, float64."""
    total = np.zeros(3)
    i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    u, v = ((x.reshape(-1) + 0.5) / side for x in (i, j))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    weights = np.stack((1 - u - v, u, v), axis=1)
    for row, triangle in enumerate(scene.glow.triangle):
        corners = scene.corners[triangle].astype(float)
        flat = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        area = np.linalg.norm(flat) / 2
        to = weights @ corners - point
        square = (to**2).sum(axis=1)
        to /= np.sqrt(square)[:, None]
        gain = np.clip(to @ normal, 0, None) * np.clip(-to @ flat / (2 * area), 0, None) / square
        emitted = bilinear(scene.glow.images[0].astype(float), weights @ scene.glow.uvs[row])
        total += area * (emitted * gain[:, None]).mean(axis=0)
    return total


@pytest.mark.parametrize(
    "kind", ["whole", "part", "many periods", "palette", "line", "large image", "spark"]
)
def test_light_of_any_image_is_its_integral(rng, kind):
    pixels = rng.random((12, 9, 3)) ** 5 * 30
    uvs = rng.uniform(-0.4, 1.3, (4, 2))
    if kind == "whole":
        uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    if kind == "many periods":
        uvs = uvs * 12
    if kind == "palette":
        uvs[:] = uvs[0]
    if kind == "line":
        uvs[:, 1] = uvs[0, 1]
    if kind == "large image":
        pixels = np.kron(rng.random((40, 40, 1)) ** 8, np.ones((16, 16, 3))) * 20
    if kind == "spark":  # a texel that is a thousand times as bright
        pixels = np.full((64, 64, 3), 0.01)
        pixels[40, 17] = 10, 20, 5
        uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    points = np.array([(0.1, 0.2, 0.0), (0.8, 0.6, 0.0)])
    others = [patch(p, (0.1, 0.0, 1.0)) for p in points]
    scene = sign(pixels, (0, 1, 0.7), (1, 0, 0), (0.1, -1, 0.1), others, uvs=uvs)
    found = reference_irradiance(scene, lightmap_of(scene, range(2)), paths=1 << 12, seed=9)
    normal = np.array((0.1, 0.0, 1.0)) / np.hypot(0.1, 1.0)
    for point, value, error in zip(points, found.value, pooled(found.stderr), strict=True):
        expected = quadrature(scene, point, normal)
        assert (np.abs(value - expected) < 4.5 * error + 2e-3 * expected).all()
    # A few paths will do where the image is sampled by its brightness.
    if kind != "many periods":
        assert found.relative_error < 0.015


def test_pieces_are_the_triangles(rng):
    """They cover them, and their powers add up to area times mean luminance."""
    scene = glowing(random_scene(rng), rng, share=1.0)
    areas = triangle_areas(scene.corners)[scene.glow.triangle]
    for most in (1 << 17, 300):
        pieces = glow_pieces(scene.glow, areas, most)
        e, f = (
            pieces.corners[:, 1] - pieces.corners[:, 0],
            pieces.corners[:, 2] - pieces.corners[:, 0],
        )
        share = np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])
        covered = np.bincount(pieces.row, share, minlength=len(areas))
        np.testing.assert_allclose(covered, 1, atol=1e-4)  # no image has a black cell
        assert ((pieces.corners > -1e-9) & (pieces.corners.sum(axis=2)[..., None] < 1 + 1e-9)).all()
        power = np.bincount(pieces.row, pieces.power, minlength=len(areas))
        for row in np.flatnonzero(pieces.even == 0):
            image = scene.glow.images[scene.glow.image[row]]
            uvs = scene.glow.uvs[row].astype(float)
            cells = pieces.cells[scene.glow.image[row]]
            if cells.shape == image.shape[:2]:
                # What a point shows and its texel's cell lie between the texels around it.
                mean, light = luminance(covered_mean(image, uvs[None])[0]), luminance(image)
                around = [np.roll(light, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)]
                assert abs(power[row] / areas[row] - mean) <= np.ptp(around, axis=0).max() * 1.001
            # Cells of many texels are far from what a triangle covers of them: theirs is the mean.
            mean, unsure = mean_of_cells(cells, uvs)
            assert abs(power[row] / areas[row] - mean) <= unsure


def mean_of_cells(grid, uvs, side=200):
    """Mean of cells over a triangle from points of a lattice, and how far off it may be: next to a
    line between cells a point may stand for what lies behind it.
    """
    i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    inside = i + j < side
    b = np.stack((i[inside] + 1 / 3, j[inside] + 1 / 3), axis=1) / side
    points = uvs[0] + b @ (uvs[1:] - uvs[0])
    height, width = grid.shape
    x = np.floor(points[:, 0] * width).astype(int)
    y = np.floor((1 - points[:, 1]) * height).astype(int)
    values = grid[y % height, x % width]
    lines = np.ptp(x) + np.ptp(y) + 3  # the triangle's own slope is one of three
    return values.mean(), np.ptp(values) * min(1.0, 2 * lines / side) + 1e-6 * values.mean()


def test_the_kernels_density_is_that_of_the_pieces(rng):
    """What is packed, looked up as reference/glow.cl does: power over area over the total."""
    scene = glowing(random_scene(rng), rng, share=1.0)
    table = emitter_table(scene)
    words, count = table.glow, len(scene.triangles)
    chance = np.diff(np.concatenate(([0.0], table.table.astype(float))))
    centre = table.pieces.mean(axis=1).astype(float)
    areas = triangle_areas(scene.corners)
    e, f = table.pieces[:, 1] - table.pieces[:, 0], table.pieces[:, 2] - table.pieces[:, 0]
    share = np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]).astype(float)
    large = np.flatnonzero((share >= 1e-3) & (chance >= 1e-4))
    assert len(large) > 20
    for i in rng.choice(large, 100):
        triangle = table.triangle[i]
        row = words[words[triangle] :]
        b = np.array((1 - centre[i].sum(), *centre[i]))
        uv = b @ row[:6].view(np.float32).reshape(3, 2).astype(float)
        even = float(row[12:13].view(np.float32)[0])
        width, height = int(row[10]), int(row[11])
        column, line = int(uv[0] % 1 * width), int((1 - uv[1] % 1) * height)
        cell = words[row[9] + line * width + column : row[9] + line * width + column + 1]
        density = even or float(cell.view(np.float32)[0])
        assert density == pytest.approx(chance[i] / (share[i] * areas[triangle]), rel=5e-3)
    assert count == len(scene.material_ids)


def test_a_camera_sees_the_texels(rng):
    pixels = rng.random((4, 4, 3)) * 3
    scene = sign(pixels, (0, 0, 0), (1, 0, 0), (0, 1, 0), materials=(PLAIN,))
    camera = Camera((0.5, 0.5, 0.5 / np.tan(np.radians(20))), (0.5, 0.5, 0.0), 40.0)
    image = reference_image(scene, camera, 8, 8, paths=64).value
    at = (np.arange(64) + 0.5) / 64
    fine = bilinear(pixels, np.stack([x.reshape(-1) for x in np.meshgrid(at, 1 - at)], axis=1))
    expected = fine.reshape(8, 8, 8, 8, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(image, expected, rtol=0.02, atol=0.02)


def test_a_room_lit_by_an_image_is_lit_as_by_its_texels(rng):
    """Every bounce: against the same wall cut into quads that emit one texel's colour each."""
    count, fine = 3, 12
    pixels, _ = checkers(count, fine)
    walls = box()[2:]
    scene = sign(pixels, (0, 0, 0), (1, 0, 0), (0, 1, 0), walls, materials=(PLAIN,))
    cut, ids = [], []
    for i in range(count):
        for j in range(count):
            a = np.array((j, i, 0.0)) / count
            e, f = np.array((1, 0, 0)) / count, np.array((0, 1, 0)) / count
            cut += [[a, a + e, a + e + f], [a, a + e + f, a + f]]
            ids += [1 + (i + j) % 2] * 2
    lamps = [Material("a", (0, 0, 0), (4, 2, 1)), Material("b", (0, 0, 0), (0.1, 0.2, 0.4))]
    plain = scene_of(np.array([*walls, *cut]), [0] * len(walls) + ids, [PLAIN, *lamps])
    results = [
        reference_irradiance(one, lightmap_of(one, range(len(walls))), paths=4096, seed=seed)
        for one, seed in ((scene, 1), (plain, 2))
    ]
    spread = np.sqrt(sum(pooled(one.stderr) ** 2 for one in results))
    off = results[0].value - results[1].value
    assert (np.abs(off) < 4.5 * spread + 0.004 * results[1].value).all()
    noise = np.sqrt((spread**2).sum()) / spread.size
    assert np.abs(off.mean()) < 4.5 * noise + 0.002 * results[1].value.mean()
    glow = replace(scene.glow, images=(scene.glow.images[0] * 1.1,))
    wrong = reference_irradiance(
        replace(scene, glow=glow), lightmap_of(scene, range(len(walls))), paths=4096
    )
    assert wrong.value.mean() > results[1].value.mean() + 4.5 * noise
