"""Bytes and numbers of a glTF 2.0 file: buffers, views, accessors, images."""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
import pygltflib

from gibench.arrays import Array
from gibench.errors import BadInput
from gibench.scene.files import find_near, read_bytes

# glTF 2.0 specification, 3.6.2.2: accessor data types.
_DTYPES: dict[int, str] = {
    pygltflib.BYTE: "<i1",
    pygltflib.UNSIGNED_BYTE: "<u1",
    pygltflib.SHORT: "<i2",
    pygltflib.UNSIGNED_SHORT: "<u2",
    pygltflib.UNSIGNED_INT: "<u4",
    pygltflib.FLOAT: "<f4",
}
# An accessor without data is all zeros; more than the largest mesh could need are a mistake.
_MOST_ZEROS = 1 << 28
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def compressed(extension: str, path: Path) -> BadInput:
    """What to say of a mesh that is only there compressed."""
    return BadInput(
        f"its meshes are compressed with {extension}, which gibench does not read",
        where=path,
        mend="export the file without it",
    )


class Buffers:
    """Reads the accessors of one glTF file, each buffer once.

    Args:
        gltf: the parsed file.
        path: where it lies; relative URIs start there.
    """

    def __init__(self, gltf: pygltflib.GLTF2, path: Path) -> None:
        self._gltf = gltf
        self._path = path
        self._loaded: dict[int, bytes] = {}

    def is_empty(self, index: int) -> bool:
        """Whether accessor ``index`` has no data in the file."""
        accessor = self._item(self._gltf.accessors, index, "accessor")
        return accessor.bufferView is None and accessor.sparse is None

    def accessor(self, index: int, *widths: int) -> Array:
        """The numbers of accessor ``index`` as (count, width), its width one of ``widths``;
        normalised integers as floats.

        Raises:
            BadInput: no such accessor, another width, or it reaches outside its buffer.
        """
        accessor = self._item(self._gltf.accessors, index, "accessor")
        width = _WIDTHS.get(accessor.type, 0)
        if width not in widths or accessor.componentType not in _DTYPES:
            self._fail(f"accessor {index} is of type {accessor.type}/{accessor.componentType}")
        if not isinstance(accessor.count, int) or accessor.count < 0:
            self._fail(f"accessor {index} has count {accessor.count!r}")
        dtype = np.dtype(_DTYPES[accessor.componentType])
        if accessor.bufferView is None:
            if accessor.count > _MOST_ZEROS:
                self._fail(f"accessor {index} has count {accessor.count} and no data")
            values = np.zeros((accessor.count, width), dtype)
        else:
            values = self._strided(
                accessor.bufferView, accessor.byteOffset or 0, accessor.count, width, dtype
            )
        if accessor.sparse is not None:
            values = self._with_sparse(values, accessor.sparse, dtype)
        if accessor.normalized and dtype.kind in "iu":
            return np.maximum(values.astype(np.float64) / np.iinfo(dtype).max, -1.0)
        return values

    def image(self, index: int) -> tuple[str, bytes] | None:
        """Name and bytes of image ``index``, or None when its file is missing."""
        image = self._item(self._gltf.images, index, "image")
        if image.bufferView is not None:
            return image.name or f"image {index}", self._view(image.bufferView)[0]
        uri = image.uri or ""
        if uri.startswith("data:"):
            return image.name or f"image {index}", self._data_uri(uri, f"image {index}")
        file = self._file(uri)
        return None if file is None else (uri, read_bytes(file))

    def _with_sparse(self, values: Array, sparse: Any, dtype: np.dtype[Any]) -> Array:
        indices = self._strided(
            sparse.indices.bufferView,
            sparse.indices.byteOffset or 0,
            sparse.count,
            1,
            np.dtype(_DTYPES[sparse.indices.componentType]),
        )[:, 0].astype(np.int64)
        if len(indices) and indices.max() >= len(values):
            self._fail("a sparse accessor's index is out of range")
        values = values.copy()
        values[indices] = self._strided(
            sparse.values.bufferView,
            sparse.values.byteOffset or 0,
            sparse.count,
            values.shape[1],
            dtype,
        )
        return values

    def _strided(
        self, view_index: int, offset: int, count: int, width: int, dtype: np.dtype[Any]
    ) -> Array:
        data, stride = self._view(view_index)
        row = width * dtype.itemsize
        stride = stride or row
        if count == 0:
            return np.zeros((0, width), dtype)
        if stride < row or offset < 0 or offset + (count - 1) * stride + row > len(data):
            self._fail(f"an accessor reaches outside buffer view {view_index}")
        return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))

    def _view(self, index: int) -> tuple[bytes, int | None]:
        view = self._item(self._gltf.bufferViews, index, "buffer view")
        data = self._buffer(view.buffer)
        start = view.byteOffset or 0
        end = start + view.byteLength
        if start < 0 or end > len(data):
            self._fail(f"buffer view {index} reaches outside buffer {view.buffer}")
        return data[start:end], view.byteStride

    def _buffer(self, index: int) -> bytes:
        if index not in self._loaded:
            self._loaded[index] = self._read_buffer(index)
        return self._loaded[index]

    def _read_buffer(self, index: int) -> bytes:
        buffer = self._item(self._gltf.buffers, index, "buffer")
        if buffer.uri is None:
            if "EXT_meshopt_compression" in (buffer.extensions or {}):
                raise compressed("EXT_meshopt_compression", self._path)
            blob = self._gltf.binary_blob() if index == 0 else None
            if blob is None:
                self._fail(f"buffer {index} has neither a uri nor a binary chunk")
            data = bytes(blob)
        elif buffer.uri.startswith("data:"):
            data = self._data_uri(buffer.uri, f"buffer {index}")
        else:
            name = unquote(buffer.uri)
            file = self._file(buffer.uri)
            if file is None:
                raise BadInput(
                    f"buffer '{name}' is missing",
                    where=self._path,
                    mend="put it beside the file",
                )
            data = read_bytes(file)
        if len(data) < buffer.byteLength:
            self._fail(f"buffer {index} has {len(data)} of its {buffer.byteLength} bytes")
        return data

    def _file(self, uri: str) -> Path | None:
        """The file of a relative URI, whose name people write with and without escapes."""
        for name in (unquote(uri), uri):
            if file := find_near((self._path.parent,), name):
                return file
        return None

    def _data_uri(self, uri: str, what: str) -> bytes:
        head, _, body = uri.partition(",")
        if not head.lower().endswith(";base64"):
            return unquote_to_bytes(body)
        try:
            return base64.b64decode(unquote(body))
        except (binascii.Error, ValueError) as error:
            raise BadInput(f"the data URI of {what} is broken", where=self._path) from error

    def _item(self, items: list[Any] | None, index: Any, kind: str) -> Any:
        if not isinstance(index, int) or not 0 <= index < len(items or []):
            self._fail(f"there is no {kind} {index!r}")
        return (items or [])[index]

    def _fail(self, what: str) -> NoReturn:
        raise BadInput(f"not a sound glTF file: {what}", where=self._path)
