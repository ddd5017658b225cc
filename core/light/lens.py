"""What blurred lenses make of a picture's parts: direct light row by row, and every smooth part as any picture.

`exposure.blur` says how. Light of neighbouring rows takes the window of the row it lands in. For direct light, and for
its near halo, this matters, for one row's window may hold what the next one's does not. Of airlight, indirect,
subsurface and ambient light neighbouring windows hold nearly the same: these parts are blurred as they are.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.exposure.blur import BlurredDirect, blurred
from slopegate.core.exposure.patterned import patterned
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import RowWindows, row_windows
from slopegate.core.light.part import Filter, LightPart, PartName
from slopegate.core.render.integrate import pixel_positions
from slopegate.core.render.render import Buffers, Cancelled, Progress, Region, render
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene


def has_blur(rig: Rig) -> bool:
    """Whether either lens is blurred."""
    return rig.camera.blur_px > 0 or rig.projector.blur_px > 0


class SeenDirect:
    """The part `direct` of a rig with blur."""

    name: Final = "direct"

    def __init__(self, rig: Rig, buffers: Buffers, light_filter: Filter) -> None:
        """`buffers`: what the rig sees of the scene."""
        self._rig, self._filter = rig, light_filter
        self._seen = buffers
        self._pattern: Singles | None = None
        self._lit = self._make()

    def _make(self) -> BlurredDirect:
        seen = self._seen
        light = mono(seen.direct) if self._filter == "mono" else seen.direct
        light = patterned(light, seen.projector_row, seen.projector_column, self._pattern, self._rig.projector.blur_px)
        return BlurredDirect(self._rig, seen.projector_row.copy(), light)

    def add(self, windows: RowWindows, out: Singles) -> None:
        """As `LightPart.add` says."""
        if self._filter != "bayer_rg":
            self._lit.add(windows, out)
            return
        colours = np.zeros((*out.shape, 3), np.float32)
        self._lit.add(windows, colours)
        out += bayer_rg(colours)

    def light_with(self, pattern: Singles | None) -> None:
        """As `LightPart.light_with` says, as closely as `exposure.patterned`."""
        if pattern is not self._pattern:
            self._pattern = pattern
            self._lit = self._make()

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Take over what has moved."""
        self._seen = buffers
        self._lit = self._make()


class BehindLens:
    """A smooth part as a blurred camera sees it."""

    def __init__(self, part: LightPart, blur_px: float) -> None:
        self._part, self._blur_px = part, blur_px

    @property
    def name(self) -> PartName:
        """That of the part."""
        return self._part.name

    def add(self, windows: RowWindows, out: Singles) -> None:
        """As `LightPart.add` says."""
        sharp = np.zeros_like(out)
        self._part.add(windows, sharp)
        out += blurred(sharp, self._blur_px)

    def light_with(self, pattern: Singles | None) -> None:
        """As the part does."""
        self._part.light_with(pattern)

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """As the part does."""
        self._part.follow(buffers, region, time_s)


def behind_lens(rig: Rig, part: LightPart) -> LightPart:
    """The part as the rig's camera sees it: itself where the lens is sharp, or where it knows the lens already."""
    if rig.camera.blur_px == 0 or part.name in {"direct", "scatter"}:
        return part
    return BehindLens(part, rig.camera.blur_px)


def blurred_light(
    rig: Rig, view: Buffers, settings: GateSettings, pattern: Singles | None = None
) -> tuple[Singles, Singles]:
    """Direct and ambient light (H, W, 3) float32 that a gate records of what the rig's rays see under a pattern."""
    periods, direct = settings.exposure_us / rig.projector.period_us, np.zeros_like(view.direct)
    lit = patterned(view.direct, view.projector_row, view.projector_column, pattern, rig.projector.blur_px)
    BlurredDirect(rig, view.projector_row, lit).add(row_windows(rig, settings), direct)
    return direct, np.float32(periods) * blurred(view.ambient, rig.camera.blur_px)


def integrate_blurred(
    rig: Rig,
    scene: Scene,
    settings: GateSettings,
    samples: int,
    time_s: float = 0.0,
    progress: Progress | None = None,
    skip: bool = True,
    pattern: Singles | None = None,
) -> tuple[Singles, Singles]:
    """`integrate.integrate_parts` of a rig with blur."""
    places = pixel_positions(samples)
    total: list[Singles] = []
    for done, (column, row) in enumerate(places):
        if progress is not None and not progress(done / len(places)):
            raise Cancelled("Rendering was stopped")
        view = render(rig, scene, time_s, (float(column), float(row)), skip=skip)
        found = blurred_light(rig, view, settings, pattern)
        total = [a + b for a, b in zip(total, found, strict=True)] if total else list(found)
    share = np.float32(1 / len(places))
    return share * total[0], share * total[1]
