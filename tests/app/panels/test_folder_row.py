"""The folder that something is recorded into."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtCore import QStandardPaths
from pytestqt.qtbot import QtBot

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
