"""Rays: the device BVH and Embree behind one interface."""

from gibench.rays.tracer import Hits, RayTracer

__all__ = ["Hits", "RayTracer"]
