"""Scenes: triangles, materials, lights, environment, cameras, and the lightmap of receivers."""
