"""What follows from a calibration's uncertainty for whatever is computed from a rig.

A calibration gives the numbers of a rig with their covariance. What depends on them (the distance of a gate, a depth)
inherits an uncertainty: its derivatives by the numbers, times their covariance (first order propagation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import NUMBERS, Calibration, as_rows
from slopegate.core.rig.rig import Lens, Matrix3, Rig
from slopegate.core.rig.settings import PixelClocks


def numbers_of(rig: Rig) -> Doubles:
    """The rig's `NUMBERS`, (28,) float64; clocks_per_line is 0 where line times are set directly."""
    line = rig.camera.shutter.line
    clocks = line.clocks_per_line if isinstance(line, PixelClocks) else 0.0
    turned = cv2.Rodrigues(np.array(rig.projector_rotation))[0].ravel()
    timing = (rig.projector.period_us, rig.projector.active_fraction, clocks, rig.camera.shutter.delay_offset_us)
    lenses = (_lens_numbers(rig.camera.lens), _lens_numbers(rig.projector.lens))
    return np.concatenate([*lenses, turned, rig.projector_offset_m, timing])


def with_numbers(rig: Rig, numbers: Doubles) -> Rig:
    """The rig with other `NUMBERS`; what lies beyond them (sizes, steps, further distortion) stays."""
    camera, projector = _with_lens(rig.camera.lens, numbers[:9]), _with_lens(rig.projector.lens, numbers[9:18])
    period, active, clocks, offset = map(float, numbers[24:])
    shutter = replace(rig.camera.shutter, delay_offset_us=offset)
    if isinstance(shutter.line, PixelClocks):
        shutter = replace(shutter, line=replace(shutter.line, clocks_per_line=clocks))
    x, y, z = map(float, numbers[21:24])
    return replace(
        rig,
        camera=replace(rig.camera, lens=camera, shutter=shutter),
        projector=replace(rig.projector, lens=projector, period_us=period, active_fraction=min(active, 1.0)),
        projector_offset_m=(x, y, z),
        projector_rotation=_matrix(np.asarray(cv2.Rodrigues(numbers[18:21])[0])),
    )


def spread(rig: Rig, figures: Callable[[Rig, float], Doubles]) -> Doubles | None:
    """Standard errors of figures that depend on the rig, of their shape; None for a rig that was not calibrated.

    figures(rig, late_us): the figures of a rig whose gates come `late_us` later than they are set: an error of the
    delay offset shows in nothing else. Central differences over one standard error each; a figure that does not exist
    on one side is NaN.
    """
    known = rig.calibration
    if known is None:
        return None
    values = numbers_of(rig)
    errors = np.sqrt(np.diag(known.array))
    slopes = []
    for name, error in zip(known.names, errors, strict=True):
        if error == 0:
            slopes.append(np.zeros_like(figures(rig, 0.0)))
            continue
        sides = []
        for step in (error, -error):
            if name == "delay_offset_us":
                sides.append(figures(rig, float(-step)))
            else:
                moved = values.copy()
                moved[NUMBERS.index(name)] += step
                sides.append(figures(with_numbers(rig, moved), 0.0))
        slopes.append((sides[0] - sides[1]) / (2 * error))
    stacked = np.stack(slopes)
    variance = np.einsum("i...,ij,j...->...", stacked, known.array, stacked)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), np.float64)


def transformed(known: Calibration, rig: Rig, change: Callable[[Rig], Rig]) -> Calibration:
    """The calibration of a rig, of the same rig in other terms: `change(rig)`, by its derivatives."""
    values = numbers_of(rig)
    places = [NUMBERS.index(name) for name in known.names]
    slopes = np.zeros((len(places), len(places)))
    for column, (place, error) in enumerate(zip(places, np.sqrt(np.diag(known.array)), strict=True)):
        step = float(error) or 1e-6
        sides = []
        for sign in (1, -1):
            moved = values.copy()
            moved[place] += sign * step
            sides.append(numbers_of(change(with_numbers(rig, moved)))[places])
        slopes[:, column] = (sides[0] - sides[1]) / (2 * step)
    covariance = slopes @ known.array @ slopes.T
    return replace(known, covariance=as_rows((covariance + covariance.T) / 2))


def _lens_numbers(lens: Lens) -> Doubles:
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *(*lens.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]])


def _with_lens(lens: Lens, numbers: Doubles) -> Lens:
    fx, fy, cx, cy, *bent = map(float, numbers)
    further = lens.distortion[5:]
    return replace(lens, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(*bent, *further) if any(bent) or further else ())


def _matrix(rotation: Doubles) -> Matrix3:
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    return ((a, b, c), (d, e, f), (g, h, i))
