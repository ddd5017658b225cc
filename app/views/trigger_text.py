"""What the stamps of the frames tell of their triggers, in words."""

from __future__ import annotations

from slopegate.core.rig.cadence import Cadence
from slopegate.drivers.contract.tap import Counters


def time_text(time_us: float) -> str:
    """Microseconds, or milliseconds from ten of them on."""
    return f"{time_us:.0f} \u00b5s" if time_us < 10_000 else f"{time_us / 1000:.1f} ms"


def jitter_text(beat: Cadence | None) -> str:
    """The jitter; a dash where the frames come without a beat."""
    return "\u2013" if beat is None or not beat.steady else time_text(beat.jitter_us)


def triggers_text(counted: Counters, beat: Cadence | None, triggered: bool = True) -> str:
    """Period, jitter and what went wrong, in one line or two; without a trigger it tells of frames alone."""
    name = "Triggers" if triggered else "Frames"
    if beat is None:
        measured = f"{name}: too few frames yet"
    elif beat.steady:
        measured = (
            f"{name}: every {beat.period_us / 1000:.2f} ms, jitter {time_text(beat.jitter_us)}, "
            f"at worst {time_text(beat.worst_us)} in {beat.frames} frames"
        )
    else:
        measured = f"Frames come about every {beat.period_us / 1000:.1f} ms, without a beat"
    missed = f"missed {counted.missed}, " if triggered else ""
    wrong = f"{missed}lost {counted.lost}, late {counted.late}, repeated {counted.repeated}"
    return f"{measured}; since the start {wrong}."
