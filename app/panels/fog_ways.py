"""Four small pictures of a scene in fog, side by side: everything lit, upright gate, this gate, epipolar."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np
from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QCheckBox, QGridLayout, QGroupBox, QLabel, QSizePolicy, QVBoxLayout, QWidget

from slopegate.app.session.loading import CancelledError, Newest, Progress
from slopegate.app.session.source import Source
from slopegate.app.widgets.paint import level_table
from slopegate.app.widgets.sentence import write_in_middle
from slopegate.app.widgets.theme import colours
from slopegate.core.light.four_ways import WAYS, FourViews, Way, four_views, picture
from slopegate.core.measure.quality import ncc
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.settings import GateSettings

TITLES: Final[Mapping[Way, tuple[str, str]]] = {
    "regular": ("Everything lit", "A whole projector period: what an ordinary camera sees"),
    "upright": ("Upright gate", "A gate of the same exposure and distance that stands upright"),
    "this": ("This gate", "The gate that is set now"),
    "epipolar": ("Epipolar", "The projector beside the camera, so that rows are epipolar: no distance is chosen"),
}
_WHITE_PERCENTILE = 99.5
_STEPS = 65535
_COMING = "Comes by itself: the scene is rendered for this picture."
_NOTE = "NCC: how like the same scene without fog, 1 is the same."
_REFINING = "Indirect light is still being traced, and grainy."


@dataclass(frozen=True, eq=False)
class WayPicture:
    """A picture, light (h, w), and its NCC with the fog-free one, None where that is blank."""

    light: Singles
    likeness: float | None

    @property
    def white(self) -> float:
        """The light that is shown as white where it stands alone."""
        return float(np.percentile(self.light, _WHITE_PERCENTILE)) or 1.0


Pictures = Mapping[Way, WayPicture | None]


@dataclass(frozen=True, eq=False)
class MadeWays:
    """The pictures of one gate, and what they were made from: a rig and scene, and their views."""

    key: object
    views: FourViews
    settings: GateSettings
    pictures: Pictures


def draw_ways(views: FourViews, settings: GateSettings) -> Pictures:
    """All four; None for one that the rig has not."""
    found = {way: picture(views, way, settings) for way in WAYS}
    return {way: None if got is None else _judged(*got) for way, got in found.items()}


def _judged(light: Singles, clear: Singles) -> WayPicture:
    return WayPicture(light, ncc(light, clear) if float(np.ptp(clear)) > 0 else None)


def grey_of(light: Singles, white: float) -> Bytes:
    """Light (h, w) as (h, w) uint8 through the sRGB curve."""
    table = level_table(0, _STEPS, srgb=True)
    return np.ascontiguousarray(table[np.clip(light * (_STEPS / white), 0, _STEPS).astype(np.uint16)])


def prepare(source: Source, known: FourViews | None, progress: Progress) -> FourViews:
    """The views of this source's scene; `known`: those before.

    Raises CancelledError, or InputError for a rig or scene without them.
    """
    try:
        return four_views(source.rig, source.scene, lambda share: progress.report(share, ""), known)
    except Cancelled:
        raise CancelledError from None


class SmallPicture(QWidget):
    """A grey picture, fitted."""

    def __init__(self) -> None:
        super().__init__()
        self._grey: Bytes | None = None
        self._empty = ""
        policy = QSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        policy.setHeightForWidth(True)
        self.setSizePolicy(policy)

    @property
    def grey(self) -> Bytes | None:
        """What is shown, (h, w) uint8."""
        return self._grey

    def show_grey(self, grey: Bytes | None, empty: str = "") -> None:
        """Show this; for None, what is to be said in its place."""
        self._grey, self._empty = grey, empty
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(200, 150)

    def minimumSizeHint(self) -> QSize:
        return QSize(100, 75)

    def heightForWidth(self, width: int) -> int:
        share = 0.75 if self._grey is None else self._grey.shape[0] / self._grey.shape[1]
        return round(width * share)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), colours(self.palette()).grid)
        if self._grey is None:
            write_in_middle(painter, self._empty, self.rect(), QColor(colours(self.palette()).text))
            return
        height, width = self._grey.shape
        image = QImage(self._grey.data, width, height, width, QImage.Format.Format_Grayscale8)
        scale = min(self.width() / width, self.height() / height)
        size = QSize(round(width * scale), round(height * scale))
        left, top = (self.width() - size.width()) // 2, (self.height() - size.height()) // 2
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(left, top, image.scaled(size, mode=Qt.TransformationMode.SmoothTransformation))


class WaysBox(QGroupBox):
    """The four pictures. They are made in a thread of its own, and follow scene, fog and gate."""

    shown = Signal()
    """The pictures of the gate that was asked for last are on show."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Four ways to look", parent)
        self._views: tuple[object, FourViews] | None = None
        self._made: Pictures = {}
        self._settings: GateSettings | None = None
        self._hurry = self._refining = False
        """Another gate waits, so that refining is to make way; pictures on show are being refined."""
        self._worker: Newest[MadeWays] = Newest(self)
        self._worker.finished.connect(self._on_made)
        self._worker.failed.connect(self._on_failed)
        self.pictures: dict[Way, SmallPicture] = {}
        self.captions: dict[Way, QLabel] = {}
        grid = QGridLayout()
        grid.setSpacing(4)
        for place, way in enumerate(WAYS):
            view, caption = SmallPicture(), QLabel(TITLES[way][0])
            caption.setWordWrap(True)
            caption.setAlignment(Qt.AlignmentFlag.AlignHCenter)
            for widget in (view, caption):
                widget.setToolTip(TITLES[way][1])
            view.setAccessibleName(TITLES[way][0])
            grid.addWidget(view, 2 * (place // 2), place % 2)
            grid.addWidget(caption, 2 * (place // 2) + 1, place % 2)
            view.show_grey(None, _COMING)
            self.pictures[way], self.captions[way] = view, caption
        self.each = QCheckBox("Brighten each by itself")
        self.each.setToolTip("Otherwise all four are on one scale of brightness")
        self.each.toggled.connect(self._draw)
        self.note = QLabel(_NOTE)
        self.note.setWordWrap(True)
        column = QVBoxLayout(self)
        column.addLayout(grid)
        column.addWidget(self.each)
        column.addWidget(self.note)

    @property
    def busy(self) -> bool:
        """Whether pictures are being made that have not been seen yet."""
        return self._worker.busy and not self._refining

    def want(self, source: Source, settings: GateSettings) -> None:
        """Show this source's scene by this gate, as soon as it is made."""
        key, self._settings = (source.rig, source.scene), settings
        self._hurry, self._refining = True, False

        def job(progress: Progress) -> MadeWays:
            self._hurry = False
            kept = self._views
            before = None if kept is None else kept[1]
            views = before if before and kept and kept[0] == key else prepare(source, before, progress)
            return MadeWays(key, views, settings, draw_ways(views, settings))

        self._worker.want(job)

    def hold(self) -> None:
        """Refine no more until other pictures are wanted, or until `release`."""
        self._hurry = True

    def release(self) -> None:
        """Go on refining."""
        self._hurry = False
        self.refine()

    def pause(self) -> None:
        """Make no pictures until some are wanted again."""
        self._worker.cancel()
        self._refining = False

    def forget(self) -> None:
        """Show nothing."""
        self.pause()
        self._views, self._made = None, {}
        for way, view in self.pictures.items():
            view.show_grey(None, _COMING)
            self.captions[way].setText(TITLES[way][0])

    def close_worker(self) -> None:
        """End what is under way."""
        self._worker.close()

    def _on_made(self, made: MadeWays) -> None:
        self._views, self._made = (made.key, made.views), made.pictures
        self._refining = False
        self._draw()
        self.refine()
        if made.settings == self._settings:
            self.shown.emit()

    def refine(self) -> None:
        """Go on with the indirect light of the pictures while they are looked at, unless something else is wanted."""
        kept, settings = self._views, self._settings
        going_on = kept is not None and not kept[1].refined
        self.note.setText(f"{_NOTE} {_REFINING}" if going_on else _NOTE)
        if not going_on or self._hurry or self._worker.busy or not self.isVisible():
            return

        def job(progress: Progress) -> MadeWays:
            assert kept is not None
            assert settings is not None
            with suppress(Cancelled):
                kept[1].refine(lambda share: progress.report(share, "") and not self._hurry)
            return MadeWays(*kept, settings, draw_ways(kept[1], settings))

        self._refining = True
        self._worker.want(job)

    def _draw(self) -> None:
        found = [got for got in self._made.values() if got is not None]
        for way, got in self._made.items():
            title = TITLES[way][0]
            if got is None:
                self.pictures[way].show_grey(None, "This rig has no such gate.")
                self.captions[way].setText(f"{title}: this rig has none")
                continue
            white = got.white if self.each.isChecked() else max(one.white for one in found)
            self.pictures[way].show_grey(grey_of(got.light, white))
            self.captions[way].setText(title if got.likeness is None else f"{title}: NCC {got.likeness:.3f}")

    def _on_failed(self, sentence: str) -> None:
        self.note.setText(sentence)
        for way, view in self.pictures.items():
            if self._made.get(way) is None:
                view.show_grey(None, "Not made: the reason is below.")
