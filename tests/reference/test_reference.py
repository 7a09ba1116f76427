"""The path tracer against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.reference_scenes import (
    DARK,
    box,
    disc,
    lightmap_of,
    patch,
    plain_texture,
    quad,
    scene_of,
    sphere,
)

from gibench.reference.path_tracer import reference_image, reference_irradiance
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, DirectionalLight, Material, PointLight, SpotLight


def irradiance(scene, groups, **settings):
    return reference_irradiance(scene, lightmap_of(scene, groups), **settings)


def within(result, expected, sigmas=4.0, floor=0.0):
    """Estimates equal the truth to within their own standard error."""
    off = np.abs(result.value - expected)
    assert (off <= sigmas * result.stderr + floor).all(), (off / (result.stderr + 1e-30)).max()


def test_closed_furnace():
    # Radiosity B = emission + albedo B: with 1 and 1/2 it is 2 everywhere, so irradiance is 2 pi.
    glowing = Material("glow", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0))
    scene = scene_of(box((1.0, 2.0, 3.0)), 0, [glowing])
    result = irradiance(scene, range(12), paths=1 << 16)
    assert np.abs(result.value / (2 * math.pi) - 1).max() < 0.005
    assert abs(result.value.mean() / (2 * math.pi) - 1) < 0.001


@pytest.mark.parametrize("bounces", [0, 1, 2, 5])
def test_furnace_of_so_many_bounces(bounces):
    glowing = Material("glow", (0.5, 0.25, 0.8), (1.0, 2.0, 3.0))
    scene = scene_of(box(), 0, [glowing])
    result = irradiance(scene, range(12), paths=2048, bounces=bounces)
    albedo, emission = np.array(glowing.base_color), np.array(glowing.emission)
    expected = math.pi * emission * sum(albedo**k for k in range(bounces + 1))
    within(result, expected, 5, 1e-5)
    assert np.abs(result.value.mean(axis=0) / expected - 1).max() < 0.005


@pytest.mark.parametrize("distance", [0.3, 1.0, 4.0])
def test_two_parallel_plates(distance):
    """Equal squares of side 1: Howell, A Catalog of Radiation Heat Transfer, C-11."""
    x = 1 / distance
    q = math.sqrt(1 + x * x)
    factor = (2 / (math.pi * x * x)) * (
        math.log((1 + x * x) / math.sqrt(1 + 2 * x * x))
        + 2 * x * q * math.atan(x / q)
        - 2 * x * math.atan(x)
    )
    glow = Material("glow", (0.0, 0.0, 0.0), (3.0, 2.0, 1.0))
    below = quad((0, 0, 0), (0, 0, 1), (1, 0, 0))
    above = quad((0, distance, 0), (1, 0, 0), (0, 0, 1))
    scene = scene_of(below + above, [0, 0, 1, 1], [DARK, glow])
    result = irradiance(scene, [[0, 1]], paths=1 << 16)
    expected = math.pi * factor * np.array(glow.emission)
    within(result, expected, 4, 1e-6)
    assert np.abs(result.value / expected - 1).max() < 0.005


def test_wide_parallel_plates_reflect_without_end():
    # Between infinite plates that emit 1 and reflect a, radiance is 1 / (1 - a).
    glow = Material("glow", (0.7, 0.5, 0.2), (1.0, 1.0, 1.0))
    below = quad((-500, 0, -500), (0, 0, 1000), (1000, 0, 0))
    above = quad((-500, 1, -500), (1000, 0, 0), (0, 0, 1000))
    middle = quad((-100, 0, 100), (0, 0, 2), (2, 0, 0))  # within the first triangle
    scene = scene_of(below + above, 0, [glow])
    lightmap = lightmap_of(scene_of(middle, 0, [glow]), [[0, 1]])
    result = reference_irradiance(scene, lightmap, paths=1 << 14)
    within(result, math.pi / (1 - np.array(glow.base_color)), 4, 1e-3)


def test_sphere_in_a_uniform_environment():
    radiance = np.array((2.0, 1.0, 0.5))
    scene = scene_of(
        sphere(),
        0,
        [Material("white", (0.9, 0.9, 0.9))],
        environment=Environment.constant(tuple(radiance)),
    )
    result = irradiance(scene, range(len(scene.triangles)), paths=64)
    assert result.value == pytest.approx(
        np.broadcast_to(math.pi * radiance, result.value.shape), rel=1e-5
    )


@pytest.mark.parametrize("kind", ["gradient", "sun", "bright row", "one column"])
def test_image_environments_against_quadrature(kind):
    rng = np.random.default_rng(3)
    if kind == "gradient":
        environment = Environment.gradient((1.0, 2.0, 4.0), (2.0, 2.0, 2.0), (0.3, 0.2, 0.1))
    elif kind == "one column":
        environment = Environment(rng.random((6, 1, 3)).astype(np.float32))
    else:
        pixels = rng.random((16, 32, 3)).astype(np.float32)
        pixels[5, 11 if kind == "sun" else slice(None)] = 300.0
        environment = Environment(pixels)
    normals = np.array([(0, 1, 0), (0, -1, 0), (1, 0, 0), (-0.6, 0.64, 0.48), (0, 0, -1.0)])
    corners = [patch(np.array((3.0 * i, 0, 0)), n) for i, n in enumerate(normals)]
    scene = scene_of(corners, 0, [DARK], environment=environment)
    result = irradiance(scene, range(len(normals)), paths=1 << 14)

    rows, columns = 1024, 2048
    edges = np.cos(np.linspace(0, np.pi, rows + 1))
    polar = (np.arange(rows) + 0.5) / rows * np.pi
    azimuth = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi
    s, c = np.sin(polar)[:, None], np.cos(polar)[:, None]
    d = np.stack((s * np.sin(azimuth), c + 0 * azimuth, -s * np.cos(azimuth)), axis=-1)
    d = d.reshape(-1, 3)
    solid_angle = np.repeat((edges[:-1] - edges[1:]) * 2 * np.pi / columns, columns)
    radiance = environment.radiance(d) * solid_angle[:, None]
    expected = np.array([np.maximum(d @ n, 0) @ radiance for n in normals])
    within(result, expected, 4.5, 2e-4 * expected.max())
    assert np.abs(result.value / expected - 1).max() < 0.01


@pytest.mark.parametrize(("radius", "height"), [(1.0, 1.0), (0.2, 2.0), (3.0, 0.5)])
def test_plane_under_a_disc_light(radius, height):
    """On the axis pi L sin^2; beside it Howell's catalogue, B-12 (times pi L)."""
    glow = Material("glow", (0.0, 0.0, 0.0), (1.0, 5.0, 0.5))
    off = np.array([0.0, 0.5, 1.0, 2.5]) * radius
    spots = [patch(np.array((x, 0, 0)), (0, 1, 0), 1e-3 * height) for x in off]
    light = disc(radius, height)
    scene = scene_of([*spots, *light], [0] * 4 + [1] * len(light), [DARK, glow])
    result = irradiance(scene, range(4), paths=1 << 14)
    together = height**2 + off**2 + radius**2
    share = 0.5 * (
        1 - (height**2 + off**2 - radius**2) / np.sqrt(together**2 - 4 * off**2 * radius**2)
    )
    assert share[0] == pytest.approx(radius**2 / (radius**2 + height**2))
    expected = math.pi * share[:, None] * np.array(glow.emission)
    within(result, expected, 4.5, 1e-4 * expected.max())
    assert np.abs(result.value[0] / expected[0] - 1).max() < 0.005


