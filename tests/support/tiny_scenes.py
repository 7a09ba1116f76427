"""Scenes small enough to check by brute force, which travel with the package."""

from gibench.techniques.parts.conformance.rooms import Quad, box, empty_room, quad_scene, room

__all__ = ["Quad", "box", "empty_room", "quad_scene", "room"]
