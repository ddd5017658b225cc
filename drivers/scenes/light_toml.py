"""What a scene file says of fog and materials, as types. Documented for users in resources/scenes/FORMAT.md.

What each number may be is checked by what is made of it (core/scene/media.py and core/scene/materials.py).
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, model_validator
from pydantic_core import PydanticCustomError

from slopegate.core.scene.media import MAX_PER_M, extinction_of
from slopegate.drivers.scenes.scene_values import Colour, Corner, Number, Part, Positive, Text, listed, numeric

LEAST_VISIBILITY_M = extinction_of(MAX_PER_M) * (1 + 1e-12)
"""The visibility of the thickest fog, of which the extinction is the same number over it; not less by rounding."""


class FogTable(Part):
    """Fog, by its coefficients or by how far one sees in it."""

    lo_m: Corner | None = None
    hi_m: Corner | None = None
    scattering_per_m: Number | None = None
    absorption_per_m: Number | None = None
    visibility_m: (
        Annotated[
            float,
            numeric(
                LEAST_VISIBILITY_M,
                1e9,
                f"a distance in metres of at least {LEAST_VISIBILITY_M:.4f}, which is a mean free path of "
                f"{1000 / MAX_PER_M:g} mm",
            ),
        ]
        | None
    ) = None
    g: Number = 0.0

    @model_validator(mode="after")
    def _one_density(self) -> Self:
        coefficients = self.scattering_per_m is not None or self.absorption_per_m is not None
        if coefficients and self.visibility_m is not None:
            raise PydanticCustomError(
                "whole", "has both visibility_m and coefficients: it must have visibility_m or the coefficients"
            )
        if not coefficients and self.visibility_m is None:
            raise PydanticCustomError("whole", "has no density: it must have scattering_per_m or visibility_m")
        return self


class MattTable(Part):
    """Light goes everywhere."""

    type: Literal["matt"]


class GlossyTable(Part):
    """Matt with a lobe about the mirror's direction."""

    type: Literal["glossy"]
    gloss: Number
    exponent: Number = 50.0


class GlassTable(Part):
    """Light is refracted and mirrored."""

    type: Literal["glass"]
    index: Number = 1.5


class LobeTable(Part):
    """Light that comes out of skin beside where it went in."""

    sigma_mm: Positive
    weight: Colour


class SkinTable(Part):
    """Light goes in, spreads, and passes veins."""

    type: Literal["skin"]
    lobes: Annotated[tuple[LobeTable, ...], BeforeValidator(lambda value: listed(value, "lobes"))] | None = None
    veins: Text | None = None
    depth_mm: Positive = 2.0
    absorbed: Colour = (0.7, 0.7, 0.7)


MaterialTable = MattTable | GlossyTable | GlassTable | SkinTable
MATERIALS = {"matt", "glossy", "glass", "skin"}
