"""Rigid motions of objects: poses, their tables in TOML, and what moves in a frame."""
