"""How well a swept depth is known where the rig was calibrated: its standard error, pixel by pixel.

A sweep finds the time t at which a pixel is lit: row_p / v_p - line_time row_c = t, where row_p is the projector's row
of the point at w = 1/z on the pixel's ray. So every number of the rig moves w by dw = -du / u_w, the camera's own
numbers by turning the ray; derivatives are in closed form (`rig.row_slopes`). A pixel's time is known to lie within an
interval of projector rows, the same everywhere: that is the sweep's own error.

The variance of w is smooth over the picture and over w, whatever the scene: it is computed at `_NODES` and interpolated
by polynomials, to `ACCURACY` of itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.gating.gate import upright_line_time
from slopegate.core.measure.sweep import DepthMap
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.calibration import NUMBERS
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.row_slopes import OFFSET, lit, seen
from slopegate.core.rig.settings import PixelClocks

ACCURACY: Final = 3e-3
"""Relative error of the standard errors by interpolating them, for depths of 0.35 to 4 m and usual lenses."""
_NODES: Final = (9, 9, 5)
"""Of columns, rows and inverse depths: where polynomials through them err least (Chebyshev's)."""
_LEAST_AHEAD: Final = 0.05
"""A node that the projector sees at a lesser share of its distance ahead is no place to compute at."""
_BAND_PIXELS: Final = 1 << 15
_PERIOD, _ACTIVE, _CLOCKS, _LATE = (
    NUMBERS.index(name) for name in ("period_us", "active_fraction", "clocks_per_line", "delay_offset_us")
)


@dataclass(frozen=True, eq=False)
class DepthErrors:
    """One standard error of each depth, metres (H, W) float32, NaN where it is unknown: by the rig's numbers, which err
    everywhere together, and by the sweep's own steps, which err pixel by pixel."""

    rig_m: Singles
    sweep_m: Singles

    @property
    def total_m(self) -> Singles:
        """Of both, (H, W) float32."""
        total: Singles = np.hypot(self.rig_m, self.sweep_m)
        return total

    @property
    def medians_m(self) -> tuple[float, float, float] | None:
        """Of both, of the rig's and of the sweep's, over the pixels with a depth; None where there are none."""
        known = np.isfinite(self.rig_m)
        if not known.any():
            return None
        total, rig, sweep = (float(np.median(one[known])) for one in (self.total_m, self.rig_m, self.sweep_m))
        return total, rig, sweep


def depth_errors(rig: Rig, found: DepthMap) -> DepthErrors | None:
    """Of the depth map that a sweep with this rig found; None where the rig was not calibrated."""
    if rig.calibration is None:
        return None
    known = found.known
    rig_m, sweep_m = (np.full(known.shape, np.nan, np.float32) for _ in range(2))
    if known.any():
        inverse = found.inverse_depth[known].astype(np.float64)
        row_us = found.resolution_rows / math.sqrt(12) / rig.projector.rows_per_us
        by_rig, by_time = _interpolated(rig, known, inverse)
        rig_m[known] = np.sqrt(np.maximum(by_rig, 0.0)) / inverse**2
        sweep_m[known] = row_us * np.sqrt(np.maximum(by_time, 0.0)) / inverse**2
    return DepthErrors(rig_m, sweep_m)


def _interpolated(rig: Rig, known: Bools, inverse: Doubles) -> tuple[Singles, Singles]:
    """`variances` of the known pixels, in their order, by their inverse depths (n,)."""
    height, width = known.shape
    low, high = float(inverse.min()), float(inverse.max())
    columns, rows, depths = (
        _chebyshev(*span, count)
        for span, count in zip(
            ((0.5, width - 0.5), (0.5, height - 0.5), (low, max(high, low * 1.01))), _NODES, strict=True
        )
    )
    grid = np.meshgrid(columns, rows, depths, indexing="ij")
    at_nodes = variances(rig, *(one.ravel() for one in grid))
    if not all(np.isfinite(one).all() for one in at_nodes):
        return _one_by_one(rig, known, inverse)
    lens = rig.camera.lens
    over_columns, over_rows, by_depth = (
        _through(nodes, places).astype(np.float32)
        for nodes, places in ((columns, lens.column_centres), (rows, lens.row_centres), (depths, inverse))
    )
    found = np.zeros((2, len(inverse)), np.float32)
    for which, values in enumerate(at_nodes):
        for place, plane in enumerate(np.moveaxis(values.reshape(_NODES), 2, 0)):
            whole = over_rows @ plane.T.astype(np.float32) @ over_columns.T
            found[which] += by_depth[:, place] * whole[known]
    return found[0], found[1]


def _one_by_one(rig: Rig, known: Bools, inverse: Doubles) -> tuple[Singles, Singles]:
    """The same without nodes, where some lie beside the projector."""
    lens = rig.camera.lens
    places = np.nonzero(known)
    rows, columns = lens.row_centres[places[0]], lens.column_centres[places[1]]
    found = np.zeros((2, len(inverse)), np.float32)
    for first in range(0, len(inverse), _BAND_PIXELS):
        band = slice(first, first + _BAND_PIXELS)
        found[:, band] = variances(rig, columns[band], rows[band], inverse[band])
    return found[0], found[1]


def variances(rig: Rig, columns: Doubles, rows: Doubles, inverse: Doubles) -> tuple[Doubles, Doubles]:
    """Variance of the inverse depth, 1/m^2, of pixels at these places, (n,) each: by the rig, and by a microsecond.

    NaN where the projector does not look that way.
    """
    known = rig.calibration
    assert known is not None
    offset, row_us, line_us = np.array(rig.projector_offset_m), 1 / rig.projector.rows_per_us, upright_line_time(rig)
    rays = rig.camera_rays(columns, rows)
    points = rays - inverse[:, None] * offset
    ahead = points @ rig.rotation[2]
    bad = ahead < _LEAST_AHEAD * np.linalg.norm(points, axis=1)
    points[bad] = rig.rotation[2]  # anything before it: left out below
    camera, projector = seen(rig, rays), lit(rig, points)
    along = projector.by_points[:, 1]
    times = row_us * projector.by_numbers[:, 1]
    times[:, OFFSET] -= row_us * inverse[:, None] * along
    # a pixel stays where it is: the ray turns where the camera's numbers change
    turns = -np.linalg.solve(camera.by_points[:, :, :2], camera.by_numbers)
    times += row_us * np.einsum("nk,nkp->np", along[:, :2], turns)
    lit_us = row_us * projector.pixels[:, 1]
    times[:, _PERIOD], times[:, _ACTIVE] = lit_us / rig.projector.period_us, lit_us / rig.projector.active_fraction
    times[:, _LATE] = 1.0
    line = rig.camera.shutter.line
    if isinstance(line, PixelClocks):
        times[:, _CLOCKS] = -rows * line_us / line.clocks_per_line
    by_w = -row_us * along @ offset
    slopes = times[:, [NUMBERS.index(name) for name in known.names]] / by_w[:, None]
    spread = np.einsum("np,pq,nq->n", slopes, known.array, slopes, optimize=True)
    return np.where(bad, np.nan, spread), np.where(bad, np.nan, by_w**-2.0)


def _chebyshev(low: float, high: float, count: int) -> Doubles:
    places: Doubles = np.cos((np.arange(count) + 0.5) * np.pi / count)
    return (low + high) / 2 + (high - low) / 2 * places


def _through(nodes: Doubles, places: Doubles) -> Doubles:
    """(places, nodes): what each node's value counts at each place, of the polynomial through all of them."""
    found = np.ones((len(places), len(nodes)))
    for one, node in enumerate(nodes):
        for other in np.delete(nodes, one):
            found[:, one] *= (places - other) / (node - other)
    return found
