"""One scene in fog, seen four ways: with everything lit, by an upright gate, by any gate, and by an epipolar one.

The first three are gates of one rig; the fourth is of a rig with the projector beside the camera, whose rows are
epipolar (figure 8 of the paper). All are small pictures of one camera, which stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import cv2
import numpy as np

from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.epipolar import epipolar_gate
from slopegate.core.gating.gate import row_windows, slab_if_any, upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import BakeSettings
from slopegate.core.light.indirect import Indirect
from slopegate.core.light.lights import PLAIN, Lights, asked_parts, holds
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.render.render import Progress, part_of, render
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.axis import no_slabs, time_on_axis
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.rig.variants import beside_rig, binned_gate, binned_lens, binned_rig
from slopegate.core.scene.scene import KeyFrames, MeasuredScene, Mesh, Scene, Sphere

WIDTH_PX: Final = 400
"""About how wide the pictures are."""
PATHS: Final = 128
"""Paths a cell after which their indirect light is good enough."""

Way = Literal["regular", "upright", "this", "epipolar"]
WAYS: Final[tuple[Way, ...]] = ("regular", "upright", "this", "epipolar")


class SmallView:
    """A scene as a rig's camera sees it in large pixels, ready for any gate of the rig whose pixels were binned."""

    def __init__(self, rig: Rig, scene: Scene, by: int, progress: Progress | None = None) -> None:
        """Render the scene in pixels `by` times as large, with the light that it asks for; indirect light by `refine`.

        Raises Cancelled.
        """
        self._rig, self._scene, self._by = binned_rig(rig, by), binned_scene(scene, by), by
        self._buffers = render(self._rig, self._scene, progress=progress)
        asked = asked_parts(self._scene) - PLAIN
        view = SeenScene(self._rig, self._scene, self._buffers, "mono")
        self._lights = Lights(prepare_parts(view, asked, progress))
        self._direct, self._ambient = mono(self._buffers.direct), mono(self._buffers.ambient)
        self._indirect = "indirect" in asked and holds(self._scene, "indirect")
        self._bake: Bake | None = None

    @property
    def paths(self) -> int:
        """Paths a cell of its indirect light so far."""
        return 0 if self._bake is None else self._bake.paths

    @property
    def refined(self) -> bool:
        """Whether its indirect light is good enough, or it asks for none."""
        return not self._indirect or self.paths >= PATHS

    def refine(self, progress: Progress | None = None) -> None:
        """Trace twice the paths of its indirect light, and show them. Raises Cancelled, with what was there before."""
        if self.refined:
            return
        if self._bake is None:
            alone = "scatter" not in self._lights.names
            self._bake = Bake(self._rig, self._scene, BakeSettings(with_halo=alone), progress=progress)
        each = self._bake.next_pass
        for half in (0, 1):
            self._bake.trace(half, each, progress)
        part = Indirect(self._rig, self._bake.picture, "mono")
        part.show(self._bake.snapshot())
        self._lights.put(part)

    def light(self, settings: GateSettings) -> Singles:
        """What this gate records, (h, w) float32, linear, in one colour; settings as for the full rig."""
        small = binned_gate(settings, self._by)
        windows, periods = row_windows(self._rig, small), small.exposure_us / self._rig.projector.period_us
        out = gated(self._buffers.projector_row, self._direct, self._ambient, windows, periods)
        self._lights.add(windows, self._lights.names, out)
        return out


@dataclass(frozen=True, eq=False)
class FourViews:
    """What the four pictures and their fog-free references are made from."""

    rig: Rig
    scene: Scene
    own: SmallView
    beside: SmallView
    own_clear: SmallView
    beside_clear: SmallView
    """Without fog, for references."""
    epipolar: GateSettings | None
    """The gate of the rig beside; None where it has none."""

    @property
    def refined(self) -> bool:
        """Whether the indirect light of all pictures is good enough."""
        return all(view.refined for view in self._views)

    @property
    def _views(self) -> tuple[SmallView, ...]:
        return self.own, self.beside, self.own_clear, self.beside_clear

    def refine(self, progress: Progress) -> None:
        """Double the paths of their indirect light. `progress` as for `four_views`."""
        for place, view in enumerate(self._views):
            view.refine(part_of(progress, place / 4, 0.25))


