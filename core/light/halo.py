"""Who draws light that fog scatters on its last legs: near its source `scatter`, in closed form, the rest the bake.

Light that a surface sends out and fog turns towards the camera makes a halo about the surface's own place in the image.
Its core is sharp and depends on the image at full resolution; its wide rest is smooth. A weight splits the two without
a seam: `scatter` takes halo_share of it and `indirect` the rest, if the surface is in the camera's sight and lit by the
projector itself. Fog may turn such light once by any angle, or up to MOST_TURNS times by small angles.
"""

from __future__ import annotations

from math import cos, pi
from typing import Final

from slopegate.core.compiled.kept import njit

HALO_RADIUS: Final = 0.04
"""Outer radius of the near halo, as a tangent in the image plane: 17 pixels of a focal length of 417."""

MOST_TURNS: Final = 6
"""How often fog may turn light of the near halo. In deep fog light that turned more often is smooth, and small turns do
not add up as simply any more."""

SMALL_COSINE: Final = 0.7
"""Least cosine of the turns of such light where they are several. One turn alone may be as wide as it likes."""


@njit(cache=True, nogil=True)
def halo_share(offset: float) -> float:
    """Share of the near halo at this distance (a tangent in the image): 1 up to half the radius, then down to 0."""
    inner = 0.5 * HALO_RADIUS
    if offset <= inner:
        return 1.0
    if offset >= HALO_RADIUS:
        return 0.0
    return 0.5 + 0.5 * cos(pi * (offset - inner) / (HALO_RADIUS - inner))
