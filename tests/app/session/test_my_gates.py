"""The user's own gates, on the disk and from there."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigs import FINE_LINES, check_rig
from slopegate.app.session.my_gates import MyGates
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Preset
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.errors import SceneError

RIG = check_rig(160, FINE_LINES)
GATE = gate(RIG.camera.shutter.line.nearest(100.0), 3000.0, 500.0)


def preset(name: str, delay_us: float = 3000.0) -> Preset:
    return Preset(name, gate(GATE.line_time_us, delay_us, 500.0))


def test_gates_are_kept_replaced_and_forgotten(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "gates.toml"
    mine = MyGates(path)
    assert mine.names == ()
    mine.keep(preset("Face"), RIG)
    mine.keep(preset(" Wall "), RIG)
    mine.keep(preset("Face", 1000.0), RIG)
    again = MyGates(path)
    assert again.names == ("Face", "Wall")
    presets, remarks = again.presets(RIG)
    assert remarks == ()
    assert [float(one.settings.delay_us) for one in presets] == [1000.0, 3000.0]
    again.forget("Face")
    again.forget("Wall")
    assert not path.exists()
    assert MyGates(path).names == ()


def test_files_are_handed_on(tmp_path: Path) -> None:
    mine, other = MyGates(tmp_path / "a.toml"), MyGates(tmp_path / "b.toml")
    mine.keep(preset("Face"), RIG)
    mine.keep(preset("Wall"), RIG)
    other.keep(preset("Wall", 1.0), RIG)
    mine.save_as(tmp_path / "shared.toml")
    assert other.load(tmp_path / "shared.toml") == 2
    assert other.names == ("Wall", "Face")
    assert other.presets(RIG)[0][0] == mine.presets(RIG)[0][1]


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "\x1b[31m", "x" * 81])
def test_a_name_that_cannot_be_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="name is"):
        MyGates(tmp_path / "g.toml").keep(preset(name), RIG)


def test_a_file_that_cannot_be_read_is_said_and_never_written_over(tmp_path: Path) -> None:
    path = tmp_path / "gates.toml"
    path.write_text("[[gates", "utf-8")
    mine = MyGates(path)
    assert "Your own gates cannot be read" in mine.problem
    with pytest.raises(StorageError, match="nothing is written over it"):
        mine.keep(preset("Face"), RIG)
    assert path.read_text("utf-8") == "[[gates"
    with pytest.raises(SceneError, match="is not valid TOML"):
        MyGates(tmp_path / "other.toml").load(path)
