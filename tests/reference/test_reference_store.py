"""The reference's cache: what it is keyed by, going on from it, stopping, and bad input."""

from dataclasses import replace

import numpy as np
import pytest
from support.reference_scenes import box, lightmap_of, quad, scene_of

from gibench.errors import BadInput
from gibench.reference import path_tracer, store
from gibench.reference.path_tracer import reference_image, reference_irradiance
from gibench.reference.store import Rounds
from gibench.reference.wavefront import Wavefront
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, Material, PointLight

WALL = Material("wall", (0.5, 0.6, 0.7))
LAMP = PointLight((0.5, 0.6, 0.5), (1.0, 1.0, 1.0), orbit_radius=0.2)
SCENE = scene_of(box(), 0, [WALL], lights=[LAMP])
LIGHTMAP = lightmap_of(SCENE, range(12))
CAMERA = Camera((0.5, 0.5, 0.9), (0.5, 0.4, 0.0))


@pytest.fixture
def rounds_traced(monkeypatch):
    """Counts the rounds that are really traced."""
    seeds = []
    trace = Wavefront.round

    def counted(self, samples, seed, *rest):
        seeds.append(seed)
        return trace(self, samples, seed, *rest)

    monkeypatch.setattr(Wavefront, "round", counted)
    return seeds


def traced(folder, scene=SCENE, lightmap=LIGHTMAP, **settings):
    return reference_irradiance(scene, lightmap, **{"paths": 64, "store_dir": folder, **settings})


def test_the_same_is_not_traced_again(tmp_path, rounds_traced):
    first = traced(tmp_path)
    assert len(rounds_traced) == 8
    again = traced(tmp_path)
    assert len(rounds_traced) == 8
    assert np.array_equal(first.value, again.value)
    assert np.array_equal(first.stderr, again.stderr)
    assert (first.key, first.rays, first.paths) == (again.key, again.rays, again.paths)
    assert not list(tmp_path.glob("*.part"))


OTHER_LIGHTMAP = lightmap_of(SCENE, [[i, i + 1] for i in range(0, 12, 2)])
MOVED = replace(SCENE, positions=SCENE.positions * np.float32(1.5))


@pytest.mark.parametrize(
    "change",
    [
        {"scene": replace(SCENE, materials=(replace(WALL, base_color=(0.5, 0.6, 0.71)),))},
        {"scene": replace(SCENE, materials=(replace(WALL, emission=(0.0, 0.1, 0.0)),))},
        {"scene": replace(SCENE, lights=(replace(LAMP, intensity=(1.0, 1.1, 1.0)),))},
        {"scene": replace(SCENE, lights=(replace(LAMP, position=(0.5, 0.5, 0.5)),))},
        {"scene": replace(SCENE, lights=(LAMP, LAMP))},
        {"scene": replace(SCENE, environment=Environment.constant((0.1, 0.0, 0.0)))},
        {"scene": MOVED, "lightmap": lightmap_of(MOVED, range(12))},
        {"lightmap": OTHER_LIGHTMAP},
        {"frame": 7},
        {"bounces": 1},
        {"bounces": 2},
        {"seed": 2},
    ],
)
def test_anything_else_is_traced_anew(tmp_path, rounds_traced, change):
    before = traced(tmp_path)
    after = traced(tmp_path, **change)
    assert len(rounds_traced) == 16
    assert before.key != after.key
    fresh = traced(None, **change)
    assert np.array_equal(after.value, fresh.value)
    assert np.array_equal(traced(tmp_path).value, before.value)


def test_images_have_keys_of_their_own(tmp_path):
    def image(camera=CAMERA, width=4, **settings):
        return reference_image(SCENE, camera, width, 4, paths=8, store_dir=tmp_path, **settings)

    images = [
        image(),
        image(width=5),
        image(replace(CAMERA, fov_degrees=40.0)),
        image(indirect_only=True),
        image(indirect_only=True, irradiance=True),
        image(bounces=0),
    ]
    assert len({i.key for i in images}) == len(images)
    assert image().key == images[0].key
    assert np.array_equal(image().value, images[0].value)


def test_more_paths_go_on_from_what_is_there(tmp_path, rounds_traced, monkeypatch):
    monkeypatch.setattr(path_tracer, "_LARGE_ROUND", 1)
    monkeypatch.setattr(path_tracer, "_MANY_PATHS_PER_ROUND", 8)
    traced(tmp_path, paths=64)
    longer = traced(tmp_path, paths=160)
    assert len(rounds_traced) == 20 == len(set(rounds_traced))
    assert longer.paths == 160
    assert np.array_equal(longer.value, traced(None, paths=160).value)
    assert traced(tmp_path, paths=64).paths == 160


