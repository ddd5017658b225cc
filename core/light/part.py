"""The parts that a picture is the sum of, and what each of those of this room can do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal, Protocol

if TYPE_CHECKING:  # commands read the names of the parts before anything large is loaded
    from slopegate.core.gating.gate import RowWindows
    from slopegate.core.render.render import Buffers, Region
    from slopegate.core.rig.arrays import Singles

PartName = Literal["direct", "airlight", "scatter", "indirect", "subsurface", "ambient"]
PARTS: Final[tuple[PartName, ...]] = ("direct", "airlight", "scatter", "indirect", "subsurface", "ambient")

Filter = Literal["rgb", "mono", "bayer_rg"]
"""What a part's image is of: three linear colours, luminance, or one colour a pixel as behind a sensor's filters."""


class LightPart(Protocol):
    """One part of the light, prepared for a rig, a scene and a filter."""

    @property
    def name(self) -> PartName:
        """Which part it is."""
        ...

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add what these windows record of it to out, (H, W) or for the filter "rgb" (H, W, 3), float32, linear.

        The unit is that of `render.Buffers`: a white frontal surface 1 m from the projector shows 1. Nothing is
        added where the windows record nothing; a part is linear in how often they record a row.
        """
        ...

    def light_with(self, pattern: Singles | None) -> None:
        """From now on as if the projector showed this picture; None: everything lit.

        pattern (raster's height, width) float32: the share, 0..1, of its light that each projector pixel sends. It is
        kept, not copied. How closely a part follows it is said where the part is documented.
        """
        ...

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Take over what has moved: buffers as rendered for this time, unlike the last ones in this region only.

        A part that cannot follow in time keeps what it has, and says so where it is documented.
        """
        ...
