"""Words in a 3D picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QRect, QRectF, Qt
from PySide6.QtGui import QColor, QMatrix4x4, QPainter, QVector4D
from slopegate.core.rig.rig import Floats

_GAP_PX = 4


@dataclass(frozen=True, eq=False)
class Label:
    """Text at a point (3,) of the plot; its corner moved by `right` widths and `down` heights from the point."""

    where: Floats
    text: str
    colour: str
    right: float = 0.0
    down: float = -0.5


def write_labels(painter: QPainter, matrix: QMatrix4x4, view: QRect, labels: Sequence[Label]) -> None:
    """Write them where `matrix` (plot axes to clip space) puts them; one that would lie on an earlier one is left out.

    Labels at a side of the view are moved in; what lies behind the viewer is left out.
    """
    painter.setRenderHint(QPainter.RenderHint.TextAntialiasing)
    taken: list[QRectF] = []
    for label in labels:
        x, y, z = (float(number) for number in label.where)
        at = matrix.map(QVector4D(x, y, z, 1.0))
        if at.w() <= 0:
            continue
        size = painter.fontMetrics().size(0, label.text)
        gap = _GAP_PX if label.right == 0 else 0
        left = (at.x() / at.w() + 1) / 2 * view.width() + label.right * size.width() + gap
        top = (1 - at.y() / at.w()) / 2 * view.height() + label.down * size.height()
        box = QRectF(left, top, size.width(), size.height())
        if not QRectF(view).intersects(box):
            continue
        box.moveLeft(min(max(box.left(), 0.0), view.width() - box.width()))
        if not any(box.intersects(other) for other in taken):
            taken.append(box)
            painter.setPen(QColor(label.colour))
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, label.text)
