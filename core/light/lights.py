"""All light of one scene beyond the direct path, for one camera: which parts there are, and their sum for a gate."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.part import PARTS, LightPart, PartName
from slopegate.core.render.render import Buffers, Region
from slopegate.core.rig.arrays import Singles
from slopegate.core.scene.materials import Skin
from slopegate.core.scene.scene import Scene


def asked_parts(scene: Scene) -> frozenset[PartName]:
    """The parts that a scene asks for by what it holds: a plain scene costs no more than its direct and ambient light.

    Fog brings airlight, scatter and indirect light, skin subsurface light, `Scene.indirect` interreflection.
    """
    asked: set[PartName] = {"direct", "ambient"}
    if scene.fog is not None and scene.fog.scattering_per_m > 0:
        asked |= {"airlight", "scatter", "indirect"}
    if any(isinstance(item.material, Skin) for item in scene.objects):
        asked.add("subsurface")
    if scene.indirect:
        asked.add("indirect")
    return frozenset(asked)


def within_order(parts: Collection[PartName], max_order: int | None) -> frozenset[PartName]:
    """Those of the parts that hold light which changed direction at most `max_order` times; None: any number."""
    first: frozenset[PartName] = frozenset({"direct", "airlight", "ambient"})
    return frozenset(parts) & first if max_order == 1 else frozenset(parts)


class Lights:
    """The parts of a scene that are made ready so far, each under its name."""

    def __init__(self, parts: Iterable[LightPart] = ()) -> None:
        self._parts: dict[PartName, LightPart] = {part.name: part for part in parts}

    @property
    def names(self) -> tuple[PartName, ...]:
        """Which parts are ready, in the order of PARTS."""
        return tuple(name for name in PARTS if name in self._parts)

    def put(self, part: LightPart) -> None:
        """Take this part, in the place of a former one of its name."""
        self._parts[part.name] = part

    def part(self, name: PartName) -> LightPart:
        """One part that is ready. Raises KeyError for another."""
        return self._parts[name]

    def add(self, windows: RowWindows, shown: Collection[PartName], out: Singles) -> None:
        """Add what these windows record of the parts that are ready and `shown` to out, as `LightPart.add`."""
        for name in self.names:
            if name in shown:
                self._parts[name].add(windows, out)

    def follow(self, buffers: Buffers, region: Region) -> None:
        """Let every part take over what has moved."""
        for part in self._parts.values():
            part.follow(buffers, region)
