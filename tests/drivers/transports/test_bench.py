"""A scene's own bench: what it acquires is the scene's light, and resumed it is the same to the byte."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.light.part import PartName
from slopegate.core.rig.blocks import parse_grid
from slopegate.drivers.transports.bench import SceneBench
from slopegate.drivers.transports.run import Attendance
from slopegate.drivers.transports.storage import TransportFolder, open_transport
from small_transport import RIG, SCENE

PARTS: tuple[PartName, ...] = ("direct",)
SEED = 5


def folder_for(bench: SceneBench, path: Path) -> TransportFolder:
    """Two slices of 4 x 2 blocks that are both everything lit."""
    grid = parse_grid("4x2", RIG.projector.raster)
    return bench.begin(path, grid, "hadamard", [whole_period(RIG, upright_line_time(RIG))] * 2)


def test_its_frames_are_acquired_and_a_resumed_acquisition_is_the_same_to_the_byte(tmp_path: Path) -> None:
    first = SceneBench(RIG, SCENE, PARTS, SEED)
    whole = folder_for(first, tmp_path / "whole")
    assert first.acquire(whole).state == "done"

    bench = SceneBench(RIG, SCENE, PARTS, SEED, counts_per_unit=first.sensor.counts_per_unit)
    cut = folder_for(bench, tmp_path / "cut")
    stopped = bench.acquire(cut, Attendance(given_up=lambda: bool(cut.records())))
    assert (stopped.state, stopped.slices_done) == ("cancelled", 1)
    again = SceneBench(RIG, SCENE, PARTS, SEED, counts_per_unit=first.sensor.counts_per_unit)
    assert again.acquire(open_transport(tmp_path / "cut")).state == "done"
    for name in ("white.npz", "slice_0000.npz", "slice_0001.npz"):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name


def test_it_shows_the_parts_that_are_asked_for(tmp_path: Path) -> None:
    lit = replace(SCENE, indirect=True)
    told: list[float] = []

    def progress(share: float) -> bool:
        told.append(share)
        return True

    with_bounces = SceneBench(RIG, lit, ("direct", "indirect"), None, progress=progress)
    plain = SceneBench(RIG, lit, PARTS, None, counts_per_unit=with_bounces.sensor.counts_per_unit)
    images = []
    for name, bench in (("with", with_bounces), ("without", plain)):
        folder = folder_for(bench, tmp_path / name)
        bench.acquire(folder)
        images.append(folder.slice(0).total)
    assert 1e-4 < float((images[0] - images[1]).mean() / images[1].mean()) < 0.5
    assert told == sorted(told)
    assert told[-1] > 0.9


def test_patterns_light_the_scene_through_a_blurred_lens(tmp_path: Path) -> None:
    """Direct light is then one of the parts that are prepared: without it every pattern looked like everything lit."""
    blurred = replace(RIG, camera=replace(RIG.camera, blur_px=0.6))
    bench = SceneBench(blurred, SCENE, PARTS, None)
    folder = folder_for(bench, tmp_path / "blurred")
    assert bench.acquire(folder).state == "done"
    assert float(folder.slice(0).total.mean()) > 0
