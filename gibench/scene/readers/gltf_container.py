"""The containers of glTF 2.0, `.gltf` and `.glb`, and the extensions that a file names."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pygltflib

from gibench.errors import BadInput

# Extensions that may be required and still be read (every KHR_materials_* beside them).
READ_EXTENSIONS = {
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
    "EXT_texture_webp",
}
# Extensions of which nothing is said: read with the materials, told of where they matter, or
# without effect on the light of diffuse surfaces.
NOT_SAID = {
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_texture_basisu",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_lod",
    "MSFT_texture_dds",
}


def parsed(data: bytes, path: Path) -> pygltflib.GLTF2:
    """The parsed JSON of a `.gltf` or `.glb`, with the binary chunk.

    Raises:
        BadInput: it is no glTF 2.0.
    """
    text, blob = _chunks(data, path) if data[:4] == b"glTF" else (data, None)
    try:
        decoded = text.decode("utf-8-sig")
        entries = json.loads(decoded)
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise BadInput(
            f"not a glTF file ({error})", where=path, mend="glTF is JSON in UTF-8"
        ) from error
    if not isinstance(entries, dict):
        raise BadInput("not a glTF file (its JSON is no object)", where=path)
    gltf = pygltflib.GLTF2.gltf_from_json(decoded)
    if blob is not None:
        gltf.set_binary_blob(blob)
    version_text = str(gltf.asset.version if gltf.asset else None)
    if not version_text.startswith("2"):
        raise BadInput(f"glTF version {version_text}", where=path, mend="only glTF 2.0 is read")
    least = gltf.asset.minVersion if gltf.asset else None
    if least is not None and str(least) != "2.0":
        raise BadInput(f"asks for glTF {least}", where=path, mend="only glTF 2.0 is read")
    return gltf


def _chunks(data: bytes, path: Path) -> tuple[bytes, bytes | None]:
    """The JSON and the first binary chunk of a glb file; others are passed over, as the
    specification asks (4.4.3).
    """
    if len(data) < 12:
        raise BadInput("truncated: the file ends inside its header", where=path)
    version, length = struct.unpack("<II", data[4:12])
    if version != 2:
        raise BadInput(f"glb version {version}", where=path, mend="only glTF 2.0 is read")
    if len(data) < length:
        raise BadInput(f"truncated: {len(data)} of {length} bytes are there", where=path)
    found: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack("<I4s", data[at : at + 8])
        if at + 8 + size > len(data):
            raise BadInput("not a sound glb file: a chunk is cut short", where=path)
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in found:
        raise BadInput("not a sound glb file: it has no JSON chunk", where=path)
    return found[b"JSON"], found.get(b"BIN\0")


def check_extensions(gltf: pygltflib.GLTF2, path: Path) -> None:
    """Refuse a file that requires what is not read.

    Raises:
        BadInput: it does.
    """
    for name in gltf.extensionsRequired or []:
        if name not in READ_EXTENSIONS and not name.startswith("KHR_materials_"):
            raise BadInput(
                f"needs the glTF extension {name}, which gibench does not read",
                where=path,
                mend="export the file without it",
            )
