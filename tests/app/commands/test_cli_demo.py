"""The demo and the window from the command line."""

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from PySide6.QtWidgets import QApplication

from settings_inside import read_settings
from slopegate.app.cli import main
from slopegate.app.commands import demo, tour
from slopegate.app.widgets import theme
from slopegate.drivers.scenes.scene_files import shipped_scenes

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, qapp: QApplication) -> Iterator[None]:
    """One scene, no time to look."""
    monkeypatch.setattr(tour, "shipped_scenes", lambda: shipped_scenes()[:1])
    monkeypatch.setattr(tour, "LOOK_MS", 50)
    monkeypatch.setattr(tour, "PATIENCE_S", 240.0)
    yield
    theme.apply(qapp, "system")


@pytest.mark.usefixtures("quick")
def test_the_demo_leaves_pictures_in_the_folder_that_it_names(capsys: Capture, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "pictures"
    assert main(["demo", "--out", str(folder)]) == 0
    out, _ = capsys.readouterr()
    made = sorted(path.name for path in folder.iterdir())
    assert out == f"{len(made)} pictures are in {folder}\n"
    for look in ("light", "dark"):
        for width, height in ((1280, 800), (1920, 1080)):
            picture = cv2.imread(str(folder / f"window-{look}-{width}x{height}.png"))
            assert picture is not None
            assert picture.std() > 10
            assert (picture[0, 0].mean() > 128) == (look == "light")
    captures = [name for name in made if name.startswith("capture-") and name.endswith(".tif")]
    assert len(captures) >= 3
    for name in captures:
        looks = cv2.imread(str(folder / name.replace(".tif", ".png")), cv2.IMREAD_UNCHANGED)
        assert looks.shape == cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED).shape
        assert looks.max() > 150
    gates = [read_settings(folder / name)["applied"] for name in captures]
    assert len({tuple(gate.values()) for gate in gates}) == len(gates)


@pytest.mark.usefixtures("quick")
def test_a_scene_that_does_not_open_ends_the_demo_with_its_sentence(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("ambient = 'bright'", "utf-8")
    first = shipped_scenes()[0]
    entry = type(first)("broken", "Broken", "", broken)
    monkeypatch.setattr(tour, "shipped_scenes", lambda: [entry])
    assert main(["demo", "--out", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "broken.toml" in err
    assert err.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_refused(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert main(["demo", "--out", str(tmp_path / "file" / "folder")]) == 2
    assert "file" in capsys.readouterr().err


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("other systems always have a display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("no_display")
def test_without_a_display_the_window_is_refused_in_a_sentence(capsys: Capture) -> None:
    assert main([]) == 2
    assert "DISPLAY" in capsys.readouterr().err


@pytest.mark.usefixtures("no_display")
def test_without_any_display_at_all_the_demo_says_what_is_missing(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo.shutil, "which", lambda _: None)
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "xvfb-run" in capsys.readouterr().err
