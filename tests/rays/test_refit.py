"""Moving geometry: vertices against float64, the refitted tree against a new one and oracles."""

from dataclasses import replace

import numpy as np
import pytest
from support.made import by_name
from support.moving_scenes import (
    begin,
    crowd,
    furnished_room,
    moved_in,
    read_corners,
    read_tree,
)
from support.pairwise import few
from support.rays_oracle import (
    AGREE,
    ROUNDING,
    UNEXPLAINED,
    closest_float64,
    differences,
    hard_rays,
    walk,
)
from support.shading_oracle import open_device

from gibench.conform.refit import bounds_beneath, vertex_bound
from gibench.rays.bvh import build_bvh
from gibench.rays.bvh_wide import WIDTH
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer
from gibench.rays.refit import RefitPlan
from gibench.rays.tracer import Hits
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Turn
from gibench.techniques.parts.conformance.synthetic import random_motion
from gibench.techniques.parts.frame_scene import FrameScene

SIZES = few([1, 7, 64, 100], (7, 100))  # none of them divides what is moved


def moving(rng, scene=None, movers=("one", "some", "box"), frames=4, device=None):
    """A scene on a device whose objects ``movers`` take random poses."""
    scene = crowd(rng) if scene is None else scene
    motion = MovingObjects.of(scene, [random_motion(name, rng, frames) for name in movers])
    device = device or open_device()
    return FrameScene(device, scene, 8, 8, scene.cameras[0], motion=motion), motion


@pytest.mark.parametrize("size", SIZES)
def test_vertices_are_where_float64_puts_them(rng, size):
    shared, motion = moving(rng)
    scene = shared.scene
    vertices, objects = motion.vertices(scene)
    assert np.array_equal(vertices, np.unique(scene.triangles[motion.triangles]))
    rest = np.setdiff1d(np.arange(len(scene.positions)), vertices)
    assert len(vertices) and len(rest)
    for frame in (2, 0, 3):
        begin(shared, frame, size)
        positions, normals = (
            shared.device.read(b) for b in (shared.surfaces.positions, shared.surfaces.normals)
        )
        expected, directions = moved_in(scene, motion, frame)
        bound = vertex_bound(scene.positions[vertices], motion.transforms_in(frame)[objects])
        assert np.all(np.abs(positions[vertices] - expected[vertices]) <= bound)
        assert np.abs(normals[vertices] - directions[vertices]).max() <= 6 * ROUNDING * 3**0.5
        # What rests is not touched.
        np.testing.assert_array_equal(positions[rest], scene.positions[rest])
        np.testing.assert_array_equal(normals[rest], scene.normals[rest])


@pytest.mark.parametrize("size", SIZES)
def test_bounds_are_exactly_those_of_the_moved_triangles(rng, size):
    shared, motion = moving(rng)
    plan = RefitPlan.of(shared.bvh, motion.triangles)
    before = shared.bvh.nodes.reshape(-1, 7, WIDTH)
    for frame in (1, 3):
        begin(shared, frame, size)
        tree, corners = read_tree(shared), read_corners(shared)
        seen, depth = walk(tree, corners)  # every leaf holds its triangles' present corners
        assert sorted(seen) == list(range(len(corners)))
        assert depth == shared.bvh.depth
        nodes = tree.nodes.reshape(-1, 7, WIDTH)
        np.testing.assert_array_equal(nodes[:, :6], bounds_beneath(tree))
        # What has nothing moving beneath it is left alone, and so are all children's numbers.
        others = np.ones(len(nodes) * WIDTH, bool)
        others[plan.node_slots] = False
        now, then = (n.transpose(0, 2, 1).reshape(-1, 7) for n in (nodes, before))
        np.testing.assert_array_equal(now[others].view(np.int32), then[others].view(np.int32))
        np.testing.assert_array_equal(now[:, 6].view(np.int32), then[:, 6].view(np.int32))


