"""Settings and results in words, the same everywhere in the window."""

from __future__ import annotations

import math

from slopegate.core.gating.epipolar import Kept, kept
from slopegate.core.gating.gate import Slab
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.plus_minus import plus_minus
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks
from slopegate.core.search.state import Outcome


def as_sentence(said: object) -> str:
    """What is said, or an error, with a full stop and a capital, unless a name or a path begins it."""
    text = str(said).strip()
    first = text.partition(" ")[0].strip(",;:")
    if first.isalpha():
        text = f"{text[:1].upper()}{text[1:]}"
    return text if not text or text.endswith((".", "!", "?", "...")) else f"{text}."


def number(value: float, digits: int = 3) -> str:
    """A number with at most this many decimals, without trailing zeros."""
    text = f"{round(value, digits) + 0.0:.{digits}f}"  # no minus before a zero
    return text.rstrip("0").rstrip(".") if "." in text else text


def measured(value: float, error: float | None, digits: int = 3) -> str:
    """A number with its standard error, to the decimals that this has; where none is known, like any other number."""
    return number(value, digits) if error is None else plus_minus(value, error, "\u00b1")


def frames_text(count: int) -> str:
    """A number of frames, such as 1 frame or 3 frames."""
    return "1 frame" if count == 1 else f"{count} frames"


def line_text(rig: Rig, line_time_us: float) -> str:
    """The pixel clock, or the line time where the camera has no pixel clock."""
    line = rig.camera.shutter.line
    if isinstance(line, PixelClocks):
        return f"{number(line.clock_mhz(line_time_us))} MHz"
    return f"line {number(line_time_us)} \u00b5s"


def gate_text(settings: GateSettings) -> str:
    """Delay and exposure with their units."""
    return f"delay {number(float(settings.delay_us))} \u00b5s, exposure {number(settings.exposure_us)} \u00b5s"


_ALL = 0.995
"""A share of the picture from which it is called all of it."""


def meaning_text(rig: Rig, settings: GateSettings) -> str:
    """What a gate keeps that is no slab, by how many projector rows its light has moved; short, for one line."""
    if not no_slabs(rig):
        return "It selects distances, but none that can be told straight ahead"
    if settings.exposure_us >= rig.projector.period_us:
        return "Everything: all direct and all indirect light"
    found = kept(rig, settings)
    if not math.isfinite(found.low_rows):
        return "The middle of the picture does not face the projector"
    if found.direct_share < _ALL and found.some_share > 1 - _ALL:
        sure, most = f"{found.direct_share:.0%}", f"{found.some_share:.0%}"
        share = sure if found.some_share - found.direct_share < 1 - _ALL else f"{sure} to {most}"
        return f"Direct light in {share} of the picture, and indirect light"
    return _moved_text(found, rig.projector.period_rows)


def _moved_text(found: Kept, period_rows: float) -> str:
    """The same for a gate that keeps all direct light or none."""
    middle, half = (found.low_rows + found.high_rows) / 2, (found.high_rows - found.low_rows) / 2
    direct = found.direct_share >= _ALL
    if half > period_rows / 4:
        # A window nearly as long as the period is known by what it lacks.
        middle, half = math.remainder(middle + period_rows / 2, period_rows), period_rows / 2 - half
        if direct:
            return f"All but indirect light that moved {_rows_text(middle, half)} rows"
        least = max(half - abs(middle), 0.0)
        return f"All but epipolar: no direct light, indirect that moved {least:.1f} rows and more"
    if direct:
        return f"Epipolar: all direct light, and indirect that moved up to {abs(middle) + half:.1f} rows"
    return f"Non-epipolar: no direct light, indirect that moved {_rows_text(middle, half)} rows"


def _rows_text(middle: float, half: float) -> str:
    return f"{middle - half:+.1f} to {middle + half:+.1f}"


def _slab_text(slab: Slab) -> str:
    where, thick = "beyond infinity", "reaching to infinity"
    if slab.distance_m is not None:
        where = f"at {measured(slab.distance_m, slab.error('distance_m'))} m"
    if slab.thickness_m is not None:
        off = slab.error("thickness_m")
        thick = f"{measured(100 * slab.thickness_m, off and 100 * off, 1)} cm thick"
    return f"tilt {measured(slab.tilt_deg, slab.error('tilt_deg'), 1)}\u00b0, {where}, {thick}"


def outcome_text(rig: Rig, outcome: Outcome) -> str:
    """What a search found, or why it found nothing, in a few lines."""
    reason = f"{outcome.reason[:1].upper()}{outcome.reason[1:]}."
    took = frames_text(outcome.frames)
    if outcome.cause == "cancelled":
        return f"Cancelled after {took}: the gate is the one from before."
    if outcome.settings is None or outcome.slab is None:
        return f"Not found in {took}, and the gate is the one from before: {outcome.reason}."
    slab, gate = outcome.slab, outcome.settings
    head = f"Found in {took}" if outcome.found else f"Only a part of it, in {took}"
    lines = [f"{head}. {reason}"]
    lines.append(f"{line_text(rig, gate.line_time_us)}, {gate_text(gate)}")
    lines.append(f"Gate: {_slab_text(slab)}")
    if outcome.target is not None and outcome.target.distance_m is not None:
        own = outcome.target
        lines.append(f"Target: tilt {number(own.tilt_deg, 1)}\u00b0, at {number(outcome.target.distance_m)} m")
    return "\n".join(lines)
