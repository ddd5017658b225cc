"""Bars of the parts of light: what a gate keeps, and below it, from where that ends, what it refuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QBrush, QColor, QIcon, QPainter, QPaintEvent, QPen, QPixmap
from PySide6.QtWidgets import QSizePolicy, QWidget

from slopegate.app.widgets.theme import colours

_BAR_PX, _GAP_PX = 18, 4


@dataclass(frozen=True)
class Look:
    """How one part is drawn: by colour and by pattern, so that either is enough to tell it."""

    name: str
    colour: str
    pattern: Qt.BrushStyle


@dataclass(frozen=True)
class BarPair:
    """One pair of bars: amounts in one unit, by the key of a part."""

    title: str
    kept: Mapping[str, float]
    refused: Mapping[str, float]

    @property
    def whole(self) -> float:
        """Everything kept and refused together."""
        return sum(self.kept.values()) + sum(self.refused.values())


def fill_with(painter: QPainter, area: QRectF, look: Look, outline: QColor) -> None:
    """Draw one piece of a bar."""
    painter.fillRect(area, QColor(look.colour))
    if look.pattern != Qt.BrushStyle.SolidPattern:
        painter.fillRect(area, QBrush(QColor(0, 0, 0, 150), look.pattern))
    painter.setPen(QPen(outline, 1))
    painter.drawRect(area)


def swatch_icon(look: Look, outline: QColor) -> QIcon:
    """The part's colour and pattern, for a legend."""
    picture = QPixmap(44, 28)
    picture.setDevicePixelRatio(2.0)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    fill_with(painter, QRectF(0.5, 0.5, 20.5, 12.5), look, outline)
    painter.end()
    return QIcon(picture)


class LightBars(QWidget):
    """Two bars for each place: kept and refused, each the sum of its parts; the second begins where the first ends."""

    def __init__(self, looks: Mapping[str, Look], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._looks = looks
        self._pairs: tuple[BarPair, ...] = ()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setAccessibleName("Light kept and refused")

    @property
    def pairs(self) -> tuple[BarPair, ...]:
        """What is shown."""
        return self._pairs

    def show_pairs(self, pairs: Sequence[BarPair]) -> None:
        """Show these places, one below the other."""
        self._pairs = tuple(pairs)
        self.setAccessibleDescription("; ".join(self._spoken(pair) for pair in pairs))
        self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(260, max(len(self._pairs), 2) * self._pair_px())

    def minimumSizeHint(self) -> QSize:
        return QSize(200, self.sizeHint().height())

    def pieces(self) -> list[tuple[int, str, str, QRectF]]:
        """Pair, kept or refused, part, and where it is drawn: everything that is longer than nothing."""
        metrics = self.fontMetrics()
        left = metrics.horizontalAdvance("refused") + 8.0
        right = metrics.horizontalAdvance("100.0 %") + 8.0
        room = max(self.width() - left - right - 1, 1.0)
        found = []
        for index, pair in enumerate(self._pairs):
            whole = pair.whole
            top, x = index * self._pair_px() + metrics.height() + _GAP_PX, left
            for line, amounts in enumerate((pair.kept, pair.refused)):
                for key in self._looks:
                    width = room * amounts.get(key, 0.0) / whole if whole > 0 else 0.0
                    if width > 0:
                        area = QRectF(x, top + line * (_BAR_PX + _GAP_PX), width, _BAR_PX)
                        found.append((index, ("kept", "refused")[line], key, area))
                    x += width
        return found

    def paintEvent(self, event: QPaintEvent) -> None:
        painter, scheme = QPainter(self), colours(self.palette())
        metrics, middle = self.fontMetrics(), Qt.AlignmentFlag.AlignVCenter
        text = QColor(scheme.text)
        for index, pair in enumerate(self._pairs):
            top = index * self._pair_px()
            painter.setPen(text)
            painter.drawText(0, top + metrics.ascent(), pair.title)
            for line, (name, amounts) in enumerate((("kept", pair.kept), ("refused", pair.refused))):
                y = top + metrics.height() + _GAP_PX + line * (_BAR_PX + _GAP_PX)
                row = QRectF(0, y, self.width() - 1, _BAR_PX)
                painter.drawText(row, middle | Qt.AlignmentFlag.AlignLeft, name)
                share = sum(amounts.values()) / pair.whole if pair.whole > 0 else 0.0
                painter.drawText(row, middle | Qt.AlignmentFlag.AlignRight, f"{100 * share:.1f} %")
        for _, _, key, area in self.pieces():
            fill_with(painter, area, self._looks[key], text)

    def _pair_px(self) -> int:
        return self.fontMetrics().height() + 2 * _BAR_PX + 4 * _GAP_PX

    def _spoken(self, pair: BarPair) -> str:
        whole = pair.whole or 1.0
        said = []
        for word, amounts in (("kept", pair.kept), ("refused", pair.refused)):
            parts = (
                f"{self._looks[key].name} {100 * amounts[key] / whole:.1f} %" for key in self._looks if key in amounts
            )
            said.append(f"{word} " + ", ".join(parts))
        return f"{pair.title}: " + ", ".join(said)