def cone_power(spot):
    """Power of a spot light over its intensity, sr, by quadrature of glTF's formula."""
    inner, outer = math.cos(spot.inner_angle), math.cos(spot.outer_angle)
    cosine = (np.arange(200_000) + 0.5) / 200_000 * 2 - 1
    fade = np.clip((cosine - outer) / max(0.001, inner - outer), 0, 1) ** 2
    return 2 * math.pi * fade.mean() * 2


SPOT = SpotLight((0.5, 0.9, 0.4), (0.0, -1.0, 0.0), (4.0, 2.0, 1.0), 0.3, 0.8)
POINT = PointLight((0.3, 0.6, 0.7), (1.0, 2.0, 3.0))


@pytest.mark.parametrize("bounces", [1, 3, None])
def test_energy_in_a_closed_box(bounces):
    """All reflected power stays: a, a + a^2 + a^3, a / (1 - a) times what the lights send out."""
    albedo = np.array((0.8, 0.5, 0.1))
    half = np.sqrt(albedo)
    white = Material("white", tuple(half), texture=0)
    lights = [SPOT, POINT]
    scene = scene_of(
        box((1.0, 1.0, 1.5)), 0, [white], lights=lights, textures=[plain_texture(half)]
    )
    sent = 4 * math.pi * np.array(POINT.intensity) + cone_power(SPOT) * np.array(SPOT.intensity)
    lightmap = lightmap_of(scene, range(12))
    result = reference_irradiance(scene, lightmap, paths=1 << 14, bounces=bounces)
    area = lightmap.receivers.area.astype(np.float64)[:, None]
    power = (result.value * area).sum(axis=0)
    error = np.sqrt(((result.stderr * area) ** 2).sum(axis=0))
    gain = albedo / (1 - albedo)
    if bounces is not None:
        gain = sum(albedo**k for k in range(1, bounces + 1))
    assert (np.abs(power - gain * sent) <= 4 * error + 1e-3 * gain * sent).all()
    assert (error < 0.02 * power).all()
    # Never more than the series allows, whatever the number of bounces.
    assert (power <= albedo / (1 - albedo) * sent + 4 * error + 1e-3 * sent).all()


