"""Small scenes for GIBS, and a frame loop without timings."""

from dataclasses import replace

import numpy as np

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.scene.lightmap import Fragments, Lightmap, Receivers
from gibench.scene.model import Camera, Material, PointLight, Scene
from gibench.scene.readers.shapes import cube
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.gibs import SPEC
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.registry import TUNED
from support.made import made

# Of tests that ask for no other: kernels are compiled anew for every number of surfels and cells.
# Scenes here are 4 : 2 : 3, so that their grids are the same.
ROOMY = {"surfels": 4000, "grid_cells": 6}
FEW = {**ROOMY, "surfels": 180}
LOW, HIGH = (-2.0, 0.0, -1.5), (2.0, 2.0, 1.5)


def box_parts(low, high, inwards):
    """Positions, normals and triangles of a box whose fronts face inwards or outwards."""
    part = cube()
    low, high = np.asarray(low, float), np.asarray(high, float)
    positions = (part.positions + 1) / 2 * (high - low) + low
    if inwards:
        return positions, -part.normals, part.triangles[:, ::-1]
    return positions, part.normals, part.triangles


def scene_of(parts, materials, **others):
    """A scene of (box, material) pairs, each an object of its own."""
    positions, normals, triangles, material_ids, object_ids = [], [], [], [], []
    vertices = 0
    for number, ((p, n, t), material) in enumerate(parts):
        positions.append(p)
        normals.append(n)
        triangles.append(t + vertices)
        material_ids.append(np.full(len(t), material))
        object_ids.append(np.full(len(t), number))
        vertices += len(p)
    return Scene(
        "test",
        np.concatenate(positions).astype(np.float32),
        np.concatenate(normals).astype(np.float32),
        np.zeros((vertices, 2), np.float32),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate(material_ids).astype(np.int32),
        np.concatenate(object_ids).astype(np.int32),
        materials=materials,
        **others,
    )


def furnace(albedo=0.5, emission=1.0, low=LOW, high=HIGH):
    """A closed room of one diffuse, glowing material; irradiance is pi emission / (1 - albedo)."""
    material = Material("wall", (albedo,) * 3, (emission,) * 3)
    middle, half = (np.array(low) + high) / 2, (np.array(high) - low) / 2
    cameras = tuple(
        Camera(tuple(middle + s * 0.95 * half), tuple(middle), fov_degrees=110) for s in (1, -1)
    )
    parts = [(box_parts(low, high, inwards=True), 0)]
    return scene_of(parts, (material,), cameras=cameras)


def furnished():
    """A lit room with two boxes in it."""
    materials = (Material("wall", (0.7, 0.6, 0.5)), Material("box", (0.3, 0.5, 0.7)))
    parts = [
        (box_parts(LOW, HIGH, inwards=True), 0),
        (box_parts((-1.2, 0.001, -0.8), (-0.6, 1.1, -0.2), inwards=False), 1),
        (box_parts((0.3, 0.001, 0.1), (1.0, 0.5, 0.8), inwards=False), 1),
    ]
    light = PointLight((0.0, 1.8, 0.0), (3.0, 3.0, 3.0))
    camera = Camera((1.7, 1.5, 1.2), (-0.5, 0.6, -0.4), fov_degrees=75)
    return scene_of(parts, materials, lights=(light,), cameras=(camera,))


def no_receivers():
    empty = np.zeros((0, 3), np.float32)
    none = np.zeros(0, np.int32)
    receivers = Receivers(none, empty, empty, empty, empty, none.astype(np.float32))
    corners = np.zeros((0, 3, 3), np.float32)
    fragments = Fragments(np.zeros(1, np.int64), corners, none, none.astype(np.float32))
    return Lightmap(1, 1, np.zeros((0, 3, 2), np.float32), receivers, fragments)


def gibs(scene, variant=TUNED, size=64, width=64, height=48, seed=3, profile=None, **settings):
    """The technique on a device of its own."""
    flown = FlightOptions(
        settings.pop("camera_path", "rest"),
        settings.pop("rest_frames", 60),
        settings.pop("flight_frames", 240),
    ).of(scene, scene.cameras[0])
    motion = settings.pop("motion", None)
    profile = profile or replace(load_profile("vega56"), simd_width=1, max_workgroup_size=4096)
    sizes = (variant, size, width, height)
    return made(SPEC, Device(profile), scene, no_receivers(), SPEC.settings(settings), None,
                *sizes, scene.cameras[0], seed, flown, motion)  # fmt: skip


class Frames:
    """Runs a technique's frames; arguments are set once."""

    def __init__(self, technique, size=64):
        self.technique = technique
        self.launches = {
            item.name: [technique.device.prepare(one, size) for one in item.launches()]
            for item in frame_passes(technique)
        }
        self.next = 0

    def run(self, count=1):
        for _ in range(count):
            self.technique.begin_frame(self.next)
            for launches in self.launches.values():
                for launch in launches:
                    launch.enqueue(self.technique.device.queue)
            self.next += 1
        self.technique.device.queue.finish()
        return self

    def enqueue(self, name):
        for launch in self.launches[name]:
            launch.enqueue(self.technique.device.queue)
