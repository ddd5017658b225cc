"""What this program is, and where it keeps things."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, metadata, version
from pathlib import Path

import platformdirs
from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices, QGuiApplication
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QGridLayout, QLabel, QVBoxLayout, QWidget

from slopegate.app.session.log import log_path

_LIBRARIES = (
    "PySide6-Essentials",
    "numpy",
    "numba",
    "opencv-contrib-python-headless",
    "pyqtgraph",
    "embreex",
    "OpenEXR",
    "tifffile",
    "zarr",
    "pydantic",
    "mapbox-earcut",
)


def folders(settings: Path) -> dict[str, Path]:
    """Where the program keeps what, by name."""
    cache = platformdirs.user_cache_path("slopegate", appauthor=False)
    return {"Settings": settings, "Cache": cache, "Log": log_path().parent}


def libraries() -> list[str]:
    """The libraries at work with their versions."""
    found = [f"Python {platform.python_version()}"]
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:  # some machines do without
            continue
    return found


class AboutDialog(QDialog):
    """Version, licence, folders and libraries, to read and to copy."""

    def __init__(self, settings: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("About Slopegate")
        facts = metadata("slopegate")
        self.lines = [
            ("Slopegate", version("slopegate")),
            ("What it is", facts["Summary"] or ""),
            ("Licence", facts["License-Expression"] or facts["License"] or ""),
            *((name, str(path)) for name, path in folders(settings).items()),
            ("Libraries", ", ".join(libraries())),
            ("System", platform.platform()),
        ]
        grid = QGridLayout()
        for row, (name, text) in enumerate(self.lines):
            value = QLabel(text)
            value.setTextFormat(Qt.TextFormat.PlainText)
            value.setWordWrap(True)
            value.setTextInteractionFlags(
                Qt.TextInteractionFlag.TextSelectableByMouse | Qt.TextInteractionFlag.TextSelectableByKeyboard
            )
            value.setAccessibleName(name)
            grid.addWidget(QLabel(name), row, 0, Qt.AlignmentFlag.AlignTop)
            grid.addWidget(value, row, 1)
        grid.setColumnStretch(1, 1)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.rejected.connect(self.reject)
        copy = buttons.addButton("&Copy", QDialogButtonBox.ButtonRole.ActionRole)
        copy.setToolTip("Copy all of it, to send with a question")
        copy.clicked.connect(self.copy)
        for name, path in folders(settings).items():
            button = buttons.addButton(f"{name} ...", QDialogButtonBox.ButtonRole.ActionRole)
            button.setToolTip(f"Show {path}")
            button.clicked.connect(lambda _=False, path=path: open_folder(path))
        column = QVBoxLayout(self)
        column.addLayout(grid)
        column.addWidget(buttons)
        self.resize(640, self.sizeHint().height())

    @classmethod
    def show_of(cls, parent: QWidget, settings: Path) -> None:
        """Open it beside the window, or bring it to the front."""
        dialog = parent.findChild(cls) or cls(settings, parent)
        dialog.show()
        dialog.raise_()

    def copy(self) -> None:
        """Put all of it on the clipboard."""
        QGuiApplication.clipboard().setText("\n".join(f"{name}: {text}" for name, text in self.lines))


def open_folder(path: Path) -> None:
    """Show a folder in the file manager; the nearest one above it where it has not been made yet."""
    folder = next(folder for folder in (path, *path.parents) if folder.is_dir())
    QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))
