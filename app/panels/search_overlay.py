"""A search on the live image: its target, and which keypoints the last frame showed."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import Overlay
from slopegate.core.search.keypoints import Bools, Keypoints, Rectangle

SEEN, LOST, TARGET = QColor("#39d353"), QColor("#ff6b6b"), QColor("#ffd400")
_RADIUS_PX = 3.0


class SearchLayer(Overlay):
    """Circles for keypoints that are seen, crosses for those that are lost; the mouse goes through."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._target: Rectangle | None = None
        self._places: list[tuple[float, float, bool]] = []

    @property
    def counts(self) -> tuple[int, int]:
        """Keypoints drawn as seen and as lost."""
        seen = sum(place[2] for place in self._places)
        return seen, len(self._places) - seen

    def show_target(self, target: Rectangle | None) -> None:
        """Outline this rectangle of the image; None for the whole image."""
        self._target = target
        self.update()

    def show_keypoints(self, points: Keypoints | None, seen: Bools | None) -> None:
        """Draw these (K) with what the last frame showed; None draws none."""
        self._places = []
        if points is not None:
            shown = seen if seen is not None and len(seen) == len(points) else [False] * len(points)
            self._places = [
                (float(column), float(row), bool(one))
                for column, row, one in zip(points.columns, points.rows, shown, strict=True)
            ]
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        if self.viewport() is None:
            return
        painter = QPainter(self)
        if self._target is not None:
            x0, y0, x1, y1 = self._target
            painter.setPen(QPen(TARGET, 1.5, Qt.PenStyle.DashLine))
            painter.drawRect(QRectF(self.to_view(x0, y0), self.to_view(x1, y1)))
        painter.setPen(QPen(LOST, 1.2))
        for column, row, seen in self._places:
            if not seen:
                self._cross(painter, self.to_view(column, row))
        painter.setPen(QPen(SEEN, 1.2))
        for column, row, seen in self._places:
            if seen:
                painter.drawEllipse(self.to_view(column, row), _RADIUS_PX, _RADIUS_PX)

    def _cross(self, painter: QPainter, at: QPointF) -> None:
        reach = 0.7 * _RADIUS_PX
        painter.drawLine(at + QPointF(-reach, -reach), at + QPointF(reach, reach))
        painter.drawLine(at + QPointF(-reach, reach), at + QPointF(reach, -reach))
