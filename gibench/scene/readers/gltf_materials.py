"""Materials and textures of a glTF 2.0 file.

Base colour is the albedo whatever the metalness: all surfaces are diffuse. The diffuse colour of
KHR_materials_pbrSpecularGlossiness is the albedo in its place, as it was for the file's author.
Roughness and metalness are kept for what reads them (``gltf_gloss.py``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib

from gibench.arrays import Array
from gibench.errors import BadInput
from gibench.scene.model import Material, Texture
from gibench.scene.readers.content import Maps, vec3
from gibench.scene.readers.float_images import UnreadableImage
from gibench.scene.readers.gltf_buffers import Buffers
from gibench.scene.readers.gltf_formulas import uv_matrix
from gibench.scene.readers.gltf_gloss import Gloss, converted, gloss_of
from gibench.scene.readers.gltf_wrap import CLAMP, MIRROR, REPEAT, Wrap
from gibench.scene.readers.textures import (
    alpha_from_bytes,
    channel_from_bytes,
    gloss_from_bytes,
    normals_from_bytes,
    radiance_from_bytes,
    texture_from_bytes,
)

# Layers over a diffuse base that would dim it or shine themselves: extension, factor, in words.
_LAYERS = (
    ("KHR_materials_clearcoat", "clearcoatFactor", "clearcoat"),
    ("KHR_materials_sheen", "sheenColorFactor", "sheen"),
    ("KHR_materials_iridescence", "iridescenceFactor", "iridescence"),
)

SLOTS = ("color", "emission", "normal", "gloss", "transmission")
"""The uses of textures whose coordinates are read."""


@dataclass(frozen=True)
class Slot:
    """Where a texture slot takes its coordinates from.

    Attributes:
        uv_set: n of TEXCOORD_n.
        matrix: (3, 3) transform in glTF's coordinates (v downwards).
    """

    uv_set: int
    matrix: Array


@dataclass(frozen=True)
class Uses:
    """What a primitive takes of its material.

    Attributes:
        material: its number.
        slots: by name, of ``SLOTS``.
    """

    material: int
    slots: dict[str, Slot]


class Materials:
    """The materials of one file being read.

    Args:
        gltf: the parsed file.
        buffers: of it.
        path: of it, for messages.
        ignored: where to count what is not used.
    """

    def __init__(
        self, gltf: pygltflib.GLTF2, buffers: Buffers, path: Path, ignored: Counter[str]
    ) -> None:
        self._entries = list(gltf.materials or [])
        self._gltf = gltf
        self._buffers = buffers
        self._path = path
        self._ignored = ignored
        self.textures: list[Texture] = []
        self._texture_of_image: dict[int, int] = {}

    def read(self) -> tuple[list[Material], list[Maps]]:
        """All materials of the file and, last, that of primitives without one."""
        both = [self._material(entry, index) for index, entry in enumerate(self._entries)]
        primitives = [p for mesh in self._gltf.meshes or [] for p in mesh.primitives or []]
        default = Material("default")
        if any(primitive.material is None for primitive in primitives):
            default = replace(default, base_color=(1.0, 1.0, 1.0))  # glTF 2.0, 5.22.2
        both.append((default, Maps()))
        return [material for material, _ in both], [maps for _, maps in both]

    def uses(self, index: Any) -> Uses:
        """What primitives of material ``index`` take.

        Raises:
            BadInput: there is no such material.
        """
        if index is None:
            return Uses(len(self._entries), {name: _slot(None) for name in SLOTS})
        if not isinstance(index, int) or not 0 <= index < len(self._entries):
            raise BadInput(f"there is no material {index}", where=self._path)
        return Uses(index, {name: _slot(info) for name, info in self._infos(index).items()})

    def _infos(self, index: int) -> dict[str, Any]:
        """What the file says of each slot of material ``index``; None where it has no image."""
        entry = self._entries[index]
        gloss = gloss_of(entry, index, self._path).image
        glass = _transmission(entry).get("transmissionTexture")
        used = (self._color(entry)[1], entry.emissiveTexture, entry.normalTexture, gloss, glass)
        return dict(zip(SLOTS, used, strict=True))

    def wraps(self) -> list[dict[str, Wrap]]:
        """How the images of each material's slots go on beyond their edges, where there are any."""
        return [
            {
                name: self._wrap(info)
                for name, info in self._infos(index).items()
                if info is not None
            }
            for index in range(len(self._entries))
        ]

    def _wrap(self, info: Any) -> Wrap:
        """Modes along u and v of the sampler of a texture slot."""
        texture, samplers = (self._gltf.textures or [])[_index(info)], self._gltf.samplers or []
        if texture.sampler is None:
            return REPEAT, REPEAT
        if not isinstance(texture.sampler, int) or not 0 <= texture.sampler < len(samplers):
            raise BadInput(f"there is no sampler {texture.sampler!r}", where=self._path)
        sampler = samplers[texture.sampler]
        modes = []
        for mode in (sampler.wrapS, sampler.wrapT):
            known = REPEAT if mode is None else mode
            if known not in (REPEAT, CLAMP, MIRROR):
                self._ignored[f"wrap mode {mode!r}"] += 1
                known = REPEAT
            modes.append(known)
        return modes[0], modes[1]

    def _material(self, entry: Any, index: int) -> tuple[Material, Maps]:
        extensions = entry.extensions or {}
        factor, info = self._color(entry)
        if (factor[:3] > 1).any():
            self._ignored["base colours over 1: 1 used"] += 1
        strength = extensions.get("KHR_materials_emissive_strength", {}).get(
            "emissiveStrength", 1.0
        )
        emission = np.asarray(entry.emissiveFactor or [0.0] * 3, np.float64) * strength
        if emission.shape != (3,) or not np.isfinite(emission).all() or (emission < 0).any():
            raise BadInput(f"material {index} has a senseless emission", where=self._path)
        glow = None
        if entry.emissiveTexture is not None and emission.any():
            glow = self._decoded(_index(entry.emissiveTexture), radiance_from_bytes)
        mode = entry.alphaMode or "OPAQUE"
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            self._ignored[f"alphaMode {mode!r}"] += 1
            mode = "OPAQUE"
        alpha = None
        if mode != "OPAQUE" and info is not None:
            alpha = self._decoded(_index(info), alpha_from_bytes)
        for name, value, what in _LAYERS:
            if np.any(np.asarray(extensions.get(name, {}).get(value, 0.0), np.float64) > 0):
                self._ignored[f"{what} of materials: surfaces are diffuse"] += 1
        passing = float(_transmission(entry).get("transmissionFactor", 0.0))
        gloss = gloss_of(entry, index, self._path)
        material = Material(
            name=str(entry.name or f"material {index}"),
            base_color=vec3(np.clip(np.nan_to_num(factor[:3], nan=1.0), 0.0, 1.0)),
            emission=vec3(emission),
            texture=-1 if info is None else self._texture(_index(info)),
            emission_map="" if glow is None else glow.name,
            alpha_mode=mode.lower(),
            alpha_cutoff=float(0.5 if entry.alphaCutoff is None else entry.alphaCutoff),
            opacity=float(factor[3]) if mode != "OPAQUE" and len(factor) > 3 else 1.0,
            opacity_map="" if mode == "OPAQUE" or info is None else self._name(_index(info)),
            transmission=passing,
            two_sided=bool(entry.doubleSided),
            roughness=gloss.roughness,
            metalness=gloss.metalness,
            roughness_map="" if gloss.image is None else self._name(_index(gloss.image)),
            normal_map=(
                "" if entry.normalTexture is None else self._name(_index(entry.normalTexture))
            ),
            unlit="KHR_materials_unlit" in extensions,
        )
        image = self._gloss_map(entry, gloss)
        if gloss.converted and image is not None:  # with all that the factors say
            material = replace(material, roughness=1.0, metalness=1.0)
        glass = None
        if passing and (slot := _transmission(entry).get("transmissionTexture")) is not None:
            glass = self._decoded(_index(slot), partial(channel_from_bytes, channel="r"))
        normal = self._normal_map(entry)
        maps = Maps(emission=glow, opacity=alpha, gloss=image, transmission=glass, **normal)
        return material, maps

    def _gloss_map(self, entry: Any, gloss: Gloss) -> Texture | None:
        """The image of roughness and metalness, one of specular colour and gloss converted."""
        if gloss.image is None:
            return None
        if not gloss.converted:
            return self._decoded(_index(gloss.image), gloss_from_bytes)
        specular = self._decoded(_index(gloss.image), texture_from_bytes)
        if specular is None:
            return None
        alpha = self._decoded(_index(gloss.image), alpha_from_bytes)
        factor, info = self._color(entry)
        diffuse = None if info is None else self._decoded(_index(info), texture_from_bytes)
        return converted(gloss, specular, alpha, factor[:3], diffuse)

    def _normal_map(self, entry: Any) -> dict[str, Any]:
        """The normal map and its scale, as ``Maps`` has them."""
        info = entry.normalTexture
        if info is None:
            return {}
        scale = float(_or(getattr(info, "scale", None), 1.0))
        if not np.isfinite(scale):
            raise ValueError(f"normal scale {scale}")
        try:
            found = self._decoded(_index(info), normals_from_bytes, say=True)
        except UnreadableImage as error:
            self._ignored[f"normal map {self._name(_index(info))}: {error}"] += 1
            return {}
        return {"normal": found, "normal_scale": scale}

    def _color(self, entry: Any) -> tuple[Array, Any]:
        """Factor (4,) and texture slot of the albedo."""
        gloss = (entry.extensions or {}).get("KHR_materials_pbrSpecularGlossiness")
        pbr = entry.pbrMetallicRoughness
        if gloss is not None:
            factor, info = gloss.get("diffuseFactor"), gloss.get("diffuseTexture")
        elif pbr is not None:
            factor, info = pbr.baseColorFactor, pbr.baseColorTexture
        else:
            factor, info = None, None
        values = np.asarray([1.0] * 4 if factor is None else factor, np.float64)
        if values.ndim != 1 or len(values) < 3:
            raise ValueError(f"colour {factor!r}")
        return values, info

    def _texture(self, index: Any) -> int:
        """The place in ``textures`` of the image of texture ``index``, or -1."""
        image = self._image_of(index)
        if image is None:
            self._ignored["textures without a readable source"] += 1
            return -1
        if image not in self._texture_of_image:
            texture = self._decode(image, texture_from_bytes)
            self._texture_of_image[image] = -1 if texture is None else len(self.textures)
            if texture is not None:
                self.textures.append(texture)
        return self._texture_of_image[image]

    def _decoded(
        self, index: Any, decode: Callable[[str, bytes], Texture | None], say: bool = False
    ) -> Texture | None:
        """The image of a texture; one that cannot be read is counted, or raised with ``say``."""
        image = self._image_of(index)
        if image is None:
            self._ignored["textures without a readable source"] += 1
            return None
        return self._decode(image, decode, say)

    def _decode(
        self, image: int, decode: Callable[[str, bytes], Texture | None], say: bool = False
    ) -> Texture | None:
        named = self._buffers.image(image)
        if named is None:
            self._ignored["textures whose file is missing"] += 1
            return None
        try:
            return decode(*named)
        except UnreadableImage:
            if say:
                raise
            self._ignored["textures that cannot be read"] += 1
            return None

    def _image_of(self, index: Any) -> int | None:
        textures = self._gltf.textures or []
        if not isinstance(index, int) or not 0 <= index < len(textures):
            raise BadInput(f"there is no texture {index!r}", where=self._path)
        webp = (textures[index].extensions or {}).get("EXT_texture_webp", {})
        source: int | None = webp.get("source", textures[index].source)
        return source

    def _name(self, index: Any) -> str:
        """What to call the image of texture ``index``."""
        image, images = self._image_of(index), self._gltf.images or []
        if image is None or not isinstance(image, int) or not 0 <= image < len(images):
            return "image"
        uri = str(images[image].uri or "")
        return str(images[image].name or ("" if uri.startswith("data:") else uri)) or "image"


def _index(info: Any) -> Any:
    """The texture of a slot; pygltflib leaves those within extensions as dictionaries."""
    return info.get("index") if isinstance(info, dict) else info.index


def _transmission(entry: Any) -> dict[str, Any]:
    found: dict[str, Any] = (entry.extensions or {}).get("KHR_materials_transmission", {})
    return found


def _slot(info: Any) -> Slot:
    if info is None:
        return Slot(0, np.eye(3))
    if isinstance(info, dict):
        extensions, uv_set = info.get("extensions") or {}, info.get("texCoord")
    else:
        extensions, uv_set = info.extensions or {}, info.texCoord
    transform = extensions.get("KHR_texture_transform", {})
    return Slot(int(transform.get("texCoord", uv_set or 0)), uv_matrix(transform))


def _or(value: Any, default: float) -> Any:
    return default if value is None else value
