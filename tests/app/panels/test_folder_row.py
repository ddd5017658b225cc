"""The folder that something is recorded into."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from PySide6.QtCore import QStandardPaths
from pytestqt.qtbot import QtBot

from slopegate.app.panels import folder_row
from slopegate.app.panels.folder_row import FolderRow


def test_a_bare_name_lies_where_names_are_suggested(
    qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not where the program was started, which nobody chose."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(QStandardPaths, "writableLocation", lambda _: str(tmp_path / "Pictures"))
    row = FolderRow("the capture", "")
    qtbot.addWidget(row)
    qtbot.keyClicks(row.where, "mine")
    assert row.path == tmp_path / "Pictures" / "slopegate" / "mine"
    row.where.clear()
    qtbot.keyClicks(row.where, str(tmp_path / "lab" / "one"))
    assert row.path == tmp_path / "lab" / "one"
    row.used()
    row.where.clear()
    qtbot.keyClicks(row.where, "two")
    assert row.path == tmp_path / "lab" / "two"


def test_the_disk_is_not_asked_again_and_again(qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path] = []
    now_s = [100.0]

    def usage(path: Path) -> SimpleNamespace:
        asked.append(path)
        return SimpleNamespace(free=1000 - len(asked))

    monkeypatch.setattr(folder_row, "shutil", SimpleNamespace(disk_usage=usage))
    row = FolderRow("the capture", "", clock=lambda: now_s[0])
    qtbot.addWidget(row)
    qtbot.keyClicks(row.where, str(tmp_path / "one"))
    assert [row.free_bytes for _ in range(50)] == [999] * 50
    assert asked == [tmp_path]
    now_s[0] += folder_row.FREE_S
    assert row.free_bytes == 998
    qtbot.keyClicks(row.where, "b")
    assert row.free_bytes == 997
