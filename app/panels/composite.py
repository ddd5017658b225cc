"""Panel that puts the foreground of acquired light transport before a new background."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QWidget,
)

from slopegate.app.panels.loaded_transport import LoadedTransport
from slopegate.app.panels.panel import Desk
from slopegate.app.panels.transport_view import TransportView, grid_of_views
from slopegate.app.session.loading import WRITTEN_S, Loader, Newest
from slopegate.app.transports import OpenTransport
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.light_pictures import shown_picture
from slopegate.app.widgets.picture_view import PictureView
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.drivers.files.images import VIEWER_SUFFIX, save_image, shares8
from slopegate.drivers.files.picture_files import COLOUR_SUFFIXES, read_colour

VIEW_PX = 800
BEFORE, MATTE = "Before", "Matte"
HINT = "Tick the slices that hold the foreground, and choose a background."


@dataclass(frozen=True, eq=False)
class Composed:
    """Before, between and after, of the camera's size."""

    before: Bytes
    """All slices in white, to look at: (H, W) or (H, W, 3)."""
    matte: Singles
    """Share of the foreground (H, W), 0..1."""
    after: Singles
    """The foreground before the new background (H, W, 3), linear, in the unit of the slices."""
    shown: Bytes
    """The same to look at."""


def composed(opened: OpenTransport, foreground: tuple[int, ...], background: Singles | None, relit: bool) -> Composed:
    """Cut the foreground out and put it before a picture (h, w, 3), linear 0..1; None: black.

    relit: its slices are lit with the picture's colours. Raises InputError for a black picture to light with, and where
    all slices are the foreground.
    """
    black = np.zeros((*opened.shape, 3), np.float32)
    lit = relit and background is not None
    made = opened.composite(foreground, black if background is None else background, relit=lit)
    return Composed(opened.viewer_ready(opened.relight()), made.matte, made.image, opened.viewer_ready(made.image))


