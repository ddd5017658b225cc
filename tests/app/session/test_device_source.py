"""What the window makes of a camera whose scene it does not know: its rig, its gates, what it cannot do."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigs import calibrated
from slopegate.app.session.device_source import device_source, open_pictures
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Intent, Session, reachable, resolve
from slopegate.app.session.source import Options
from slopegate.core.gating.gate import slab
from slopegate.core.rig.settings import GateSettings, LineTimes, ShutterLimits, Steps, gate, quantise, to_trigger
from slopegate.drivers.cameras.video import NO_GATE, PLAIN
from slopegate.drivers.captures.film import END, FilmWriter, create_film, make_film_manifest
from slopegate.drivers.captures.model import FilmEnd, FilmFrame, Gate
from slopegate.drivers.contract.device_rig import device_rig, seen_rig
from slopegate.drivers.contract.families import Address, read_address
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo
from slopegate.drivers.files.rig_files import parse_rig, rig_to_toml
from small_window import small_rig

RIG = small_rig()
WHERE = Address("gentl", "A:1")


class Said:
    """A camera of which nothing is asked but its facts."""

    def __init__(self, info: CameraInfo) -> None:
        self.info = info


def facts(size: tuple[int, int] = (320, 240), limits: ShutterLimits | None = None, **can: Ability) -> CameraInfo:
    return CameraInfo("Plain camera", *size, "mono8", 255, 0.0, limits, Abilities(**can))


def source_of(info: CameraInfo) -> Any:
    return device_source(WHERE, RIG, Said(info), Options())  # type: ignore[arg-type]


def test_addresses_are_read_as_they_are_written() -> None:
    assert read_address(str(WHERE)) == WHERE
    for wrong in ("", "gentl", ":1", "gentl:"):
        with pytest.raises(ValueError, match="FAMILY:WHERE"):
            read_address(wrong)


def test_the_limits_are_those_that_camera_and_rig_allow() -> None:
    limits = ShutterLimits(LineTimes(20, 30, 0.5), Steps(0, 9000, 1), Steps(200, 20000, 10))
    made = source_of(facts(limits=limits))
    assert made.rig.camera.shutter == limits
    assert made.rig.camera.lens == RIG.camera.lens
    assert made.is_device
    assert made.place == "gentl:A:1"
    assert made.remark == made.no_gate == made.no_timing == ""
    assert [preset.name for preset in made.presets] == ["Everything lit", "Upright at 1 m"]
    assert made.rig.calibration is None
    found = slab(made.rig, resolve(made.rig, Intent(made.presets[1].settings)).gate)
    assert found.distance_m == pytest.approx(1.0, abs=0.02)


def test_what_a_camera_says_of_itself_is_not_what_was_calibrated() -> None:
    """Other clocks a line, other pixels: the calibration follows, or says no more of them."""
    known = calibrated(RIG)
    assert known.calibration is not None
    same, _ = device_rig(known, facts(limits=RIG.camera.shutter))
    assert same.calibration == known.calibration
    lines, _ = device_rig(
        known, facts(limits=ShutterLimits(LineTimes(20, 30, 0.5), Steps(0, 9000, 1), Steps(9, 99, 1)))
    )
    assert lines.calibration is not None
    assert set(known.calibration.names) - set(lines.calibration.names) == {"clocks_per_line"}
    assert parse_rig(rig_to_toml(lines), "x").calibration == lines.calibration
    larger, _ = seen_rig(known, facts((640, 400)))
    assert larger.calibration is not None
    errors, before = larger.calibration.standard_errors, known.calibration.standard_errors
    for name in ("camera.fx", "camera.fy", "camera.cx", "camera.cy"):
        assert errors[name] == pytest.approx(2 * before[name])
    assert errors["projector.fx"] == pytest.approx(before["projector.fx"])


@pytest.mark.parametrize("size", [(640, 480), (512, 512), (160, 100)])
def test_a_camera_of_another_size_sees_the_same_width(size: tuple[int, int]) -> None:
    rig, remark = seen_rig(RIG, facts(size))
    assert "describes 320 \u00d7 240" in remark
    assert (rig.camera.lens.width, rig.camera.lens.height) == size
    left, middle, right = (float(rig.camera.lens.normalise(x, size[1] / 2)[0]) for x in (0, size[0] / 2, size[0]))
    expected = [float(RIG.camera.lens.normalise(x, 120)[0]) for x in (0, 160, 320)]
    assert [left, middle, right] == pytest.approx(expected)
    assert float(rig.camera.lens.normalise(0, size[1] / 2)[1]) == pytest.approx(0.0)


def test_a_plain_camera_has_no_gate_and_no_remark_about_distances() -> None:
    made = source_of(replace(facts((640, 480)), can=PLAIN))
    assert made.no_gate == made.no_timing == NO_GATE.missing
    assert made.remark == ""


def test_a_camera_without_a_delay_is_asked_for_the_one_that_it_has() -> None:
    limits = replace(RIG.camera.shutter, delay_offset_us=700.0)
    made = source_of(facts(limits=limits, delay=Ability("It has none.")))
    assert made.no_timing == ""
    assert made.no_gate == "It has none."
    intent = reachable(made, Intent(gate(12.0, 4321.0, 1000.0)))
    assert to_trigger(intent.wish).start_us == pytest.approx(-700.0)
    assert intent.wish.exposure_us == 1000.0


def test_without_the_trigger_nobody_knows_where_the_slab_is() -> None:
    made = source_of(facts(limits=RIG.camera.shutter, trigger=Ability("It runs by itself.")))
    assert made.no_timing == made.no_gate == "It runs by itself."
    assert len(made.presets) == 1


def test_a_gate_that_is_always_the_same_is_known_and_stays(tmp_path: Path) -> None:
    """Its preset is taken, whatever gate the window had, and nothing else is granted."""
    folder = tmp_path / "film"
    made = record(folder, lost_by_camera=2, lost_by_disk=1)
    source = open_pictures(folder, RIG, Options(), Progress(lambda share, text: None))
    with closing(source):
        assert source.fixed_gate == source.no_gate == source.no_plane == "The gate is fixed by the recording."
        assert source.no_timing == ""
        assert (source.triggered, source.replayed, source.lost_before) == (False, True, 3)
        assert source.remark == (
            "3 frames were lost while this was recorded: 2 by the camera and 1 because the disk was too slow"
        )
        assert source.own_rig == "A recording has the rig that it was recorded with"
        session = Session()
        session.adopt(source, Intent(gate(20.0, 5000.0, 700.0), complement=True))
        assert session.resolved is not None
        assert session.resolved.sent == made
        assert not session.ask_wish(gate(20.0, 5000.0, 700.0))
        assert session.refusal == "The gate is fixed by the recording."
        assert session.use(source.presets[0])
        session.close()


def record(path: Path, lost_by_camera: int, lost_by_disk: int) -> GateSettings:
    """A recording of two frames that tells of losses; its gate."""
    limits = RIG.camera.shutter
    wanted = quantise(limits, gate(25.0, 3000.0, 500.0), RIG.projector.period_us)
    info = facts(limits=limits)
    folder = create_film(path, make_film_manifest("A scene", RIG, info, wanted))
    writer, kept = FilmWriter(folder), Gate.of(wanted)
    for number in range(2):
        image = np.full((info.height, info.width), number, np.uint16)
        stamped = FilmFrame(
            number=number, sequence=number, time_s=0.05 * number, taken="2026-01-01T00:00:00Z", asked=kept, applied=kept
        )
        writer.add(image, stamped)
    writer.close()
    end = FilmEnd(
        frames=2,
        lost_by_camera=lost_by_camera,
        lost_by_disk=lost_by_disk,
        repeated=0,
        seconds=0.05,
        bytes=1,
        ended="It was stopped",
    )
    (path / END).write_text(end.model_dump_json(), "utf-8")
    return wanted
