"""Numba loops of the renderer: exact hits, shading, texture look-up. Every ray is computed by itself, so the result of
a ray does not depend on which others are cast with it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bits = NDArray[np.uint32]


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
def fill_triangles(points: Doubles, faces: Ints, margin: float, bit: np.uint32, grid: Bits) -> None:
    """Set `bit` in every cell of `grid` that a triangle touches, or passes by less than `margin` cells.

    points (P, 2): column and row coordinates; cell (r, c) covers [r, r + 1) x [c, c + 1).
    """
    height, width = grid.shape
    for f in range(faces.shape[0]):
        y0, y1, y2 = points[faces[f, 0], 1], points[faces[f, 1], 1], points[faces[f, 2], 1]
        first = int(max(np.floor(min(y0, y1, y2) - margin), 0.0))
        last = int(min(np.floor(max(y0, y1, y2) + margin), height - 1.0))
        for row in range(first, last + 1):
            low, high = row - margin, row + 1.0 + margin
            left, right = np.inf, -np.inf
            for edge in range(3):
                ax, ay = points[faces[f, edge], 0], points[faces[f, edge], 1]
                bx, by = points[faces[f, (edge + 1) % 3], 0], points[faces[f, (edge + 1) % 3], 1]
                if max(ay, by) < low or min(ay, by) > high:
                    continue
                slope = (bx - ax) / (by - ay) if ay != by else 0.0
                for y, x in ((ay, ax), (by, bx)):
                    cut = min(max(y, low), high)
                    at = x + (cut - y) * slope
                    left, right = min(left, at), max(right, at)
            start = int(max(np.floor(left - margin), 0.0))
            end = int(min(np.floor(right + margin), width - 1.0))
            for column in range(start, end + 1):
                grid[row, column] |= bit


@njit(cache=True, nogil=True)
def look_up(directions: Singles, left: float, top: float, scale: float, grid: Bits, out: Bits) -> None:
    """out (R,) = the cell of `grid` in which directions (R, 2), x/z and y/z, lie; 0 outside it and for NaN.

    left, top: where the grid starts; scale: cells per unit of x/z.
    """
    for i in range(out.shape[0]):
        column, row = (directions[i, 0] - left) * scale, (directions[i, 1] - top) * scale
        inside = 0.0 <= column < grid.shape[1] and 0.0 <= row < grid.shape[0]
        out[i] = grid[int(row), int(column)] if inside else 0


@njit(cache=True, nogil=True)
def _joined(a: float, b: float, share: float, step: float) -> bool:
    return a > 0 and b > 0 and abs(a - b) <= max(share * max(a, b), step)


@njit(cache=True, nogil=True)
def _draw_triangle(net: Singles, i: int, j: int, k: int, m: int, n: int, o: int, out: Singles) -> None:
    """Draw net[i, j], net[k, m], net[n, o] into the cells of `out` whose centres it covers, nearest surface kept."""
    x0, y0, w0 = np.float64(net[i, j, 0]) - 0.5, np.float64(net[i, j, 1]) - 0.5, np.float64(net[i, j, 2])
    ax, ay, aw = net[k, m, 0] - 0.5 - x0, net[k, m, 1] - 0.5 - y0, net[k, m, 2] - w0
    bx, by, bw = net[n, o, 0] - 0.5 - x0, net[n, o, 1] - 0.5 - y0, net[n, o, 2] - w0
    area = ax * by - ay * bx
    if abs(area) < 1e-9:
        return
    left = max(int(np.ceil(x0 + min(0.0, ax, bx) - 1e-3)), 0)
    right = min(int(np.floor(x0 + max(0.0, ax, bx) + 1e-3)), out.shape[1] - 1)
    top = max(int(np.ceil(y0 + min(0.0, ay, by) - 1e-3)), 0)
    bottom = min(int(np.floor(y0 + max(0.0, ay, by) + 1e-3)), out.shape[0] - 1)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            px, py = column - x0, row - y0
            s, t = (px * by - py * bx) / area, (ax * py - ay * px) / area
            # Float32 places a corner to 1e-4 of a cell: neighbours overlap by a little more than that.
            if s >= -1e-3 and t >= -1e-3 and s + t <= 1.001:
                w = w0 + s * aw + t * bw
                out[row, column] = max(out[row, column], w)


@njit(cache=True, nogil=True)
def draw_net(net: Singles, share: float, step: float, out: Singles) -> None:
    """Draw a surface net (H, W, 3) of cell column, cell row, inverse depth (0 = none) into `out`, nearest kept.

    Neighbours are joined unless they differ by more than `share` of the larger and more than `step`. Every pixel
    covers at least the cell that it falls into.
    """
    height, width = net.shape[0], net.shape[1]
    for i in range(height):
        for j in range(width):
            w = net[i, j, 2]
            if not w > 0:
                continue
            if 0 <= net[i, j, 0] < out.shape[1] and 0 <= net[i, j, 1] < out.shape[0]:
                row, column = int(net[i, j, 1]), int(net[i, j, 0])
                out[row, column] = max(out[row, column], w)
            if i + 1 == height or j + 1 == width:
                continue
            right, down, across = net[i, j + 1, 2], net[i + 1, j, 2], net[i + 1, j + 1, 2]
            if _joined(right, down, share, step):
                if _joined(w, right, share, step) and _joined(w, down, share, step):
                    _draw_triangle(net, i, j, i, j + 1, i + 1, j, out)
                if _joined(across, right, share, step) and _joined(across, down, share, step):
                    _draw_triangle(net, i + 1, j + 1, i, j + 1, i + 1, j, out)
