"""Gated images with the area of pixels: many rays a pixel, each with its own surface point and projector row."""

from __future__ import annotations

import numpy as np

from slopegate.core.gating.gate import recorded_times, row_windows
from slopegate.core.render.render import Cancelled, Progress, make_tracer
from slopegate.core.render.tracing import RAYS_PER_BAND
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.projected import shares
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene


def integrate(
    rig: Rig,
    scene: Scene,
    settings: GateSettings,
    samples: int,
    time_s: float = 0.0,
    progress: Progress | None = None,
    skip: bool = True,
    pattern: Singles | None = None,
) -> Singles:
    """The linear image (H, W, 3) float32 of a gate, each pixel the mean over samples x samples rays.

    The sum of `integrate_parts`, which says the rest.
    """
    direct, ambient = integrate_parts(rig, scene, settings, samples, time_s, progress, skip, pattern)
    return direct + ambient


def integrate_parts(
    rig: Rig,
    scene: Scene,
    settings: GateSettings,
    samples: int,
    time_s: float = 0.0,
    progress: Progress | None = None,
    skip: bool = True,
    pattern: Singles | None = None,
) -> tuple[Singles, Singles]:
    """Direct and ambient light (H, W, 3) float32 of a gate, each pixel the mean over samples x samples rays.

    Every ray's projector row is tested against the one window of the camera row that it belongs to (model section 3).
    Unit: E = 1, so that a gate of one period gives the fully lit image plus the ambient light. `progress` is told the
    share done; Cancelled is raised when it returns False. `skip` as for `make_tracer`. `pattern`: what the projector
    shows, as in `rig.projected`; each ray looks up its own projector pixel. Raises InputError when samples is below 1.
    """
    require(samples >= 1, "samples", samples, "a whole number of at least 1")
    tracer, windows = make_tracer(rig, scene, skip), row_windows(rig, settings)
    bodies = tracer.still() + tracer.moving(time_s)
    periods = settings.exposure_us / rig.projector.period_us
    lens = rig.camera.lens
    shape = lens.height * lens.width, 3
    direct, ambient = np.empty(shape, np.float32), np.empty(shape, np.float32)
    positions = pixel_positions(samples)
    for start in range(0, len(direct), RAYS_PER_BAND):
        if progress is not None and not progress(start / len(direct)):
            raise Cancelled("Rendering was stopped")
        pixels = np.arange(start, min(start + RAYS_PER_BAND, len(direct)))
        rows, columns = np.divmod(pixels, lens.width)
        lit, room = np.zeros((len(pixels), 3)), np.zeros((len(pixels), 3))
        aside, down = pixel_shifts(samples, columns, rows)
        for column, row in positions:
            rays = tracer.trace(columns + (column + aside) % 1, rows + (row + down) % 1, bodies)
            light = rays.direct
            if pattern is not None:
                light = light * shares(pattern, rays.projector_row, rays.projector_column)[:, None]
            lit += recorded_times(windows, rows, rays.projector_row)[:, None] * light
            room += periods * rays.ambient
        direct[pixels], ambient[pixels] = lit / len(positions), room / len(positions)
    return direct.reshape(lens.height, lens.width, 3), ambient.reshape(lens.height, lens.width, 3)


def pixel_positions(samples: int) -> Doubles:
    """Places (samples^2, 2) of rays in a pixel (column part, row part): a regular grid, sheared both ways.

    The shear gives every ray a row and a column of its own, so that an edge along either axis is resolved to
    1 / samples^2 of a pixel.
    """
    across, down = (axis.ravel() for axis in np.meshgrid(np.arange(samples), np.arange(samples)))
    column = (across + (down + 0.5) / samples) / samples
    row = (down + (across + 0.5) / samples) / samples
    return np.stack([column, row], axis=1)


def pixel_shifts(samples: int, columns: Indices, rows: Indices) -> tuple[Doubles, Doubles]:
    """By how much the pixels at these places (P,) move all of their rays (columns, rows), (P,) float64, modulo 1.

    One grid for all pixels would err alike in all of them where a gate's edge runs along its diagonals. Neighbours
    that look at other places err differently, and the mean over 4 x 4 pixels hardly at all. The places are those of a
    sequence without gaps (Roberts's R2). One ray a pixel stays at its centre.
    """
    if samples == 1:
        return np.zeros(len(columns)), np.zeros(len(rows))
    steps, number = samples**2, (4 * (rows % 4) + columns % 4).astype(np.float64)
    # Whole steps of the grid: every pixel keeps the rows and columns that its own mean is taken over.
    aside, down = (np.floor(number * part % 1 * steps) / steps for part in (0.7548776662466927, 0.5698402909980532))
    return np.asarray(aside, np.float64), np.asarray(down, np.float64)
