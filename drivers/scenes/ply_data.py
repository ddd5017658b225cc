"""What stands in a PLY file: its header, and the numbers of each element, in text and in both binary forms."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Doubles, Indices
from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.mesh_parts import MAX_POINTS
from slopegate.drivers.scenes.obj_text import text_of

MAX_HEADER_BYTES = 1_000_000
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CHUNK = 50_000


@dataclass(frozen=True)
class PlyProperty:
    """A number of each row, or a list of them where `count_type` is given; types as numpy writes them ("u1")."""

    name: str
    type: str
    count_type: str | None = None


@dataclass(frozen=True)
class PlyElement:
    """A table of the header."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]


@dataclass(frozen=True)
class PlyHeader:
    """What a file says that it holds."""

    order: str
    """"<" or ">" of binary numbers, "" of text."""
    elements: tuple[PlyElement, ...]
    comments: tuple[str, ...]
    unknown: tuple[str, ...]
    """Lines that are no part of the format."""
    end: int
    """Where the numbers begin, in bytes."""


@dataclass(frozen=True)
class PlyTable:
    """The numbers of one element."""

    columns: dict[str, Doubles]
    types: dict[str, str]
    lists: dict[str, tuple[Doubles, Indices]]
    """The numbers of all rows one after the other, and how many each row has."""


def read_header(path: Path, data: bytes) -> PlyHeader:
    """Raises SceneError for what is no header of a PLY file."""
    ending = data.find(b"end_header", 0, MAX_HEADER_BYTES)
    if not data.startswith(b"ply") or ending < 0:
        raise SceneError(f"{path} is no PLY file: it must begin with 'ply' and a header that ends with 'end_header'")
    order: str | None = None
    comments: list[str] = []
    unknown: list[str] = []
    elements: list[PlyElement] = []
    for line in text_of(data[3:ending]).replace("\r", "\n").split("\n"):
        match line.split():
            case []:
                continue
            case ["comment" | "obj_info", *_]:
                comments.append(line.strip())
            case ["format", name, _] if name in _FORMATS:
                order = _FORMATS[name]
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(PlyElement(name, int(count), ()))
            case ["property", *words] if elements and (found := _property(words)) is not None:
                elements[-1] = replace(elements[-1], properties=(*elements[-1].properties, found))
            case ["format" | "element" | "property", *_]:
                raise SceneError(f"{path} has a header with {shown(line.strip())}, which PLY does not know")
            case _:
                unknown.append(line.strip())
    if order is None:
        raise SceneError(f"{path} has a header without a format: it must be {', '.join(_FORMATS)}")
    for names in ([each.name for each in elements], *([item.name for item in each.properties] for each in elements)):
        if len(set(names)) < len(names):
            raise SceneError(f"{path} has a header that names {shown(max(names, key=names.count))} twice")
    end = _numbers_begin(data, ending + len(b"end_header"))
    return PlyHeader(order, tuple(elements), tuple(comments), tuple(unknown), end)


def _property(words: list[str]) -> PlyProperty | None:
    match words:
        case ["list", count, kind, name] if kind in _TYPES and _TYPES.get(count, "f")[0] != "f":
            return PlyProperty(name.lower(), _TYPES[kind], _TYPES[count])
        case [kind, name] if kind in _TYPES:
            return PlyProperty(name.lower(), _TYPES[kind])
    return None


def _numbers_begin(data: bytes, end: int) -> int:
    """Where the line of `end_header` ends: with a lone return only if the first line does, too."""
    while data[end : end + 1] in {b" ", b"\t"}:
        end += 1
    lone = data[3:4] == b"\r" and data[4:5] != b"\n"
    if data[end : end + 2] == b"\r\n" and not lone:
        return end + 2
    return end + (data[end : end + 1] in {b"\r", b"\n"})


def read_tables(path: Path, data: bytes, header: PlyHeader, wanted: set[str]) -> tuple[dict[str, PlyTable], list[str]]:
    """The tables of the elements `wanted`, and remarks about numbers that the header does not promise.

    Raises SceneError where the file ends too early or a table is too long. What a header asks for is compared with the
    bytes that are there before memory is taken.
    """
    tables: dict[str, PlyTable] = {}
    reader = _TextRows(path, data, header.end) if header.order == "" else _BinaryRows(path, data, header)
    for element in header.elements:
        if not element.properties or element.count == 0:
            continue
        listed = any(item.count_type for item in element.properties)
        if (listed or element.name in wanted) and element.count > MAX_POINTS:
            raise SceneError(
                f"{path} has {element.count} rows of {shown(element.name)}: at most {MAX_POINTS} are allowed"
            )
        table = reader.table(element)
        if element.name in wanted:
            tables[element.name] = table
    if reader.more():
        reader.remarks.append("what follows its last element is left out")
    return tables, reader.remarks


