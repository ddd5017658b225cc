"""Ways to prepare the parts of a scene's light: what is measured of each, and what it is measured against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, Protocol

from slopegate.app.bench.subject import Subject
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.airlight import TableSize, prepare_airlight
from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import Baked, BakeSettings
from slopegate.core.light.indirect import SMOOTHING_RADIUS, Indirect
from slopegate.core.light.lights import PLAIN, asked_parts
from slopegate.core.light.part import PartName
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.light.scatter import Scatter, ScatterSums
from slopegate.core.render.render import render
from slopegate.core.rig.arrays import Singles

DEFAULT_BAKE: Final = BakeSettings()


class PreparedLight(Protocol):
    """What can be added for any gate, as `LightPart.add`."""

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add what these windows record to out."""
        ...


@dataclass(frozen=True, eq=False)
class LightWay:
    """One way to prepare a part. prepare does it, and is timed."""

    name: str
    prepare: Callable[[], PreparedLight]
    default: bool = False


@dataclass(frozen=True, eq=False)
class PartTruth:
    """What ways of a part are measured against: a slower, finer one. halves: two independent ones if it has noise."""

    whole: PreparedLight
    halves: tuple[PreparedLight, PreparedLight] | None = None


@dataclass(frozen=True, eq=False)
class Study:
    """A part, the ways to prepare it, and what they are measured against."""

    part: PartName
    truth: PartTruth
    ways: list[LightWay]


def indirect_study(subject: Subject, paths: tuple[int, ...], truth_paths: int, order: int) -> Study:
    """Indirect light: numbers of paths, sizes of cells, bands of projector rows, smoothing."""
    return Study("indirect", _indirect_truth(subject, truth_paths, order), _indirect_ways(subject, paths, order))


def airlight_study(subject: Subject) -> Study:
    """Airlight: how fine its table is, across the picture and along rays."""
    seen = render(subject.rig, subject.scene)
    usual = TableSize()

    def prepared(size: TableSize) -> PreparedLight:
        return prepare_airlight(subject.rig, subject.scene, seen, "mono", size=size)

    def way(name: str, size: TableSize) -> LightWay:
        return LightWay(name, partial(prepared, size), size == usual)

    ways = [way(f"rays {usual.pixels} pixels apart, {usual.nodes} steps along each", usual)]
    for pixels in (usual.pixels // 2, 2 * usual.pixels):
        ways.append(way(f"{pixels} pixels apart, not {usual.pixels}", TableSize(pixels, usual.nodes)))
    for nodes in (usual.nodes // 4, usual.nodes // 2, 2 * usual.nodes):
        ways.append(way(f"{nodes} steps, not {usual.nodes}", TableSize(usual.pixels, nodes)))
    return Study("airlight", PartTruth(prepared(TableSize(2, 4 * usual.nodes))), ways)


def scatter_study(subject: Subject) -> Study:
    """The near halo: by layers of Gaussians as the program does, and pair by pair, which is exact."""
    seen = render(subject.rig, subject.scene)
    made_for = subject.rig, subject.scene, seen
    ways = [
        LightWay("sums of Gaussians", lambda: Scatter(*made_for, "mono"), True),
        LightWay("all pairs of pixels", lambda: ScatterSums(*made_for, "mono")),
    ]
    return Study("scatter", PartTruth(ScatterSums(*made_for, "mono")), ways)


def usual_parts(subject: Subject, paths: int, order: int) -> list[PreparedLight]:
    """All parts beside direct and ambient light, prepared as the program does."""
    asked = asked_parts(subject.scene) - PLAIN
    seen = SeenScene(subject.rig, subject.scene, render(subject.rig, subject.scene), "mono", max_order=order)
    parts: list[PreparedLight] = [*prepare_parts(seen, asked)]
    if "indirect" in asked:
        parts.append(_bake_way(subject, "", paths, BakeSettings(max_order=order)).prepare())
    return parts


def _bake_way(
    subject: Subject,
    name: str,
    paths: int,
    settings: BakeSettings = DEFAULT_BAKE,
    radius: int = SMOOTHING_RADIUS,
    default: bool = False,
) -> LightWay:
    """Indirect light baked with so many paths a cell, and cells smoothed over this radius."""

    def prepare() -> PreparedLight:
        bake = Bake(subject.rig, subject.scene, settings)
        for half in (0, 1):
            bake.trace(half, paths // 2)
        return _shown(subject, bake, bake.snapshot(), radius)

    return LightWay(name, prepare, default)


def _indirect_ways(subject: Subject, paths: tuple[int, ...], max_order: int) -> list[LightWay]:
    """One thing changed at a time, from the default with the middle one of these numbers of paths (each at least 2)."""
    usual = paths[len(paths) // 2]
    plain = BakeSettings(max_order=max_order)
    pitch = plain.pitch_for(subject.rig)

    def way(name: str, settings: BakeSettings = plain, radius: int = SMOOTHING_RADIUS, count: int = usual) -> LightWay:
        return _bake_way(subject, name, count, settings, radius, name == f"{usual} paths a cell")

    found = [way(f"{count} paths a cell", count=count) for count in paths]
    for other in (max(1, pitch // 2), 2 * pitch):
        cells = BakeSettings(pitch_px=other, max_order=max_order)
        found.append(way(f"cells of {other} pixels, not {pitch}", cells))
    for bands in (plain.bands // 2, 2 * plain.bands, 4 * plain.bands):
        found.append(way(f"{bands} bands, not {plain.bands}", BakeSettings(bands=bands, max_order=max_order)))
    for radius in (0, 1, 2 * SMOOTHING_RADIUS):
        found.append(way(f"smoothed over {radius} cells, not {SMOOTHING_RADIUS}", radius=radius))
    return found


def _indirect_truth(subject: Subject, paths: int, max_order: int) -> PartTruth:
    """Cells of two pixels, bands of two rows, no smoothing, and so many paths a cell."""
    bands = max(1, subject.rig.projector.lens.height // 2)
    bake = Bake(subject.rig, subject.scene, BakeSettings(pitch_px=2, bands=bands, max_order=max_order, seed=99))
    for half in (0, 1):
        bake.trace(half, paths // 2)
    baked = bake.snapshot()
    one, other = (_shown(subject, bake, baked.half(which), 0) for which in (0, 1))
    return PartTruth(_shown(subject, bake, baked, 0), (one, other))


def _shown(subject: Subject, bake: Bake, baked: Baked, radius: int) -> PreparedLight:
    part = Indirect(subject.rig, bake.picture, "mono", radius)
    part.show(baked)
    return part
