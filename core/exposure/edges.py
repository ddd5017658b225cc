"""Row windows and image planes in the form that the kernels take: float32 edges, tables of tiles."""

from __future__ import annotations

import numpy as np

from slopegate.core.exposure.kernels import TILE, Pixels, Planes, Windows, tile_bounds
from slopegate.core.gating.gate import RowWindows
from slopegate.core.rig.arrays import Doubles, Singles


def kernel_windows(windows: RowWindows) -> Windows:
    """Row windows with float32 edges, rounded up: then r < edge and r >= edge have the same truth for every float32 r.

    So float32 kernels decide exactly as float64 ones would, and windows that share an edge still share it. All that
    float32 costs is that the pixel's own projector row r is rounded, once. What that moves, derived:

    - r lies in [0, N_p) with N_p <= 2^n rows, where float32 values are at most 2^(n - 24) apart: |dr| <= 2^(n - 25),
      3.1e-5 projector rows for 720. (The last step below N_p is a whole one: r = N_p would be off the raster.)
    - A camera row's window, seen along the camera's rows, is that of a rig whose kappa_p = (r - c_p) / f_p is off by
      dr / f_p. With kappa_p = kappa_c + b w that is the same light in camera row r_c - f_c dr / f_p: the edge errs by
      at most 2^(n - 25) f_c / f_p camera rows: 5.1e-5 for the check rig, 1 / 196 of the 0.01 that is allowed, and below
      0.01 for every rig with f_c / f_p < 40 and N_p <= 8192.
    - No depth stands in this: r = f_p (kappa_c + b w) + c_p stays within the raster from the nearest lit surface
      (0.3 m and nearer) to infinity, w = 0, where it is as finite as anywhere. In inverse depth the error is
      dr / (f_p b) everywhere: 3.1e-7 / m for the check rig, 0.03 um at 0.3 m, 0.3 um at 1 m, 31 um at 10 m.
    - The edges themselves are off by less than 2.3e-11 rows (`gate.row_windows`), and r before it is rounded by a few
      roundings of float64: 1e-12 rows; neither matters beside dr.
    """
    return Windows(_round_up(windows.low), _round_up(windows.high), windows.inside, windows.outside)


def _round_up(edges: Doubles) -> Singles:
    """The least float32 that is not below each edge; an edge that a float32 holds stays what it is."""
    nearest = edges.astype(np.float32)
    return np.where(nearest < edges, np.nextafter(nearest, np.float32(np.inf)), nearest)


def make_planes(projector_row: Singles, direct: Pixels, ambient: Pixels, skip: bool = True) -> Planes:
    """Planes (H, W) with their tile tables; the arrays are kept, not copied. Without `skip` no tile is left out."""
    height, width = projector_row.shape
    low = np.empty((height, -(-width // TILE)), np.float32)
    high = np.empty_like(low)
    if skip:
        tile_bounds(projector_row, (0, height), low, high)
    else:
        low[...], high[...] = -1, np.inf
    return Planes(projector_row, direct, ambient, low, high)


def some_rows(planes: Planes, windows: Windows, first: int, last: int) -> tuple[Planes, Windows]:
    """What belongs to camera rows first .. last - 1, as views."""
    rows = slice(first, last)
    cut = Planes(
        planes.projector_row[rows],
        planes.direct[rows],
        planes.ambient[rows],
        planes.tile_low[rows],
        planes.tile_high[rows],
    )
    return cut, Windows(windows.low[rows], windows.high[rows], windows.inside[rows], windows.outside[rows])
