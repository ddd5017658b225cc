"""Ways to prepare the parts of a scene's light: what is measured of each, and what it is measured against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from slopegate.app.bench.subject import Subject
from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import Baked, BakeSettings
from slopegate.core.light.indirect import SMOOTHING_RADIUS, Indirect
from slopegate.core.light.lights import asked_parts
from slopegate.core.light.part import LightPart, PartName

DEFAULT_BAKE: Final = BakeSettings()


@dataclass(frozen=True, eq=False)
class LightWay:
    """One way to prepare a part. prepare does it, and is timed."""

    name: str
    prepare: Callable[[], LightPart]
    default: bool = False


@dataclass(frozen=True, eq=False)
class PartTruth:
    """What ways of a part are measured against: a slower, finer one. halves: two independent ones if it has noise."""

    whole: LightPart
    halves: tuple[LightPart, LightPart] | None = None


@dataclass(frozen=True, eq=False)
class Study:
    """A part, the ways to prepare it, and what they are measured against."""

    part: PartName
    truth: PartTruth
    ways: list[LightWay]


def indirect_study(subject: Subject, paths: tuple[int, ...], truth_paths: int, order: int) -> Study:
    """Indirect light: numbers of paths, sizes of cells, bands of projector rows, smoothing."""
    return Study("indirect", _indirect_truth(subject, truth_paths, order), _indirect_ways(subject, paths, order))


def usual_parts(subject: Subject, paths: int, order: int) -> list[LightPart]:
    """All parts beside direct and ambient light, prepared as the program does."""
    parts = []
    if "indirect" in asked_parts(subject.scene):
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

    def prepare() -> LightPart:
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


def _shown(subject: Subject, bake: Bake, baked: Baked, radius: int) -> LightPart:
    part = Indirect(subject.rig, bake.picture, "mono", radius)
    part.show(baked)
    return part
