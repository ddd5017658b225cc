"""What surfaces are made of besides their matt colour."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import require, require_positive
from slopegate.core.rig.rig import Vector3


@dataclass(frozen=True)
class Gloss:
    """A lobe about the mirror's direction, beside the matt light (Lafortune and Willems 1994, normalised Phong).

    `share` of the light that falls in straight is thrown into it; its brightness falls as cos^exponent of the angle to
    the mirror's direction: reflectance = share (exponent + 2) / (2 pi) cos^exponent. A share of 0 is matt.
    """

    share: float
    exponent: float = 50.0

    def __post_init__(self) -> None:
        require(0 <= self.share <= 1, "gloss", self.share, "from 0 to 1")
        require(1 <= self.exponent <= 1e5, "exponent", self.exponent, "from 1 to 100000")


@dataclass(frozen=True)
class Glass:
    """Clear glass: light is refracted and mirrored, not scattered. The object's albedo is the share that is let
    through at each surface beside what is mirrored."""

    index: float = 1.5

    def __post_init__(self) -> None:
        require(1 <= self.index <= 4, "index", self.index, "from 1 to 4")


@dataclass(frozen=True)
class SkinLobe:
    """One Gaussian of the light that comes out beside the point where it went in, per area.

    sigma_mm: its standard deviation along a line on the skin; weight: its share of the light of each colour that is
    sent back.
    """

    sigma_mm: float
    weight: Vector3

    def __post_init__(self) -> None:
        require_positive("sigma_mm", self.sigma_mm)
        require(
            all(math.isfinite(w) and 0 <= w <= 1 for w in self.weight), "weight", self.weight, "numbers from 0 to 1"
        )


@dataclass(frozen=True, eq=False)
class Skin:
    """Light that goes in at a point leaves around it, and veins below take their share of what went deep.

    lobes: narrow to wide, shares of the light that the albedo sends back; what they leave over (`surface`) is thrown
    back where it fell and is direct light. veins (h, w) float32 from 0 (none) to 1, laid over the object by its texture
    coordinates (rows downwards, as textures); depth_mm: how deep they lie; absorbed: the share, per colour, that light
    loses there.
    """

    lobes: tuple[SkinLobe, ...]
    veins: Singles | None = None
    depth_mm: float = 2.0
    absorbed: Vector3 = (0.7, 0.7, 0.7)

    def __post_init__(self) -> None:
        require_positive("depth_mm", self.depth_mm)
        require(
            all(math.isfinite(c) and 0 <= c <= 1 for c in self.absorbed),
            "absorbed",
            self.absorbed,
            "numbers from 0 to 1",
        )
        total = tuple(sum(lobe.weight[k] for lobe in self.lobes) for k in range(3))
        require(max(total) <= 1 + 1e-9, "lobes", total, "weights that add up to at most 1 per colour")
        if self.veins is not None:
            ok = self.veins.ndim == 2 and self.veins.size > 0 and bool(((self.veins >= 0) & (self.veins <= 1)).all())
            require(ok, "veins", self.veins.shape, "a picture with values from 0 to 1")

    @property
    def surface(self) -> Vector3:
        """Share of the light, per colour, that is thrown back where it fell: 1 less the weights of the lobes."""
        red, green, blue = (max(1 - sum(lobe.weight[k] for lobe in self.lobes), 0.0) for k in range(3))
        return red, green, blue


SKIN_LOBES: Final[tuple[SkinLobe, ...]] = (
    SkinLobe(0.220, (0.100, 0.336, 0.344)),
    SkinLobe(0.432, (0.118, 0.198, 0.0)),
    SkinLobe(0.753, (0.113, 0.007, 0.007)),
    SkinLobe(1.411, (0.358, 0.004, 0.0)),
    SkinLobe(2.722, (0.078, 0.0, 0.0)),
)
"""Measured skin as six Gaussians (d'Eon, Luebke and Enderton 2007, table 1); the narrowest, of 0.08 mm, is surface."""

Material = Gloss | Glass | Skin
"""None in a material's place: matt, and nothing else."""
