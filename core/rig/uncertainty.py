"""What follows from a calibration's uncertainty for whatever is computed from a rig.

A calibration gives the numbers of a rig with their covariance. What depends on them (the distance of a gate, a depth)
inherits an uncertainty: its derivatives by the numbers, times their covariance (first order propagation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import NUMBERS, Calibration, as_rows
from slopegate.core.rig.rig import Lens, Rig, matrix3
from slopegate.core.rig.settings import MAX_TIME_US, MIN_PERIOD_US, GateSettings, PixelClocks, gate

_SMALLEST: Final = 1e-5
"""Steps of derivatives are at least this share of the largest ones, so that rounding does not rule them."""
_TURN: Final = slice(NUMBERS.index("rotation_x_rad"), NUMBERS.index("rotation_z_rad") + 1)
_SAME: Final = 1e-6
"""Share of a standard error below which another is rounding."""


def numbers_of(rig: Rig) -> Doubles:
    """The rig's `NUMBERS`, (28,) float64; clocks_per_line is 0 where line times are set directly."""
    line = rig.camera.shutter.line
    clocks = line.clocks_per_line if isinstance(line, PixelClocks) else 0.0
    import cv2  # large, and only calibrated rigs need it

    turned = cv2.Rodrigues(np.array(rig.projector_rotation))[0].ravel()
    timing = (rig.projector.period_us, rig.projector.active_fraction, clocks, rig.camera.shutter.delay_offset_us)
    lenses = (_lens_numbers(rig.camera.lens), _lens_numbers(rig.projector.lens))
    return np.concatenate([*lenses, turned, rig.projector_offset_m, timing])


def with_numbers(rig: Rig, numbers: Doubles) -> Rig:
    """The rig with other `NUMBERS`, which nothing is known of; what lies beyond them (sizes, steps) stays."""
    camera, projector = _with_lens(rig.camera.lens, numbers[:9]), _with_lens(rig.projector.lens, numbers[9:18])
    period, active, clocks, offset = map(float, numbers[24:])
    shutter = replace(rig.camera.shutter, delay_offset_us=offset)
    if isinstance(shutter.line, PixelClocks):
        shutter = replace(shutter, line=replace(shutter.line, clocks_per_line=clocks))
    x, y, z = map(float, numbers[21:24])
    import cv2

    return replace(
        rig,
        camera=replace(rig.camera, lens=camera, shutter=shutter),
        projector=replace(rig.projector, lens=projector, period_us=period, active_fraction=min(active, 1.0)),
        projector_offset_m=(x, y, z),
        projector_rotation=matrix3(cv2.Rodrigues(numbers[18:21])[0]),
        calibration=None,
    )


def spread(rig: Rig, figures: Callable[[Rig, float], Doubles]) -> Doubles | None:
    """Standard errors of figures that depend on the rig, of their shape; None for a rig that was not calibrated.

    figures(rig, late_us): the figures of a rig whose gates come `late_us` later than they are set: an error of the
    delay offset shows in nothing else. Central differences over one standard error each, or less where that would leave
    what a rig can be; a figure that does not exist on one side is NaN, and so is its standard error.
    """
    known = rig.calibration
    if known is None:
        return None
    values = numbers_of(rig)
    slopes = []
    for name, error in zip(known.names, np.sqrt(np.diag(known.array)), strict=True):
        if error == 0:
            continue
        place = NUMBERS.index(name)
        low, high = beside(values, place, float(error))
        ends = [_figures_at(rig, values, place, end, figures) for end in (low, high)]
        slopes.append((ends[1] - ends[0]) * (error / (high - low)))
    if not slopes:
        return np.zeros_like(figures(rig, 0.0))
    stacked, correlation = np.stack(slopes), known.correlation
    variance = np.einsum("i...,ij,j...->...", stacked, correlation, stacked, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), np.float64)


def _figures_at(
    rig: Rig, values: Doubles, place: int, value: float, figures: Callable[[Rig, float], Doubles]
) -> Doubles:
    """The figures where one of the rig's numbers is another."""
    if NUMBERS[place] == "delay_offset_us":
        # cameras are told of the offset that is believed in: where it is longer, gates come too early
        return figures(rig, float(values[place]) - value)
    moved = values.copy()
    moved[place] = value
    return figures(with_numbers(rig, moved), 0.0)