def four_views(rig: Rig, scene: Scene, progress: Progress, known: FourViews | None = None) -> FourViews:
    """Prepare everything that does not depend on the gate. `progress` is told the share done; raises Cancelled.

    known: views made before; where they are of the same scene in other fog, what they have without fog is kept.
    """
    by = max(round(rig.camera.lens.width / WIDTH_PX), 1)
    aside = beside_rig(rig)
    there = moved_scene(scene, aside.camera_centre_m - rig.camera_centre_m)
    own = SmallView(rig, scene, by, part_of(progress, 0.0, 0.25))
    beside = SmallView(aside, there, by, part_of(progress, 0.25, 0.25))
    if known is not None and known.rig == rig and _same_but_fog(known.scene, scene):
        clear = known.own_clear, known.beside_clear
    else:
        own_clear = SmallView(rig, replace(scene, fog=None), by, part_of(progress, 0.5, 0.25))
        clear = own_clear, SmallView(aside, replace(there, fog=None), by, part_of(progress, 0.75, 0.25))
    return FourViews(rig, scene, own, beside, *clear, epipolar_gate(aside))


def _same_but_fog(one: Scene, other: Scene) -> bool:
    """Whether two scenes are made of the very same things; `replace` keeps them."""
    lit_alike = one.ambient == other.ambient and one.indirect == other.indirect
    return one.objects is other.objects and one.capture is other.capture and lit_alike


def picture(views: FourViews, way: Way, settings: GateSettings) -> tuple[Singles, Singles] | None:
    """One of the pictures, and its fog-free reference, (h, w) each; None where the rig has no such gate.

    settings: the gate at hand. The upright one has the same exposure and distance on the axis.
    """
    chosen = gate_of(views, way, settings)
    if chosen is None:
        return None
    lit = whole_period(views.rig, upright_line_time(views.rig))
    view, clear = (views.beside, views.beside_clear) if way == "epipolar" else (views.own, views.own_clear)
    return view.light(chosen), clear.light(lit)


def gate_of(views: FourViews, way: Way, settings: GateSettings) -> GateSettings | None:
    """The gate of a picture, of the rig beside for the epipolar one; None where there is none."""
    if way == "epipolar":
        return views.epipolar
    if way == "upright":
        return upright_gate_of(views.rig, settings)
    return whole_period(views.rig, settings.line_time_us) if way == "regular" else settings


def upright_gate_of(rig: Rig, settings: GateSettings) -> GateSettings | None:
    """The upright gate of the same exposure that meets the axis at the same distance; None where gates are no slabs."""
    found = None if no_slabs(rig) else slab_if_any(rig, settings).slab
    if found is None:
        return None
    level = upright_line_time(rig)
    return gate(level, time_on_axis(rig, level, found.inverse_distance_per_m), settings.exposure_us)


def binned_scene(scene: Scene, by: int) -> Scene:
    """The scene for `binned_rig`: only a measured one has pixels of its own, of which each keeps its middle's depth."""
    seen = scene.capture
    if seen is None or by == 1:
        return scene
    lens = binned_lens(seen.lens, by)
    rows, columns = (np.arange(size) * by + by // 2 for size in (lens.height, lens.width))
    photo = seen.photo[: lens.height * by, : lens.width * by]
    mean = cv2.resize(photo, (lens.width, lens.height), interpolation=cv2.INTER_AREA)
    depth = np.ascontiguousarray(seen.inverse_depth[np.ix_(rows, columns)])
    return replace(scene, capture=MeasuredScene(lens, depth, np.asarray(mean, np.float32)))


def moved_scene(scene: Scene, by_m: Doubles) -> Scene:
    """The scene with everything in it moved by this vector (3,), metres; a measured one moves with its camera."""
    fog = scene.fog
    if fog is not None:
        lo, hi = (tuple(float(c) for c in np.add(corner, by_m)) for corner in (fog.lo_m, fog.hi_m))
        fog = replace(fog, lo_m=(lo[0], lo[1], lo[2]), hi_m=(hi[0], hi[1], hi[2]))
    return replace(scene, objects=tuple(_moved(item, by_m) for item in scene.objects), fog=fog)


def _moved(item: Mesh | Sphere, by_m: Doubles) -> Mesh | Sphere:
    motion = None if item.motion is None else _moved_motion(item.motion, by_m)
    if isinstance(item, Mesh):
        return replace(item, vertices=item.vertices + by_m, motion=motion)
    x, y, z = np.add(item.centre_m, by_m)
    return replace(item, centre_m=(float(x), float(y), float(z)), motion=motion)


def _moved_motion(motion: KeyFrames, by_m: Doubles) -> KeyFrames:
    x, y, z = np.add(motion.pivot_m, by_m)
    return replace(motion, pivot_m=(float(x), float(y), float(z)))
