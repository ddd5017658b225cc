"""What fills the space between surfaces: homogeneous fog in a box."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Vector3

MAX_PER_M = 1000.0
"""Largest coefficient, 1/m: a mean free path of 1 mm."""
CONTRAST_AT_VISIBILITY = 0.02
"""What is left of a black object's contrast at the visibility (Koschmieder): extinction = 3.912 / visibility."""


@dataclass(frozen=True)
class Fog:
    """Homogeneous fog in the axis-aligned box lo_m .. hi_m of world coordinates; sides may be infinite.

    Coefficients in 1/m. `g` is the mean cosine of the scattering angle (Henyey and Greenstein 1941): above 0 forward.
    The default box is everything in front of the rig. Raises InputError, one sentence, for values without a meaning.
    """

    scattering_per_m: float
    absorption_per_m: float = 0.0
    g: float = 0.0
    lo_m: Vector3 = (-math.inf, -math.inf, 0.0)
    hi_m: Vector3 = (math.inf, math.inf, math.inf)

    def __post_init__(self) -> None:
        for name in ("scattering_per_m", "absorption_per_m"):
            value = getattr(self, name)
            require(
                0 <= value <= MAX_PER_M,
                name,
                value,
                f"from 0 to {MAX_PER_M:.0f} per metre (there the mean free path is {1000 / MAX_PER_M:g} mm)",
            )
        require(-1 < self.g < 1, "g", self.g, "between -1 and 1, both excluded")
        for axis, low, high in zip("xyz", self.lo_m, self.hi_m, strict=True):
            require(low < high, "lo_m", self.lo_m, f"below hi_m {self.hi_m} along {axis}, as along every axis")

    @property
    def extinction_per_m(self) -> float:
        """Share of light lost a metre, by scattering and absorption together."""
        return self.scattering_per_m + self.absorption_per_m

    @property
    def visibility_m(self) -> float:
        """Distance at which a black object keeps 2 % of its contrast; infinite in clear air."""
        extinction = self.extinction_per_m
        return -math.log(CONTRAST_AT_VISIBILITY) / extinction if extinction else math.inf


def extinction_of(visibility_m: float) -> float:
    """The extinction, 1/m, of a visibility."""
    return -math.log(CONTRAST_AT_VISIBILITY) / visibility_m
