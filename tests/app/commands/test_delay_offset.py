"""The README's way to the delay offset, tried on a camera that starts later than the program was told."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from slopegate.app.cli import main
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, from_trigger, gate, to_trigger
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.device_camera import trigger_delay
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml

Capture = pytest.CaptureFixture[str]
Take = Callable[[GateSettings], NDArray[np.uint16]]
SPAN_US = (0.0, 1e6, 1.0)


def with_offset(rig: Rig, offset_us: float) -> Rig:
    shutter = replace(rig.camera.shutter, delay_offset_us=offset_us)
    return replace(rig, camera=replace(rig.camera, shutter=shutter))


def wired_rig(rig: Rig, true_us: float, distance_m: float) -> Take:
    """A rig with a board of this distance before it, whose rows begin `true_us` before the trigger delay says so.

    It is told a trigger delay as every driver tells it, from the offset in the rig file.
    """
    scene = Scene("A board", objects=(plane("board", (0.0, 0.0, distance_m), (4.0, 4.0), turn()),))
    camera = VirtualCamera(rig, scene, rate_hz=math.inf, noise=False)
    camera.start()
    frame = np.zeros((camera.info.height, camera.info.width), np.uint16)

    def take(settings: GateSettings) -> NDArray[np.uint16]:
        wanted = to_trigger(settings)
        told_us, _ = trigger_delay(
            SPAN_US, wanted.start_us + rig.camera.shutter.delay_offset_us, rig.projector.period_us
        )
        start = type(wanted.start_us)(told_us - true_us)
        camera.configure(from_trigger(replace(wanted, start_us=start)))
        assert camera.read(frame, 5.0) is not None
        return frame

    return take


def middle_delay_us(take: Take, rig: Rig, clock_mhz: float, exposure_us: float) -> float:
    """As by hand: through a projector period in coarse steps, then to both ends of where the image's middle is lit."""
    line = rig.camera.shutter.line
    height, width = rig.camera.lens.height, rig.camera.lens.width
    middle = slice(height // 2 - 2, height // 2 + 2), slice(width // 2 - 20, width // 2 + 20)

    def level(delay_us: float) -> float:
        return float(take(gate(line.line_time_us(clock_mhz), delay_us, exposure_us))[middle].mean())

    delays = np.arange(0.0, rig.projector.period_us, exposure_us / 2)
    levels = [level(delay_us) for delay_us in delays]
    best = float(delays[int(np.argmax(levels))])
    half = (max(levels) + min(levels)) / 2
    ends = []
    for step in (-1.0, 1.0):
        end = best
        while level(end) > half:
            end += step
        ends.append(end - step / 2)
    return sum(ends) / 2


def planned(capsys: Capture, rig_file: Path, distance_m: float, *more: str) -> dict[str, float]:
    words = ["plan", "--tilt-deg", "0", "--distance-m", str(distance_m), "--thickness-m", "0.05"]
    assert main([*words, "--rig", str(rig_file), "--json", *more]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(("told_us", "true_us"), [(0.0, 7000.0), (16250.0, 7000.0), (7000.0, 7000.0), (0.0, -300.0)])
def test_a_board_at_a_known_distance_gives_the_offset(
    rig: Rig, tmp_path: Path, capsys: Capture, told_us: float, true_us: float
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(with_offset(rig, told_us)))
    rig = load_rig(path)
    period_us = rig.projector.period_us
    clock_mhz = planned(capsys, path, 1.2)["clock_mhz"]
    found_us = middle_delay_us(wired_rig(rig, true_us, 1.2), rig, clock_mhz, 200.0)
    offset_us = planned(capsys, path, 1.2, "--found-delay-us", str(found_us))["delay_offset_us"]
    # whole periods make no difference
    assert abs(math.remainder(offset_us - true_us, period_us)) < 1.0
    # the new rig file now lights the board where the plan says, and nearer by another
    path.write_text(rig_to_toml(with_offset(rig, offset_us)))
    rig = load_rig(path)
    for distance_m in (1.2, 0.8):
        values = planned(capsys, path, distance_m)
        wanted = gate(values["line_time_us"], values["delay_us"], values["exposure_us"])
        take = wired_rig(rig, true_us, distance_m)
        lit = take(gate(values["line_time_us"], period_us / 2, period_us)).copy()
        seen = take(wanted)
        middle = slice(60, 180), slice(80, 240)
        assert (seen[middle] >= 0.95 * lit[middle]).mean() > 0.95


def test_it_is_printed_to_be_copied(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(with_offset(load_rig(None), 500.0)))
    words = ["plan", "--tilt-deg", "0", "--distance-m", "1", "--thickness-m", "0.05", "--rig", str(path)]
    assert main([*words, "--found-delay-us", "2629.6339"]) == 0
    out = capsys.readouterr().out
    # 500 us later than the plan's 2129.6339
    assert out.endswith(
        "That target lit up at 2629.63 us, so in the rig file, under [shutter]:\n  delay_offset_us = 1000.0\n"
    )


def test_it_needs_a_distance(capsys: Capture) -> None:
    words = ["plan", "--plane=0,0,1,-1", "--thickness-m", "0.05", "--found-delay-us", "2000"]
    assert main(words) == 2
    assert "--found-delay-us goes with --tilt-deg and --distance-m" in capsys.readouterr().err
