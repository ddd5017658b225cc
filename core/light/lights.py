"""All light of one scene beyond the direct path, for one camera: which parts there are, and their sum for a gate."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Final

import numpy as np

from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.part import PARTS, LightPart, PartName
from slopegate.core.render.render import Buffers, Region
from slopegate.core.rig.arrays import Singles
from slopegate.core.scene.materials import Skin
from slopegate.core.scene.scene import Scene

PLAIN: Final[frozenset[PartName]] = frozenset({"direct", "ambient"})
"""The parts that need no preparing: a plain scene has only these."""


def total(parts: Mapping[PartName, Singles], shape: tuple[int, ...]) -> Singles:
    """The sum of images of parts, from the first of PARTS to the last; black where there are none."""
    found = np.zeros(shape, np.float32)
    for name in PARTS:
        if name in parts:
            found += parts[name]
    return found


def asked_parts(scene: Scene) -> frozenset[PartName]:
    """The parts that a scene asks for by what it holds: a plain scene costs no more than its direct and ambient light.

    Fog brings airlight, scatter and indirect light, skin subsurface light, `Scene.indirect` interreflection.
    """
    asked: set[PartName] = set(PLAIN)
    asked |= {name for name in PARTS if name not in asked and name != "indirect" and holds(scene, name)}
    if scene.indirect or holds(scene, "airlight"):
        asked.add("indirect")
    return frozenset(asked)


def holds(scene: Scene, name: PartName) -> bool:
    """Whether a scene holds what a part comes from; without it the part is black and is not prepared."""
    if name in {"airlight", "scatter"}:
        return scene.fog is not None and scene.fog.scattering_per_m > 0
    if name == "subsurface":
        return any(isinstance(item.material, Skin) for item in scene.objects)
    if name == "indirect":
        return bool(scene.objects)
    return True


def within_order(parts: Collection[PartName], max_order: int | None) -> frozenset[PartName]:
    """Those of the parts that hold light which changed direction at most `max_order` times; None: any number."""
    first: frozenset[PartName] = frozenset({"direct", "airlight", "ambient"})
    return frozenset(parts) & first if max_order == 1 else frozenset(parts)


class Lights:
    """The parts of a scene that are made ready so far, each under its name."""

    def __init__(self, parts: Iterable[LightPart] = ()) -> None:
        self._parts: dict[PartName, LightPart] = {part.name: part for part in parts}
        self._pattern: Singles | None = None

    @property
    def names(self) -> tuple[PartName, ...]:
        """Which parts are ready, in the order of PARTS."""
        return tuple(name for name in PARTS if name in self._parts)

    def put(self, part: LightPart) -> None:
        """Take this part, in the place of a former one of its name, lit as the others are."""
        part.light_with(self._pattern)
        self._parts[part.name] = part

    def drop(self, name: PartName) -> None:
        """Forget a part, if it is there."""
        self._parts.pop(name, None)

    def part(self, name: PartName) -> LightPart:
        """One part that is ready. Raises KeyError for another."""
        return self._parts[name]

    def add(self, windows: RowWindows, shown: Collection[PartName], out: Singles) -> None:
        """Add what these windows record of the parts that are ready and `shown` to out, as `LightPart.add`."""
        for name in self.names:
            if name in shown:
                self._parts[name].add(windows, out)

    def light_with(self, pattern: Singles | None) -> None:
        """Let every part, and every one that comes, be as if the projector showed this: see `LightPart.light_with`."""
        self._pattern = pattern
        for part in self._parts.values():
            part.light_with(pattern)

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Let every part take over what has moved."""
        for part in self._parts.values():
            part.follow(buffers, region, time_s)
