"""From poses of a chart to a rig's geometry: views come in one by one, from folders or live, and the result at the end.

A view that has a fault is never part of a fit. One that is faultless and still does not fit the others is named, and
left out where whoever calls it says so.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import Final

import numpy as np

from slopegate.core.calibration.advice import Judgement, coverage, distance_error, verdict
from slopegate.core.calibration.applied import Facts, with_geometry
from slopegate.core.calibration.chart import CHART_ERROR_PERCENT, Chart
from slopegate.core.calibration.chart_scene import pose_of
from slopegate.core.calibration.focus import MOST_BLUR_PX, Focus, TypicalFocus, focus, typical
from slopegate.core.calibration.geometry import (
    LEAST_VIEWS,
    ChartView,
    Geometry,
    Size,
    calibrate,
    with_scale_error,
)
from slopegate.core.calibration.sight import MOST_BEYOND, ChartSight, look
from slopegate.core.rig.arrays import Ints
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.pictures import CalibrationError, PoseFrames

AS_ASKED: Final = "left out as asked"


@dataclass(frozen=True, eq=False)
class LookedView:
    """What is kept of a pose that was looked at: all but its pictures.

    view: None where the chart was not found or hardly lit. size: of the camera's picture. digest: SHA-256 of the files.
    edge_px: width of the chart's edges, 10 to 90 %. focus: how sharp the projector is, None where too little shows it.
    beyond_share: of the pixels with a clear code, those with one that no pixel of the projector has.
    """

    name: str
    view: ChartView | None
    faults: tuple[str, ...]
    size: Size
    digest: str
    shift_px: float
    saturated_share: float
    edge_px: float
    lit_share: float
    focus: Focus | None
    beyond_share: float

    @property
    def usable(self) -> bool:
        """Whether a fit may have it."""
        return self.view is not None and not self.faults


@dataclass(frozen=True)
class LeftOutView:
    """A view that is no part of the fit, and why, as a sentence."""

    name: str
    why: str

    @property
    def asked(self) -> bool:
        """Whether somebody wanted it so; else something is wrong with it."""
        return self.why.endswith(AS_ASKED)


@dataclass(frozen=True, eq=False)
class CalibratedGeometry:
    """A rig with the geometry that the views tell, and what became of every view.

    outliers: names of views in the fit that do not fit the others, worst first. focus: that of the projector in all
    views of the fit, None where none tells it.
    """

    rig: Rig
    geometry: Geometry
    views: tuple[LookedView, ...]
    left_out: tuple[LeftOutView, ...]
    outliers: tuple[str, ...]
    focus: TypicalFocus | None


class GeometryRun:
    """Views of one chart through one camera and one projector, as they come."""

    def __init__(self, chart: Chart, projector: Raster, passed_over: Sequence[str] = ()) -> None:
        """passed_over: names of views that were left out before anybody looked at them."""
        self.chart, self.projector = chart, projector
        self._passed_over = [LeftOutView(name, f"{name}: {AS_ASKED}") for name in passed_over]
        self._views: dict[str, LookedView] = {}

    @property
    def views(self) -> tuple[LookedView, ...]:
        """All that was looked at, with their faults, in the order in which they came."""
        return tuple(self._views.values())

    @property
    def usable(self) -> int:
        """How many views a fit may have."""
        return sum(view.usable for view in self._views.values())

    def add(self, pose: PoseFrames) -> ChartSight:
        """Look at a pose and keep what a fit needs; one of the same name is replaced.

        Raises CalibrationError where its pictures have another size than those before, and InputError where they are
        not as many as the projector's code needs.
        """
        height, width = pose.frames.shape[1:]
        for known in self._views.values():
            if known.name != pose.name and known.size != (width, height):
                raise CalibrationError(
                    f"{pose.name} has pictures of {width} x {height} pixels and {known.name} of {known.size[0]} x "
                    f"{known.size[1]}: one camera has one size"
                )
        sight = look(pose.name, self.chart, pose.order, pose.frames, pose.full_scale)
        sharp = focus(pose.order, pose.frames, sight.decoded, sight.blur_px)
        self._views[pose.name] = LookedView(
            pose.name, sight.view, sight.faults, (width, height), pose.digest, sight.shift_px, sight.saturated,
            sight.blur_px, sight.lit_share, sharp, sight.beyond_share,
        )  # fmt: skip
        return sight

    def remove(self, name: str) -> None:
        """Forget a view. Raises KeyError where there is none of this name."""
        del self._views[name]

    def finish(
        self,
        base: Rig,
        leave_out: Collection[str] = (),
        chart_error_percent: float = CHART_ERROR_PERCENT,
        facts: Mapping[str, str] | None = None,
    ) -> CalibratedGeometry:
        """Fit all views without a fault, but those to be left out, and put the geometry into the base rig.

        chart_error_percent: standard error of the chart's lengths, which all lengths of the result share. facts: more
        of them for the rig's file. Raises InputError or CalibrationError where the views do not do.
        """
        self._check_raster(leave_out)
        left_out = self._passed_over + [
            LeftOutView(view.name, f"{view.name}: {AS_ASKED}" if view.name in leave_out else _joined(view))
            for view in self._views.values()
            if view.name in leave_out or not view.usable
        ]
        names = {one.name for one in left_out}
        used = [view for view in self._views.values() if view.name not in names]
        if len(used) < LEAST_VIEWS:
            raise CalibrationError(_too_few(len(used), len(self._views), left_out) + self._unfocused())
        fitted = self._fit(used)
        geometry = with_scale_error(fitted, chart_error_percent / 100)
        sharp = [view.focus for view in used if view.focus is not None]
        seen = typical(sharp) if sharp else None
        told = self._facts(geometry, used, left_out, chart_error_percent) | dict(facts or {})
        if seen is not None:
            told["geometry.projector_blur_px"] = f"{seen.blur_px:.3f} +- {seen.standard_error:.3f}"
        rig = with_geometry(base, geometry, _as_facts(told))
        return CalibratedGeometry(rig, geometry, self.views, tuple(left_out), self._outliers(used, fitted), seen)

    def _check_raster(self, leave_out: Collection[str]) -> None:
        """One view with codes beyond the projector may be out of order; several mean that it is another one."""
        beyond = [one.name for one in self.views if one.beyond_share > MOST_BEYOND and one.name not in leave_out]
        if len(beyond) > 1:
            raise CalibrationError(
                f"{', '.join(beyond)} show codes that a projector of {self.projector} pixels does not have: give the "
                "size of the one that showed them"
            )

    def _unfocused(self) -> str:
        """What may be wrong with the projector where views cannot be used."""
        sharp = [view.focus for view in self.views if view.focus is not None]
        if not sharp or (blur := typical(sharp).blur_px) <= MOST_BLUR_PX:
            return ""
        return f"; the projector's stripes are blurred by {blur:.1f} of its pixels: focus it where the chart is held"

    def _fit(self, used: Sequence[LookedView]) -> Geometry:
        seen = [view.view for view in used if view.view is not None]
        return calibrate(seen, used[0].size, (self.projector.width, self.projector.height))

    def _outliers(self, used: Sequence[LookedView], fitted: Geometry) -> tuple[str, ...]:
        """Views that do not fit the others: the worst, then the worst of those that are left without it, and so on."""
        names: list[str] = []
        while fitted.outliers:
            names.append(fitted.outliers[0])
            left = [view for view in used if view.name not in names]
            if len(left) <= LEAST_VIEWS:
                break
            fitted = self._fit(left)
        return tuple(names)

    def _facts(
        self, geometry: Geometry, used: list[LookedView], left_out: list[LeftOutView], chart_error_percent: float
    ) -> dict[str, str]:
        pictures = hashlib.sha256("".join(sorted(view.digest for view in used)).encode()).hexdigest()
        found = {
            "geometry.made": datetime.now(UTC).isoformat(timespec="seconds"),
            "geometry.chart": str(self.chart),
            "geometry.chart_error_percent": f"{chart_error_percent:g}",
            "geometry.views": ", ".join(view.name for view in used),
            "geometry.corners": str(sum(view.corners for view in geometry.views)),
            "geometry.pictures_sha256": pictures,
            "geometry.rms_px": f"{geometry.rms_px:.4f}",
            "geometry.camera_rms_px": f"{geometry.camera_rms_px:.4f}",
            "geometry.projector_rms_px": f"{geometry.projector_rms_px:.4f}",
        }
        return found | ({"geometry.left_out": ", ".join(one.name for one in left_out)} if left_out else {})


@dataclass(frozen=True, eq=False)
class Sureness:
    """How well a calibration does: in words, by where corners were seen, and by what distances it gives.

    camera, projector: corners in each cell of either picture. distance_error: one standard error of the distances of
    the charts that were seen, as a share of them.
    """

    judged: Judgement
    camera: Ints
    projector: Ints
    distance_error: float


@lru_cache(maxsize=2)
def sureness(chart: Chart, found: CalibratedGeometry) -> Sureness:
    """Judge a calibration by rules of thumb. The last ones are kept: a window asks again and again."""
    used = {view.name for view in found.geometry.views}
    views = [one.view for one in found.views if one.name in used and one.view is not None]
    lenses = (found.rig.camera.lens, found.rig.projector.lens)
    camera, projector = (
        coverage(points, (lens.width, lens.height))
        for lens, points in zip(
            lenses, ([view.camera for view in views], [view.projector for view in views]), strict=True
        )
    )
    known = [(view, pose) for view in views if (pose := pose_of(lenses[0], view.points_m, view.camera))]
    error = distance_error(found.rig, np.concatenate([pose.placed(view.points_m) for view, pose in known]))
    return Sureness(verdict(len(views), camera, found.geometry, error), camera, projector, error)


def judgement(chart: Chart, usable: int, found: CalibratedGeometry | None) -> Judgement:
    """The traffic light of so many usable views together, and of what they tell; None: nothing yet."""
    return verdict(usable, coverage((), (1, 1)), None, math.inf) if found is None else sureness(chart, found).judged


def _joined(view: LookedView) -> str:
    return "; ".join(view.faults) or f"{view.name}: the projector lights too few of its corners"


def _too_few(used: int, seen: int, left_out: list[LeftOutView]) -> str:
    views: dict[str, list[str]] = {}
    for one in left_out:  # what is wrong with several is said once
        views.setdefault(one.why.replace(f"{one.name}: ", ""), []).append(one.name)
    why = "; ".join(f"{', '.join(names)}: {reason}" for reason, names in views.items())
    return (
        f"{used} of {seen} views can be used{f' ({why})' if why else ''}: at least {LEAST_VIEWS} are needed, each with "
        "the chart at another angle"
    )


def _as_facts(told: Mapping[str, str]) -> Facts:
    return tuple(told.items())
