"""Skinned meshes of glTF 2.0 (3.7.3) in the pose that the file's nodes have at rest.

The transform of the node that holds the mesh counts for nothing: vertices go where their joints
are, each by the mean of its joints' transforms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pygltflib

from gibench.arrays import Array
from gibench.scene.readers.content import Part
from gibench.scene.readers.gltf_buffers import Buffers
from gibench.scene.readers.gltf_formulas import local_matrix


class Skins:
    """The skins of one file.

    Args:
        gltf: the parsed file.
        buffers: of it.
        ignored: where to count skins that cannot be used.
    """

    def __init__(self, gltf: pygltflib.GLTF2, buffers: Buffers, ignored: Counter[str]) -> None:
        self._gltf = gltf
        self._buffers = buffers
        self._ignored = ignored
        nodes = gltf.nodes or []
        self._parents = {child: i for i, node in enumerate(nodes) for child in node.children or []}

    def posed(self, part: Part, primitive: Any, skin: Any) -> Part:
        """The part in world space, posed by its joints; as it stands in the mesh where it has none
        that can be used.
        """
        matrices, bound = self._matrices(skin), self._bound(primitive.attributes, part)
        if matrices is None or bound is None or bound[0].max(initial=0) >= len(matrices):
            self._ignored["skins without sound joints and weights: as the mesh stands"] += 1
            return part
        return posed(part, *bound, matrices)

    def _matrices(self, skin: Any) -> Array | None:
        """What each joint of a skin does to the mesh, (j, 4, 4)."""
        skins, nodes = self._gltf.skins or [], self._gltf.nodes or []
        if not isinstance(skin, int) or not 0 <= skin < len(skins):
            return None
        joints: Sequence[Any] = skins[skin].joints or []
        if not joints or not all(isinstance(j, int) and 0 <= j < len(nodes) for j in joints):
            return None
        worlds = np.stack([self._world(joint) for joint in joints])
        if skins[skin].inverseBindMatrices is None:
            return worlds
        inverse = self._buffers.accessor(skins[skin].inverseBindMatrices, 16)
        if len(inverse) < len(joints):
            return None
        columns = inverse[: len(joints)].astype(np.float64).reshape(-1, 4, 4)
        return np.asarray(worlds @ columns.transpose(0, 2, 1))

    def _world(self, node: int) -> Array:
        nodes = self._gltf.nodes or []
        matrix, seen = local_matrix(nodes[node]), {node}
        while (above := self._parents.get(node)) is not None and above not in seen:
            matrix = local_matrix(nodes[above]) @ matrix
            seen.add(above)
            node = above
        return np.asarray(matrix)

    def _bound(self, attributes: Any, part: Part) -> tuple[Array, Array] | None:
        """Joints and weights (v, k) of the part's vertices; None where it has none."""
        joints, weights = [], []
        for n in range(8):
            which = getattr(attributes, f"JOINTS_{n}", None)
            weight = getattr(attributes, f"WEIGHTS_{n}", None)
            if which is None or weight is None:
                break
            joints.append(self._buffers.accessor(which, 4).astype(np.int64))
            weights.append(self._buffers.accessor(weight, 4).astype(np.float64))
        count = len(part.positions)
        if not joints or any(len(values) != count for values in (*joints, *weights)):
            return None
        return np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)


def posed(part: Part, joints: Array, weights: Array, matrices: Array) -> Part:
    """The part with each vertex moved by the weighted mean of its joints' ``matrices`` (j, 4, 4); a
    vertex without weights stays where it is.

    Args:
        part: in the mesh's space.
        joints: (v, k) which joints.
        weights: (v, k) how much each counts.
        matrices: (j, 4, 4) what each joint does.
    """
    blended = np.zeros((len(joints), 4, 4))
    for which, weight in zip(joints.T, weights.T, strict=True):
        blended += weight[:, None, None] * matrices[which]
    total = weights.sum(axis=1)
    blended[total <= 0] = np.eye(4)
    linear = blended[:, :3, :3] / np.where(total > 0, total, 1.0)[:, None, None]
    shift = blended[:, :3, 3] / np.where(total > 0, total, 1.0)[:, None]
    a, b, c = (linear[:, :, i] for i in range(3))
    normal_matrix = np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)), axis=2)
    turned = np.where(np.einsum("vi,vi->v", a, normal_matrix[:, :, 0]) < 0, -1.0, 1.0)

    def moved(vectors: Array, by: Array) -> Array:
        return np.asarray(np.einsum("vij,vj->vi", by, vectors.astype(np.float64)))

    normals, tangents, triangles = part.normals, part.tangents, part.triangles
    if normals is not None:
        normals = moved(normals, normal_matrix) * turned[:, None]
    if tangents is not None:
        sign = tangents[:, 3:] * turned[:, None]
        tangents = np.concatenate((moved(tangents[:, :3], linear), sign), axis=1)
    mirrors = bool(len(turned)) and float(np.median(turned)) < 0
    return replace(
        part,
        positions=moved(part.positions, linear) + shift,
        normals=normals,
        tangents=tangents,
        triangles=triangles[:, ::-1] if mirrors else triangles,
        mirrored=part.mirrored != mirrors,
    )
