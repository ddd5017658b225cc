"""The pieces that the 3D picture is made of."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph.opengl as gl
from numpy.typing import ArrayLike, NDArray
from OpenGL import GL
from PySide6.QtGui import QColor
from slopegate.app.views.slab_geometry import to_plot
from slopegate.core.rig.rig import Floats
from slopegate.core.scene.scene import Mesh, Sphere

_SUN = np.array([0.3, -0.6, 0.74])


class Glass(gl.GLMeshItem):  # type: ignore[misc]
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


def set_lines(item: Any, ends: Floats, colour: Any, width: float) -> None:
    """Show lines between pairs of points (N, 3), one colour or one a point."""
    item.setData(pos=ends, color=colour, width=width)
    item.setVisible(len(ends) > 0)


def rgba(colour: str) -> tuple[float, float, float, float]:
    """#rrggbb as four numbers 0..1."""
    tone = QColor(colour)
    return tone.redF(), tone.greenF(), tone.blueF(), tone.alphaF()


def opaque(colours: ArrayLike) -> NDArray[np.float32]:
    """Colours (N, 3) with an opacity of one, (N, 4)."""
    tones = np.asarray(colours, np.float32)
    return np.concatenate([tones, np.ones((len(tones), 1), np.float32)], axis=1)
