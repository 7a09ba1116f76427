"""Techniques: each a file or folder here that defines ``SPEC``."""
