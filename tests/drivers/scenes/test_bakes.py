"""Bakes on the disk: found again, gone on with, kept when stopped; and what is refused."""

from __future__ import annotations

import os
import threading
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from interrupts import caught
from rigs import plain_rig, shutter
from slopegate.core.light.bake import Bake, trace_in_turn
from slopegate.core.light.baked import BakeSettings
from slopegate.core.render.render import Cancelled, Progress
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.drivers.scenes import bakes
from slopegate.drivers.scenes.bakes import BakeGoal, bake_key, bake_to, begin_bake, check_memory, trace_both

RIG = plain_rig(48, 36, 50.0, shutter(PixelClocks(10 * 996.66866, (78.0,))))
SETTINGS = BakeSettings(pitch_px=4, bands=12, max_order=3)


def corner() -> Scene:
    floor = plane("floor", (0.0, 0.3, 1.2), (2.0, 1.2), turn(tilt_deg=90.0), Finish((0.7, 0.7, 0.7)))
    wall = plane("wall", (0.0, 0.0, 1.6), (2.0, 1.2), turn(), Finish((0.6, 0.6, 0.6)))
    return Scene("corner", objects=(floor, wall, Sphere("ball", (0.1, 0.1, 1.2), 0.1)))


def assert_equal(one: Bake, other: Bake) -> None:
    a, b = one.snapshot(), other.snapshot()
    for item in fields(a):
        np.testing.assert_array_equal(getattr(a, item.name), getattr(b, item.name))


def test_a_bake_is_found_again_and_gone_on_with(tmp_path: Path) -> None:
    first = begin_bake(RIG, corner(), SETTINGS, folder=tmp_path)
    report = bake_to(first, BakeGoal(paths=32), folder=tmp_path)
    assert not report.cached
    assert report.paths >= 32
    assert 0 < report.error_percent < 100
    again = begin_bake(RIG, corner(), SETTINGS, folder=tmp_path)
    assert_equal(first, again)
    assert bake_to(again, BakeGoal(paths=32), folder=tmp_path).cached
    more = bake_to(again, BakeGoal(paths=128), folder=tmp_path)
    assert not more.cached
    assert more.paths >= 128
    assert begin_bake(RIG, corner(), SETTINGS, folder=tmp_path).paths == more.paths


def test_two_threads_trace_what_one_does() -> None:
    one, two = Bake(RIG, corner(), SETTINGS), Bake(RIG, corner(), SETTINGS)
    trace_in_turn(one, 8, None)
    trace_both(two, 8, None)
    assert_equal(one, two)


@pytest.mark.skipif(os.name == "nt", reason="no thread can be sent a signal there")
def test_an_interrupted_pass_is_added_whole_or_not_at_all() -> None:
    first_is_there = threading.Event()

    class Struck(Bake):
        def trace(self, half: int, each: int, progress: Progress | None = None) -> None:
            if half == 1:
                assert first_is_there.wait(30)
                interrupt.strike()
            super().trace(half, each, progress)
            first_is_there.set()

    bake, whole = Struck(RIG, corner(), SETTINGS), Bake(RIG, corner(), SETTINGS)
    with caught() as interrupt:
        trace_both(bake, 8, None)
    assert not interrupt.early
    whole.trace(0, 8)
    assert_equal(bake, whole)


def test_stopping_leaves_what_whole_passes_brought(tmp_path: Path) -> None:
    bake = begin_bake(RIG, corner(), SETTINGS, folder=tmp_path)
    told: list[float] = []

    def progress(share: float) -> bool:
        told.append(share)
        return bake.paths < 32

    with pytest.raises(Cancelled):
        bake_to(bake, BakeGoal(paths=4096), progress, tmp_path)
    assert told == sorted(told)
    kept = begin_bake(RIG, corner(), SETTINGS, folder=tmp_path)
    assert kept.paths == bake.paths >= 32
    assert_equal(bake, kept)


@pytest.mark.parametrize("change", ["ball moved", "other colour", "other order", "other rig", "fog"])
def test_what_changes_the_light_is_another_bake(change: str) -> None:
    scene, rig, settings = corner(), RIG, SETTINGS
    key = bake_key(rig, scene, settings)
    assert key == bake_key(rig, replace(corner(), name="other name", ambient=0.5), settings)
    first, *rest = scene.objects
    assert not isinstance(first, Sphere)
    match change:
        case "ball moved":
            scene = replace(scene, objects=(first, rest[0], Sphere("ball", (0.1, 0.1, 1.3), 0.1)))
        case "other colour":
            scene = replace(scene, objects=(replace(first, albedo=(0.7, 0.7, 0.6)), *rest))
        case "other order":
            settings = replace(settings, max_order=4)
        case "other rig":
            rig = plain_rig(48, 36, 51.0, shutter(PixelClocks(10 * 996.66866, (78.0,))))
        case "fog":
            scene = replace(scene, fog=Fog(0.5))
    assert bake_key(rig, scene, settings) != key


def test_a_disk_that_cannot_be_written_costs_the_bake_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("in the way")
    bake = begin_bake(RIG, corner(), SETTINGS, folder=tmp_path / "file" / "bakes")
    assert bake_to(bake, BakeGoal(paths=16), folder=tmp_path / "file" / "bakes").paths >= 16
    assert "is not kept" in caplog.text


def test_more_memory_than_there_is_is_refused_with_the_amount() -> None:
    check_memory(10_000_000, 20_000_000)
    with pytest.raises(InputError, match="needs 30 MB of memory, and 20 MB are free"):
        check_memory(30_000_000, 20_000_000)
    assert bakes.free_bytes() is None or bakes.free_bytes() > 1_000_000  # type: ignore[operator]
