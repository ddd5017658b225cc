"""Numba loops of the renderer: exact hits, shading, texture look-up. Every ray is computed by itself, so the result of
a ray does not depend on which others are cast with it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]


@njit(cache=True, nogil=True)
def into_frame(vectors: Doubles, rotation: Doubles, out: Doubles) -> None:
    """Rotate world vectors (R, 3) into a body's own frame: out = rotation^T vector."""
    for i in range(vectors.shape[0]):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for k in range(3):
            out[i, k] = rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z


@njit(cache=True, nogil=True)
def refine_triangles(
    prim: Ints,
    origin: Doubles,
    directions: Doubles,
    light: Doubles,
    corner: Doubles,
    edge1: Doubles,
    edge2: Doubles,
    normal: Doubles,
    albedo: Singles,
    depth: Doubles,
    facing: Doubles,
    colour: Singles,
    bary: Singles,
) -> None:
    """Compute in float64 where rays meet the triangles that embree found for them; keep the nearest so far.

    A hit that is not nearer than depth[i] gets prim[i] = -1. The hit is where the ray meets the triangle's plane. A ray
    that float32 let in just beside the triangle may meet the plane far off where it is seen edge-on: beyond 1e-3 of an
    edge, the nearest place of the triangle stands instead. facing: distance of the light from the triangle's plane.
    """
    for i in range(prim.shape[0]):
        p = prim[i]
        if p < 0:
            continue
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        nx, ny, nz = normal[p, 0], normal[p, 1], normal[p, 2]
        ox, oy, oz = corner[p, 0] - origin[0], corner[p, 1] - origin[1], corner[p, 2] - origin[2]
        ax, ay, az = edge1[p, 0], edge1[p, 1], edge1[p, 2]
        bx, by, bz = edge2[p, 0], edge2[p, 1], edge2[p, 2]
        aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
        area = aa * bb - ab * ab
        slope = nx * dx + ny * dy + nz * dz
        t = (nx * ox + ny * oy + nz * oz) / slope if slope != 0.0 else 0.0
        hx, hy, hz = t * dx - ox, t * dy - oy, t * dz - oz
        ha, hb = hx * ax + hy * ay + hz * az, hx * bx + hy * by + hz * bz
        u, v = (bb * ha - ab * hb) / area, (aa * hb - ab * ha) / area
        if slope == 0.0 or not (u > -1e-3 and v > -1e-3 and u + v < 1.001):
            u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
            u, v = u / max(u + v, 1.0), v / max(u + v, 1.0)
            along = (ox + u * ax + v * bx) * dx + (oy + u * ay + v * by) * dy + (oz + u * az + v * bz) * dz
            t = along / (dx * dx + dy * dy + dz * dz)
        if not 0.0 < t < depth[i]:
            prim[i] = -1
            continue
        depth[i] = t
        lx, ly, lz = corner[p, 0] - light[0], corner[p, 1] - light[1], corner[p, 2] - light[2]
        facing[i] = abs(nx * lx + ny * ly + nz * lz)
        for k in range(3):
            colour[i, k] = albedo[p, k]
        bary[i, 0], bary[i, 1] = u, v


@njit(cache=True, nogil=True)
def sample_texture(prim: Ints, bary: Singles, first: int, uv: Doubles, texture: Singles, colour: Singles) -> None:
    """Albedo of the hits on triangles first .. first + len(uv): the texel [floor(v h), floor(u w)], clamped."""
    height, width = texture.shape[0], texture.shape[1]
    for i in range(prim.shape[0]):
        p = prim[i] - first
        if p < 0 or p >= uv.shape[0]:
            continue
        s, t = np.float64(bary[i, 0]), np.float64(bary[i, 1])
        r = 1.0 - s - t
        u = r * uv[p, 0, 0] + s * uv[p, 1, 0] + t * uv[p, 2, 0]
        v = r * uv[p, 0, 1] + s * uv[p, 1, 1] + t * uv[p, 2, 1]
        # Clamped before the conversion: a whole number has a range, u and v have none.
        row = int(min(max(v * height, 0.0), height - 1.0))
        column = int(min(max(u * width, 0.0), width - 1.0))
        for k in range(3):
            colour[i, k] = texture[row, column, k]


