"""The timing from a capture on disk: its slices are gates, and between them they show the plane fully lit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.informative import GOAL, TimingGoal
from slopegate.core.calibration.target import FlatTarget
from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.lit_view import LitView
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.calibrations.plane_gates import PlaneGates, TimingOutcome
from slopegate.drivers.calibrations.seen_target import seen_chart, seen_plane
from slopegate.drivers.captures.model import SliceRecord
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.contract.frame import filters

LEAST_SLICES: Final = 4
WHOLE: Final = 0.98
"""Of a period: a slice exposed at least so long shows everything lit by itself."""


def timing_of_capture(
    capture: Capture,
    rig: Rig,
    target: Chart | FlatTarget,
    goal: TimingGoal = GOAL,
    told: Callable[[float], object] = lambda share: None,
) -> TimingOutcome:
    """What a capture's slices tell of the timing.

    rig: whose geometry counts; gates were set by the capture's own rig, whose shutter therefore counts. `told` is given
    the share done. Raises CalibrationError in one sentence where the capture does not do, StorageError.
    """
    records = {index: record for index, record in capture.records().items() if not record.empty}
    if len(records) < LEAST_SLICES:
        raise CalibrationError(
            f"{capture.path} has {len(records)} slices with light: at least {LEAST_SLICES}, through several gates of a "
            "plane, tell a timing"
        )
    by = _gated_by(rig, capture)
    view = _lit_view(capture, by, records, lambda share: told(0.5 * share))
    camera = capture.manifest.camera
    if isinstance(target, Chart):
        seen = seen_chart(view, by, target, bool(filters(camera.pixel_format)))
    else:
        seen = seen_plane(view, by, target)
    gates = PlaneGates(by, view, seen, camera.max_count, goal)
    for done, (index, record) in enumerate(records.items()):
        gates.add(capture.mean(index), record.applied.settings())
        told(0.5 + 0.5 * done / len(records))
    return gates.outcome(camera.name)


def _gated_by(rig: Rig, capture: Capture) -> Rig:
    """The rig with the shutter that the capture was made with. Raises CalibrationError for another camera's."""
    lens, (height, width) = rig.camera.lens, capture.shape
    if (lens.width, lens.height) != (width, height):
        raise CalibrationError(
            f"{capture.path} has pictures of {width} x {height} pixels and the rig's camera has {lens.width} x "
            f"{lens.height}: give the rig file of the camera that took them"
        )
    return replace(rig, camera=replace(rig.camera, shutter=capture.rig.camera.shutter))


def _lit_view(capture: Capture, rig: Rig, records: dict[int, SliceRecord], told: Callable[[float], object]) -> LitView:
    """Everything lit: of slices exposed for a whole period their mean; else what is most in any slice, for each records
    light once or not at all."""
    whole = [index for index, one in records.items() if one.applied.exposure_us >= WHOLE * rig.projector.period_us]
    dark, most = capture.dark_mean(), capture.manifest.camera.max_count
    full: Singles | None = None
    saturated: Bools = np.zeros(capture.shape, np.bool_)
    used = whole or list(records)
    for done, index in enumerate(used):
        image = capture.mean(index)
        saturated |= image >= most
        lit = image - dark
        full = lit if full is None else full + lit if whole else np.maximum(full, lit)
        told(done / len(used))
    assert full is not None
    record = capture.dark_record()
    noise = 0.0 if record is None or record.noise_counts is None else record.noise_counts
    full = full / np.float32(len(whole)) if whole else full
    # Other light is in the dark frame neither, for the lens is covered: it counts as the slices' own.
    ambient = np.zeros(capture.shape, np.float32)
    return LitView(full, ambient, dark, noise / capture.manifest.frames**0.5, saturated)
