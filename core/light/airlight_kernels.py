"""Light scattered once by fog, along one camera ray: where it is lit, how much comes from where, and its integral.

A ray of direction d (z = 1) from the camera holds at inverse depth w the point that the projector, at the offset o from
the camera, sees along D = d - w o; Q_z is D's component along the projector's axis. Light scattered there into the ray
is, per unit of w,

    sigma_s p(mu) pi |D| |d| / Q_z^3 exp(-sigma_t (l_p + l_c)),    mu = -D . d / (|D| |d|)

with ds = |d| dw / w^2 and 1 / (z_p^2 cos theta) = w^2 |D| / Q_z^3: the two w^2 cancel, so nothing is singular at
infinity. p is Henyey and Greenstein's phase function (1941), l_p and l_c the lengths of both legs inside the fog, and a
projector pixel has the value 1.

The camera itself lies at w = infinity. So everything is a function of tau = w / (w + kappa), from 0 at infinity to 1 at
the camera: with e = 1 - tau and f = kappa tau, D' = e d - f o is along D, and the same expression with D' in D's place
and times kappa is the light per unit of tau.

The sides of a raster and of a box are planes in (x, y, w), so on a ray of a pinhole rig they leave one interval.
"""

from __future__ import annotations

from math import exp, inf, sqrt
from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render.fog import Medium
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Matrix3, Vector3

NEVER: Final = 1e-60
"""Smallest Q_z: closer to the projector's own centre light has no bound."""
_FADED: Final = 100.0
"""Light that fog dims by exp(-100) more than the nearest of its interval is left out."""
_TOLERANCE: Final = 1e-10
_MOST_PIECES: Final = 2000
_DEPTH: Final = 64


class Optics(NamedTuple):
    """Camera and projector as compiled loops take them, in world axes but for low and high.

    eye, light: their centres; offset = light - eye; rotation: to the projector's axes; low, high: x/z and y/z there of
    the raster's sides; kappa: 1/m, where tau = 1/2.
    """

    eye: Vector3
    light: Vector3
    offset: Vector3
    rotation: Matrix3
    low: tuple[float, float]
    high: tuple[float, float]
    kappa: float


class Ray(NamedTuple):
    """A camera ray: direction with z = 1, its length, and the depth at which it enters the fog."""

    along: Vector3
    length: float
    entry: float


@njit(cache=True, nogil=True, error_model="numpy")
def _keep(first: float, last: float, constant: float, slope: float) -> tuple[float, float]:
    """The part of first..last where constant + slope w >= 0; the end before the start for none."""
    # Most sides cut nothing, and are told by a product in place of a quotient.
    if slope > 0.0:
        return (first if constant + slope * first >= 0.0 else max(first, -constant / slope)), last
    if slope < 0.0:
        keeps = last < inf and constant + slope * last >= 0.0
        return first, (last if keeps else min(last, constant / -slope))
    return (first, last) if constant >= 0.0 else (1.0, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def lit_span(optics: Optics, medium: Medium, along: Vector3) -> tuple[float, float]:
    """Least and greatest w at which a ray is inside fog and raster; the greatest may be infinite. (0, 0) for none."""
    r, o, eye = optics.rotation, optics.offset, optics.eye
    dx, dy, dz = along
    ax, ox = r[0][0] * dx + r[0][1] * dy + r[0][2] * dz, r[0][0] * o[0] + r[0][1] * o[1] + r[0][2] * o[2]
    ay, oy = r[1][0] * dx + r[1][1] * dy + r[1][2] * dz, r[1][0] * o[0] + r[1][1] * o[1] + r[1][2] * o[2]
    az, oz = r[2][0] * dx + r[2][1] * dy + r[2][2] * dz, r[2][0] * o[0] + r[2][1] * o[1] + r[2][2] * o[2]
    first, last = 0.0, inf
    first, last = _keep(first, last, ax - optics.low[0] * az, optics.low[0] * oz - ox)
    first, last = _keep(first, last, optics.high[0] * az - ax, ox - optics.high[0] * oz)
    first, last = _keep(first, last, ay - optics.low[1] * az, optics.low[1] * oz - oy)
    first, last = _keep(first, last, optics.high[1] * az - ay, oy - optics.high[1] * oz)
    for k in range(3):
        if medium.lo[k] > -inf:
            first, last = _keep(first, last, along[k], eye[k] - medium.lo[k])
        if medium.hi[k] < inf:
            first, last = _keep(first, last, -along[k], medium.hi[k] - eye[k])
    return (first, last) if first < last else (0.0, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def make_ray(optics: Optics, medium: Medium, along: Vector3) -> Ray:
    """The ray of this direction. One that just misses the fog enters it where its neighbours do."""
    entry = 0.0
    for k in range(3):
        if along[k] != 0.0:
            one, other = (medium.lo[k] - optics.eye[k]) / along[k], (medium.hi[k] - optics.eye[k]) / along[k]
            entry = max(entry, min(one, other))
    return Ray(along, sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]), entry)


