"""The container, tables and numbers of a glTF 2.0 file (.glb, .gltf), read exactly as the specification has them.

Whatever points outside the file, or asks for more than it holds, is refused in one sentence that names the entry.
"""

from __future__ import annotations

import base64
import binascii
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.reading import MAX_FILE_BYTES, json_value, read_plain
from slopegate.drivers.scenes.gltf_tables import GltfAccessor, GltfSparse, GltfTable
from slopegate.drivers.scenes.scene_toml import checked

MAX_JSON_ENTRIES: Final = 1_000_000
"""Values in the JSON: a million of them may take 8 s and 600 MB to read."""
MAX_COUNT: Final = 6_000_000
"""Entries of one accessor."""
MAX_COPIED_BYTES: Final = 500_000_000
"""Of arrays that are not simply a part of the file: small files can ask for long ones."""

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_DATA_URI = re.compile(r"data:[^,]*;base64,", re.IGNORECASE)
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:")

Entry = TypeVar("Entry")
Values = NDArray[Any]


class GltfData:
    """The tables of a file, and the arrays and bytes that they refer to."""

    def __init__(self, path: Path, data: bytes) -> None:
        """Raises SceneError for what is no glTF 2.0; buffers are looked at when they are asked for."""
        self.path = path
        text, self._binary = _unpacked(path, data)
        self.table = _table(path, text)
        self._buffers: dict[int, bytes] = {}
        self._arrays: dict[int, Values] = {}
        self._copied_bytes = 0

    def refusal(self, what: str) -> SceneError:
        """The error that says what is wrong with the file."""
        return SceneError(f"{self.path}: {what}")

    def entry(self, entries: Sequence[Entry], index: int, name: str, where: str) -> Entry:
        """The entry of a list called `name` that `where` refers to."""
        if index >= len(entries):
            raise self.refusal(f"{where} is {index}: the file has {len(entries)} {name}, counted from 0")
        return entries[index]

    def accessor(self, index: int, where: str, types: Sequence[str]) -> GltfAccessor:
        """An accessor that has one of these types."""
        found = self.entry(self.table.accessors, index, "accessors", where)
        if found.type not in types:
            raise self.refusal(
                f"accessors[{index}].type is {shown(found.type)}: {where} must have {' or '.join(types)}"
            )
        if found.component_type not in _COMPONENTS:
            allowed = ", ".join(map(str, _COMPONENTS))
            raise self.refusal(
                f"accessors[{index}].componentType is {found.component_type}: it must be one of {allowed}"
            )
        if found.count > MAX_COUNT:
            raise self.refusal(f"accessors[{index}].count is {found.count}: at most {MAX_COUNT} are allowed")
        return found

    def array(self, index: int, where: str, types: Sequence[str]) -> Values:
        """The numbers of an accessor, (count, width): integers that are normalized as floats, the others as filed."""
        accessor = self.accessor(index, where, types)
        if index not in self._arrays:
            self._arrays[index] = self._read(accessor, f"accessors[{index}]")
        return self._arrays[index]

    def view(self, index: int, where: str) -> memoryview:
        """The bytes of a buffer view."""
        view = self.entry(self.table.buffer_views, index, "bufferViews", where)
        data = self._buffer(view.buffer, f"bufferViews[{index}].buffer")
        end = view.byte_offset + view.byte_length
        if end > len(data):
            raise self.refusal(
                f"bufferViews[{index}] ends at byte {end}, but buffers[{view.buffer}] has {len(data)} bytes: "
                "the file is damaged or cut short"
            )
        return memoryview(data)[view.byte_offset : end]

    def bytes_of(self, uri: str, where: str) -> bytes:
        """What a URI refers to: data within it, or a file beside this one."""
        if uri[:5].lower() == "data:":
            head = _DATA_URI.match(uri)
            if head is None:
                raise self.refusal(f"{where} is {shown(uri)}: data inside the file must be base64")
            try:
                return base64.b64decode(uri[head.end() :])
            except (binascii.Error, ValueError) as error:
                raise self.refusal(f"{where} cannot be read: it is no base64") from error
        if _SCHEME.match(uri) or uri.startswith("//"):
            raise self.refusal(f"{where} is {shown(uri)}: it must be a file beside this one")
        return read_plain(self.path.parent / unquote(uri))

    def _buffer(self, index: int, where: str) -> bytes:
        buffer = self.entry(self.table.buffers, index, "buffers", where)
        if index in self._buffers:
            return self._buffers[index]
        if buffer.uri is not None:
            data = self.bytes_of(buffer.uri, f"buffers[{index}].uri")
        elif index == 0 and self._binary is not None:
            data = self._binary
        else:
            raise self.refusal(f"buffers[{index}] has no data: it has no uri, and the file no part of its own for it")
        if sum(map(len, self._buffers.values())) + len(data) > MAX_FILE_BYTES:
            raise self.refusal(f"its buffers have more than the {MAX_FILE_BYTES / 1e6:.0f} MB that are allowed")
        self._buffers[index] = data
        return data

    def _read(self, accessor: GltfAccessor, where: str) -> Values:
        dtype, width = np.dtype(_COMPONENTS[accessor.component_type]), _WIDTHS[accessor.type]
        if accessor.buffer_view is None:
            self._spend(accessor.count * width * dtype.itemsize, where)
            values = np.zeros((accessor.count, width), dtype)
        else:
            values = self._stretch(accessor.buffer_view, accessor.byte_offset, accessor.count, width, dtype, where)
        if accessor.sparse is not None:
            self._spend(values.nbytes, where)
            values = self._replaced(values, accessor.sparse, f"{where}.sparse")
        if accessor.normalized and dtype.kind in "ui":
            self._spend(4 * values.size, where)
            values = np.maximum(values.astype(np.float32) / np.float32(np.iinfo(dtype).max), np.float32(-1))
        return values

    def _stretch(self, view: int, offset: int, count: int, width: int, dtype: np.dtype[Any], where: str) -> Values:
        data = self.view(view, f"{where}.bufferView")
        size = width * dtype.itemsize
        stride = self.table.buffer_views[view].byte_stride or size
        if stride < size:
            raise self.refusal(f"bufferViews[{view}].byteStride is {stride}: {where} needs at least {size}")
        end = offset + max(count - 1, 0) * stride + size * (count > 0)
        if end > len(data):
            raise self.refusal(
                f"{where} ends at byte {end}, but bufferViews[{view}] has {len(data)} bytes: the file is damaged"
            )
        if count == 0:
            return np.zeros((0, width), dtype)
        return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))

    def _replaced(self, values: Values, sparse: GltfSparse, where: str) -> Values:
        if sparse.count > len(values):
            raise self.refusal(f"{where}.count is {sparse.count}: the accessor has {len(values)} entries")
        code = _COMPONENTS.get(sparse.indices.component_type, "")
        if "u" not in code:
            raise self.refusal(f"{where}.indices.componentType is {sparse.indices.component_type}: it must be unsigned")
        # Tightly packed, whatever stride the buffer view has for others.
        index = self._stretch(
            sparse.indices.buffer_view, sparse.indices.byte_offset, sparse.count, 1, np.dtype(code), f"{where}.indices"
        ).ravel()
        if len(index) and index.max() >= len(values):
            raise self.refusal(f"{where}.indices has {index.max()}: the accessor has {len(values)} entries")
        out = values.copy()
        out[index] = self._stretch(
            sparse.values.buffer_view,
            sparse.values.byte_offset,
            sparse.count,
            values.shape[1],
            values.dtype,
            f"{where}.values",
        )
        return out

    def _spend(self, count_bytes: int, where: str) -> None:
        self._copied_bytes += count_bytes
        if self._copied_bytes > MAX_COPIED_BYTES:
            raise self.refusal(
                f"{where} and those before it ask for {self._copied_bytes / 1e6:.0f} MB beyond the file's own bytes: "
                f"at most {MAX_COPIED_BYTES / 1e6:.0f} MB are allowed"
            )


