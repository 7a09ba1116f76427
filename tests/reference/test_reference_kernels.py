"""The reference's kernels against float64 NumPy on random vertices, hits and lights."""

import numpy as np
import pytest
from support import reference_oracle as oracle
from support.reference_scenes import lightmap_of, random_scene

from gibench.device import reads, unsigned, writes
from gibench.rays.tracer import Hits
from gibench.reference import host_cl, wavefront
from gibench.reference.camera import image_plane
from gibench.reference.packed import pack_fragments, pack_scene
from gibench.reference.queues import Queues
from gibench.reference.starts import CameraStart, ReceiverStart
from gibench.reference.wavefront import Wavefront
from gibench.scene.model import (
    Camera,
    DirectionalLight,
    SpotLight,
)

OWNERS, SAMPLES, SEED = 37, 7, 12345
GROUPS = [1, 16, 64, 100]
GRAZING = 1e-6


@pytest.fixture(params=GROUPS)
def group(request, monkeypatch):
    monkeypatch.setattr(
        wavefront, "host_program", lambda **more: host_cl.host_program(request.param, **more)
    )
    return request.param


class ChosenRays:
    """A ray tracer that remembers its rays and answers what it is told."""

    def __init__(self, hits=None):
        self.hits, self.rays = hits, None

    def closest(self, origins, directions, max_distance=np.inf):
        self.rays = origins.copy(), directions.copy()
        return self.hits

    def occluded(self, origins, directions, max_distance=np.inf):
        self.rays = origins.copy(), directions.copy(), np.array(max_distance)
        return self.blocked(directions)

    @staticmethod
    def blocked(directions):
        return directions[:, 0] > 0.2


def units(rng, count):
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def ready(scene, tracer, rng, count):
    """A wavefront and queues with ``count`` random vertices inside the unit box."""
    start = ReceiverStart(pack_fragments(lightmap_of(scene, [0]).fragments))
    front = Wavefront(pack_scene(scene, 0), tracer, start, 6)
    q = Queues(front.program, OWNERS * SAMPLES, front._slots)
    at = q.vertices[0]
    at.origin.array[:] = rng.uniform(0.05, 0.85, at.origin.array.shape)
    at.direction.array[:] = units(rng, len(at.path.array))
    at.geometric.array[:] = units(rng, len(at.path.array))
    tilted = at.geometric.array + 0.3 * units(rng, len(at.path.array))
    at.shading.array[:] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    at.path.array[:] = rng.permutation(OWNERS * SAMPLES)
    at.density.array[:] = rng.random(len(at.path.array))
    at.density.array[::9] = -1
    q.throughput.array[:] = rng.random(q.throughput.array.shape)
    q.collected.array[:] = rng.random(q.collected.array.shape)
    return front, q, at


WHICH = (unsigned("first", 100), unsigned("samples", SAMPLES), unsigned("round_seed", SEED))


