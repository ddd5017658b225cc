"""How well the views tell a lens' distortion: its coefficients one by one, and what they amount to together.

Far coefficients of a long lens move hardly any corner that was seen, and what one moves another can take back: their
values are then wild, and mean something together only, where corners were.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from slopegate.core.calibration.geometry import Geometry
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import GEOMETRY, LENS
from slopegate.core.rig.plus_minus import plus_minus
from slopegate.core.rig.rig import Lens

MOST_ALONE_PX: Final = 3.0
"""A coefficient is not determined where its standard error alone moves the picture's farthest corner by more."""
COEFFICIENTS: Final = LENS[LENS.index("k1") :]
"""In OpenCV's order."""


@dataclass(frozen=True)
class CornerDistortion:
    """What the distortion of a lens does to the corner of its picture that is farthest from the principal point.

    lens: "camera" or "projector". alone_px: by how much one standard error of each coefficient moves that corner,
    pixels. corner_px: by how much all of them move it together, with its standard error.
    """

    lens: str
    alone_px: dict[str, float]
    corner_px: float
    standard_error_px: float

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the coefficients that mean nothing by themselves."""
        return tuple(name for name, moved in self.alone_px.items() if moved > MOST_ALONE_PX)

    @property
    def remark(self) -> str:
        """The same as a sentence; empty where every coefficient is determined."""
        loose = self.undetermined
        if not loose:
            return ""
        first = ", ".join(loose[:-1])
        names, are = (f"{first} and {loose[-1]}", "are") if first else (loose[-1], "is")
        worst = max(loose, key=self.alone_px.__getitem__)
        return (
            f"the {self.lens}'s {names} {are} not determined by these views: in the farthest corner of its picture one "
            f"standard error of {worst} alone is {self.alone_px[worst]:.3g} px, and all distortion together "
            f"{plus_minus(self.corner_px, self.standard_error_px)} px; poses with the chart nearer to the corners tell "
            "it better"
        )


def corner_distortions(geometry: Geometry) -> tuple[CornerDistortion, CornerDistortion]:
    """Of the camera's lens and of the projector's."""
    return _corner("camera", geometry.camera, geometry), _corner("projector", geometry.projector, geometry)


def _corner(name: str, lens: Lens, geometry: Geometry) -> CornerDistortion:
    first = GEOMETRY.index(f"{name}.{COEFFICIENTS[0]}")
    place = slice(first, first + len(COEFFICIENTS))
    covariance, by = geometry.covariance[place, place], _slopes(lens)
    moved = by @ np.array((*lens.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5])
    alone = np.hypot(*by) * np.sqrt(np.diag(covariance))
    error = math.sqrt(max(0.0, float(np.trace(by @ covariance @ by.T))))
    return CornerDistortion(name, dict(zip(COEFFICIENTS, alone.tolist(), strict=True)), math.hypot(*moved), error)


def _slopes(lens: Lens) -> Doubles:
    """By how many pixels (2, 5) a unit of each coefficient moves the corner farthest from the principal point."""
    x = max(-lens.cx, lens.width - lens.cx, key=abs) / lens.fx
    y = max(-lens.cy, lens.height - lens.cy, key=abs) / lens.fy
    straight, *bent = (
        np.array(replace(lens, distortion=tuple(one)).project(x, y))
        for one in (np.zeros(len(COEFFICIENTS)), *np.eye(len(COEFFICIENTS)))
    )
    return np.stack(bent, axis=1) - straight[:, None]
