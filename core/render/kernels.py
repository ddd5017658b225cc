"""The compiled loops of the renderer: exact hits, textures, projector rows, shading.

Every ray is computed by itself, so its result does not depend on which others are cast with it: a part of an image that
is rendered anew is equal to the whole rendered anew, to the last bit.

`to_projector_axes` and `pinhole_places` repeat the law of `Rig.to_projector` and `triangulate.projector_rows` for
speed; tests/core/render/test_render.py holds them together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render.kernels_facets import Spheres
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles


class Hits(NamedTuple):
    """Nearest hits of R rays: depth (R,) in lengths of the direction, infinite where nothing was hit; facing (R,), the
    distance of the light from the tangent plane there; colour (R, 3) linear albedo."""

    depth: Doubles
    facing: Doubles
    colour: Singles


class Pixels(NamedTuple):
    """`render.Buffers` with one leading axis, (P,) and (P, 3)."""

    projector_row: Singles
    projector_column: Singles
    inverse_depth: Singles
    direct: Singles
    ambient: Singles


class Faces(NamedTuple):
    """T triangles in their body's frame: a corner, the edges from it, the unit normal (T, 3); albedo (T, 3)."""

    corner: Doubles
    edge1: Doubles
    edge2: Doubles
    normal: Doubles
    albedo: Singles


@njit(cache=True, nogil=True)
def turn_some(vectors: Doubles, which: Indices, rotation: Doubles, out: Singles) -> None:
    """Turn some of the vectors (R, 3) back: out (N, 3) = rotation^T vector."""
    for n in range(which.shape[0]):
        x, y, z = vectors[which[n], 0], vectors[which[n], 1], vectors[which[n], 2]
        for k in range(3):
            out[n, k] = rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z


@njit(cache=True, nogil=True)
def into_body(
    origins: Doubles, directions: Doubles, rotation: Doubles, position: Doubles, starts: Doubles, along: Doubles
) -> None:
    """World rays, origins and directions (R, 3), in the frame of a body at rotation p + position: starts, along."""
    for i in range(origins.shape[0]):
        x, y, z = origins[i, 0] - position[0], origins[i, 1] - position[1], origins[i, 2] - position[2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        for k in range(3):
            starts[i, k] = rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z
            along[i, k] = rotation[0, k] * dx + rotation[1, k] * dy + rotation[2, k] * dz


@njit(cache=True, nogil=True)
def refine_triangles(
    prim: Ints,
    origin: Doubles,
    directions: Doubles,
    rotation: Doubles,
    light: Doubles,
    faces: Faces,
    hits: Hits,
    bary: Singles,
) -> None:
    """Compute in float64 where rays meet the triangles found for them (prim (R,), -1: none); keep the nearest so far.

    A hit that is not nearer than hits.depth gets prim[i] = -1. The hit is where the ray meets the triangle's plane. A
    ray that float32 let in just beside the triangle may meet the plane far off where it is seen edge-on: beyond 1e-3 of
    an edge, the nearest place of the triangle stands instead. Origin and light are in the body's frame, the directions
    (R, 3) in world axes.
    """
    for i in range(prim.shape[0]):
        p = prim[i]
        if p < 0:
            continue
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        dx = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
        dy = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
        dz = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
        nx, ny, nz = faces.normal[p, 0], faces.normal[p, 1], faces.normal[p, 2]
        corner = faces.corner
        ox, oy, oz = corner[p, 0] - origin[0], corner[p, 1] - origin[1], corner[p, 2] - origin[2]
        ax, ay, az = faces.edge1[p, 0], faces.edge1[p, 1], faces.edge1[p, 2]
        bx, by, bz = faces.edge2[p, 0], faces.edge2[p, 1], faces.edge2[p, 2]
        # Barycentric coordinates from the hit on the plane: float32 rays only say which triangle, float64 says where.
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
        if not 0.0 < t < hits.depth[i]:
            prim[i] = -1
            continue
        hits.depth[i] = t
        lx, ly, lz = corner[p, 0] - light[0], corner[p, 1] - light[1], corner[p, 2] - light[2]
        hits.facing[i] = abs(nx * lx + ny * ly + nz * lz)
        for k in range(3):
            hits.colour[i, k] = faces.albedo[p, k]
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
    rotation: Doubles,
    light: Doubles,
    spheres: Spheres,
    among: Bools,
    hits: Hits,
    which: Ints,
) -> None:
    """Exact nearest hits of the rays `among` (R,) on spheres, kept where they are nearer than hits.depth.

    Origin, light and spheres are in the body's frame, the directions (R, 3) in world axes. which (R,) is set to the
    sphere where one is kept; it may be empty if nobody wants to know.
    """
    radii = spheres.radii
    for i in range(directions.shape[0]):
        if not among[i]:
            continue
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        dx = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
        dy = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
        dz = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
        square = dx * dx + dy * dy + dz * dz
        for s in range(radii.shape[0]):
            cx = spheres.centres[s, 0] - origin[0]
            cy = spheres.centres[s, 1] - origin[1]
            cz = spheres.centres[s, 2] - origin[2]
            middle = (cx * dx + cy * dy + cz * dz) / square
            # Distance of the ray's line from the centre, without the cancellation of b^2 - 4 a c.
            px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
            rest = radii[s] * radii[s] - (px * px + py * py + pz * pz)
            if rest <= 0.0:
                continue
            half = np.sqrt(rest / square)
            # The nearer side, but for an origin inside the sphere, which sees the farther one from within.
            t = middle - half if middle > half else middle + half
            if not 0.0 < t < hits.depth[i]:
                continue
            hits.depth[i] = t
            nx, ny, nz = (t * dx - cx) / radii[s], (t * dy - cy) / radii[s], (t * dz - cz) / radii[s]
            hx = t * dx + origin[0] - light[0]
            hy = t * dy + origin[1] - light[1]
            hz = t * dz + origin[2] - light[2]
            hits.facing[i] = abs(nx * hx + ny * hy + nz * hz)
            if which.shape[0] > 0:
                which[i] = s
            for k in range(3):
                hits.colour[i, k] = spheres.albedo[s, k]


