"""Finds and reads the files that a mesh file names: its textures and material libraries.

Such names come from other computers: with backslashes, in other capitals, or with the folder of whoever wrote them.
"""

from __future__ import annotations

import os
from os.path import exists, isfile
from pathlib import Path

from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_decoding import decode_colour
from slopegate.drivers.files.reading import read_plain
from slopegate.drivers.scenes.mesh_surfaces import MAX_TEXELS


class MeshPictures:
    """The textures that one mesh file names, each read once; `remarks` says which were found elsewhere."""

    def __init__(self, path: Path) -> None:
        self.remarks: list[str] = []
        self._path = path
        self._read: dict[Path, Singles] = {}
        self._texels = 0

    def read(self, folder: Path, name: str, namer: Path) -> Singles:
        """The texture `name`, beside `folder`, as linear (h, w, 3) float32 in 0..1.

        Raises SceneError where it is missing or cannot be read, and where all together are too large.
        """
        found = find_named(folder, name)
        if found is None:
            raise SceneError(f"{shown_path(folder, name)} is missing: {namer} names it as a texture")
        self._remark_elsewhere(folder, name, found)
        if found not in self._read:
            self._read[found] = decode_colour(read_plain(found), found)
            self._texels += self._read[found].shape[0] * self._read[found].shape[1]
        if self._texels > MAX_TEXELS:
            raise SceneError(
                f"{self._path} has textures of more than {MAX_TEXELS / 1e6:.0f} megapixels together: that is too much"
            )
        return self._read[found]

    def _remark_elsewhere(self, folder: Path, name: str, found: Path) -> None:
        wanted = folder.joinpath(*_parts(name))
        if os.path.normpath(wanted).casefold() != os.path.normpath(found).casefold():
            self.remarks.append(f"the texture {shown(name)} is not there: {found} is taken instead")


def shown_path(folder: Path, name: str) -> str:
    """The path of a file that is missing, as a sentence shows it."""
    plain = name if name.isprintable() and len(name) <= 200 else shown(name)
    return str(folder / plain.replace("\\", "/"))


def find_named(folder: Path, name: str) -> Path | None:
    """The file that a file in `folder` calls `name`, or the one of that name nearest to the folder, or None."""
    parts = _parts(name)
    if name.startswith("/") and isfile(name):
        return Path(name)
    tails = (parts[start:] for start in range(len(parts)))
    return next((found for tail in tails if (found := _within(folder, tail)) is not None), None)


def _parts(name: str) -> list[str]:
    return [part for part in name.strip().strip('"').replace("\\", "/").split("/") if part not in {"", "."}]


def _within(folder: Path, parts: list[str]) -> Path | None:
    here = folder
    for part in parts:
        if exists(here / part):
            here = here / part
            continue
        try:
            names = sorted(os.listdir(here))
        except (OSError, ValueError):
            return None
        same = next((name for name in names if part.casefold() in {name.casefold(), _eight_bit(name).casefold()}), None)
        if same is None:
            return None
        here = here / same
    return here if isfile(here) else None


def _eight_bit(name: str) -> str:
    """A file's name read as Latin-1, as old files write it; a name that is not UTF-8 comes escaped from Python."""
    return os.fsencode(name).decode("latin-1")
