"""What the mask panel lets a worker do: find the best gate for a region, and measure what it really keeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slopegate.app.session.loading import CancelledError, Progress
from slopegate.core.gating.gate import complement
from slopegate.core.measure.mask import GOOD_IOU, MaskGate, best_gate, overlap, seen_in_frames
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.stream.depth_run import frames_behind
from slopegate.drivers.stream.stream import Stream

Bools = NDArray[np.bool_]

_WHOLE = 0.01
"""A gate and its complement make whole periods, to within the shutter's steps."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A painted region (H, W), what is to become of it, and which projector row lights each pixel (-1: none)."""

    region: Bools
    hide: bool
    projector_row: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Found:
    """The answer to `Wanted`."""

    wanted: Wanted
    best: MaskGate


@dataclass(frozen=True)
class Achieved:
    """What two frames showed, the one of the gate and the one of its complement."""

    iou: float
    told_share: float
    """Share of the lit pixels that are bright enough to tell."""


def find(rig: Rig, wanted: Wanted, progress: Progress) -> Found:
    """Try every line time. Raises ValueError where the region has no lit pixel."""
    progress.step(0.0, "Trying every clock ...")
    return Found(wanted, best_gate(rig, wanted.projector_row, wanted.region, wanted.hide))


def measure(
    stream: Stream, rig: Rig, black_count: float, sent: GateSettings, wanted: Wanted, progress: Progress
) -> Achieved:
    """Take a frame of the gate and one of its complement from the running camera and compare with the region.

    Raises CameraError, ValueError while something else takes every frame, or CancelledError.
    """
    with frames_behind(stream, lambda: not progress.report(0.5, "Measuring ...")) as take:
        got = [take(settings) for settings in (sent, complement(sent, rig.projector.period_us))]
    first, second = got
    if first is None or second is None:
        raise CancelledError
    both_us, period_us = first[1].exposure_us + second[1].exposure_us, rig.projector.period_us
    if abs(both_us / period_us - round(both_us / period_us)) > _WHOLE:
        raise CameraError("this camera does not make the complement of its gate, against which it would be measured.")
    seen, told = seen_in_frames(first[0], second[0], black_count)
    chosen = ~seen if wanted.hide else seen
    lit = wanted.projector_row >= 0
    told &= lit
    share = int(np.count_nonzero(told)) / max(int(np.count_nonzero(lit)), 1)
    return Achieved(overlap(chosen, wanted.region, told), share)


def found_text(found: Found) -> str:
    """How well the gate does what is wanted, and whether that is good."""
    best, verb = found.best, "mask" if found.wanted.hide else "keep"
    region = best.hit_pixels + best.missed_pixels
    numbers = (
        f"overlap {best.iou:.3f} ({best.hit_pixels / region:.0%} of the region, and "
        f"{best.extra_pixels / region:.0%} of its area elsewhere)"
    )
    if best.good:
        return f"Predicted: {numbers}, the best of {best.line_times} clocks."
    why = (
        "What is painted does not lie in one slab of space."
        if best.missed_pixels > best.extra_pixels
        else "The slab that holds it holds as much else: paint all that lies there, or something apart from it."
    )
    return f"No gate can {verb} this region: even the nearest one's {numbers} is below {GOOD_IOU:g}. {why}"