def test_only_what_moves_and_its_ancestors_are_visited(rng):
    scene = crowd(rng)
    bvh = build_bvh(scene.corners)
    motion = MovingObjects.of(scene, [random_motion("one", rng)])
    assert motion.triangles.sum() == 1
    plan = RefitPlan.of(bvh, motion.triangles)
    assert len(plan.triangle_slots) == 1
    assert len(plan.node_slots) <= bvh.depth  # a path from the root
    assert all(count == 1 for _, count in plan.levels)
    everything = RefitPlan.of(bvh, np.ones(len(scene.triangles), bool))
    used = np.count_nonzero(bvh.nodes.reshape(-1, 7, WIDTH)[:, 0] < np.inf)
    assert len(everything.node_slots) == used == sum(count for _, count in everything.levels)
    assert len(everything.levels) == bvh.depth
    assert everything.leaf_blocks == bvh.block_count
    assert everything.inner == bvh.node_count - 1
    assert len(everything.triangle_slots) == len(scene.triangles)
    nothing = RefitPlan.of(bvh, np.zeros(len(scene.triangles), bool))
    assert not len(nothing.triangle_slots) and not len(nothing.node_slots) and not nothing.levels


@pytest.mark.parametrize(
    ("packets", "size"),
    [
        (False, 96),
        (True, 32),
        *(pytest.param(p, n, marks=pytest.mark.slow) for p, n in ((False, 32), (True, 96))),
    ],
)
def test_hits_are_those_of_a_new_tree_and_of_the_oracles(rng, packets, size):
    shared, _ = moving(rng)
    device = shared.device
    nodes, triangles = (a.value for a in shared.bvh_args)
    tree = DeviceBvh(shared.bvh, nodes, triangles)
    refitted = DeviceTracer(device, tree, size, packets=packets)
    for frame in range(3):
        begin(shared, frame, size)
        corners = read_corners(shared)
        rebuilt = DeviceTracer(
            device, DeviceBvh.upload(device, build_bvh(corners), f"new{frame}"), size,
            name=f"tracer{frame}", packets=packets,
        )  # fmt: skip
        embree = EmbreeTracer(corners)
        for kind, (o, d) in hard_rays(corners, 401, rng).items():
            mine = refitted.closest(o, d)
            exact = closest_float64(corners, o, d)
            for other in (rebuilt.closest(o, d), embree.closest(o, d), Hits(*exact)):
                why = differences(corners, o, d, mine, other)
                assert not np.any(why == UNEXPLAINED), (kind, frame)
                if kind in ("random", "outside"):
                    assert np.count_nonzero(why != AGREE) <= 1, (kind, frame)
            assert np.array_equal(mine.triangle >= 0, refitted.occluded(o, d)), (kind, frame)
            limit = rng.uniform(0.0, 6.0, len(o)).astype(np.float32)
            near = refitted.closest(o, d, limit).triangle >= 0
            assert np.array_equal(near, mine.distance < limit), (kind, frame)


def test_nothing_drifts_in_a_thousand_frames(rng):
    scene = crowd(rng)
    axis = tuple(rng.normal(size=3).tolist())
    motion = MovingObjects.of(
        scene, [Turn("some", axis, period_frames=100), Turn("box", (0, 1, 0))]
    )
    shared = FrameScene(open_device(), scene, 8, 8, scene.cameras[0], motion=motion)

    def state():
        return [
            shared.device.read(b)
            for b in (
                shared.surfaces.positions,
                shared.surfaces.normals,
                *(a.value for a in shared.bvh_args),
            )
        ]

    at_rest = state()
    begin(shared, 0, 64)
    for now, then in zip(state(), at_rest, strict=True):  # a turn by nothing
        np.testing.assert_array_equal(now.view(np.int32), then.view(np.int32))
    begin(shared, 137, 64)
    once = state()
    for frame in range(138, 1200):
        begin(shared, frame, 64)
    begin(shared, 1337, 64)  # both turns have come round
    for now, then in zip(state(), once, strict=True):
        np.testing.assert_array_equal(now.view(np.int32), then.view(np.int32))


def test_a_large_scene_on_the_move_loses_no_ray(rng):
    """Leaves of several blocks and a deep tree, all of it on the move at once."""
    scene = crowd(rng, (3000, 5000), ("still", "all"))
    scene.positions[:200] = scene.positions[0] + 1e-3 * rng.normal(size=(200, 3))
    shared, _ = moving(rng, scene, ("still", "all", "box"), frames=2)
    nodes, triangles = (a.value for a in shared.bvh_args)
    tracer = DeviceTracer(shared.device, DeviceBvh(shared.bvh, nodes, triangles), 64)
    begin(shared, 1, 64)
    corners = read_corners(shared)
    embree = EmbreeTracer(corners)
    for kind, (o, d) in hard_rays(corners, 2001, rng).items():
        why = differences(corners, o, d, tracer.closest(o, d), embree.closest(o, d))
        assert not np.any(why == UNEXPLAINED), kind