def _unpacked(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """The JSON text of a file, and the binary part of a GLB, if it has one."""
    if data[:4] != b"glTF":
        if path.suffix.lower() == ".glb":
            raise SceneError(f"{path} is no GLB file: it must begin with the letters glTF")
        return data, None
    if len(data) < 12:
        raise SceneError(f"{path} is cut short: it has {len(data)} bytes, fewer than the head of a GLB file")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise SceneError(f"{path} is a GLB file of version {version}: only version 2 can be read")
    if length > len(data):
        raise SceneError(f"{path} is cut short: it has {len(data)} bytes of {length}")
    chunks: list[tuple[int, bytes]] = []
    place = 12
    while place + 8 <= length and len(chunks) < 2:
        size, kind = struct.unpack_from("<II", data, place)
        if place + 8 + size > length:
            raise SceneError(f"{path} is damaged: a part of {size} bytes at byte {place} reaches beyond its end")
        chunks.append((kind, data[place + 8 : place + 8 + size]))
        place += 8 + size
    if not chunks or chunks[0][0] != _JSON:
        raise SceneError(f"{path} is damaged: a GLB file must begin with a part of JSON")
    return chunks[0][1], chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BINARY else None


def _table(path: Path, text: bytes) -> GltfTable:
    if text.count(b",") + text.count(b"[") + text.count(b"{") > MAX_JSON_ENTRIES:
        raise SceneError(f"{path} has more than {MAX_JSON_ENTRIES} values in its JSON, which is all that is allowed")
    found = json_value(text, str(path))
    if isinstance(found, dict) and isinstance(found.get("asset", {}), dict):
        version = found.get("asset", {}).get("version", "1.0")
        if isinstance(version, str) and not version.startswith("2."):
            raise SceneError(f"{path} is glTF of version {shown(version)}: only version 2.0 can be read")
    table = checked(GltfTable, found, path)
    if table.asset.min_version not in {None, "2.0"}:
        raise SceneError(f"{path} needs a reader of glTF {shown(table.asset.min_version)}: only 2.0 can be read")
    return table
