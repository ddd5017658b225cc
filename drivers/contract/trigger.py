"""The trigger delay that a camera is told."""

from __future__ import annotations

from typing import Final

from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import Steps, turns_into

FREE_RUNNING: Final = "The camera was opened to run by itself, without the projector's trigger."
"""Why a camera that was not to be triggered has no delay."""

TRIGGERED: Final = "The projector's sync signal sets the pace of the camera."
"""Why the frame rate of a camera that is triggered cannot be chosen."""


def trigger_delay(span: tuple[float, float, float], exact_us: float, period_us: float) -> tuple[float, int]:
    """A camera's own delay for an exact one, and how many projector periods were added to bring it into the range.

    `span` is the camera's smallest and largest delay and its step (0: none). A trigger one period later lights the same
    rows, so a start before the trigger becomes one in the next period. Raises InputError when no number of whole
    periods brings it into the range.
    """
    low, high, step = span
    turns = turns_into(low, high, exact_us, period_us)
    delay_us = exact_us + turns * period_us
    if not low <= delay_us <= high:
        raise InputError(
            f"the delay needs a trigger delay of {exact_us:.0f} us, give or take whole periods of {period_us:.0f} us: "
            f"the camera's goes from {low:.0f} to {high:.0f} us"
        )
    return Steps(low, high, step).nearest(delay_us) if step else delay_us, turns
