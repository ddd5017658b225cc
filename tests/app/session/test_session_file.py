"""What a session's file may hold, and what is said of one that holds something else."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from slopegate.app.session.session_file import SavedSession, read_session, write_session
from slopegate.drivers.files.errors import SceneError

SAVED = SavedSession(scene="a.toml", rig_toml="", rate_hz=20.0, slab=(15.0, 1.0, 0.1))


def test_it_reads_back_as_it_was_written(tmp_path: Path) -> None:
    assert read_session(write_session(tmp_path / "a.slopegate", SAVED)) == SAVED


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"rate_hz": -1}, "rate_hz is -1: it must be above 0"),
        ({"slab": [1, 2, "a"]}, "slab.2 is 'a': it must be a valid number"),
        ({"format": "other"}, "format is 'other': it must be 'slopegate-session'"),
        ({"colour": 1}, "colour is not a key that is known there"),
        ({"version": 2, "colour": 1}, "it has version 2 and this program reads up to 1, so it needs a newer one"),
    ],
)
def test_what_is_wrong_is_told_with_its_value(tmp_path: Path, changed: dict[str, Any], told: str) -> None:
    path = write_session(tmp_path / "a.slopegate", SAVED)
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    with pytest.raises(SceneError) as error:
        read_session(path)
    assert str(error.value) == f"{path} cannot be opened as a session: {told}"


@pytest.mark.parametrize(
    ("damaged", "told"),
    [
        (lambda text: text[:-20], "it is cut short: it ends in the middle of a value or list, in line "),
        (lambda text: text.replace(",", ";", 1), "it is not JSON from line 2, column "),
        (lambda text: "solid cube", "it is not JSON from line 1, column 1 on"),
        (lambda text: "[" * 100_000, "it is not valid JSON: its values are nested too deeply"),
        (lambda text: "[]", "the file is []: it must be an object"),
    ],
)
def test_a_damaged_file_is_told_in_our_words(tmp_path: Path, damaged: Callable[[str], str], told: str) -> None:
    path = write_session(tmp_path / "a.slopegate", SAVED)
    path.write_text(damaged(path.read_text("utf-8")), "utf-8")
    with pytest.raises(SceneError) as error:
        read_session(path)
    sentence = str(error.value)
    assert sentence.startswith(f"{path} cannot be opened as a session: {told}")
    assert not any(word in sentence for word in ("EOF", "parsing", "expected", "limit"))
