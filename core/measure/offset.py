"""How far a gate's window stands from the row that lights a place directly.

A window beside the direct row records only light that went astray: under skin, in fog, between surfaces (Kubo et al.
2018, section VI-C, figure 12). The place is one point of the image with the projector row that lights it, known from
the scene or found by moving the window over it. All of it is the law of `gate.phase_us`: a gate's window covers the
phases delay - exposure / 2 .. delay + exposure / 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from slopegate.core.gating.gate import phase_us
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise

Box = tuple[int, int, int, int]
"""x0, y0, x1, y1: columns x0 .. x1 - 1 of rows y0 .. y1 - 1."""

COARSE: Final = 24
"""Windows of equal width that cover a projector period."""
LEAST_SHARE: Final = 0.25
"""A peak this much above the mean of all windows, as a share of it, is light; less is noise."""


@dataclass(frozen=True)
class LitPlace:
    """A point of the image, by its continuous camera row, and the projector row coordinate that lights it."""

    camera_row: float
    projector_row: float


def place_in(rig: Rig, projector_row: Singles, box: Box) -> LitPlace | None:
    """The middle of a box, from the projector rows (H, W) of its pixels (-1: unlit); None where none is lit.

    The median of what each pixel says of the middle row, as if the surface were frontal: a tilted one adds as much
    above the middle as it takes below.
    """
    x0, y0, x1, y1 = box
    part = projector_row[y0:y1, x0:x1].astype(np.float64)
    middle = (y0 + y1) / 2
    rows_per_row = rig.projector.lens.fy / rig.camera.lens.fy
    moved = part - (np.arange(y0, y1)[:, None] + 0.5 - middle) * rows_per_row
    lit = part >= 0
    return LitPlace(middle, float(np.median(moved[lit]))) if lit.any() else None


def direct_delay_us(rig: Rig, line_time_us: float, place: LitPlace) -> float:
    """The delay of the gate whose window is centred on the direct row, microseconds."""
    return float(phase_us(rig, line_time_us, np.array(place.camera_row), np.array(place.projector_row)))


def offset_rows(rig: Rig, settings: GateSettings, place: LitPlace) -> float:
    """Projector rows from the direct row to the middle of the window, the shorter way round the period."""
    period_us = rig.projector.period_us
    late_us = settings.delay_us - direct_delay_us(rig, settings.line_time_us, place)
    return ((late_us + period_us / 2) % period_us - period_us / 2) * rig.projector.rows_per_us


def with_offset(rig: Rig, settings: GateSettings, place: LitPlace, rows: float) -> GateSettings:
    """The same gate, with the middle of its window so many projector rows from the direct row."""
    delay = direct_delay_us(rig, settings.line_time_us, place) + rows / rig.projector.rows_per_us
    return gate(settings.line_time_us, delay, settings.exposure_us)


def coarse_gates(rig: Rig, line_time_us: float) -> list[GateSettings]:
    """Gates that together cover the projector's period once, for the first look at where a place is lit."""
    width = rig.projector.period_us / COARSE
    asked = [gate(line_time_us, (k + 0.5) * width, width) for k in range(COARSE)]
    return [quantise(rig.camera.shutter, one, rig.projector.period_us) for one in asked]


def fine_gates(rig: Rig, best: GateSettings) -> list[GateSettings]:
    """Narrow gates, each half over the next, that cover a coarse one and half of both its neighbours."""
    width = max(best.exposure_us / 8, rig.camera.shutter.exposure_us.min)
    delays = np.arange(best.delay_us - best.exposure_us, best.delay_us + best.exposure_us + width / 2, width / 2)
    asked = [gate(best.line_time_us, float(delay), width) for delay in delays]
    return [quantise(rig.camera.shutter, one, rig.projector.period_us) for one in asked]


def brightest(light: Doubles) -> int:
    """Which of the coarse gates (N,) records the direct light. Raises InputError where none stands out."""
    mean = float(light.mean())
    stands_out = mean > 0 and float(light.max()) > (1 + LEAST_SHARE) * mean
    if not stands_out:
        raise InputError("the marked place shows no more of the projector's light at one delay than at others")
    return int(light.argmax())


def place_from(rig: Rig, camera_row: float, gates: list[GateSettings], light: Doubles) -> LitPlace:
    """The place that recorded this much light (N,) by the fine gates: the middle of what is above half the peak."""
    require(len(gates) == light.size > 0, "light", light.size, f"one value a gate, which is {len(gates)}")
    above = np.maximum(light - (float(light.min()) + float(light.max())) / 2, 0.0)
    period_us, first = rig.projector.period_us, float(gates[int(light.argmax())].delay_us)
    # delays of the hardware may be a period apart: all are taken as near to the peak's as they can be
    late = [(float(one.delay_us) - first + period_us / 2) % period_us - period_us / 2 for one in gates]
    weight = float(above.sum())
    delay = first + (float(np.dot(above, late)) / weight if weight > 0 else 0.0)
    line_time_us = gates[0].line_time_us
    row = (delay + camera_row * line_time_us) % period_us * rig.projector.rows_per_us
    return LitPlace(camera_row, row)


def at_line_time(settings: GateSettings, rig: Rig, place: LitPlace, line_time_us: float) -> GateSettings:
    """The same window over the place with another line time: the slab turns, and the offset stays."""
    rows = offset_rows(rig, settings, place)
    return with_offset(rig, replace(settings, line_time_us=line_time_us), place, rows)
