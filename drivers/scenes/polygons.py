"""Cuts the polygons of mesh files into triangles that cover the same area, also where they are not convex."""

from __future__ import annotations

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices
from slopegate.drivers.files.errors import SceneError

MAX_CORNERS = 20_000
"""Of a polygon that is not convex: cutting it takes a time that grows as the square of its corners."""
MAX_WORK = 1e9
"""The sum of these squares over a file."""
_SAME_AREA = 1e-3
_FLAT = 0.1
"""How far from its plane a corner may lie, in shares of the polygon's size, before its triangles are called a guess."""


def cut(where: str, points: Doubles, corners: Indices, sizes: Indices) -> tuple[Indices, Indices, int]:
    """Triangles of polygons with at least 3 corners each.

    points (V, 3), corners (N,) their numbers, polygon by polygon, and sizes (P,) how many each polygon has. Returns
    triangles (T, 3) as places in `corners`, the polygon (T,) of each, and how many polygons cross themselves or are far
    from flat, so that what they cover is a guess. Raises SceneError, which begins with `where`, for polygons that take
    too long to cut.
    """
    starts = np.cumsum(sizes) - sizes
    order, owners, crossing, work = [], [], 0, 0
    for size in np.unique(sizes).tolist():
        owner = np.flatnonzero(sizes == size)
        places = starts[owner, None] + np.arange(size)
        rest = np.zeros(0, np.int64)
        if size == 3:
            fans = places[:, None, :]
        elif size == 4:
            fans, rest = _quads(points[corners[places]], places)
        else:
            fans, rest = _fans(points[corners[places]], places)
        whole = np.setdiff1d(np.arange(len(owner)), rest)
        order.append(fans.reshape(-1, 3))
        owners.append(np.repeat(owner[whole], size - 2))
        work += size * size * len(rest)
        if len(rest) and (size > MAX_CORNERS or work > MAX_WORK):
            raise SceneError(
                f"{where} has {len(rest)} polygons of {size} corners that are not convex: one may have at most "
                f"{MAX_CORNERS}, and many of them fewer"
            )
        for number in rest.tolist():
            triangles, crosses = _ears(points[corners[places[number]]])
            order.append(places[number][triangles])
            owners.append(np.full(len(triangles), owner[number]))
            crossing += crosses
    polygon = np.concatenate(owners)
    sorting = np.argsort(polygon, kind="stable")
    return np.concatenate(order)[sorting], polygon[sorting], crossing


def guessed(polygons: int) -> list[str]:
    """The remark, if any, about what `cut` counts."""
    if not polygons:
        return []
    return [f"{polygons} of its polygons cross themselves or are far from flat: what they cover is a guess"]


def _normals(a: Doubles, b: Doubles, c: Doubles) -> Doubles:
    with np.errstate(all="ignore"):
        return np.cross(b - a, c - a)


def _quads(shape: Doubles, places: Indices) -> tuple[Indices, Indices]:
    """Two triangles (Q, 2, 3) of each quad (P, 4, 3), cut along the diagonal within it, and the quads without one."""
    a, b, c, d = (shape[:, k] for k in range(4))
    with np.errstate(all="ignore"):
        inside = (_normals(a, b, c) * _normals(a, c, d)).sum(axis=1)
        other = (_normals(b, c, d) * _normals(b, d, a)).sum(axis=1)
    rest = np.flatnonzero((inside < 0) & (other < 0))
    whole = np.setdiff1d(np.arange(len(shape)), rest)
    first, second = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[1, 2, 3], [1, 3, 0]])
    turned = ((inside < 0) & (other > 0))[whole]
    chosen = np.where(turned[:, None, None], second, first)
    return places[whole[:, None, None], chosen], rest


def _fans(shape: Doubles, places: Indices) -> tuple[Indices, Indices]:
    """Fans (Q, n - 2, 3) around the first corner of polygons (P, n, 3), and the polygons that this would not cover."""
    count = shape.shape[1]
    normals = _normals(shape[:, :1], shape[:, 1:-1], shape[:, 2:])
    with np.errstate(all="ignore"):
        whole_normal = normals.sum(axis=1, keepdims=True)
        inside = (normals * whole_normal).sum(axis=2)
        flat = np.linalg.norm(whole_normal[:, 0], axis=1) < 1e-6 * np.linalg.norm(normals, axis=2).sum(axis=1)
    # What is not finite is refused later, with the vertex.
    rest = np.flatnonzero(((inside < 0).any(axis=1) | flat) & np.isfinite(inside).all(axis=1))
    whole = np.setdiff1d(np.arange(len(shape)), rest)
    fan = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    return places[whole][:, fan], rest


def _ears(shape: Doubles) -> tuple[Indices, bool]:
    """Triangles (T, 3) of one polygon (n, 3), seen along its normal, and whether they are a guess."""
    import mapbox_earcut

    normals = _normals(shape[:1], shape[1:-1], shape[2:])
    right, down = [(1, 2), (2, 0), (0, 1)][int(np.argmax(np.abs(normals).sum(axis=0)))]
    centred = shape - shape.mean(axis=0)
    size = max(float(np.abs(centred).max()), 1e-300)
    normal = normals.sum(axis=0)
    depth = np.abs(centred @ normal).max() / max(float(np.linalg.norm(normal)), 1e-300)
    # A quad comes here only if it crosses itself, and ears would leave one of its corners out.
    if depth > _FLAT * size or len(shape) == 4:
        return np.array([[0, k, k + 1] for k in range(1, len(shape) - 1)]), True
    flat = np.ascontiguousarray(centred[:, [right, down]]) / size
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32)).astype(np.int64).reshape(-1, 3)
    a, b, c = (flat[found[:, k]] for k in range(3))
    covered = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])).sum()
    following = np.roll(flat, -1, axis=0)
    area = abs(float((flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]).sum()))
    return found, abs(float(covered) - area) > _SAME_AREA * max(float(covered), area)
