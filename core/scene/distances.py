"""How far the surfaces of a scene are from a point, and whether any of them may be seen from it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Lens
from slopegate.core.scene.scene import Mesh, Sphere

_CHUNK: Final = 100_000
"""Triangles at a time."""


def nearest_m(objects: Sequence[Mesh | Sphere], point: Doubles, low_m: float, high_m: float) -> float:
    """Distance from the point (3,) to the nearest surface at any key frame, exact where it is not in low_m..high_m."""
    nearest = math.inf
    for item in objects:
        for place in _rests(item, point):
            if isinstance(item, Sphere):
                found = abs(float(np.linalg.norm(item.centre_m - place)) - item.radius_m)
            else:
                found = _to_mesh(item, place, min(nearest, high_m), low_m)
            nearest = min(nearest, found)
    return nearest


def in_view(objects: Sequence[Mesh | Sphere], lens: Lens) -> bool:
    """Whether an object may be seen by a camera at the origin that looks along z; a motion always may bring one."""
    left, right = (float(lens.normalise(column, lens.height / 2)[0]) for column in (0.0, lens.width))
    top, bottom = (float(lens.normalise(lens.width / 2, row)[1]) for row in (0.0, lens.height))
    # A distorted lens sees more in its corners: a little is added on all sides.
    aside, down = 0.1 * (right - left), 0.1 * (bottom - top)
    sides = [(1, 0, aside - left), (-1, 0, right + aside), (0, 1, down - top), (0, -1, bottom + down), (0, 0, 1)]
    normals = np.array(sides, np.float64)
    for item in objects:
        if item.motion is not None:
            return True
        if isinstance(item, Sphere):
            inside = (normals @ item.centre_m) / np.linalg.norm(normals, axis=1) > -item.radius_m
        else:
            inside = (item.vertices @ normals.T > 0).any(axis=0)
        if inside.all():
            return True
    return False


def _rests(item: Mesh | Sphere, point: Doubles) -> Iterator[Doubles]:
    """The point in the frame of the object, at each of its key frames."""
    if item.motion is None:
        yield point
        return
    once = replace(item.motion, loop=False)  # a loop is back at its first key frame when it reaches the last
    for time_s in once.times_s:
        rotation, position = once.pose(float(time_s))
        yield rotation.T @ (point - position)


def _to_mesh(mesh: Mesh, point: Doubles, enough: float, low_m: float) -> float:
    """The distance to a mesh; any upper bound of it where that is not above `enough` and the mesh beyond `low_m`."""
    offset = mesh.vertices - point
    bound = float(np.sqrt((offset**2).sum(axis=1).min()))
    least = float(np.linalg.norm(np.maximum(np.maximum(offset.min(axis=0), -offset.max(axis=0)), 0)))
    if least >= low_m and bound <= enough:
        return bound
    for start in range(0, len(mesh.faces), _CHUNK):
        corners = offset[mesh.faces[start : start + _CHUNK]]
        box = np.maximum(np.maximum(corners.min(axis=1), -corners.max(axis=1)), 0)
        close = (box**2).sum(axis=1) < bound**2
        if close.any():
            bound = min(bound, float(_to_triangles(corners[close]).min()))
    return bound


def _to_triangles(corners: Doubles) -> Doubles:
    """Distances (T,) of triangles (T, 3, 3) from the origin."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    found = np.min([_to_edges(a, b), _to_edges(b, c), _to_edges(c, a)], axis=0)
    normal = np.cross(b - a, c - a)
    length = np.sqrt((normal**2).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        height = (normal * a).sum(axis=1) / length
        foot = normal * (height / length)[:, None]
        sides = [(np.cross(q - p, foot - p) * normal).sum(axis=1) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    inside = (length > 0) & np.all(sides, axis=0)
    return np.asarray(np.where(inside, np.minimum(np.abs(height), found), found), np.float64)


def _to_edges(start: Doubles, end: Doubles) -> Doubles:
    along = end - start
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(-(start * along).sum(axis=1) / square, 0, 1)
    return np.asarray(np.sqrt(((start + share[:, None] * along) ** 2).sum(axis=1)))