def test_an_interrupted_run_goes_on(tmp_path, rounds_traced, monkeypatch):
    monkeypatch.setattr(path_tracer, "_SAVE_EVERY_SECONDS", 0.0)
    done = 0

    def advance(paths):
        nonlocal done
        done += paths
        if done > 3 * 8 * 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        traced(tmp_path, progress=advance)
    # Each file on disk is whole: three rounds were kept, the fourth was lost.
    rounds_traced.clear()
    resumed = traced(tmp_path)
    assert len(rounds_traced) == 5
    assert np.array_equal(resumed.value, traced(None).value)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not an archive", None])
def test_a_damaged_file_is_traced_again(tmp_path, rounds_traced, damage):
    first = traced(tmp_path)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:-200] if damage is None else damage)
    assert np.array_equal(traced(tmp_path).value, first.value)
    assert len(rounds_traced) == 16


def test_a_file_under_a_wrong_name_is_not_believed(tmp_path, rounds_traced):
    traced(tmp_path)
    (file,) = tmp_path.iterdir()
    content = file.read_bytes()
    file.unlink()
    other = traced(tmp_path, bounces=1)
    (file,) = tmp_path.iterdir()
    file.write_bytes(content)
    assert np.array_equal(traced(tmp_path, bounces=1).value, other.value)


def test_a_target_error_stops(tmp_path, monkeypatch):
    monkeypatch.setattr(path_tracer, "_LARGE_ROUND", 1)
    loose = traced(tmp_path, paths=None, target_error=0.05)
    tight = traced(tmp_path, paths=None, target_error=0.01)
    assert loose.relative_error <= 0.05
    assert tight.relative_error <= 0.01
    assert loose.rounds < tight.rounds
    assert tight.paths < path_tracer.MOST_PATHS
    capped = traced(None, paths=64, target_error=1e-9)
    assert capped.paths == 64


def test_progress_counts_every_path():
    steps = []
    traced(None, progress=steps.append)
    assert sum(steps) == 64 * 12


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"target_error": 0.0}, "target error: a target error of 0 is never reached; give"),
        ({"target_error": -0.1}, "never reached"),
        ({"target_error": float("nan")}, "never reached"),
        ({"paths": 7}, "paths: 7 paths give no standard error; give 8 or more"),
        ({"paths": 0}, "0 paths"),
        ({"bounces": -1}, "bounces: -1 bounces"),
        ({"seed": -1}, "seed"),
        ({"lightmap": lightmap_of(scene_of([*box(), *box()], 0, [WALL]), [20])}, "another scene"),
        ({"scene": replace(SCENE, materials=(replace(WALL, base_color=(-1, 0, 0)),))}, "material"),
    ],
)
def test_bad_input(settings, words):
    with pytest.raises(BadInput, match=words):
        traced(None, **settings)


@pytest.mark.parametrize(
    ("camera", "size"),
    [
        (replace(CAMERA, target=CAMERA.position), (4, 4)),
        (replace(CAMERA, target=(0.5, 0.0, 0.9)), (4, 4)),
        (replace(CAMERA, fov_degrees=180.0), (4, 4)),
        (CAMERA, (0, 4)),
    ],
)
def test_bad_cameras(camera, size):
    with pytest.raises(BadInput):
        reference_image(SCENE, camera, *size, paths=8)


def test_irradiance_images_are_indirect():
    with pytest.raises(BadInput, match="indirect"):
        reference_image(SCENE, CAMERA, 4, 4, irradiance=True)


def test_two_seeds_agree_within_their_errors():
    glow = Material("glow", (0.3, 0.3, 0.3), (2.0, 1.0, 1.0))
    panel = quad((0.3, 0.9, 0.3), (0.4, 0, 0), (0, 0, 0.4))
    scene = scene_of([*box(), *panel], [0] * 12 + [1, 1], [WALL, glow], lights=[LAMP])
    lightmap = lightmap_of(scene, list(range(12)) * 20)
    a, b = (reference_irradiance(scene, lightmap, paths=512, seed=s) for s in (1, 2))
    z = (a.value - b.value) / np.hypot(a.stderr, b.stderr)
    assert 0.8 < z.std() < 1.3
    assert not np.array_equal(a.value, b.value)


def test_rounds_are_mean_and_standard_error():
    values = np.random.default_rng(5).random((9, 4, 3))
    rounds = Rounds.none(4)
    assert np.isinf(rounds.standard_error()).all()
    for value in values:
        rounds.add(value)
    assert rounds.mean == pytest.approx(values.mean(axis=0))
    assert rounds.standard_error() == pytest.approx(values.std(axis=0, ddof=1) / 3)
    assert store.key_digest({"a": 1}) != store.key_digest({"a": 2})
