"""What surfaces do besides throwing light back matt: gloss in direct light, and what a skin keeps for itself.

A lobe of share s and exponent n about the mirror's direction shows, beside the matt light albedo * strength, the
radiance s (n + 2) / 2 cos^n(alpha) * strength: its reflectance is s (n + 2) / (2 pi) cos^n(alpha), that of matt albedo
/ pi (Lafortune and Willems 1994). alpha is the angle between the mirror's direction and the line of sight. Only light
that falls on the side which is seen has a mirror's direction there. The room's light has none: it shows what is matt.

Scenes without such surfaces come nowhere near this: their tracer has no `Looks`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render.kernels import Hits, Pixels, strength
from slopegate.core.render.kernels_facets import Spheres
from slopegate.core.rig.arrays import Doubles, Indices, Ints, Singles
from slopegate.core.scene.materials import Glass, Gloss, Material, Skin


class Coats(NamedTuple):
    """What N triangles or spheres are made of: matt (N, 3) float32, the share of the colour that they throw back matt
    where light falls; share (N,) and exponent (N,) of the lobe, 0 for none; glass (N,), its index of refraction, 0 for
    all else."""

    matt: Singles
    share: Doubles
    exponent: Doubles
    glass: Doubles


class Looks(NamedTuple):
    """What R rays met: unit normal (R, 3) in world axes, to either side; matt, exponent and glass as in `Coats`; lobe
    (R, 3) float32, the lobe's share per colour."""

    normal: Doubles
    matt: Singles
    lobe: Singles
    exponent: Doubles
    glass: Doubles

    def some(self, which: Indices) -> Looks:
        """Those of some rays."""
        return Looks(self.normal[which], self.matt[which], self.lobe[which], self.exponent[which], self.glass[which])


def coats(materials: list[Material | None]) -> Coats:
    """The coats of N things."""
    count = len(materials)
    out = Coats(np.ones((count, 3), np.float32), np.zeros(count), np.zeros(count), np.zeros(count))
    for n, material in enumerate(materials):
        match material:
            case Gloss():
                out.share[n], out.exponent[n] = material.share, material.exponent
            case Glass():
                out.glass[n] = material.index
            case Skin():
                out.matt[n] = material.surface
    return out


def plain(material: Material | None) -> bool:
    """Whether direct light needs to know no more than the colour."""
    return material is None or (isinstance(material, Gloss) and material.share == 0)


def nothing_met(count: int) -> Looks:
    """Looks of rays that have met nothing yet."""
    return Looks(
        np.zeros((count, 3)),
        np.ones((count, 3), np.float32),
        np.zeros((count, 3), np.float32),
        np.zeros(count),
        np.zeros(count),
    )


@njit(cache=True, nogil=True)
def note_triangles(prim: Ints, rotation: Doubles, normal: Doubles, coat: Coats, looks: Looks) -> None:
    """Note what rays (R,) met whose nearest hit so far is on triangle prim[i] (-1: none) of a body turned so."""
    for i in range(prim.shape[0]):
        p = prim[i]
        if p < 0:
            continue
        for k in range(3):
            turned = rotation[k, 0] * normal[p, 0] + rotation[k, 1] * normal[p, 1] + rotation[k, 2] * normal[p, 2]
            looks.normal[i, k] = turned
            looks.matt[i, k], looks.lobe[i, k] = coat.matt[p, k], coat.share[p]
        looks.exponent[i], looks.glass[i] = coat.exponent[p], coat.glass[p]


@njit(cache=True, nogil=True)
def note_spheres(
    which: Ints,
    origins: Doubles,
    directions: Doubles,
    depth: Doubles,
    rotation: Doubles,
    spheres: Spheres,
    coat: Coats,
    looks: Looks,
) -> None:
    """Note what rays (R,) met whose nearest hit so far, at depth (R,), is on sphere which[i] (-1: none).

    The rays are world ones relative to the body's frame: origins (R, 3), or (1, 3) for all, from that frame's own
    origin, and directions (R, 3), both in world axes; the body is turned by `rotation`.
    """
    for i in range(which.shape[0]):
        s = which[i]
        if s < 0:
            continue
        o = i if origins.shape[0] > 1 else 0
        x, y, z = spheres.centres[s, 0], spheres.centres[s, 1], spheres.centres[s, 2]
        for k in range(3):
            centre = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
            looks.normal[i, k] = (origins[o, k] + depth[i] * directions[i, k] - centre) / spheres.radii[s]
            looks.matt[i, k], looks.lobe[i, k] = coat.matt[s, k], coat.share[s]
        looks.exponent[i], looks.glass[i] = coat.exponent[s], coat.glass[s]


@njit(cache=True, nogil=True)
def add_lobes(
    row: Singles,
    q: Doubles,
    vectors: Doubles,
    views: Doubles,
    hits: Hits,
    looks: Looks,
    places: Indices,
    out: Pixels,
) -> None:
    """Turn the matt direct light of R lit points in the pixels `places` (R,) of `out` into that of their coats.

    q (R, 3): the points as x/z, y/z, z in the projector's axes; vectors (R, 3) lead there from the projector and views
    (R, 3) along the line of sight, both of any length, in world axes.
    """
    for i in range(row.shape[0]):
        if row[i] < 0:
            continue
        p = places[i]
        for k in range(3):
            out.direct[p, k] *= looks.matt[i, k]
        if looks.exponent[i] == 0.0:
            continue
        nx, ny, nz = looks.normal[i, 0], looks.normal[i, 1], looks.normal[i, 2]
        bx, by, bz = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        dx, dy, dz = views[i, 0], views[i, 1], views[i, 2]
        falls, seen = nx * bx + ny * by + nz * bz, nx * dx + ny * dy + nz * dz
        if falls * seen <= 0.0:
            continue
        # The beam thrown back as by a mirror, against the line of sight; both lengths are divided out.
        mx, my, mz = bx - 2 * falls * nx, by - 2 * falls * ny, bz - 2 * falls * nz
        lengths = np.sqrt((bx * bx + by * by + bz * bz) * (dx * dx + dy * dy + dz * dz))
        cosine = -(mx * dx + my * dy + mz * dz) / lengths
        if cosine <= 0.0:
            continue
        n = looks.exponent[i]
        white = strength(hits.facing[i], q[i, 2])
        height = np.float32((n + 2) / 2 * min(cosine, 1.0) ** n)
        for k in range(3):
            added = looks.lobe[i, k] * height * white
            out.direct[p, k] = min(out.direct[p, k] + added, np.float32(1e30))
