"""The dialogs that ask for files and numbers."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path

from PySide6.QtCore import QStandardPaths, Qt
from PySide6.QtWidgets import QFileDialog, QMessageBox, QWidget

from slopegate.app.session.holding import Hold
from slopegate.app.session.session_file import SUFFIX as SESSION_SUFFIX
from slopegate.app.session.snapshot import suggested_name
from slopegate.app.widgets.number_box import NumberBox, ask_number
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.video import FILMS
from slopegate.drivers.captures.export import FORMATS
from slopegate.drivers.contract.frame import Modes
from slopegate.drivers.scenes.mesh_files import SUFFIXES as MESH_SUFFIXES


def ask_scene_file(parent: QWidget) -> Path | None:
    """A scene file, mesh or video, or None."""
    kinds = " ".join(f"*{suffix}" for suffix in (".toml", *MESH_SUFFIXES, SESSION_SUFFIX))
    films = " ".join(f"*{suffix}" for suffix in sorted(FILMS))
    captures = " ".join(f"*{suffix}" for suffix in FORMATS["ome-tiff"].suffixes)
    offered = f"Scenes, meshes and sessions ({kinds});;Videos ({films});;Exported captures ({captures});;All files (*)"
    name, _ = QFileDialog.getOpenFileName(parent, "Open a scene or a video", "", offered)
    return Path(name) if name else None


def ask_scene_folder(parent: QWidget) -> Path | None:
    """A folder, or None."""
    name = QFileDialog.getExistingDirectory(parent, "Open a folder: a photo with depth and scene.json, or pictures")
    return Path(name) if name else None


def ask_rig_file(parent: QWidget) -> Path | None:
    """A rig file, or None."""
    name, _ = QFileDialog.getOpenFileName(parent, "Open a rig file", "", "Rig files (*.toml);;All files (*)")
    return Path(name) if name else None


def ask_rate(parent: QWidget, modes: Modes) -> float | None:
    """Frames a second that the camera can make, or None."""
    low, high = max(modes.rates_hz[0], 0.1), min(modes.rates_hz[1], 10_000.0)
    present = min(max(modes.rate_hz if math.isfinite(modes.rate_hz) else 20.0, low), high)
    text = f"Frames a second, from {low:.4g} to {high:.4g}:"
    box = NumberBox()
    box.setRange(low, high)
    box.setValue(present)
    return ask_number(parent, "Frame rate", text, box)


def ask_sure(parent: QWidget, title: str, question: str) -> bool:
    """Whether the answer is yes. The question is shown as it is written, whatever the names in it look like."""
    yes, no = QMessageBox.StandardButton.Yes, QMessageBox.StandardButton.No
    box = QMessageBox(QMessageBox.Icon.Question, title, question, yes | no, parent)
    box.setTextFormat(Qt.TextFormat.PlainText)
    box.setDefaultButton(no)
    answer = box.exec()
    box.deleteLater()
    return answer == yes


def ask_to_end(parent: QWidget, hold: Hold, doing: str) -> bool:
    """Whether the work that holds something may be ended, which is done then. `doing` begins the sentence."""
    box = QMessageBox(QMessageBox.Icon.Question, "Slopegate", f"{doing} ends {hold.by}.", parent=parent)
    box.setTextFormat(Qt.TextFormat.PlainText)
    box.setInformativeText(hold.fate)
    end = box.addButton("End it", QMessageBox.ButtonRole.AcceptRole)
    leave = box.addButton("Let it go on", QMessageBox.ButtonRole.RejectRole)
    box.setDefaultButton(leave)
    box.setEscapeButton(leave)
    box.exec()
    wanted = box.clickedButton() is end
    box.deleteLater()
    if wanted:
        hold.stop()
    return wanted


def snapshot_folder(last: str) -> Path:
    """Where snapshots go: where the last one went, or the folder for pictures."""
    return Path(last or QStandardPaths.writableLocation(QStandardPaths.StandardLocation.PicturesLocation))


def ask_snapshot_file(parent: QWidget, scene: Scene, folder: Path) -> Path | None:
    """Where to write the frame on show, with a suffix, or None; asked from this folder on."""
    start = folder / suggested_name(scene, datetime.now())
    kinds = "16-bit TIFF (*.tif *.tiff);;16-bit PNG (*.png)"
    name, kind = QFileDialog.getSaveFileName(parent, "Save the frame on show", str(start), kinds)
    path = Path(name)
    return (path if path.suffix else path.with_suffix(".png" if "*.png" in kind else ".tif")) if name else None
