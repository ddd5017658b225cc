"""Parts of the 3D picture: labels, the translucent slab, solid objects, lines and colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyqtgraph.opengl as gl
from numpy.typing import ArrayLike
from OpenGL import GL
from PySide6.QtCore import QRect, QRectF, Qt
from PySide6.QtGui import QColor, QMatrix4x4, QPainter, QVector4D

from slopegate.app.views.slab_geometry import to_plot
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.scene.scene import Mesh, Sphere

_GAP_PX = 4
"""Between a point and its label."""
_RIM = [(2.5 * math.cos(angle), 2.5 * math.sin(angle)) for angle in np.arange(16) * math.pi / 8]
"""Where a label is written in the colour of the background first, in pixels from its place."""
_SUN = np.array([0.3, -0.6, 0.74])
"""Direction of the light that shades solid objects."""


@dataclass(frozen=True, eq=False)
class Label:
    """Text at a point (3,) of the plot; its corner moved by `right` widths and `down` heights from the point."""

    where: Doubles
    text: str
    colour: str
    right: float = 0.0
    down: float = -0.5


def write_labels(painter: QPainter, matrix: QMatrix4x4, view: QRect, labels: Sequence[Label], paper: str) -> None:
    """Write them where `matrix` (plot axes to clip space) puts them; one that would lie on an earlier one is left out.

    Labels at a side of the view are moved in; what lies behind the viewer is left out. `paper`: the colour of a rim
    about the letters, so that no line crosses them.
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
            _write(painter, box, label, paper)


def _write(painter: QPainter, box: QRectF, label: Label, paper: str) -> None:
    # not by a field behind, which would hide more of the picture than the letters need
    painter.setPen(QColor(paper))
    for right, down in _RIM:
        painter.drawText(box.translated(right, down), Qt.AlignmentFlag.AlignCenter, label.text)
    painter.setPen(QColor(label.colour))
    painter.drawText(box, Qt.AlignmentFlag.AlignCenter, label.text)


class Translucent(gl.GLMeshItem):  # type: ignore[misc]
    """A translucent mesh that hides nothing: it is tested against the depth of what was drawn but leaves none."""

    def paint(self) -> None:
        """Draw without writing depth."""
        GL.glDepthMask(GL.GL_FALSE)
        try:
            super().paint()
        finally:
            GL.glDepthMask(GL.GL_TRUE)


def solid(thing: Mesh | Sphere) -> Any:
    """An object as it rests, in its albedo, faces shaded by how they lie."""
    if isinstance(thing, Mesh):
        data = gl.MeshData(vertexes=to_plot(thing.vertices), faces=thing.faces)
    else:
        data = gl.MeshData.sphere(12, 24, thing.radius_m)
        data.setVertexes(data.vertexes() + to_plot(thing.centre_m))
    normals = data.faceNormals()
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    shade = 0.35 + 0.65 * np.abs(normals @ _SUN / lengths)[:, None]
    data.setFaceColors(opaque(shade * np.power(np.array(thing.albedo), 1 / 2.2)))
    return gl.GLMeshItem(meshdata=data, smooth=False, computeNormals=False, glOptions="opaque")


def set_lines(item: Any, ends: Doubles, colour: Any, width: float) -> None:
    """Show lines between pairs of points (N, 3), one colour or one a point."""
    item.setData(pos=ends, color=colour, width=width)
    item.setVisible(len(ends) > 0)


def rgba(colour: str) -> tuple[float, float, float, float]:
    """#rrggbb as four numbers 0..1."""
    tone = QColor(colour)
    return tone.redF(), tone.greenF(), tone.blueF(), tone.alphaF()


def opaque(colours: ArrayLike) -> Singles:
    """Colours (N, 3) with an opacity of one, (N, 4)."""
    tones = np.asarray(colours, np.float32)
    return np.concatenate([tones, np.ones((len(tones), 1), np.float32)], axis=1)
