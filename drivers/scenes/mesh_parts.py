"""What a reader of mesh files hands over: parts with one surface each, whatever the file's format was."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.drivers.files.errors import SceneError

Wrap = Literal["repeat", "mirror", "clamp"]
MAX_TRIANGLES: Final = 2_000_000
MAX_POINTS: Final = 10_000_000
"""Of a table in a file: vertices, texture coordinates or faces."""


def check_triangles(path: Path, triangles: int) -> None:
    """Raise SceneError for more triangles than a file may have."""
    if triangles > MAX_TRIANGLES:
        raise SceneError(f"{path} has {triangles} triangles: at most {MAX_TRIANGLES} are allowed")


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Triangles of a file with one material, in the file's own axes; what is None the file does not say.

    Colours are linear. Where several are given they multiply: a texel by `factor`, by the corner's colour.
    """

    vertices: Doubles
    """(V, 3); any number, also what is not finite."""
    faces: Indices
    """(F, 3), not yet checked against V."""
    uv: Doubles | None = None
    """(F, 3, 2): u to the right and v down in the texture, of each corner of a face; beyond 0..1 `wrap` says."""
    colours: Singles | None = None
    """(F, 3, 3), of each corner of a face."""
    factor: tuple[float, float, float] | None = None
    """The colour of the whole surface, or what its texture is multiplied by."""
    texture: Singles | None = None
    """(h, w, 3), 0..1."""
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    """What lies beyond the texture's edges, along u and v."""
    shared: object = None
    """Parts with the same key that is not None are copies of each other: the same arrays, placed by `transform`."""
    transform: Doubles | None = None
    """(4, 4): from the part's own axes to the file's; None where they are the same."""


@dataclass(frozen=True)
class MeshFile:
    """What a mesh file holds."""

    parts: tuple[MeshPart, ...]
    remarks: tuple[str, ...] = ()
    """What of the file was left out or made otherwise, a clause each without the file's name."""
