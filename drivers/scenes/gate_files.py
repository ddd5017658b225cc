"""Files of named gates alone, to keep and to hand on: TOML with [[gates]] tables as in a scene file.

Each gate may say for which `rig` it was made; another rig makes another slab of the same settings.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Preset
from slopegate.drivers.files.durable import check_destination, write_durably
from slopegate.drivers.scenes.scene_build import build_gates
from slopegate.drivers.scenes.scene_toml import GateTable, gate_list, read_toml

SUFFIXES = (".toml",)
MAX_GATES = 1000


def gate_table(preset: Preset, rig: Rig | None = None) -> GateTable:
    """A gate as a table, which reads back to the last bit; by its slab where it was asked for by that."""
    common: dict[str, Any] = {"name": preset.name, "complement": preset.complement, "rig": rig.name if rig else None}
    if preset.asked_slab is not None:
        tilt_deg, distance_m, thickness_m = preset.asked_slab
        return GateTable(**common, tilt_deg=tilt_deg, distance_m=distance_m, thickness_m=thickness_m)
    settings = preset.settings
    return GateTable(
        **common,
        line_time_us=float(settings.line_time_us),
        delay_us=float(settings.delay_us),
        exposure_us=float(settings.exposure_us),
    )


def keys_of(table: GateTable) -> dict[str, Any]:
    """What of a table is written: all but what it leaves open."""
    return {key: value for key, value in table if value is not None and value is not False}


def read_gate_file(path: Path) -> tuple[GateTable, ...]:
    """The gates in a file. Raises SceneError."""
    return gate_list(read_toml(path), path)


def write_gate_file(path: Path, tables: Sequence[GateTable]) -> None:
    """Write gates to a file, replacing it whole. Raises StorageError."""
    check_destination(path, SUFFIXES)
    lines = ["# Gates of Slopegate. Delays are to the middle of the exposure of row 0.", ""]
    for table in tables:
        lines.append("[[gates]]")
        # every string of JSON is one of TOML, and so are these numbers
        lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in keys_of(table).items()]
        lines.append("")
    write_durably(path, "\n".join(lines).encode())


def presets_of(tables: Sequence[GateTable], rig: Rig, path: Path) -> tuple[tuple[Preset, ...], tuple[str, ...]]:
    """The gates for this rig, and remarks on those that it cannot make as the file has them or that another made."""
    presets, remarks = build_gates(tuple(tables), rig, path)
    others = [repr(table.name) for table in tables if table.rig not in (None, rig.name) and table.tilt_deg is None]
    if others:
        remarks += (f"{path}: {', '.join(others)}: made for another rig, whose slabs lie elsewhere",)
    return presets, remarks
