"""Makes the parts of a scene's light ready: one line for each part that needs nothing but the scene.

Indirect light is not among them: it is baked, in passes that go on while the rest is looked at (`bake`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final

from slopegate.core.light.airlight import prepare_airlight
from slopegate.core.light.lens import SeenDirect, behind_lens, has_blur
from slopegate.core.light.lights import holds
from slopegate.core.light.part import Filter, LightPart, PartName
from slopegate.core.light.scatter import Scatter
from slopegate.core.light.subsurface import prepare_subsurface
from slopegate.core.render.render import Buffers, Progress, part_of
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class SeenScene:
    """What a part is prepared for: the scene at one instant as a rig's camera sees it, through a filter.

    samples: rays a pixel along each axis. 1 is what live frames take. max_order: how often light may change its
    direction, None for as often as matters.
    """

    rig: Rig
    scene: Scene
    buffers: Buffers
    light_filter: Filter
    time_s: float = 0.0
    samples: int = 1
    max_order: int | None = None


def _subsurface(view: SeenScene, progress: Progress | None) -> LightPart:
    return prepare_subsurface(view.rig, view.scene, view.light_filter, view.time_s, progress)


def _airlight(view: SeenScene, progress: Progress | None) -> LightPart:
    made_for = view.rig, view.scene, view.buffers, view.light_filter, view.time_s
    return prepare_airlight(*made_for, progress, samples=view.samples)


def _scatter(view: SeenScene, progress: Progress | None) -> LightPart:
    return Scatter(view.rig, view.scene, view.buffers, view.light_filter, view.max_order)


def _direct(view: SeenScene, progress: Progress | None) -> LightPart:
    return SeenDirect(view.rig, view.buffers, view.light_filter)


_Maker = Callable[[SeenScene, Progress | None], LightPart]
_MAKERS: Final[dict[PartName, _Maker]] = {
    "direct": _direct,
    "airlight": _airlight,
    "scatter": _scatter,
    "subsurface": _subsurface,
}


def prepare_parts(view: SeenScene, names: Collection[PartName], progress: Progress | None = None) -> list[LightPart]:
    """Those of the parts that the scene has and that need no bake, ready for any gate, as the rig's lenses show them.

    Direct light is among them only where a lens is blurred: otherwise the gate itself has it.

    `progress` is told the share done; Cancelled is raised when it returns False.
    """
    wanted = [name for name in _MAKERS if name in names and holds(view.scene, name)]
    if not has_blur(view.rig):
        wanted = [name for name in wanted if name != "direct"]
    parts = []
    for place, name in enumerate(wanted):
        parts.append(
            behind_lens(view.rig, _MAKERS[name](view, part_of(progress, place / len(wanted), 1 / len(wanted))))
        )
    return parts
