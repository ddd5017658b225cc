"""Which intrinsics a camera can have: numbers in another unit are told before they make a black picture."""

from __future__ import annotations

from typing import Final

from slopegate.core.rig.checks import require

SHORTEST, LONGEST = 0.1, 200.0
"""Of focal lengths, in longer sides of the picture: 157 degrees across, and the longest telescopes."""
MOST_APART: Final = 4.0
"""How often fx goes into fy or the other way round: pixels are square, or binned along one side."""


def require_pinhole(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], names: tuple[str, str, str, str]
) -> None:
    """Raise InputError for a focal length that cannot be in pixels and a principal point far outside the picture.

    `size` is width and height; `focal` and `centre` are (fx, fy) and (cx, cy), which the sentence calls by `names`.
    """
    longer = max(size)
    shortest, longest = SHORTEST * longer, LONGEST * longer
    for name, value in zip(names[:2], focal, strict=True):
        allowed = f"a focal length in pixels, from {shortest:g} to {longest:g} for {size[0]} x {size[1]} of them"
        require(shortest <= value <= longest, name, value, allowed)
    apart = max(focal) / min(focal)
    allowed = f"within a factor of {MOST_APART:g} of {names[0]}, which is {focal[0]:g}"
    require(apart <= MOST_APART, names[1], focal[1], allowed)
    for name, value, side in zip(names[2:], centre, size, strict=True):
        # By the longer side: of a sensor that is read only in part the principal point may lie far beside the few rows.
        allowed = f"within {-longer}..{side + longer}: in the picture, or at most {longer} pixels outside it"
        require(-longer <= value <= side + longer, name, value, allowed)
