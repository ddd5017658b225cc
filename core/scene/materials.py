"""What surfaces are made of besides their matt colour."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
        require(1 <= self.exponent <= 1e5, "gloss_exponent", self.exponent, "from 1 to 100000")


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

    lobes: narrow to wide; their weights and `surface` together scale the albedo. surface: the share, per colour, that
    is thrown back where it fell (this is direct light). veins (h, w) float32 from 0 (none) to 1, laid over the object
    by its texture coordinates or over its (x, y) extent; depth_mm: how deep they lie; a lobe of deviation s reaches
    them by exp(-(depth / s)^2 / 2), and there loses the share `absorbed`.
    """

    surface: Vector3
    lobes: tuple[SkinLobe, ...]
    veins: Singles | None = None
    depth_mm: float = 2.0
    absorbed: Vector3 = (0.7, 0.7, 0.7)

    def __post_init__(self) -> None:
        require_positive("depth_mm", self.depth_mm)
        for name in ("surface", "absorbed"):
            value = getattr(self, name)
            require(all(math.isfinite(c) and 0 <= c <= 1 for c in value), name, value, "numbers from 0 to 1")
        total = [s + sum(lobe.weight[k] for lobe in self.lobes) for k, s in enumerate(self.surface)]
        require(max(total) <= 1 + 1e-9, "lobes", total, "weights that with `surface` add up to at most 1 per colour")


Material = Gloss | Glass | Skin
"""None in a material's place: matt, and nothing else."""