@njit(cache=True, nogil=True)
def hit_spheres(
    origin: Doubles,
    directions: Doubles,
    light: Doubles,
    centres: Doubles,
    radii: Doubles,
    albedo: Singles,
    depth: Doubles,
    facing: Doubles,
    colour: Singles,
) -> None:
    """Exact nearest hits on spheres in front of the origin, kept where they are nearer than depth[i]."""
    for s in range(radii.shape[0]):
        radius = radii[s]
        cx, cy, cz = centres[s, 0] - origin[0], centres[s, 1] - origin[1], centres[s, 2] - origin[2]
        for i in range(directions.shape[0]):
            dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
            square = dx * dx + dy * dy + dz * dz
            middle = (cx * dx + cy * dy + cz * dz) / square
            # Distance of the ray's line from the centre, without the cancellation of b^2 - 4 a c.
            px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
            rest = radius * radius - (px * px + py * py + pz * pz)
            if rest <= 0.0:
                continue
            half = np.sqrt(rest / square)
            t = middle - half if middle > half else middle + half
            if not 0.0 < t < depth[i]:
                continue
            depth[i] = t
            nx, ny, nz = (t * dx - cx) / radius, (t * dy - cy) / radius, (t * dz - cz) / radius
            hx = t * dx + origin[0] - light[0]
            hy = t * dy + origin[1] - light[1]
            hz = t * dz + origin[2] - light[2]
            facing[i] = abs(nx * hx + ny * hy + nz * hz)
            for k in range(3):
                colour[i, k] = albedo[s, k]


@njit(cache=True, nogil=True)
def shade_spheres(
    light: Doubles, vectors: Doubles, centres: Doubles, radii: Doubles, reach: float, shaded: NDArray[np.bool_]
) -> None:
    """Mark the segments light .. light + reach * vector that a sphere's surface crosses."""
    for s in range(radii.shape[0]):
        cx, cy, cz = centres[s, 0] - light[0], centres[s, 1] - light[1], centres[s, 2] - light[2]
        for i in range(vectors.shape[0]):
            dx, dy, dz = vectors[i, 0], vectors[i, 1], vectors[i, 2]
            square = dx * dx + dy * dy + dz * dz
            middle = (cx * dx + cy * dy + cz * dz) / square
            px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
            rest = radii[s] * radii[s] - (px * px + py * py + pz * pz)
            if rest > 0.0:
                half = np.sqrt(rest / square)
                if 0.0 < middle - half < reach or 0.0 < middle + half < reach:
                    shaded[i] = True


@njit(cache=True, nogil=True)
def to_projector_axes(
    origin: Doubles,
    directions: Doubles,
    depth: Doubles,
    light: Doubles,
    rotation: Doubles,
    vectors: Doubles,
    q: Doubles,
) -> None:
    """Hit points as vectors from the projector, in world axes (vectors) and as x/z, y/z, z in its own axes (q).

    NaN in q[:, 0:2] where there is no hit or the point is not in front of the projector.
    """
    for i in range(depth.shape[0]):
        t = depth[i]
        if not t < np.inf:
            q[i, 0], q[i, 1], q[i, 2] = np.nan, np.nan, -1.0
            continue
        x = origin[0] + t * directions[i, 0] - light[0]
        y = origin[1] + t * directions[i, 1] - light[1]
        z = origin[2] + t * directions[i, 2] - light[2]
        vectors[i, 0], vectors[i, 1], vectors[i, 2] = x, y, z
        qz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        q[i, 2] = qz
        if qz > 0.0:
            q[i, 0] = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) / qz
            q[i, 1] = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) / qz
        else:
            q[i, 0], q[i, 1] = np.nan, np.nan


@njit(cache=True, nogil=True)
def pinhole_rows(q: Doubles, matrix: Doubles, width: int, height: int, last_row: np.float32, out: Singles) -> None:
    """Row coordinate (R,) of points q (R, 3), x/z and y/z first, in an undistorted projector's raster; -1 outside.

    last_row: the largest float32 below `height`, to which rows may not round up.
    """
    for i in range(out.shape[0]):
        column = q[i, 0] * matrix[0, 0] + matrix[0, 2]
        row = q[i, 1] * matrix[1, 1] + matrix[1, 2]
        inside = 0.0 <= column < width and 0.0 <= row < height
        out[i] = min(np.float32(row), last_row) if inside else np.float32(-1.0)


@njit(cache=True, nogil=True)
def shine(row: Singles, q: Doubles, facing: Doubles, colour: Singles, direct: Singles) -> None:
    """direct (R, 3) = colour facing / z_p^3 where row is not negative, else 0; kept finite at the very projector."""
    for i in range(row.shape[0]):
        strength = np.float32(0.0)
        if row[i] >= 0:
            strength = np.float32(min(facing[i] / q[i, 2] ** 3, 1e30))
        for k in range(3):
            direct[i, k] = colour[i, k] * strength