@njit(cache=True, nogil=True, error_model="numpy")
def tau_of(w: float, kappa: float) -> float:
    """The coordinate of an inverse depth, which may be infinite."""
    return w / (w + kappa) if w < inf else 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _entry_share(medium: Medium, light: Vector3, beam: Vector3) -> float:
    """Largest (side - light) / beam over the sides of the box that the projector's light has to pass; 0 for none."""
    share = 0.0
    for k in range(3):
        way = medium.lo[k] - light[k]
        if way <= 0.0:
            way = min(medium.hi[k] - light[k], 0.0)
        # Rounding at the very border may turn the beam away from a side that it touches.
        if way * beam[k] > 0.0:
            share = max(share, way / beam[k])
    return share


@njit(cache=True, nogil=True, error_model="numpy")
def fog_length(optics: Optics, medium: Medium, ray: Ray, tau: float) -> float:
    """l_p + l_c in metres at a place of a ray that is lit and inside the fog; infinite at infinity."""
    e, f, o = 1.0 - tau, optics.kappa * tau, optics.offset
    if f <= 0.0:
        return inf
    x, y, z = e * ray.along[0] - f * o[0], e * ray.along[1] - f * o[1], e * ray.along[2] - f * o[2]
    beam = sqrt(x * x + y * y + z * z)
    lit = beam * (1.0 / f - _entry_share(medium, optics.light, (x, y, z)))
    return max(lit, 0.0) + ray.length * max(e / f - ray.entry, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def density(optics: Optics, medium: Medium, ray: Ray, tau: float) -> float:
    """Light scattered once into a ray per unit of tau, at a place that is lit and inside the fog."""
    e, f, o, r = 1.0 - tau, optics.kappa * tau, optics.offset, optics.rotation[2]
    x, y, z = e * ray.along[0] - f * o[0], e * ray.along[1] - f * o[1], e * ray.along[2] - f * o[2]
    depth = r[0] * x + r[1] * y + r[2] * z
    if not (depth > NEVER and f > 0.0):
        return 0.0
    beam, near = sqrt(x * x + y * y + z * z), 1.0 / f
    lit = beam * (near - _entry_share(medium, optics.light, (x, y, z)))
    way = max(lit, 0.0) + ray.length * max(e * near - ray.entry, 0.0)
    value = 0.25 * optics.kappa * medium.scattering * beam * ray.length * exp(-medium.extinction * way)
    if medium.g == 0.0:
        return value / (depth * depth * depth)
    mu = -(x * ray.along[0] + y * ray.along[1] + z * ray.along[2]) / (beam * ray.length)
    turned = max(1.0 + medium.g * medium.g - 2.0 * medium.g * mu, 0.0)
    # The phase function's pi is that of the projector's light.
    return value * (1.0 - medium.g * medium.g) / (depth * depth * depth * turned * sqrt(turned))


# Exact integrals: Gauss and Kronrod's rule of 7 and 15 nodes, halved where the two differ.

_NODES: Final = np.array([
    0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
    0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
    0.586087235467691130294144691693, 0.405845151377397166906606412076961,
    0.207784955007898467600689403773245, 0.0,
])  # fmt: skip
_KRONROD: Final = np.array([
    0.022935322010529224963732008058970, 0.063092092629978553290700663189204,
    0.104790010322250183839876322541518, 0.140653259715525918745189590510238,
    0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
    0.204432940075298892414161999234649, 0.209482141084727828012999174891714,
])  # fmt: skip
_GAUSS: Final = np.array([
    0.0, 0.129484966168869693270611432679082, 0.0, 0.279705391489276667901467771423780,
    0.0, 0.381830050505118944950369775488975, 0.0, 0.417959183673469387755102040816327,
])  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _rule(optics: Optics, medium: Medium, ray: Ray, first: float, last: float) -> tuple[float, float]:
    """Integral of the density by 15 nodes, and how far the 7 among them are off."""
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    fine = coarse = 0.0
    for i in range(8):
        value = density(optics, medium, ray, middle + half * _NODES[i])
        if i < 7:
            value += density(optics, medium, ray, middle - half * _NODES[i])
        fine += _KRONROD[i] * value
        coarse += _GAUSS[i] * value
    return half * fine, half * abs(fine - coarse)


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth_integral(
    optics: Optics, medium: Medium, ray: Ray, first: float, last: float, known: float, stack: Doubles
) -> float:
    """Integral over an interval in which the density has no kink, to 1e-10 of it and of `known`, its neighbours'.

    stack (_DEPTH, 2): for the kernel's own use.
    """
    total, held, pieces = 0.0, 0, 0
    while True:
        value, error = _rule(optics, medium, ray, first, last)
        pieces += 1
        middle = 0.5 * (first + last)
        fine = error <= _TOLERANCE * (known + total + value)
        if not fine and held < _DEPTH and pieces < _MOST_PIECES and first < middle < last:
            # The half nearer to the camera first: it holds most of the light, against which the rest is judged.
            stack[held, 0], stack[held, 1] = first, middle
            held += 1
            first = middle
            continue
        total += value
        if held == 0:
            return total
        held -= 1
        first, last = stack[held, 0], stack[held, 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _kinks(optics: Optics, medium: Medium, along: Vector3, out: Doubles) -> int:
    """Places tau at which the projector's light comes to enter the box by another side, (3,); returns how many."""
    count, o, light = 0, optics.offset, optics.light
    for i in range(3):
        for j in range(i):
            a = max(medium.lo[i] - light[i], 0.0) + min(medium.hi[i] - light[i], 0.0)
            b = max(medium.lo[j] - light[j], 0.0) + min(medium.hi[j] - light[j], 0.0)
            if a == 0.0 or b == 0.0:
                continue
            # (side - light) / D alike for both: a (d_j - w o_j) = b (d_i - w o_i).
            top, bottom = a * along[j] - b * along[i], a * o[j] - b * o[i]
            if top * bottom > 0.0:
                out[count] = tau_of(top / bottom, optics.kappa)
                count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _visible_start(optics: Optics, medium: Medium, ray: Ray, first: float, last: float) -> float:
    """Where an interval may begin instead: what lies before is dimmed by exp(-_FADED) against its end.

    The way through the fog grows with distance: what the camera's leg gains the other can at most lose.
    """
    near = fog_length(optics, medium, ray, last)
    if (fog_length(optics, medium, ray, first) - near) * medium.extinction <= _FADED:
        return first
    kept = last
    for _ in range(200):
        middle = 0.5 * (first + kept)
        if not first < middle < kept:
            break
        faded = (fog_length(optics, medium, ray, middle) - near) * medium.extinction
        if faded > _FADED:
            first = middle
        else:
            kept = middle
            if faded > 0.5 * _FADED:
                break
    return first


@njit(cache=True, nogil=True, error_model="numpy")
def integral(
    optics: Optics, medium: Medium, ray: Ray, first: float, last: float, cuts: Doubles, stack: Doubles
) -> float:
    """Light scattered into a ray between two places that are lit and inside the fog, with all in between.

    cuts (3,) and stack (_DEPTH, 2): for the kernel's own use.
    """
    if not first < last:
        return 0.0
    first = _visible_start(optics, medium, ray, first, last)
    count = _kinks(optics, medium, ray.along, cuts)
    total = 0.0
    while last > first:
        start = first
        for i in range(count):
            if start < cuts[i] < last:
                start = cuts[i]
        total += _smooth_integral(optics, medium, ray, start, last, total, stack)
        last = start
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def integrals(optics: Optics, medium: Medium, directions: Doubles, first: Doubles, last: Doubles, out: Doubles) -> None:
    """Add to out (R,) the light scattered into rays (R, 3), z = 1, between first and last (R,), places tau."""
    cuts, stack = np.empty(3), np.empty((_DEPTH, 2))
    for i in range(out.shape[0]):
        if first[i] < last[i]:
            ray = make_ray(optics, medium, (directions[i, 0], directions[i, 1], directions[i, 2]))
            out[i] += integral(optics, medium, ray, first[i], last[i], cuts, stack)


@njit(cache=True, nogil=True, error_model="numpy")
def lit_spans(optics: Optics, medium: Medium, directions: Doubles, out: Doubles) -> None:
    """Places tau (R, 2) between which rays (R, 3), z = 1, are inside fog and raster; 0 and 0 where nowhere."""
    for i in range(out.shape[0]):
        first, last = lit_span(optics, medium, (directions[i, 0], directions[i, 1], directions[i, 2]))
        out[i, 0], out[i, 1] = tau_of(first, optics.kappa), tau_of(last, optics.kappa)
