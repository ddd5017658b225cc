"""Draws the pictures and meshes of shipped scenes that were made for this project. Run this file to write them anew.

Metres. In mesh files x is right, y up, z towards the rig, so that a thing's front is seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

SCENES: Final = Path(__file__).resolve().parents[2] / "resources" / "scenes"
NOTE: Final = "made for this project"

Polygon = Sequence[tuple[float, float]]
Points = NDArray[np.float64]

WHITE: Final = (235, 235, 235)
ARROW: Final = (
    (35, 235),
    (35, 95),
    (62, 60),
    (120, 60),
    (120, 88),
    (150, 42),
    (120, 0),
    (120, 26),
    (50, 26),
    (0, 80),
    (0, 235),
)
"""Turn right: millimetres on the road, to the right and towards the rig, within 150 x 235."""
ARROW_AT: Final = (75, 430)
"""Left and far end of the arrow, millimetres on the road."""
ROAD_MM: Final = (300, 1050)
"""Width and length of the road."""


def road() -> NDArray[np.uint8]:
    """The road, a pixel a millimetre, its far end on top: asphalt, lines at the sides, and the arrow."""
    width, length = ROAD_MM
    grain = np.random.default_rng(9).integers(-1, 2, (length // 6, width // 6, 1))
    grey = cv2.resize(
        np.repeat(grain, 3, axis=2).astype(np.int16) * 5 + 96, (width, length), interpolation=cv2.INTER_NEAREST
    )
    picture = np.ascontiguousarray(grey.astype(np.uint8))
    for left in (10, width - 20):
        cv2.rectangle(picture, (left, 0), (left + 9, length), WHITE, -1)
    cv2.fillPoly(picture, [np.array(ARROW, np.int32) + ARROW_AT], WHITE)
    return picture


def stop_sign() -> NDArray[np.uint8]:
    """The face of a stop sign, 256 x 256; its octagon touches the edges."""
    picture = np.full((256, 256, 3), 235, np.uint8)
    corner = 256 * (1 - np.tan(np.pi / 8)) / 2
    inner, outer = 12, 256 - 12
    near, far = corner + 5, 256 - corner - 5
    octagon = [
        (near, inner),
        (far, inner),
        (outer, near),
        (outer, far),
        (far, outer),
        (near, outer),
        (inner, far),
        (inner, near),
    ]
    cv2.fillPoly(picture, [np.rint(octagon).astype(np.int32)], (40, 36, 190), cv2.LINE_AA)
    size, _ = cv2.getTextSize("STOP", cv2.FONT_HERSHEY_SIMPLEX, 2.5, 16)
    place = (128 - size[0] // 2, 128 + size[1] // 2)
    cv2.putText(picture, "STOP", place, cv2.FONT_HERSHEY_SIMPLEX, 2.5, WHITE, 16, cv2.LINE_AA)
    return picture


class MeshText:
    """An OBJ file under way."""

    def __init__(self, what: str) -> None:
        self._lines, self._vertices = [f"# {what}, metres, y up; {NOTE}"], 0

    def add(self, points: Points, faces: Sequence[Sequence[int]], uv: Points | None = None) -> None:
        """Vertices (V, 3) and the polygons between them; uv (V, 2), v down."""
        self._lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in points]
        if uv is not None:
            self._lines += [f"vt {u:.4f} {1 - v:.4f}" for u, v in uv]
        for face in faces:
            corners = [str(k + 1 + self._vertices) for k in face]
            self._lines.append("f " + " ".join(corner if uv is None else f"{corner}/{corner}" for corner in corners))
        self._vertices += len(points)

    def text(self) -> str:
        """The file."""
        return "\n".join(self._lines) + "\n"


def octagon() -> str:
    """The plate of a stop sign, 1 m from side to side, about its centre, with the whole picture on it."""
    angle = np.pi / 8 + np.arange(8) * np.pi / 4
    flat = np.stack([np.cos(angle), np.sin(angle)], axis=1) / (2 * np.cos(np.pi / 8))
    mesh = MeshText("The plate of a stop sign")
    mesh.add(np.column_stack([flat, np.zeros(8)]), [range(8)], flat * (1, -1) + 0.5)
    return mesh.text()


def prism(mesh: MeshText, outline: Polygon, left: float, right: float) -> None:
    """A closed prism along x over an outline of (z, y) that its own middle sees all of."""
    middle = np.mean(outline, axis=0)
    ring = np.array([*outline, tuple(middle)])
    count = len(outline)
    points = np.concatenate([np.column_stack([np.full(count + 1, x), ring[:, 1], ring[:, 0]]) for x in (left, right)])
    faces: list[tuple[int, ...]] = []
    for k in range(count):
        after, other = (k + 1) % count, count + 1
        faces += [(k, after, count), (other + after, other + k, other + count), (k, other + k, other + after, after)]
    mesh.add(points, faces)


_ROOF: Final = ((0.046, 0.034), (0.024, 0.056), (-0.040, 0.056), (-0.060, 0.036))
CAR: Final = ((-0.080, 0.012), (0.080, 0.012), (0.082, 0.026), *_ROOF, (-0.080, 0.034))
SIDE_WINDOW: Final = ((0.036, 0.036), (0.019, 0.052), (-0.037, 0.052), (-0.050, 0.036))


def car() -> str:
    """The body of a toy car, 16 cm long, its bonnet towards the rig, standing at the origin."""
    mesh = MeshText("The body of a toy car")
    prism(mesh, CAR, -0.036, 0.036)
    return mesh.text()


def car_trim() -> str:
    """Wheels and windows of the toy car."""
    mesh = MeshText("Wheels and windows of a toy car")
    angle = np.arange(12) * np.pi / 6
    for z in (-0.048, 0.050):
        rim = [(z + 0.014 * np.sin(a), 0.014 + 0.014 * np.cos(a)) for a in angle]
        prism(mesh, rim, -0.039, -0.026)
        prism(mesh, rim, 0.026, 0.039)
    prism(mesh, SIDE_WINDOW, -0.0365, 0.0365)
    for (z0, y0), (z1, y1), out in ((CAR[3], CAR[4], 1), (CAR[6], CAR[5], -1)):
        across = np.array([y0 - y1, z1 - z0]) * out
        lift = 0.0008 * across / np.linalg.norm(across) * (-1)
        ends = [np.array([z0, y0]) + s * np.array([z1 - z0, y1 - y0]) + lift for s in (0.12, 0.88)]
        points = [(x, y, z) for (z, y), xs in zip(ends, ((-0.030, 0.030), (0.030, -0.030)), strict=True) for x in xs]
        mesh.add(np.array(points), [(0, 1, 2, 3)])
    return mesh.text()


PICTURES: Final[dict[str, Callable[[], NDArray[np.uint8]]]] = {"road.png": road, "stop_sign.png": stop_sign}
MESHES: Final[dict[str, Callable[[], str]]] = {"octagon.obj": octagon, "car.obj": car, "car_trim.obj": car_trim}

if __name__ == "__main__":
    for name, draw in PICTURES.items():
        cv2.imwrite(str(SCENES / name), draw(), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    for name, write in MESHES.items():
        (SCENES / name).write_text(write(), encoding="utf-8")