def test_directional_light_counts_only_once_reflected():
    # Sunlight on a wide white floor; a patch above looks down on it: E = a * irradiance * cos.
    sun = DirectionalLight((0.6, -0.8, 0.0), (10.0, 5.0, 1.0))
    floor = quad((-300, 0, -300), (0, 0, 600), (600, 0, 0))
    down = patch(np.array((0.0, 1.0, 0)), (0, -1, 0))
    up = patch(np.array((5.0, 1.0, 0)), (0, 1, 0))
    scene = scene_of([*floor, down, up], 0, [Material("grey", (0.5, 0.4, 0.3))], lights=[sun])
    result = irradiance(scene, [2, 3], paths=4096, bounces=1)
    expected = np.array((0.5, 0.4, 0.3)) * np.array(sun.irradiance) * 0.8
    assert result.value[0] == pytest.approx(expected, rel=1e-3)
    assert not result.value[1].any()


def test_backs_are_black():
    glow = Material("glow", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0))
    seen = patch(np.array((0.5, 0.5, 0.5)), (0, 1, 0))
    # Turned outwards the box lets in light of its surroundings nowhere: its backs stop paths.
    for inside, environment in (
        (True, (0.0, 0.0, 0.0)),
        (False, (0.0, 0.0, 0.0)),
        (False, (1, 1, 1)),
    ):
        scene = scene_of(
            [seen, *box(inside=inside)],
            [0] + [1] * 12,
            [DARK, glow],
            environment=Environment.constant(environment),
        )
        assert irradiance(scene, [0], paths=64).value.any() == inside


def test_texture_is_sampled_as_the_scene_says():
    """A wall with one texel per corner region seen by the camera, v upwards, repeated."""
    pixels = np.arange(24, dtype=np.float32).reshape(2, 4, 3) / 24
    from gibench.scene.model import Texture

    wall = quad((0, 0, 0), (4, 0, 0), (0, 2, 0))
    uv = np.array([[0, 0], [2, 0], [2, 1], [0, 0], [2, 1], [0, 1]], np.float32)
    lit = DirectionalLight((0.0, 0.0, -1.0), (math.pi, math.pi, math.pi))
    scene = scene_of(
        wall,
        0,
        [Material("wall", (1.0, 1.0, 1.0), texture=0)],
        lights=[lit],
        uvs=uv,
        textures=[Texture("t", pixels)],
    )
    camera = Camera((2, 1, 50.0), (2, 1, 0), math.degrees(2 * math.atan(1 / 50)))
    image = reference_image(scene, camera, 16, 8, paths=64, bounces=0)
    # Pixel centres of texels: the box filter over a quarter texel of a bilinear ramp is its middle.
    inner = np.kron(np.tile(pixels, (1, 2, 1)), np.ones((4, 2, 1)))
    x = (np.arange(16) + 0.5) / 2 - 0.5
    y = (np.arange(8) + 0.5) / 4 - 0.5
    grid = np.tile(pixels, (1, 2, 1)).astype(np.float64)

    def bilinear(px, py):
        x0, y0 = math.floor(px), math.floor(py)
        fx, fy = px - x0, py - y0
        get = lambda i, j: grid[j % 2, i % 8]  # noqa: E731
        top = get(x0, y0) * (1 - fx) + get(x0 + 1, y0) * fx
        low = get(x0, y0 + 1) * (1 - fx) + get(x0 + 1, y0 + 1) * fx
        return top * (1 - fy) + low * fy

    fine = (np.arange(8) + 0.5) / 8 - 0.5
    expected = np.array(
        [
            [
                np.mean([bilinear(i + a / 2, j + b / 4) for a in fine for b in fine], axis=0)
                for i in x
            ]
            for j in y
        ]
    )
    assert image.value.shape == inner.shape
    assert np.abs(image.value - expected).max() < 0.02
    assert np.abs(image.value - expected).mean() < 0.002