def seed_and_sample(path, dimension):
    return path % SAMPLES, oracle.seed_of(100 + path // SAMPLES, SEED, dimension)


def connection(scene, packed, light, vertex, path, point, normal):
    """Direction, distance and weight, as the kernel's comments say them."""
    if light < len(scene.lights):
        lamp = scene.lights[light]
        if isinstance(lamp, DirectionalLight):
            to = -np.array(lamp.direction)
            return to, np.inf, np.array(lamp.irradiance) * max(to @ normal, 0) / np.pi
        to = np.array(lamp.position) - point
        distance = np.linalg.norm(to)
        to /= distance
        strength = np.array(lamp.intensity) / distance**2
        if isinstance(lamp, SpotLight):
            inner, outer = np.cos(lamp.inner_angle), np.cos(lamp.outer_angle)
            fade = np.clip((-to @ np.array(lamp.direction) - outer) / (inner - outer), 0, 1)
            strength = strength * fade**2
        return to, distance, strength * max(to @ normal, 0) / np.pi
    if light == len(scene.lights):
        x, y = oracle.sample_2d(*seed_and_sample(path, 4 * vertex + 1))
        i, within = oracle.choose(packed.emitters.table, x)
        r = np.sqrt(within)
        triangle = packed.emitters.triangle[i]
        at, facing, _, _ = oracle.surface(scene, triangle, r * (1 - y), r * y)
        to = oracle.leave_surface(at, facing) - point
        distance = np.linalg.norm(to)
        to /= distance
        material = scene.material_ids[triangle]
        if to @ normal <= 0 or to @ facing >= 0:
            return to, distance, np.zeros(3)
        by_light = float(packed.emitters.density[material]) * distance**2 / -(to @ facing)
        by_cosine = to @ normal / np.pi
        share = by_cosine / by_light * oracle.power(by_light, by_cosine)
        return to, distance, share * np.array(scene.materials[material].emission)
    table = packed.environment_table
    height, width = table.density.shape
    x, y = oracle.sample_2d(*seed_and_sample(path, 4 * vertex + 2))
    row, down = oracle.choose(table.rows, x)
    column, across = oracle.choose(table.columns[row], y)
    edges = np.cos(np.pi * np.array((row, row + 1)) / height)
    up = edges[0] + (edges[1] - edges[0]) * down
    azimuth = 2 * np.pi * ((column + across) / width - 0.5)
    radius = np.sqrt(1 - up * up)
    to = np.array((radius * np.sin(azimuth), up, -radius * np.cos(azimuth)))
    by_light = float(table.density[row, column])
    by_cosine = max(to @ normal, 0) / np.pi
    share = by_cosine / by_light * oracle.power(by_light, by_cosine) if by_cosine else 0.0
    return to, np.inf, share * scene.environment.radiance(to[None])[0]


@pytest.mark.parametrize(("vertex", "count"), [(0, 259), (2, 131), (1, 1)])
def test_connect_and_resolve(rng, group, vertex, count):
    scene, tracer = random_scene(rng), ChosenRays()
    front, q, at = ready(scene, tracer, rng, count)
    before = q.collected.array.copy()
    front._go_on(q, at, count, vertex, WHICH)
    front._connect(q, at, count, vertex)
    front.program.queue.finish()
    packed = pack_scene(scene, 0)
    origins, directions, limits = tracer.rays or (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    found = np.column_stack((origins, directions)).astype(np.float64)
    blocked = tracer.blocked(directions)
    expected, wanted, doubtful = before.astype(np.float64), 0, 0
    for v in range(count):
        point, normal = at.origin.array[v].astype(float), at.shading.array[v].astype(float)
        path = int(at.path.array[v])
        for light in range(len(scene.lights) if vertex == 0 else 0, len(scene.lights) + 2):
            to, distance, weight = connection(scene, packed, light, vertex, path, point, normal)
            above = to @ at.geometric.array[v]
            # Grazing the geometric surface, float32 and float64 may decide differently.
            doubtful += abs(above) < GRAZING and weight.sum() > 0
            if weight.sum() > 0 and above > 0:
                off = np.abs(found - np.concatenate((point, to))).max(axis=1)
                ray = int(off.argmin())
                if off[ray] > 1e-5:
                    assert above < GRAZING
                    continue
                wanted += 1
                # A limit just short of the light.
                assert limits[ray] == pytest.approx(distance, rel=2e-5)
                if not blocked[ray]:
                    expected[path] += weight * q.throughput.array[path]
    assert q.collected.array == pytest.approx(expected, rel=2e-3, abs=2e-4)
    # Every connection has one ray, in whatever order.
    assert wanted <= len(found) <= wanted + doubtful
    assert len(np.unique(found, axis=0)) == len(found)


@pytest.mark.parametrize(
    ("vertex", "kind", "plain", "count"),
    [
        (1, 0, False, 259),
        (4, 0, False, 130),
        (7, 0, False, 259),
        (0, 2, False, 65),
        (0, 1, True, 259),
    ],
)
def test_shade(rng, group, vertex, kind, plain, count):
    scene = random_scene(rng)
    triangle = rng.integers(-1, len(scene.triangles), count).astype(np.int32)
    u = rng.random(count).astype(np.float32) * np.float32(0.5)
    v = rng.random(count).astype(np.float32) * np.float32(0.5)
    distance = rng.uniform(0.1, 2, count).astype(np.float32)
    front, q, at = ready(scene, ChosenRays(Hits(triangle, distance, u, v)), rng, count)
    carried, collected = q.throughput.array.copy(), q.collected.array.astype(np.float64)
    if vertex:  # where they came from, the end by chance was drawn
        rays = at.direction.array.copy(), at.density.array.copy()
        front._go_on(q, at, count, vertex - 1, WHICH)
        at.direction.array[:], at.density.array[:] = rays
    made = front._follow(q, at, q.vertices[1], count, vertex, kind, plain)
    front._go_on(q, q.vertices[1], made, vertex, WHICH)
    packed = pack_scene(scene, 0)
    table = packed.environment_table
    alive = {}
    for i in range(count):
        d, density = at.direction.array[i].astype(float), float(at.density.array[i])
        path = int(at.path.array[i])
        if density < 0:
            continue
        if triangle[i] < 0:
            height, width = table.density.shape
            row = min(int(np.arccos(d[1]) / np.pi * height), height - 1)
            column = min(int((np.arctan2(d[0], -d[2]) / (2 * np.pi) + 0.5) * width), width - 1)
            share = (
                oracle.power(density, float(table.density[row, column])) if kind == 0 else kind - 1
            )
            collected[path] += share * carried[path] * scene.environment.radiance(d[None])[0]
            continue
        point, geometric, shading, uv = oracle.surface(scene, triangle[i], float(u[i]), float(v[i]))
        facing = -(d @ geometric)
        if facing <= 0:
            continue
        number = scene.material_ids[triangle[i]]
        material = scene.materials[number]
        if max(material.emission) > 0:
            by_light = float(packed.emitters.density[number]) * float(distance[i]) ** 2 / facing
            share = oracle.power(density, by_light) if kind == 0 else kind - 1
            collected[path] += share * carried[path] * np.array(material.emission)
        if vertex > 6:
            continue
        albedo = np.array(material.base_color)
        if material.texture >= 0:
            albedo = albedo * oracle.texture(scene.textures[material.texture].pixels, uv)
        left = carried[path] * (1.0 if plain else albedo)
        if vertex >= 3:
            survival = min(left.max(), 0.95)
            if oracle.sample_1d(*seed_and_sample(path, 4 * vertex + 3)) >= survival:
                continue
            left = left / survival
        if left.max() > 0:
            next_ = oracle.direction(oracle.sample_2d(*seed_and_sample(path, 4 * vertex)), shading)
            alive[path] = left, point, geometric, shading, next_
    after = q.vertices[1]
    assert q.collected.array == pytest.approx(collected, rel=2e-3, abs=1e-4)
    assert made == len(alive)
    assert set(after.path.array[:made].tolist()) == set(alive)
    for j in range(made):
        path = int(after.path.array[j])
        left, point, geometric, shading, next_ = alive[path]
        assert q.throughput.array[path] == pytest.approx(left, rel=1e-3, abs=1e-5)
        assert after.origin.array[j] == pytest.approx(point, abs=5e-5)
        # Off the surface, on the front.
        assert (after.origin.array[j] - point) @ geometric > 0
        assert after.geometric.array[j] == pytest.approx(geometric, abs=1e-5)
        assert after.shading.array[j] == pytest.approx(shading, abs=1e-5)
        assert after.direction.array[j] == pytest.approx(next_, abs=1e-4)
        if abs(next_ @ geometric) > 1e-4:
            wanted = next_ @ shading / np.pi if next_ @ geometric > 0 else -1
            assert after.density.array[j] == pytest.approx(wanted, abs=1e-4)


def test_start_at_receivers_and_average(rng, group):
    scene = random_scene(rng)
    groups = [rng.choice(12, 3, replace=False) for _ in range(OWNERS)]
    fragments = pack_fragments(lightmap_of(scene, groups).fragments)
    front = Wavefront(pack_scene(scene, 0), ChosenRays(), ReceiverStart(fragments), 0)
    front.last_vertex, front._has_area_light, front._slots = 0, False, front._delta
    q = Queues(front.program, OWNERS * SAMPLES, 1)
    q.collected.array[:] = 5
    front._wave(q, 0, OWNERS, SAMPLES, SEED)
    at = q.vertices[0]
    assert (q.mean.array[:OWNERS] == 0).all()
    for path in at.path.array:
        owner, sample = divmod(int(path), SAMPLES)
        begin, end = fragments.start[owner : owner + 2]
        which = oracle.sample_1d(sample, oracle.seed_of(owner, SEED, 0x7FFF0000))
        f = begin + oracle.choose(fragments.table[begin:end], which)[0]
        x, y = oracle.sample_2d(sample, oracle.seed_of(owner, SEED, 0x7FFF0001))
        r = np.sqrt(x)
        point, geometric, shading, _ = oracle.surface(
            scene, fragments.triangle[f], r * (1 - y), r * y
        )
        assert at.origin.array[path] == pytest.approx(point, abs=5e-5)
        assert at.geometric.array[path] == pytest.approx(geometric, abs=1e-5)
        assert at.shading.array[path] == pytest.approx(shading, abs=1e-4)
    values = rng.random((OWNERS * SAMPLES, 3)).astype(np.float32)
    q.collected.array[:] = values
    front.program.run(
        "average",
        OWNERS,
        unsigned("owners", OWNERS),
        unsigned("samples", SAMPLES),
        reads("collected", q.collected),
        writes("mean", q.mean),
    )
    front.program.queue.finish()
    expected = values.reshape(OWNERS, SAMPLES, 3).astype(np.float64).mean(axis=1)
    assert q.mean.array[:OWNERS] == pytest.approx(expected, rel=1e-5)


def test_start_at_camera(rng, group):
    scene = random_scene(rng)
    camera = Camera(tuple(rng.random(3)), tuple(rng.random(3) + 1), 47.0)
    width, height = 9, 5
    plane = image_plane(camera, width, height)
    paths = width * height * SAMPLES
    missed = Hits(np.full(paths, -1, np.int32), *(np.zeros(paths, np.float32) for _ in range(3)))
    tracer = ChosenRays(missed)
    start = CameraStart(plane, width, height, False, False)
    mean = Wavefront(pack_scene(scene, 0), tracer, start, None).round(SAMPLES, SEED)
    position, forward, right, up = plane
    assert (forward @ right, forward @ up, right @ up) == pytest.approx((0, 0, 0), abs=1e-12)
    assert np.linalg.norm(up) == pytest.approx(np.tan(np.radians(23.5)))
    assert np.linalg.norm(right) == pytest.approx(np.tan(np.radians(23.5)) * width / height)
    assert forward == pytest.approx(oracle.unit_vector(np.array(camera.target) - position))
    origins, directions = tracer.rays
    for path in range(paths):
        owner, sample = divmod(path, SAMPLES)
        x, y = oracle.sample_2d(sample, oracle.seed_of(owner, SEED, 0x7FFF0001))
        across, down = (owner % width + x) / width, (owner // width + y) / height
        wanted = oracle.unit_vector(forward + (2 * across - 1) * right + (1 - 2 * down) * up)
        assert directions[path] == pytest.approx(wanted, abs=1e-6)
    assert origins == pytest.approx(np.broadcast_to(position, origins.shape), abs=1e-7)
    sky = scene.environment.radiance(directions).reshape(-1, SAMPLES, 3).mean(axis=1)
    assert mean == pytest.approx(sky, rel=1e-4)