@njit(cache=True, nogil=True)
def meet_triangles(
    prim: Ints, origins: Doubles, directions: Doubles, light: Doubles, faces: Faces, hits: Hits, bary: Singles
) -> None:
    """`refine_triangles` for rays from anywhere, origins and directions (R, 3) in the body's frame: what they meet must
    lie ahead of them, and a triangle seen edge-on is not met."""
    for i in range(prim.shape[0]):
        p = prim[i]
        if p < 0:
            continue
        nx, ny, nz = faces.normal[p, 0], faces.normal[p, 1], faces.normal[p, 2]
        ox, oy, oz = (
            faces.corner[p, 0] - origins[i, 0],
            faces.corner[p, 1] - origins[i, 1],
            faces.corner[p, 2] - origins[i, 2],
        )
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        slope = nx * dx + ny * dy + nz * dz
        t = (nx * ox + ny * oy + nz * oz) / slope if slope != 0.0 else -1.0
        if not 0.0 < t < hits.depth[i]:
            prim[i] = -1
            continue
        ax, ay, az = faces.edge1[p, 0], faces.edge1[p, 1], faces.edge1[p, 2]
        bx, by, bz = faces.edge2[p, 0], faces.edge2[p, 1], faces.edge2[p, 2]
        hx, hy, hz = t * dx - ox, t * dy - oy, t * dz - oz
        aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
        ha, hb, area = hx * ax + hy * ay + hz * az, hx * bx + hy * by + hz * bz, aa * bb - ab * ab
        bary[i, 0], bary[i, 1] = (bb * ha - ab * hb) / area, (aa * hb - ab * ha) / area
        hits.depth[i] = t
        lx, ly, lz = faces.corner[p, 0] - light[0], faces.corner[p, 1] - light[1], faces.corner[p, 2] - light[2]
        hits.facing[i] = abs(nx * lx + ny * ly + nz * lz)
        for k in range(3):
            hits.colour[i, k] = faces.albedo[p, k]