def test_camera_sees_what_the_receivers_get():
    # Irradiance through a camera, reflected radiance, and the receivers' own irradiance agree.
    white = Material("white", (0.8, 0.6, 0.4))
    scene = scene_of(box(), 0, [white], lights=[POINT])
    back = [0, 1]  # z = 0, faces +z
    camera = Camera((0.5, 0.5, 0.999), (0.5, 0.5, 0), 2 * math.degrees(math.atan(0.5 / 0.999)))
    on_wall = irradiance(scene, [back], paths=1 << 16)
    seen = reference_image(scene, camera, 6, 6, indirect_only=True, irradiance=True, paths=8192)
    spread = np.sqrt((seen.stderr**2).sum(axis=(0, 1)) / 36**2 + on_wall.stderr[0] ** 2)
    off = np.abs(seen.value.mean(axis=(0, 1)) - on_wall.value[0])
    assert (off < 4 * spread).all()
    assert (spread < 0.01 * on_wall.value[0]).all()
    reflected = reference_image(scene, camera, 6, 6, indirect_only=True, paths=8192)
    both = np.array(white.base_color) / math.pi
    expected, error = seen.value * both, np.hypot(seen.stderr * both, reflected.stderr)
    assert (np.abs(reflected.value - expected) < 6 * error + 1e-6).all()


def test_standard_error_is_honest():
    white = Material("white", (0.7, 0.7, 0.7))
    glow = Material("glow", (0.2, 0.2, 0.2), (4.0, 3.0, 2.0))
    ids = [0] * 11 + [1]
    scene = scene_of(box(), ids, [white, glow], lights=[SPOT])
    groups = np.repeat(np.arange(12), 60)
    truth = irradiance(scene, range(12), paths=1 << 16, seed=9).value
    result = irradiance(scene, groups, paths=256, seed=2)
    assert result.rounds == 8
    z = (result.value - np.repeat(truth, 60, axis=0)) / result.stderr
    # With 8 rounds z follows Student's t with 7 degrees of freedom: standard deviation 1.18.
    assert 1.0 < z.std() < 1.4
    assert abs(z.mean()) < 0.15
    assert np.mean(np.abs(z) > 2.365) == pytest.approx(0.05, abs=0.03)


def test_smooth_normals_tilt_the_cosine():
    # One triangle with normals tilted by 30 degrees under an environment that is lit at the zenith
    # half only: what counts is the cosine to the tilted normal, above the triangle's own plane.
    tilt = np.array((0.5, math.sqrt(0.75), 0.0))
    environment = Environment.constant((1.0, 1.0, 1.0))
    scene = scene_of([patch(np.zeros(3), (0, 1, 0))], 0, [DARK], environment=environment)
    scene = replace(scene, normals=np.tile(tilt, (3, 1)).astype(np.float32))
    result = irradiance(scene, [0], paths=1 << 14)
    # The lune between the two planes is lost: pi (1 + cos 30) / 2 remains.
    assert result.value[0] == pytest.approx(math.pi * (1 + math.sqrt(0.75)) / 2, rel=2e-3)
