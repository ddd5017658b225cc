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


def tiles() -> NDArray[np.uint8]:
    """Glazed tiles, 16 x 12 of them, in a few blues and whites."""
    colours = np.array([(236, 234, 230), (222, 214, 200), (190, 150, 96), (150, 96, 48)], np.uint8)
    chosen = np.random.default_rng(4).choice(4, (12, 16), p=[0.5, 0.25, 0.15, 0.1])
    picture = np.full((12 * 24, 16 * 24, 3), 120, np.uint8)
    for row, column in np.ndindex(chosen.shape):
        picture[row * 24 + 1 : row * 24 + 23, column * 24 + 1 : column * 24 + 23] = colours[chosen[row, column]]
    return picture


def turned(mesh: MeshText, profile: Points, segments: int) -> None:
    """A surface of revolution about y: profile (P, 2) of radius and height, from one end on the axis to the other."""
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    between = profile[1:-1]
    points = [(0.0, float(profile[0, 1]), 0.0)]
    points += [(r * x, y, r * z) for r, y in between for x, z in ring]
    points.append((0.0, float(profile[-1, 1]), 0.0))
    last = len(points) - 1
    faces: list[tuple[int, ...]] = []
    for k in range(segments):
        after = (k + 1) % segments
        faces.append((0, 1 + after, 1 + k))
        for p in range(len(between) - 1):
            low, high = 1 + p * segments, 1 + (p + 1) * segments
            faces.append((low + k, low + after, high + after, high + k))
        faces.append((last, last - segments + k, last - segments + after))
    mesh.add(np.array(points), faces)


BOTTLE: Final = ((0.030, 0.000), (0.038, 0.004), (0.040, 0.012), (0.040, 0.130), (0.037, 0.155), (0.028, 0.178),
                 (0.018, 0.194), (0.0145, 0.210), (0.0145, 0.262), (0.0165, 0.264), (0.0165, 0.280))  # fmt: skip
"""Radius and height of a bottle's outside, from its foot to its mouth."""
BOTTLE_WALL_M: Final = 0.0035


def bottle() -> str:
    """A hollow bottle with a closed mouth (no way for light to slip in), 28 cm high, standing at the origin."""
    outside = np.array([(0.0, 0.0), *BOTTLE, (0.0, 0.280)])
    inside = np.maximum(np.array([(0.0, BOTTLE_WALL_M), *BOTTLE, (0.0, 0.276)]) - (BOTTLE_WALL_M, 0.0), 0.0)
    inside[:, 1] = np.clip(inside[:, 1], BOTTLE_WALL_M, 0.276)
    inside[1, 1], inside[2, 1] = BOTTLE_WALL_M, 0.006
    mesh = MeshText("A hollow bottle")
    for profile in (outside, inside):
        turned(mesh, profile, 64)
    return mesh.text()


def pepper() -> str:
    """A bell pepper, about 8 cm across, standing at the origin."""
    rings, segments = 22, 44
    up = np.linspace(0, np.pi, rings)[:, None]
    round_ = (2 * np.pi * np.arange(segments) / segments)[None]
    lobes = 1 - 0.09 * np.abs(np.sin(2 * round_)) ** 0.6 * np.sin(up) ** 0.5 - 0.03 * np.cos(3 * round_ + 1)
    radius = 0.040 * lobes * np.sin(up) ** 0.55 * (1 + 0.16 * np.cos(up))
    dent = 0.016 * np.exp(-((up / 0.55) ** 2)) - 0.008 * np.exp(-(((np.pi - up) / 0.5) ** 2))
    height = 0.042 + 0.042 * np.cos(up) - dent + 0 * round_
    points = np.stack([radius * np.sin(round_), height, radius * np.cos(round_)], axis=-1)
    faces = [
        (
            r * segments + k,
            r * segments + (k + 1) % segments,
            (r + 1) * segments + (k + 1) % segments,
            (r + 1) * segments + k,
        )
        for r in range(rings - 1)
        for k in range(segments)
    ]
    mesh = MeshText("A bell pepper")
    mesh.add(points.reshape(-1, 3) - (0, float(points[..., 1].min()), 0), faces)
    return mesh.text()


def stem() -> str:
    """The stem of a bell pepper that stands at the origin."""
    profile = np.array(
        [(0, 0.062), (0.012, 0.064), (0.011, 0.070), (0.006, 0.074), (0.0055, 0.092), (0.007, 0.095), (0, 0.095)]
    )
    mesh = MeshText("The stem of a bell pepper")
    turned(mesh, profile, 10)
    return mesh.text()


