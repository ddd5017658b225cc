"""How the live image is shown beyond its levels."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from slopegate.app.widgets.colour_maps import ColourMap
from slopegate.drivers.contract.frame import CameraInfo


class Display(BaseModel):
    """What the user wants to see: it changes nothing of what is recorded."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    colour_map: ColourMap = "grey"
    mark_saturated: bool = False
    mark_dark: bool = False
    dark_percent: float = Field(default=1.0, ge=0, le=50)
    """Pixels with at most this part of the camera's range above its dark level count as too dark."""
    scale_bar: bool = False
    auto_dark_percent: float = Field(default=0.1, ge=0, le=45)
    """Part of the pixels that automatic levels show as black,"""
    auto_bright_percent: float = Field(default=0.1, ge=0, le=45)
    """and as white."""

    def dark_count(self, info: CameraInfo) -> int:
        """The greatest count of this camera that is too dark."""
        return int(info.black_count + self.dark_percent / 100 * (info.max_count - info.black_count))
