"""Preferences survive a restart, and damage."""

from __future__ import annotations

from pathlib import Path

import pytest

from slopegate.app.session.preferences import Preferences, RememberedGate, default_path, load, save


def load_window(path: Path) -> tuple[Preferences, str]:
    return load(path, Preferences, "the window")


def test_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "window.json"
    kept = Preferences(
        gate=RememberedGate(line_time_us=12.5, delay_us=-3.0, exposure_us=500.0), theme="dark", rate_hz=None
    )
    assert save(path, kept) == ""
    assert load_window(path) == (kept, "")
    assert [item.name for item in path.parent.iterdir()] == ["window.json"]


def test_nothing_remembered_is_nothing_to_report(tmp_path: Path) -> None:
    assert load_window(tmp_path / "window.json") == (Preferences(), "")


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"\xff\xfe\x00",
        b"[]",
        b'{"theme": "pink"}',
        b'{"gate": {"line_time_us": -1, "delay_us": 0, "exposure_us": 1}}',
        b'{"gate": {"line_time_us": NaN, "delay_us": 0, "exposure_us": 1}}',
        b'{"rate_hz": 0}',
        b'{"layouts": 3}',
    ],
)
def test_damage_gives_defaults_and_a_sentence(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "window.json"
    path.write_bytes(text)
    got, notice = load_window(path)
    assert got == Preferences()
    assert "window.json" in notice
    assert "\n" not in notice


def test_a_folder_in_its_place_is_reported_both_ways(tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.mkdir()
    assert load_window(path)[1]
    assert "window.json cannot be written" in save(path, Preferences())
    assert list(path.iterdir()) == []
    assert [item.name for item in tmp_path.iterdir()] == ["window.json"]


def test_it_lies_in_the_configuration_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert default_path().name == "window.json"
    assert default_path().parent.name == "slopegate"
