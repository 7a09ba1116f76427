"""Damaged files load, or are refused in one line."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from support.mutants import wholes, write_mutant

from gibench.errors import BadInput
from gibench.scene.load import load_scene


def _check(path: Path) -> bool:
    """Load what is there, or see that it is refused as it should be; whether it has loaded."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            scene = load_scene(str(path))
        except BadInput as error:
            assert "\n" not in str(error)
            assert len(str(error)) < 1000
            return False
    assert np.isfinite(scene.positions).all()
    assert np.isfinite(scene.uvs).all()
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-3)
    for material in scene.materials:
        assert 0 <= min(material.base_color) <= max(material.base_color) <= 1
        assert np.isfinite(material.emission).all()
        assert min(material.emission) >= 0
        assert -1 <= material.texture < len(scene.textures)
    assert all("\n" not in line for line in scene.warnings)
    return True


@pytest.mark.parametrize("kind", sorted(wholes()))
def test_the_whole_files_load(tmp_path: Path, kind: str) -> None:
    whole = wholes()[kind]
    for name, content in whole.files.items():
        (tmp_path / name).write_bytes(content)
    assert _check(tmp_path / whole.entry)


@pytest.mark.parametrize("seed", range(60))
def test_a_mutant_loads_or_is_refused_in_one_line(tmp_path: Path, seed: int) -> None:
    _check(write_mutant(tmp_path, seed))


@pytest.mark.slow
def test_1500_mutants_load_or_are_refused_in_one_line(tmp_path: Path) -> None:
    loaded = 0
    for seed in range(1000, 2500):
        folder = tmp_path / str(seed)
        folder.mkdir()
        try:
            loaded += _check(write_mutant(folder, seed))
        except Exception as error:
            raise AssertionError(f"mutant {seed}") from error
    assert 300 < loaded < 1400  # mutants are neither all harmless nor all hopeless
