"""The user's own named gates: kept in the platform's folder for settings, and in files to hand on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os.path import isfile
from pathlib import Path

from slopegate.app.session.preferences import default_path
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Preset
from slopegate.drivers.files.durable import StorageError, make_folder, remove
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.gate_files import MAX_GATES, gate_table, presets_of, read_gate_file, write_gate_file
from slopegate.drivers.scenes.scene_toml import GateTable

FILE_NAME = "gates.toml"
MAX_NAME = 80


def my_gates_path() -> Path:
    """The user's own file of gates."""
    return default_path().with_name(FILE_NAME)


class MyGates:
    """Gates by their names, in one file. Every change is on the disk when its call returns."""

    def __init__(self, path: Path) -> None:
        """`problem` says why the file could not be used; then nothing is written over it."""
        self.path = path
        self.problem = ""
        self._tables: tuple[GateTable, ...] = ()
        if isfile(path):
            try:
                self._tables = read_gate_file(path)
            except SceneError as error:
                self.problem = f"Your own gates cannot be read: {error}"

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, in the order in which they were kept."""
        return tuple(table.name for table in self._tables)

    def presets(self, rig: Rig) -> tuple[tuple[Preset, ...], tuple[str, ...]]:
        """The gates that this rig can make, and a remark for each that it cannot make as it was kept."""
        return presets_of(self._tables, rig, self.path)

    def keep(self, preset: Preset, rig: Rig) -> None:
        """Keep a gate by its name, in place of one that has it. Raises InputError and StorageError."""
        name = preset.name.strip()
        require(0 < len(name) <= MAX_NAME and name.isprintable(), "name", name, f"a line of 1 to {MAX_NAME} letters")
        self._take([gate_table(replace(preset, name=name), rig)])

    def forget(self, name: str) -> None:
        """Remove the gate of this name. Raises StorageError."""
        self._write(tuple(table for table in self._tables if table.name != name))

    def load(self, path: Path) -> int:
        """Take over all gates of a file, in place of those that have their names; how many.

        Raises SceneError and StorageError.
        """
        tables = read_gate_file(path)
        self._take(tables)
        return len(tables)

    def save_as(self, path: Path) -> None:
        """Write them to a file to hand on. Raises StorageError."""
        write_gate_file(path, self._tables)

    def _take(self, more: Sequence[GateTable]) -> None:
        kept = {table.name: table for table in (*self._tables, *more)}
        require(len(kept) <= MAX_GATES, "gates", len(kept), f"at most {MAX_GATES}")
        self._write(tuple(kept.values()))

    def _write(self, tables: tuple[GateTable, ...]) -> None:
        if self.problem:
            raise StorageError(f"{self.problem}; nothing is written over it: mend it or move it away")
        if tables:
            make_folder(self.path.parent)
            write_gate_file(self.path, tables)
        else:
            remove(self.path)
        self._tables = tables
