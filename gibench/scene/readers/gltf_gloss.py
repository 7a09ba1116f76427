"""Roughness and metalness of glTF's materials (glTF 2.0, 3.9.2).

KHR_materials_pbrSpecularGlossiness is converted by the Khronos Group's formulas, published with
the extension (``examples/convert-between-workflows``): roughness is 1 - glossiness, metalness
solves for what a dielectric of 4 % and a metal would reflect together. The diffuse colour stays the
albedo.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Array, Doubles, Vec3
from gibench.errors import BadInput
from gibench.scene.gloss import DIELECTRIC_F0
from gibench.scene.model import Texture
from gibench.scene.readers.content import vec3
from gibench.scene.readers.textures import resampled

# Rec. 601, as the conversion has it.
_LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True)
class Gloss:
    """What a material says of its gloss.

    Attributes:
        roughness: perceptual, 0 to 1.
        metalness: 0 to 1.
        image: the texture's slot, or None.
        converted: whether it is of specular colour and glossiness.
        specular: colour of the factor, of a converted one.
    """

    roughness: float = 1.0
    metalness: float = 0.0
    image: Any = None
    converted: bool = False
    specular: Vec3 = (1.0, 1.0, 1.0)


def gloss_of(entry: Any, index: int, path: Path) -> Gloss:
    """The gloss of material ``index``.

    Raises:
        BadInput: a factor is not from 0 to 1.
    """

    def share(name: str, value: Any, default: float) -> float:
        number = float(default if value is None else value)
        if not 0 <= number <= 1:
            raise BadInput(
                f"material {index} has {name} {value}", where=path, mend="it goes from 0 to 1"
            )
        return number

    other = (entry.extensions or {}).get("KHR_materials_pbrSpecularGlossiness")
    pbr = entry.pbrMetallicRoughness
    if other is not None:
        given = other.get("specularFactor", (1.0, 1.0, 1.0))
        specular = vec3([share("specularFactor", value, 1.0) for value in given])
        diffuse = np.asarray(other.get("diffuseFactor", [1.0] * 4), np.float64)[:3]
        return Gloss(
            roughness=1.0 - share("glossinessFactor", other.get("glossinessFactor"), 1.0),
            metalness=float(metalness_of(diffuse, np.array(specular))),
            image=other.get("specularGlossinessTexture"),
            converted=True,
            specular=specular,
        )
    if pbr is None:  # all its defaults (3.9.2)
        return Gloss(metalness=1.0)
    return Gloss(
        roughness=share("roughnessFactor", pbr.roughnessFactor, 1.0),
        metalness=share("metallicFactor", pbr.metallicFactor, 1.0),
        image=pbr.metallicRoughnessTexture,
    )


def metalness_of(diffuse: Array, specular: Array) -> Doubles:
    """Metalness (...) of linear ``diffuse`` and ``specular`` colours (..., 3)."""
    d, s = np.asarray(diffuse, np.float64), np.asarray(specular, np.float64)
    bright, mirror = np.sqrt(d**2 @ _LUMA), np.sqrt(s**2 @ _LUMA)
    kept = 1.0 - s.max(axis=-1)
    b = bright * kept / (1 - DIELECTRIC_F0) + mirror - 2 * DIELECTRIC_F0
    root = np.sqrt(np.maximum(b * b - 4 * DIELECTRIC_F0 * (DIELECTRIC_F0 - mirror), 0.0))
    found = np.clip((root - b) / (2 * DIELECTRIC_F0), 0.0, 1.0)
    return np.asarray(np.where(mirror < DIELECTRIC_F0, 0.0, found))


def converted(
    gloss: Gloss, specular: Texture, alpha: Texture | None, factor: Array, diffuse: Texture | None
) -> Texture:
    """The image (0, roughness, metalness) of one of specular colour and, in its alpha, glossiness.

    Args:
        gloss: with the factors, which the image has then.
        specular: its colours, linear.
        alpha: its alpha in three equal channels, or None for 1.
        factor: (3,) of the diffuse colour.
        diffuse: its image, linear, or None; taken to lie as the other one does.
    """
    height, width = specular.pixels.shape[:2]
    colors = np.asarray(factor, np.float64) * (
        1.0 if diffuse is None else resampled(diffuse.pixels, height, width)
    )
    mirror = specular.pixels.astype(np.float64) * np.array(gloss.specular)
    glossy = (1.0 - gloss.roughness) * (1.0 if alpha is None else alpha.pixels[:, :, 0])
    pixels = np.zeros((height, width, 3), np.float32)
    pixels[:, :, 1] = 1.0 - glossy
    pixels[:, :, 2] = metalness_of(np.broadcast_to(colors, mirror.shape), mirror)
    return Texture(specular.name, pixels)
