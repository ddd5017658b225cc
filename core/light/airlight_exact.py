"""Light scattered once by fog, exactly: ray by ray, to float64. The measure of the table that runs live."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slopegate.core.gating.gate import RowWindows
from slopegate.core.light import airlight_kernels as kernels
from slopegate.core.light.airlight_kernels import Optics
from slopegate.core.render.fog import Medium, medium_of
from slopegate.core.render.tracing import ProjectorFrame, field_of, point
from slopegate.core.rig.arrays import Bools, Doubles
from slopegate.core.rig.rig import Rig, to_pixels
from slopegate.core.rig.triangulate import inverse_depth, to_projector_axes
from slopegate.core.scene.media import Fog

_PLACES = 129
"""Places of a ray at which a distorted projector's raster is looked for."""
_HALVINGS = 60


def make_optics(rig: Rig) -> Optics:
    """The rig for the compiled loops. Through a distorted projector low and high are a little too wide."""
    lens = rig.projector.lens
    if lens.distorted:
        low, high = field_of(lens)
    else:
        low = np.array([-lens.cx / lens.fx, -lens.cy / lens.fy])
        high = np.array([(lens.width - lens.cx) / lens.fx, (lens.height - lens.cy) / lens.fy])
    offset = np.array(rig.projector_offset_m, np.float64)
    rotation = tuple(point(row) for row in rig.rotation)
    return Optics(
        point(rig.camera_centre_m),
        point(rig.projector_centre_m),
        point(offset),
        (rotation[0], rotation[1], rotation[2]),
        (float(low[0]), float(low[1])),
        (float(high[0]), float(high[1])),
        # A rig works at about ten times its baseline.
        0.1 / rig.baseline_m,
    )


def exact_airlight(
    rig: Rig, fog: Fog, directions: Doubles, depths: Doubles, windows: RowWindows, camera_rows: NDArray[np.integer]
) -> Doubles:
    """What the windows of these camera rows (R,) record of the light that fog scatters once into rays, (R,) float64.

    directions (R, 3), z = 1, from the camera end at depths (R,) in metres, which may be infinite. Nothing in between
    casts a shadow. Unit and radiance as in `render.Buffers`. To 1e-9 relative (tests hold it to 1e-6 of adaptive
    quadrature).
    """
    out = np.zeros(len(directions))
    medium = medium_of(fog)
    if medium is None or medium.scattering == 0:
        return out
    optics = make_optics(rig)
    inside, outside = windows.inside[camera_rows], windows.outside[camera_rows]
    ends = 1 / (1 + optics.kappa * depths)
    for first, last in _pieces(rig, optics, medium, directions):
        start = np.minimum(np.maximum(first, ends), last)
        begin, end = _gated(rig, optics, directions, (first, last), windows, camera_rows)
        # Before, in and behind the window: sums of light, not differences, which rounding could make negative.
        begin = np.clip(begin, start, last)
        end = np.clip(end, begin, last)
        for count, one, other in ((outside, start, begin), (inside, begin, end), (outside, end, last)):
            if count.any():
                out += count * _light(optics, medium, directions, one, other)
    return out


def _light(optics: Optics, medium: Medium, directions: Doubles, first: Doubles, last: Doubles) -> Doubles:
    out = np.zeros(len(directions))
    kernels.integrals(optics, medium, directions, first, last, out)
    return out


def _pieces(rig: Rig, optics: Optics, medium: Medium, directions: Doubles) -> list[tuple[Doubles, Doubles]]:
    """Where rays are lit and inside the fog: intervals of tau, (R,) each; empty ones end where they begin."""
    spans = np.empty((len(directions), 2))
    kernels.lit_spans(optics, medium, directions, spans)
    if not rig.projector.lens.distorted:
        return [(spans[:, 0], spans[:, 1])]
    frame, (turned, change) = ProjectorFrame(rig.projector), to_projector_axes(rig, directions)

    def lit(tau: Doubles) -> Bools:
        """Whether the raster holds the places tau (R, P)."""
        at = (1 - tau)[..., None] * turned[:, None] - (optics.kappa * tau)[..., None] * change
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = at / np.where(at[..., 2:] > 0, at[..., 2:], np.nan)
        return np.asarray(frame.rows(slopes.reshape(-1, 3)) >= 0).reshape(tau.shape)

    places = spans[:, :1] + (spans[:, 1:] - spans[:, :1]) * np.linspace(0, 1, _PLACES)
    holds = lit(places) & (spans[:, 1:] > spans[:, :1])
    padded = np.pad(holds, ((0, 0), (1, 1)))
    starts, stops = holds & ~padded[:, :-2], holds & ~padded[:, 2:]
    order = np.cumsum(starts, axis=1)
    found = []
    for number in range(1, int(order.max(initial=0)) + 1):
        some = order[:, -1] >= number
        begin = np.argmax(starts & (order == number), axis=1)
        after = np.argmax(stops & (order == number), axis=1)
        rows = np.arange(len(directions))
        before, beyond = np.maximum(begin - 1, 0), np.minimum(after + 1, _PLACES - 1)
        first = _halved(lit, places[rows, before], places[rows, begin])
        last = _halved(lit, places[rows, beyond], places[rows, after])
        found.append((first, np.where(some, last, first)))
    return found


def _halved(lit: Callable[[Doubles], Bools], out: Doubles, within: Doubles) -> Doubles:
    """The border between places that are lit, `within`, and others, by halving; `within` where both are the same."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (out + within)
        holds = lit(middle[:, None])[:, 0]
        out, within = np.where(holds, out, middle), np.where(holds, middle, within)
    return within


def _gated(
    rig: Rig,
    optics: Optics,
    directions: Doubles,
    lit: tuple[Doubles, Doubles],
    windows: RowWindows,
    camera_rows: NDArray[np.integer],
) -> tuple[Doubles, Doubles]:
    """The part of lit intervals whose projector rows lie in the windows, from low to below high."""
    turned, change = to_projector_axes(rig, directions)
    first, last = lit
    rows = [
        to_pixels(rig.projector.lens, (1 - tau)[:, None] * turned - (optics.kappa * tau)[:, None] * change)[1]
        for tau in lit
    ]
    for edge, above in ((windows.low[camera_rows], True), (windows.high[camera_rows], False)):
        met, _ = inverse_depth(rig, directions, edge)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = np.clip(np.nan_to_num(met / (met + optics.kappa)), *lit)
        # On a ray rows only rise or only fall: its ends tell on which side of the edge either lies.
        starts_in, ends_in = (rows[0] >= edge) == above, (rows[1] >= edge) == above
        first, last = (
            np.where(starts_in, first, np.maximum(first, np.where(ends_in, crossing, lit[1]))),
            np.where(ends_in, last, np.minimum(last, np.where(starts_in, crossing, lit[0]))),
        )
    return first, last
