"""The compiled loops of `surfaces`: spheres, normals and colours of what rays meet."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Vector3

MATT: Final = 0
GLOSS: Final = 1
GLASS: Final = 2


class Paint(NamedTuple):
    """One mesh's material and colour: its row of the materials, its texels from `offset` on, height 0 for none."""

    kind: int
    offset: int
    height: int
    width: int
    albedo: Vector3


class Faceted(NamedTuple):
    """T triangles: unit normal (T, 3), uv (T, 3, 2) float32, mesh (T,); per mesh `paint` (K, 4): kind, offset, height
    and width of its texels, and its albedo (K, 3); texels (N, 3) of all textures, one after the other."""

    normal: Singles
    uv: Singles
    mesh: Ints
    paint: Indices
    albedo: Singles
    texels: Singles


class Balls(NamedTuple):
    """S spheres: centres (S, 3), radii (S,), albedo (S, 3), kind (S,)."""

    centres: Doubles
    radii: Doubles
    albedo: Singles
    kind: Ints


class Met(NamedTuple):
    """What N rays meet: distance (N,), infinite for nothing; unit normal (N, 3) turned towards where the ray comes
    from; albedo (N, 3) linear; kind (N,), a row of the materials, -1 for nothing."""

    distance: Singles
    normal: Singles
    albedo: Singles
    kind: Ints


@njit(cache=True, nogil=True)
def settle(
    origins: Singles,
    directions: Singles,
    found: tuple[Ints, Singles, Singles, Singles],
    faces: Faceted,
    balls: Balls,
    met: Met,
) -> None:
    """Fill `met` from the triangles found, (primitive, distance, u, v), each (N,), and from the spheres."""
    prim, tfar, us, vs = found
    for i in range(origins.shape[0]):
        p = prim[i]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        distance = np.float32(np.inf)
        met.kind[i] = -1
        for k in range(3):
            met.normal[i, k] = met.albedo[i, k] = 0.0
        if p >= 0:
            distance = tfar[i]
            nx, ny, nz = faces.normal[p, 0], faces.normal[p, 1], faces.normal[p, 2]
            side = np.float32(1.0) if nx * dx + ny * dy + nz * dz <= 0 else np.float32(-1.0)
            met.normal[i, 0], met.normal[i, 1], met.normal[i, 2] = side * nx, side * ny, side * nz
            m = faces.mesh[p]
            met.kind[i] = np.int32(faces.paint[m, 0])
            height, width = faces.paint[m, 2], faces.paint[m, 3]
            if height == 0:
                for k in range(3):
                    met.albedo[i, k] = faces.albedo[m, k]
            else:
                s, t = us[i], vs[i]
                r = np.float32(1.0) - s - t
                u = r * faces.uv[p, 0, 0] + s * faces.uv[p, 1, 0] + t * faces.uv[p, 2, 0]
                v = r * faces.uv[p, 0, 1] + s * faces.uv[p, 1, 1] + t * faces.uv[p, 2, 1]
                row = int(min(max(v * height, 0.0), height - 1.0))
                column = int(min(max(u * width, 0.0), width - 1.0))
                texel = faces.paint[m, 1] + row * width + column
                for k in range(3):
                    met.albedo[i, k] = faces.texels[texel, k]
        met.distance[i] = distance
        if balls.radii.shape[0] > 0:
            _settle_balls(i, origins, directions, balls, met)


@njit(cache=True, nogil=True)
def _settle_balls(i: int, origins: Singles, directions: Singles, balls: Balls, met: Met) -> None:
    dx, dy, dz = np.float64(directions[i, 0]), np.float64(directions[i, 1]), np.float64(directions[i, 2])
    for s in range(balls.radii.shape[0]):
        cx = balls.centres[s, 0] - origins[i, 0]
        cy = balls.centres[s, 1] - origins[i, 1]
        cz = balls.centres[s, 2] - origins[i, 2]
        middle = cx * dx + cy * dy + cz * dz
        px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
        radius = balls.radii[s]
        rest = radius * radius - (px * px + py * py + pz * pz)
        if rest <= 0.0:
            continue
        half = np.sqrt(rest)
        # A ray that starts on the sphere lies within rounding of it: what is nearer than this share of the radius is
        # where it started.
        near = 1e-5 * radius
        t = middle - half if middle - half > near else middle + half
        if not near < t < met.distance[i]:
            continue
        met.distance[i] = t
        nx, ny, nz = (t * dx - cx) / radius, (t * dy - cy) / radius, (t * dz - cz) / radius
        side = 1.0 if nx * dx + ny * dy + nz * dz <= 0 else -1.0
        met.normal[i, 0], met.normal[i, 1], met.normal[i, 2] = side * nx, side * ny, side * nz
        met.kind[i] = balls.kind[s]
        for k in range(3):
            met.albedo[i, k] = balls.albedo[s, k]


@njit(cache=True, nogil=True)
def block_by_balls(origins: Singles, vectors: Singles, share: float, balls: Balls, out: Bools) -> None:
    """Set out (N,) where a sphere stands on the first `share` of a vector (N, 3), its start left out by 1e-4."""
    for i in range(origins.shape[0]):
        if out[i]:
            continue
        dx, dy, dz = np.float64(vectors[i, 0]), np.float64(vectors[i, 1]), np.float64(vectors[i, 2])
        square = dx * dx + dy * dy + dz * dz
        for s in range(balls.radii.shape[0]):
            cx = balls.centres[s, 0] - origins[i, 0]
            cy = balls.centres[s, 1] - origins[i, 1]
            cz = balls.centres[s, 2] - origins[i, 2]
            middle = (cx * dx + cy * dy + cz * dz) / square
            px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
            rest = balls.radii[s] * balls.radii[s] - (px * px + py * py + pz * pz)
            if rest <= 0.0:
                continue
            half = np.sqrt(rest / square)
            if 1e-4 < middle - half < share or 1e-4 < middle + half < share:
                out[i] = True
                break
