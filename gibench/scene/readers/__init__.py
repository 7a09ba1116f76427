"""Readers of mesh files, images and scene files: each yields one ``Content`` or a Scene."""