def test_memory_is_declared(rng):
    shared, motion = moving(rng)
    held, scene = shared.device.memory.allocated, shared.scene
    size = (scene, 8, 8)
    assert held == by_name(FrameScene.buffers(*size, bvh=shared.bvh, motion=motion))
    least = by_name(FrameScene.buffers(*size, motion=motion))
    assert all(n <= held[name] for name, n in least.items())
    plan = RefitPlan.of(shared.bvh, motion.triangles)
    vertices = len(motion.vertices(scene)[0])
    resting = by_name(FrameScene.buffers(*size, bvh=shared.bvh))
    assert {name: n for name, n in held.items() if name not in resting} == {
        "moving_vertices": 4 * vertices,
        "moving_vertex_objects": 4 * vertices,
        "rest_positions": 12 * vertices,
        "rest_normals": 12 * vertices,
        "moving_triangle_slots": 4 * motion.triangles.sum(),
        "moving_node_slots": 4 * len(plan.node_slots),
        "object_transforms": 48 * motion.objects,
    }
    # At rest nothing of it is there, and the table of transforms only where it is asked for.
    resting = FrameScene(open_device(), scene, 8, 8, scene.cameras[0], shared.bvh)
    assert resting.passes() == []
    held = resting.device.memory.allocated
    assert held == by_name(FrameScene.buffers(*size, bvh=shared.bvh))
    table = resting.device.read(resting.object_transforms())
    np.testing.assert_array_equal(table, np.tile(np.eye(3, 4).reshape(-1), (5, 1)))
    assert held == by_name(FrameScene.buffers(*size, bvh=shared.bvh, transforms=True))
    assert held["object_transforms"] == 48 * 5


def test_transforms_are_the_motions(rng):
    shared, motion = moving(rng)
    for frame in (0, 2):
        shared.begin_frame(frame)
        table = shared.device.read(shared.object_transforms()).reshape(-1, 3, 4)
        np.testing.assert_array_equal(table, motion.transforms_in(frame).astype(np.float32))
        np.testing.assert_array_equal(table[[0, 3]], np.tile(np.eye(3, 4), (2, 1, 1)))
        assert not np.array_equal(table[1], np.eye(3, 4))


def test_work_counts_each_vertex_triangle_and_node_once(rng):
    shared, motion = moving(rng)
    vertices, triangles = len(motion.vertices(shared.scene)[0]), int(motion.triangles.sum())
    plan = RefitPlan.of(shared.bvh, motion.triangles)
    move, leaves, nodes = (item.work for item in shared.passes())
    assert [item.name for item in shared.passes()] == [
        "move_vertices", "refit_leaves", "refit_nodes",
    ]  # fmt: skip
    # 3 x 3 products and 3 x 3 sums of a point, 3 x 3 and 3 x 2 of a direction.
    assert move.flops == 33 * vertices
    assert move.bytes_written == 24 * vertices and leaves.bytes_written == 36 * triangles
    assert nodes.bytes_written == 24 * len(plan.node_slots)
    assert leaves.flops == nodes.flops == 0
    assert move.bytes_read == 32 * vertices + 48 * motion.objects
    assert leaves.bytes_read == 20 * triangles + 12 * vertices


def test_vertices_that_no_triangle_uses_rest(rng):
    scene = furnished_room()
    loose = np.full((2, 3), 7.0, np.float32)
    scene = replace(
        scene,
        positions=np.concatenate([scene.positions, loose]),
        normals=np.concatenate([scene.normals, loose]),
        uvs=np.zeros((len(scene.positions) + 2, 2), np.float32),
    )
    shared, motion = moving(rng, scene, ("left box",))
    assert motion.vertices(scene)[0].max() < len(scene.positions) - 2
    begin(shared, 1, 16)
    np.testing.assert_array_equal(shared.device.read(shared.surfaces.positions)[-2:], loose)


def test_a_scene_of_one_triangle_moves(rng):
    scene = crowd(rng, (1,), ("all",))
    keep = scene.object_ids == scene.object_ids[0]
    scene = replace(scene, triangles=scene.triangles[keep], object_ids=scene.object_ids[keep],
                    material_ids=scene.material_ids[keep])  # fmt: skip
    shared, _ = moving(rng, scene, ("all",))
    begin(shared, 2, 16)
    tree, corners = read_tree(shared), read_corners(shared)
    assert walk(tree, corners) == ([0], 1)
    np.testing.assert_array_equal(tree.nodes.reshape(-1, 7, WIDTH)[:, :6], bounds_beneath(tree))