def _cut_short(path: Path, element: PlyElement) -> SceneError:
    return SceneError(
        f"{path} is cut short: its header says {element.count} rows of {shown(element.name)}, and fewer are there"
    )


class _BinaryRows:
    """Tables of a binary file, one after the other."""

    def __init__(self, path: Path, data: bytes, header: PlyHeader) -> None:
        self.remarks: list[str] = []
        self._path, self._data, self._at, self._order = path, data, header.end, header.order

    def more(self) -> bool:
        return self._at < len(self._data)

    def table(self, element: PlyElement) -> PlyTable:
        least = sum(np.dtype(item.count_type or item.type).itemsize for item in element.properties)
        if element.count * least > len(self._data) - self._at:
            raise _cut_short(self._path, element)
        return self._alike(element) or self._various(element)

    def _alike(self, element: PlyElement) -> PlyTable | None:
        """The table if all its lists have the lengths of the first row, as in files of triangles alone."""
        fields: list[tuple[Any, ...]] = []
        lengths: dict[str, int] = {}
        at = self._at
        for item in element.properties:
            if item.count_type is None:
                fields.append((item.name, self._order + item.type))
                at += np.dtype(item.type).itemsize
                continue
            size = np.dtype(item.count_type).itemsize
            if at + size > len(self._data):
                return None
            length = int(np.frombuffer(self._data, self._order + item.count_type, 1, at)[0])
            if length < 0 or length > len(self._data):
                return None
            lengths[item.name] = length
            fields += [
                (f"#{item.name}", self._order + item.count_type),
                (item.name, self._order + item.type, (length,)),
            ]
            at += size + length * np.dtype(item.type).itemsize
        row = np.dtype(fields)
        if element.count * row.itemsize > len(self._data) - self._at:
            return None
        rows = np.frombuffer(self._data, row, element.count, self._at)
        if any((rows[f"#{name}"] != length).any() for name, length in lengths.items()):
            return None
        self._at += element.count * row.itemsize
        columns = {item.name: rows[item.name] for item in element.properties if item.count_type is None}
        lists = {name: (rows[name].reshape(-1), np.full(element.count, length)) for name, length in lengths.items()}
        return _as_table(element, columns, lists)

    def _various(self, element: PlyElement) -> PlyTable:
        """The table where lists differ in length: first where each begins, then its numbers."""
        starts: dict[str, list[int]] = {item.name: [] for item in element.properties}
        lengths: dict[str, list[int]] = {item.name: [] for item in element.properties if item.count_type}
        steps = [
            (
                item.name,
                np.dtype(item.type).itemsize,
                None if item.count_type is None else struct.Struct(self._order + _letter(item.count_type)),
            )
            for item in element.properties
        ]
        at, data = self._at, self._data
        try:
            for _ in range(element.count):
                for name, size, counter in steps:
                    if counter is None:
                        starts[name].append(at)
                        at += size
                        continue
                    (length,) = counter.unpack_from(data, at)
                    at += counter.size
                    starts[name].append(at)
                    lengths[name].append(length)
                    if length < 0:
                        raise SceneError(f"{self._path} has a list {shown(name)} of {length} numbers")
                    at += length * size
        except struct.error as error:
            raise _cut_short(self._path, element) from error
        if at > len(data):
            raise _cut_short(self._path, element)
        self._at = at
        columns, lists = {}, {}
        for item in element.properties:
            counts = np.array(lengths[item.name]) if item.count_type else np.ones(element.count, np.int64)
            values = self._gathered(np.array(starts[item.name]), counts, self._order + item.type)
            if item.count_type:
                lists[item.name] = values, counts
            else:
                columns[item.name] = values
        return _as_table(element, columns, lists)

    def _gathered(self, starts: Indices, counts: Indices, kind: str) -> NDArray[Any]:
        size = np.dtype(kind).itemsize
        values = np.zeros(int(counts.sum()), kind)
        places = np.cumsum(counts) - counts
        raw = np.frombuffer(self._data, np.uint8)
        for count in np.unique(counts).tolist():
            rows = np.flatnonzero(counts == count)
            found = raw[starts[rows, None] + np.arange(count * size)].view(kind)
            values[places[rows, None] + np.arange(count)] = found.reshape(len(rows), count)
        return values


def _letter(kind: str) -> str:
    return {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}[kind]