def really_made(believed: Rig, settings: GateSettings, rig: Rig, late_us: float) -> GateSettings:
    """The gate that settings make on `rig`, `late_us` later, where they were computed for another one.

    A camera is set to a pixel clock: its line time is what that is on the rig that it belongs to.
    """
    line, told = rig.camera.shutter.line, believed.camera.shutter.line
    stretch = 1.0
    if isinstance(line, PixelClocks) and isinstance(told, PixelClocks):
        stretch = line.clocks_per_line / told.clocks_per_line
    return gate(settings.line_time_us * stretch, float(settings.delay_us) + late_us, settings.exposure_us)


def retold(rig: Rig, change: Callable[[Rig], Rig]) -> Rig:
    """`change(rig)`, which is the same rig in other terms, with its calibration in those terms."""
    other = change(rig)
    if rig.calibration is None:
        return other
    return replace(other, calibration=transformed(rig.calibration, rig, change))


def still_known(before: Rig, after: Rig) -> Rig:
    """`after`, whose calibration is left with the numbers that it has as `before`."""
    known = after.calibration
    if known is None:
        return after
    changed = numbers_of(before) != numbers_of(after)
    kept = [place for place, name in enumerate(known.names) if not changed[NUMBERS.index(name)]]
    if not kept:
        return replace(after, calibration=None)
    names, covariance = tuple(known.names[place] for place in kept), known.array[np.ix_(kept, kept)]
    return replace(after, calibration=replace(known, names=names, covariance=as_rows(covariance)))


def transformed(known: Calibration, rig: Rig, change: Callable[[Rig], Rig]) -> Calibration:
    """The calibration of a rig, of the same rig in other terms: `change(rig)`, by its derivatives.

    It tells what the other did, and the angles that follow from those that it told.
    """
    values, middle = numbers_of(rig), numbers_of(change(rig))
    slopes = np.zeros((len(NUMBERS), len(known.names)))
    errors = np.sqrt(np.diag(known.array))
    for column, (name, error) in enumerate(zip(known.names, errors, strict=True)):
        place = NUMBERS.index(name)
        low, high = beside(values, place, float(error))
        ends = []
        for value in (low, high):
            moved = values.copy()
            moved[place] = value
            ends.append(_near(numbers_of(change(with_numbers(rig, moved))), middle))
        slopes[:, column] = (ends[1] - ends[0]) / (high - low)
    covariance = slopes @ known.array @ slopes.T
    spreads = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    turned = range(len(NUMBERS))[_TURN]
    mixed = [NUMBERS[one] for one in turned if spreads[one] > _SAME * spreads[_TURN].max()]
    names = (*known.names, *(name for name in mixed if name not in known.names))
    kept = [NUMBERS.index(name) for name in names]
    covariance = covariance[np.ix_(kept, kept)]
    return replace(known, names=names, covariance=as_rows((covariance + covariance.T) / 2))


def beside(values: Doubles, place: int, error: float) -> tuple[float, float]:
    """The number one standard error less and more, within what a rig may have and where it still is nearly linear."""
    value, name = float(values[place]), NUMBERS[place]
    lens = values[9:18] if name.startswith("projector.") else values[:9]
    key = name.removeprefix("projector.").removeprefix("camera.")
    if key in ("fx", "fy", "cx", "cy"):
        largest = 0.01 * float(lens[0])
    elif key.startswith("offset_"):
        largest = 0.01 * float(np.linalg.norm(values[21:24]))
    elif name in ("period_us", "active_fraction", "clocks_per_line"):
        largest = 0.001 * value
    else:
        largest = 10.0 if name == "delay_offset_us" else 0.01
    step = min(max(error, _SMALLEST * largest), largest)
    low, high = value - step, value + step
    if name == "active_fraction":
        high = min(high, 1.0)
    if name == "period_us":
        low, high = max(low, MIN_PERIOD_US), min(high, MAX_TIME_US)
    return low, high


def _near(numbers: Doubles, middle: Doubles) -> Doubles:
    """The numbers with their rotation vector written as the one near `middle`'s: about half a turn there are two."""
    turn = numbers[_TURN]
    angle = float(np.linalg.norm(turn))
    if not angle:
        return numbers
    other = turn * (1 - 2 * np.pi / angle)
    if np.linalg.norm(other - middle[_TURN]) < np.linalg.norm(turn - middle[_TURN]):
        numbers = numbers.copy()
        numbers[_TURN] = other
    return numbers


def _lens_numbers(lens: Lens) -> Doubles:
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *(*lens.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]])


def _with_lens(lens: Lens, numbers: Doubles) -> Lens:
    fx, fy, cx, cy, *bent = map(float, numbers)
    further = lens.distortion[5:]
    return replace(lens, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(*bent, *further) if any(bent) or further else ())
