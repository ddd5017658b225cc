"""Builds GLB files of a few triangles, key by key."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

CODES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
CORNERS = [0, 1, 2, 0, 2, 3]
UPRIGHT = [[0, 1], [1, 1], [1, 0], [0, 0]]


class SmallGlb:
    """A file in the making; `json` may be changed at will before it is written."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.json |= {"nodes": [{"mesh": 0}], "meshes": [], "accessors": [], "bufferViews": []}
        self.data = b""

    @classmethod
    def square(cls, kind: str = "float32", **attributes: int) -> SmallGlb:
        """One square of two triangles, 0..1 in x and y."""
        glb = cls()
        glb.mesh(POSITION=glb.array(SQUARE, kind), **attributes)
        return glb

    def mesh(self, indices: ArrayLike | None = CORNERS, mode: int = 4, **attributes: int) -> dict[str, Any]:
        """Add a mesh of one primitive, which comes back."""
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        if indices is not None:
            primitive["indices"] = self.array(indices, "uint16")
        self.json["meshes"].append({"primitives": [primitive]})
        return primitive

    def view(self, data: bytes, **more: int) -> int:
        """Add bytes as a buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)} | more)
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def array(self, values: ArrayLike, kind: str = "float32", **more: Any) -> int:
        """Add numbers as an accessor."""
        array = np.ascontiguousarray(values, kind)
        shape = {1: "SCALAR", 2: f"VEC{array.shape[-1]}", 3: "MAT4"}[array.ndim]
        entry = {"bufferView": self.view(array.tobytes()), "componentType": CODES[kind], "count": len(array)}
        self.json["accessors"].append(entry | {"type": shape} | more)
        return len(self.json["accessors"]) - 1

    def texture(self, pixels: ArrayLike, kind: str = "uint8", sampler: dict[str, int] | None = None) -> dict[str, Any]:
        """A base colour texture of these numbers, (h, w) or (h, w, 3); comes back as it is used in a material."""
        values = np.asarray(pixels, kind)
        png = cv2.imencode(".png", values[..., ::-1] if values.ndim == 3 else values)[1].tobytes()
        self.json |= {"images": [{"bufferView": self.view(png), "mimeType": "image/png"}]}
        self.json |= {"textures": [{"source": 0} | ({} if sampler is None else {"sampler": 0})]}
        if sampler is not None:
            self.json["samplers"] = [sampler]
        return {"index": 0}

    def paint(self, **surface: Any) -> dict[str, Any]:
        """Give the first primitive of the first mesh a material with these keys of pbrMetallicRoughness."""
        material: dict[str, Any] = {"pbrMetallicRoughness": surface}
        self.json["materials"] = [material]
        self.json["meshes"][0]["primitives"][0]["material"] = 0
        return material

    def packed(self) -> bytes:
        """The bytes of the GLB file."""
        self.json["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        binary = self.data + b"\0" * (-len(self.data) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def write(self, path: Path) -> Path:
        """Write the GLB file."""
        path.write_bytes(self.packed())
        return path