@njit(cache=True, nogil=True)
def meet_spheres(
    origins: Doubles, directions: Doubles, light: Doubles, spheres: Spheres, hits: Hits, which: Ints
) -> None:
    """`hit_spheres` for rays from anywhere, origins and directions (R, 3) in the body's frame."""
    for i in range(origins.shape[0]):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        square = dx * dx + dy * dy + dz * dz
        for s in range(spheres.radii.shape[0]):
            radius = spheres.radii[s]
            cx = spheres.centres[s, 0] - origins[i, 0]
            cy = spheres.centres[s, 1] - origins[i, 1]
            cz = spheres.centres[s, 2] - origins[i, 2]
            middle = (cx * dx + cy * dy + cz * dz) / square
            px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
            rest = radius * radius - (px * px + py * py + pz * pz)
            if rest <= 0.0:
                continue
            half = np.sqrt(rest / square)
            t = middle - half if middle > half else middle + half
            if not 0.0 < t < hits.depth[i]:
                continue
            hits.depth[i], which[i] = t, s
            nx, ny, nz = (t * dx - cx) / radius, (t * dy - cy) / radius, (t * dz - cz) / radius
            hx, hy, hz = (
                t * dx + origins[i, 0] - light[0],
                t * dy + origins[i, 1] - light[1],
                t * dz + origins[i, 2] - light[2],
            )
            hits.facing[i] = abs(nx * hx + ny * hy + nz * hz)
            for k in range(3):
                hits.colour[i, k] = spheres.albedo[s, k]


@njit(cache=True, nogil=True)
def keep_nearer(before: Doubles, directions: Doubles, hits: Hits, kept: Indices) -> int:
    """Move the rays (R,) that met something nearer than `before` to the front, in order; returns how many there are.

    kept (R,): which they were.
    """
    count = 0
    for i in range(before.shape[0]):
        if hits.depth[i] < before[i]:
            kept[count] = i
            hits.depth[count], hits.facing[count] = hits.depth[i], hits.facing[i]
            for k in range(3):
                directions[count, k], hits.colour[count, k] = directions[i, k], hits.colour[i, k]
            count += 1
    return count


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
def pinhole_places(q: Doubles, matrix: Doubles, size: tuple[int, int], rows: Singles, columns: Singles) -> None:
    """Row and column coordinates (R,) of points q (R, 3), x/z and y/z first, in an undistorted projector's raster of
    `size` (width, height); both -1 outside.

    Coordinates that float32 would round up to the raster's end become the largest float32 before it.
    """
    width, height = size
    zero = np.float32(0)
    last_row, last_column = np.nextafter(np.float32(height), zero), np.nextafter(np.float32(width), zero)
    for i in range(rows.shape[0]):
        column = q[i, 0] * matrix[0, 0] + matrix[0, 2]
        row = q[i, 1] * matrix[1, 1] + matrix[1, 2]
        # NaN, from points not in front of the projector, is inside nothing.
        inside = 0.0 <= column < width and 0.0 <= row < height
        rows[i] = min(np.float32(row), last_row) if inside else np.float32(-1.0)
        columns[i] = min(np.float32(column), last_column) if inside else np.float32(-1.0)


@njit(cache=True, nogil=True)
def strength(facing: float, z: float) -> np.float32:
    """Radiance of a white point: facing / z^3, z its depth from the projector."""
    return np.float32(min(facing / z**3, 1e30))


@njit(cache=True, nogil=True)
def shine(
    row: Singles, column: Singles, q: Doubles, hits: Hits, ambient: np.float32, places: Indices, out: Pixels
) -> None:
    """Write what R rays that met `hits` bring into the pixels `places` (R,) of `out`.

    direct = colour strength where row is not negative, else 0; ambient = colour ambient; inverse depth = 1 / depth.
    The first and third are kept finite at the very projector and the very camera.
    """
    for i in range(row.shape[0]):
        p = places[i]
        lit = row[i] >= 0
        brightness = strength(hits.facing[i], q[i, 2]) if lit else np.float32(0.0)
        out.projector_row[p] = row[i]
        out.projector_column[p] = column[i] if lit else np.float32(-1.0)
        out.inverse_depth[p] = min(1.0 / hits.depth[i], 1e30)
        for k in range(3):
            out.direct[p, k] = hits.colour[i, k] * brightness
            out.ambient[p, k] = hits.colour[i, k] * ambient