CAPSULE: Final = ((0.0, 0.2846), (0.0186, 0.2846), (0.0186, 0.2636), (0.0169, 0.2620), (0.0169, 0.2105),
                  (0.0194, 0.1925), (0.0200, 0.1925), (0.0175, 0.2105), (0.0175, 0.2620), (0.0192, 0.2636),
                  (0.0192, 0.2852), (0.0, 0.2852))  # fmt: skip
"""Radius and height of the foil about a bottle's neck, its inside first: it nowhere touches the glass."""


def capsule() -> str:
    """The foil over the neck of a bottle that stands at the origin."""
    mesh = MeshText("The foil over the neck of a bottle")
    turned(mesh, np.array(CAPSULE), 48)
    return mesh.text()


def label() -> str:
    """A paper round the front of a bottle that stands at the origin, a millimetre before its glass."""
    angle = np.linspace(-1.1, 1.1, 33)
    flat = np.stack([np.sin(angle), np.cos(angle)], axis=1) * (BOTTLE[3][0] + 0.001)
    points = [(x, y, z) for y in (0.035, 0.115) for x, z in flat]
    mesh = MeshText("The label of a bottle")
    faces = [(k, k + 1, k + 34, k + 33) for k in range(32)]
    mesh.add(np.array(points), faces)
    return mesh.text()


def tuft() -> str:
    """A tuft of grass that stands at the origin, 18 cm high: most of its blades are thinner than a pixel."""
    mesh, random = MeshText("A tuft of grass"), np.random.default_rng(18)
    along = np.linspace(0, 1, 8)
    for _ in range(110):
        turn, lean, height = random.uniform(0, 2 * np.pi), random.uniform(0.02, 0.75), random.uniform(0.10, 0.18)
        foot = random.normal(0, 0.007, 2)
        away = 0.5 * height * lean * along**2
        spine = np.stack([foot[0] + away * np.cos(turn), height * along, foot[1] + 0.5 * away * np.sin(turn)], axis=1)
        half = random.uniform(0.00008, 0.0004) * (1 - 0.7 * along)
        side = half[:, None] * (1.0, 0.0, 0.0)
        points = np.stack([spine - side, spine + side], axis=1).reshape(-1, 3)
        mesh.add(points, [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(7)])
    return mesh.text()


LOGO_PX: Final = (1280, 720)
"""Width and height: those of the usual rig's projector, for `relight` projects it."""


def logo() -> NDArray[np.uint8]:
    """The picture that is projected onto a wall: a slope between two rules, and the name."""
    width, height = LOGO_PX
    picture = np.zeros((height, width, 3), np.uint8)
    for y in (150, 560):
        cv2.rectangle(picture, (340, y), (940, y + 7), WHITE, -1)
    cv2.fillPoly(picture, [np.array([(420, 400), (860, 400), (860, 200)], np.int32)], WHITE, cv2.LINE_AA)
    for k in range(1, 8):
        cv2.line(picture, (420 + 55 * k, 400), (420 + 55 * k, 400 - 25 * k), (0, 0, 0), 2, cv2.LINE_AA)
    size, _ = cv2.getTextSize("SLOPEGATE", cv2.FONT_HERSHEY_SIMPLEX, 3, 10)
    cv2.putText(picture, "SLOPEGATE", (640 - size[0] // 2, 515), cv2.FONT_HERSHEY_SIMPLEX, 3, WHITE, 10, cv2.LINE_AA)
    return picture


PICTURES: Final[dict[str, Callable[[], NDArray[np.uint8]]]] = {
    "road.png": road,
    "stop_sign.png": stop_sign,
    "tiles.png": tiles,
    "logo.png": logo,
}
MESHES: Final[dict[str, Callable[[], str]]] = {
    "octagon.obj": octagon,
    "car.obj": car,
    "car_trim.obj": car_trim,
    "bottle.obj": bottle,
    "pepper.obj": pepper,
    "pepper_stem.obj": stem,
    "bottle_capsule.obj": capsule,
    "bottle_label.obj": label,
    "tuft.obj": tuft,
}

if __name__ == "__main__":
    for name, draw in PICTURES.items():
        cv2.imwrite(str(SCENES / name), draw(), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    for name, write in MESHES.items():
        (SCENES / name).write_text(write(), encoding="utf-8")
