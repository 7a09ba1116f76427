"""Alpha masks of materials as cut-outs of triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Array, Bools
from gibench.scene.cutouts import surface_texels
from gibench.scene.model import Material
from gibench.scene.readers.content import Content, Part, counted, of_corners

# Different alphas of a part's vertices that are told apart: each takes a mask of its own.
_MOST_ALPHAS = 16


def cut_out(
    parts: list[Part], content: Content, notes: list[str]
) -> tuple[list[Part], tuple[Bools, ...]]:
    """The parts with ``Part.cutouts`` where their material has a mask, and the masks.

    Opacity times the mask's texel is compared with the cutoff (glTF 2.0, 3.9.4). Triangles of which
    all is there need no mask, those of which nothing is are left out. Where that would leave
    nothing at all, everything stays whole.
    """
    masks: dict[tuple[int, float, float], int] = {}
    images: list[Bools] = []
    result: list[Part] = []
    todo: list[tuple[Part, Material]] = []
    for part in parts:
        material = content.materials[part.material]
        if material.alpha_mode == "mask" and len(part.triangles) and part.alphas is not None:
            todo += _by_alpha(part, material, notes)
        else:
            todo.append((part, material))
    for part, material in todo:
        if material.alpha_mode != "mask" or not len(part.triangles):
            result.append(part)
            continue
        alpha = content.map_of(part.material).opacity
        uvs = part.uvs if part.opacity_uvs is None else part.opacity_uvs
        if alpha is None or uvs is None or not len(uvs):
            if alpha is not None:
                notes.append(f"cut-outs of {material.name} have no coordinates: drawn whole")
            if alpha is not None or material.opacity >= material.alpha_cutoff:
                result.append(part)
            else:
                told = counted(len(part.triangles), "triangle")
                notes.append(f"{told} of {material.name} cut out: opacity under the cutoff")
            continue
        key = id(alpha), material.opacity, material.alpha_cutoff
        if key not in masks:
            masks[key] = len(images)
            images.append(
                np.asarray(alpha.pixels[:, :, 0] * material.opacity >= material.alpha_cutoff)
            )
        result.append(_masked(part, uvs, masks[key], images[masks[key]]))
    if not any(len(part.triangles) for part in result):
        names = dict.fromkeys(content.materials[part.material].name for part in parts)
        if any(len(part.triangles) for part in parts):
            notes.append(f"everything is cut out ({', '.join(list(names)[:3])}): drawn whole")
        return parts, ()
    return result, tuple(images)


def _by_alpha(part: Part, material: Material, notes: list[str]) -> list[tuple[Part, Material]]:
    """The part cut up by its vertices' alpha, each piece with a material whose opacity has it
    (glTF 2.0, 3.7.2.1: colours of vertices multiply the base colour).
    """
    assert part.alphas is not None
    corners = of_corners(part, part.alphas[:, None])[:, :, 0]
    varies = np.ptp(corners, axis=1) > 0
    alphas = np.where(varies, corners.mean(axis=1), corners[:, 0])
    if varies.any():
        notes.append(
            f"alpha of vertices within {counted(int(varies.sum()), 'triangle')} of cut-outs of "
            f"{material.name}: the mean of each used"
        )
    if len(np.unique(alphas)) > _MOST_ALPHAS:
        alphas = np.round(alphas * _MOST_ALPHAS) / _MOST_ALPHAS
    return [
        (
            _some(part, alphas == alpha),
            replace(material, opacity=material.opacity * alpha),
        )
        for alpha in np.unique(alphas).tolist()
    ]


def _some(part: Part, keep: Bools) -> Part:
    """The part with some of its triangles."""
    return replace(
        part,
        triangles=part.triangles[keep],
        materials=None if part.materials is None else part.materials[keep],
    )


def _masked(part: Part, uvs: Array, number: int, image: Bools) -> Part:
    found, of = surface_texels(image, of_corners(part, uvs))
    keep = found > 0
    cutouts = np.where(found < of, number, -1)[keep]
    return replace(
        _some(part, keep),
        cutouts=cutouts if (cutouts >= 0).any() else None,
        opacity_uvs=uvs,
    )