class CompositePanel(TransportView):
    """Which slices are the foreground, the background, and the picture before and after; saves picture and matte."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._shown: LoadedTransport | None = None
        self._background: Singles | None = None
        self.result: Composed | None = None
        """What is shown; None before any foreground was chosen."""
        self._worker: Newest[Composed] = Newest(self)
        self._reader: Loader[tuple[str, Singles]] = Loader(lambda _: None, self)
        self._saver: Loader[Path] = Loader(lambda _: None, self)
        self._make_widgets()
        self._arrange()
        self._connect()
        self.show_transport()

    @property
    def busy(self) -> bool:
        """Whether anything is being read, worked out or saved."""
        return self._worker.busy or self._reader.busy or self._saver.busy

    def _make_widgets(self) -> None:
        self.mode = ChoiceBox()
        self.mode.addItems([BEFORE, MATTE])
        self.mode.setAccessibleName("What to show beside the result")
        self.mode.setToolTip("The scene as it was, or how much of each pixel the foreground covers")
        self.before = PictureView("The scene before, or the matte")
        self.after = PictureView("The foreground before the new background")
        self.rows = QListWidget()
        self.rows.setAccessibleName("Slices of the foreground")
        self.rows.setToolTip("Ticked slices are the foreground, the others what is behind it")
        self.rows.setMinimumHeight(72)
        self.background = QPushButton("Background \u2026")
        self.background.setToolTip("A picture, cut and scaled to the camera's image")
        self.relit = QCheckBox("Lit by the background")
        self.relit.setToolTip("Light the foreground with the background's colours, by its own light transport")
        self.save, self.save_matte = QPushButton("Save picture \u2026"), QPushButton("Save matte \u2026")
        self.save.setToolTip("A picture to look at (.png), or linear light (.exr, .npy)")
        self.save_matte.setToolTip("The share of the foreground: .png up to 255, or .exr and .npy up to 1")
        self.text = Sentence(HINT)

    def _arrange(self) -> None:
        grid = grid_of_views(self.body, [(self.mode, self.before), (QLabel("After"), self.after)])
        grid.addWidget(self.text, 2, 0, 1, 2)
        grid.addWidget(self.rows, 3, 0, 1, 2)
        buttons: list[QWidget] = [self.background, self.relit, self.save, self.save_matte]
        grid.addLayout(FlowLayout(buttons), 4, 0, 1, 2)
        grid.setRowStretch(3, 1)

    def _connect(self) -> None:
        self._worker.finished.connect(self._on_composed)
        self._reader.finished.connect(self._on_read)
        self._saver.finished.connect(self._on_saved)
        self._worker.failed.connect(self._on_failed)
        for worker in (self._reader, self._saver):
            worker.failed.connect(self.text.setText)
        self.rows.itemChanged.connect(self._compose)
        self.relit.toggled.connect(self._compose)
        self.mode.activated.connect(self._show)
        self.background.clicked.connect(self._ask_background)
        self.save.clicked.connect(lambda: self._ask_save(False))
        self.save_matte.clicked.connect(lambda: self._ask_save(True))

    @property
    def foreground(self) -> tuple[int, ...]:
        """The places of the slices that are ticked."""
        ticked = Qt.CheckState.Checked
        return tuple(place for place in range(self.rows.count()) if self.rows.item(place).checkState() == ticked)

    def begin(self, loaded: LoadedTransport) -> None:
        """Show this transport, unless it is shown already."""
        if loaded is self._shown:
            return
        self._worker.cancel()
        self._shown, self.result = loaded, None
        with QSignalBlocker(self.rows):
            self.rows.clear()
            for name in loaded.names:
                item = QListWidgetItem(name)
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsUserCheckable)
                item.setCheckState(Qt.CheckState.Unchecked)
                self.rows.addItem(item)
        self._show()

    def _compose(self) -> None:
        loaded, places, background, relit = self._shown, self.foreground, self._background, self.relit.isChecked()
        if loaded is None:
            return
        opened = loaded.opened
        if not places:
            self._worker.cancel()
            self.result = None
            self._show()
            return
        self._worker.want(lambda _: composed(opened, places, background, relit))

    def _on_composed(self, result: Composed) -> None:
        self.result = result
        self._show()

    def _on_failed(self, sentence: str) -> None:
        self.result = None
        self._show()
        self.text.setText(sentence)

    def _show(self) -> None:
        result = self.result
        self.save.setEnabled(result is not None)
        self.save_matte.setEnabled(result is not None)
        if result is None:
            self.before.show_picture(None)
            self.after.show_picture(None)
            self.text.setText(HINT)
            return
        height, width = result.matte.shape
        if self.mode.currentText() == MATTE:
            left = shown_picture(shares8(result.matte), VIEW_PX)
        else:
            left = shown_picture(result.before, VIEW_PX)
        self.before.show_picture(left, (width, height))
        self.after.show_picture(shown_picture(result.shown, VIEW_PX), (width, height))
        self.text.setText(f"The foreground covers {result.matte.mean():.1%} of the image.")

    def _ask_background(self) -> None:
        kinds = " ".join(f"*{suffix}" for suffix in sorted(COLOUR_SUFFIXES))
        name, _ = QFileDialog.getOpenFileName(self, "Background", "", f"Pictures ({kinds})")
        if name:
            path = Path(name)
            self._reader.start(lambda _: (path.name, read_colour(path)))

    def _on_read(self, found: tuple[str, Singles]) -> None:
        name, self._background = found
        self.background.setToolTip(f"{name}: choose another picture")
        self._compose()

    def _ask_save(self, matte: bool) -> None:
        result = self.result
        kind = "Matte" if matte else "Picture"
        name, _ = QFileDialog.getSaveFileName(self, kind, "", "Images (*.png *.exr *.npy)")
        if name and result is not None:
            path = Path(name)
            self._saver.start(lambda _: save_composed(path, result, matte))

    def _on_saved(self, path: Path) -> None:
        self.text.setText(f"Saved {path}")

    def closeEvent(self, event: QCloseEvent) -> None:
        self._worker.close()
        self._reader.close()
        self._saver.close(WRITTEN_S)
        event.accept()


def save_composed(path: Path, result: Composed, matte: bool) -> Path:
    """Write the result, or its matte: .png to look at, other kinds linear. Raises StorageError or InputError."""
    to_look_at = path.suffix.lower() == VIEWER_SUFFIX
    if matte:
        save_image(path, shares8(result.matte) if to_look_at else result.matte, {})
    else:
        save_image(path, result.shown if to_look_at else result.after, {})
    return path