class _TextRows:
    """Tables of a text file, one row a line."""

    def __init__(self, path: Path, data: bytes, start: int) -> None:
        self.remarks: list[str] = []
        self._path = path
        self._left = len(data) - start
        self._lines = _lines(data, start)
        self._surplus = False
        """Whether a row of the table that is being read holds more numbers than the header says."""

    def more(self) -> bool:
        return next(self._lines, None) is not None

    def table(self, element: PlyElement) -> PlyTable:
        # A digit and a blank each, but for the last.
        if element.count * len(element.properties) * 2 - 1 > self._left:
            raise _cut_short(self._path, element)
        columns: dict[str, list[Doubles]] = {item.name: [] for item in element.properties if item.count_type is None}
        lists: dict[str, list[tuple[Doubles, Indices]]] = {
            item.name: [(np.zeros(0), np.zeros(0, np.int64))] for item in element.properties if item.count_type
        }
        done, self._surplus = 0, False
        while done < element.count:
            rows = self._rows(element, done, min(_CHUNK, element.count - done))
            for name, values in rows.columns.items():
                columns[name].append(values)
            for name, pair in rows.lists.items():
                lists[name].append(pair)
            done += _CHUNK
        if self._surplus:
            self.remarks.append(f"its rows of {shown(element.name)} hold more than its header says: that is left out")
            columns = {}  # which of the numbers beside a list is which is not known then
        joined = {
            name: (np.concatenate([values for values, _ in each]), np.concatenate([counts for _, counts in each]))
            for name, each in lists.items()
        }
        return _as_table(element, {name: np.concatenate(each) for name, each in columns.items()}, joined)

    def _rows(self, element: PlyElement, done: int, count: int) -> PlyTable:
        """The next `count` rows, of which those alike are taken together."""
        alike: dict[tuple[int, ...], list[int]] = {}
        rows: list[list[str]] = []
        for index in range(count):
            line = next(self._lines, None)
            if line is None:
                raise _cut_short(self._path, element)
            words = line.split()
            lengths = _lengths(element, words)
            if lengths is None or (not lengths and len(words) > len(element.properties)):
                raise SceneError(
                    f"{self._path} has {shown(line.strip())} as row {done + index + 1} of {shown(element.name)}: its "
                    f"header promises {_promise(element)}"
                )
            needed = len(element.properties) + sum(lengths)
            self._surplus |= len(words) > needed
            rows.append(words[:needed])
            alike.setdefault(lengths, []).append(index)
        columns = {item.name: np.zeros(count) for item in element.properties if item.count_type is None}
        counts = {item.name: np.zeros(count, np.int64) for item in element.properties if item.count_type}
        parts: dict[str, list[tuple[Indices, Doubles]]] = {name: [] for name in counts}
        for lengths, chosen in alike.items():
            values = self._numbers(element, [rows[index] for index in chosen])
            places, at, number = np.array(chosen), 0, 0
            for item in element.properties:
                if item.count_type is None:
                    columns[item.name][places] = values[:, at]
                    at += 1
                    continue
                length = lengths[number]
                counts[item.name][places] = length
                parts[item.name].append((places, values[:, at + 1 : at + 1 + length]))
                at, number = at + 1 + length, number + 1
        lists = {name: (_merged(parts[name], counts[name]), counts[name]) for name in counts}
        return _as_table(element, columns, lists)

    def _numbers(self, element: PlyElement, rows: list[list[str]]) -> Doubles:
        try:
            return np.array([float(word) for row in rows for word in row]).reshape(len(rows), -1)
        except ValueError as error:
            raise SceneError(f"{self._path} has a row of {shown(element.name)} that holds more than numbers") from error


def _lines(data: bytes, start: int) -> Iterator[str]:
    """Lines that are not empty."""
    if b"\r" in data:
        data, start = data[start:].replace(b"\r", b"\n"), 0
    while start < len(data):
        end = data.find(b"\n", start)
        end = end if end >= 0 else len(data)
        line = data[start:end].decode("latin-1")
        if line and not line.isspace():
            yield line
        start = end + 1


def _lengths(element: PlyElement, words: list[str]) -> tuple[int, ...] | None:
    """How long the lists of a row are; None for a row that does not fit the header."""
    at, lengths = 0, []
    for item in element.properties:
        if item.count_type is None:
            at += 1
            continue
        if at >= len(words) or not words[at].isdecimal() or len(words[at]) > 9:
            return None
        lengths.append(int(words[at]))
        at += 1 + lengths[-1]
    return tuple(lengths) if at <= len(words) else None


def _promise(element: PlyElement) -> str:
    return ", ".join(f"a list {item.name}" if item.count_type else item.name for item in element.properties)


def _merged(parts: list[tuple[Indices, Doubles]], counts: Indices) -> Doubles:
    starts = np.cumsum(counts) - counts
    values = np.zeros(int(counts.sum()))
    for places, part in parts:
        values[starts[places, None] + np.arange(part.shape[1])] = part
    return values


def _as_table(
    element: PlyElement, columns: dict[str, NDArray[Any]], lists: dict[str, tuple[NDArray[Any], Indices]]
) -> PlyTable:
    with np.errstate(invalid="ignore"):  # numpy warns of some that are no numbers
        return PlyTable(
            {name: np.asarray(values, np.float64) for name, values in columns.items()},
            {item.name: item.type for item in element.properties},
            {name: (np.asarray(values, np.float64), counts) for name, (values, counts) in lists.items()},
        )
