"""Files of named gates: what is written reads back to the last bit, and what is wrong is said."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import FINE_LINES, check_rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Preset
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.gate_files import gate_table, presets_of, read_gate_file, write_gate_file

RIG = check_rig(160, FINE_LINES)
LINE_US = RIG.camera.shutter.line.nearest(100.0)


@given(
    name=st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1, max_size=40).filter(str.strip),
    delay_us=st.floats(-1e6, 1e6),
    exposure_us=st.floats(1e-3, 1e6),
    complement=st.booleans(),
)
def test_a_gate_reads_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, name: str, delay_us: float, exposure_us: float, complement: bool
) -> None:
    path = tmp_path_factory.mktemp("gates") / "g.toml"
    preset = Preset(name, gate(LINE_US, delay_us, exposure_us), complement)
    table = gate_table(preset, RIG)
    write_gate_file(path, [table])
    assert read_gate_file(path) == (table,)
    assert (table.delay_us, table.exposure_us, table.line_time_us) == (delay_us, exposure_us, LINE_US)


def test_gates_come_back_for_their_rig_and_are_remarked_for_another(tmp_path: Path) -> None:
    path = tmp_path / "g.toml"
    asked = Preset("By slab", gate(LINE_US, 3000.0, 500.0), asked_slab=(0.0, 1.2, 0.2))
    plain = Preset("By settings", gate(LINE_US, 3000.0, 500.0), complement=True)
    write_gate_file(path, [gate_table(asked, RIG), gate_table(plain, RIG)])
    (first, second), remarks = presets_of(read_gate_file(path), RIG, path)
    assert (second, remarks) == (plain, ())
    assert first.asked_slab == (0.0, 1.2, 0.2)
    other = check_rig(80, FINE_LINES)
    assert other.name == RIG.name
    text = path.read_text("utf-8").replace(f'rig = "{RIG.name}"', 'rig = "Another"')
    path.write_text(text, "utf-8")
    _, remarks = presets_of(read_gate_file(path), RIG, path)
    assert remarks == (f"{path}: 'By settings': made for another rig, whose slabs lie elsewhere",)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "gates is missing"),
        ("gates = []", "a list of gates with at least one entry"),
        ('[[gates]]\nname = "a"\n', "must have exactly one of these sets of keys"),
        ('[[gates]]\nname = ""\nclock_mhz = 1\ndelay_us = 1\nexposure_us = 1\n', "a text that is not empty"),
        ('[[objects]]\nname = "a"\n', "objects is not a key that is known there"),
        ("[[gates", "is not valid TOML"),
    ],
)
def test_what_is_no_file_of_gates_is_refused_in_a_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "g.toml"
    path.write_text(text or "# nothing", "utf-8")
    with pytest.raises(SceneError, match=r"g\.toml") as caught:
        read_gate_file(path)
    assert sentence in str(caught.value)


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"it must be one of \.toml"):
        write_gate_file(tmp_path / "g.json", [])
