"""Against a stand-in for IDS' library that keeps the vendor's order and ranges and freezes where the camera would."""

from __future__ import annotations

import ctypes
import importlib
import os
import subprocess
import sys
import time
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import LADDER, plain_rig, shutter
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, LineTimes, PixelClocks, gate
from slopegate.drivers.cameras.ueye import find_ueye, missing_ueye, open_ueye
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import Frame, OpenOptions
from slopegate.drivers.stream.stream import Stream
from ueye_stub import CLOCKS_PER_LINE, SERIAL, Stub, stub
from waiting import next_frame, until

PERIOD_US = 16666.7
CLOCKS = PixelClocks(CLOCKS_PER_LINE, LADDER)


def make_rig(offset_us: float = 0.0, line: PixelClocks | LineTimes = CLOCKS, size: tuple[int, int] = (320, 240)) -> Rig:
    return plain_rig(*size, 500.0, shutter(line, offset_us=offset_us))


@pytest.fixture
def library() -> Stub:
    loaded = stub()
    loaded.fresh()
    return loaded


def settled_frame(stream: Stream, asked: GateSettings) -> Frame:
    frame = next_frame(stream)
    while not frame.stamp.settled or frame.stamp.asked != asked:
        frame = next_frame(stream)
    return frame


def made_with(image: NDArray[np.uint16]) -> dict[str, int]:
    """What the camera wrote into the frame: exposure and delay in microseconds, clock in MHz, first row, shutter."""
    part = [int(value) for value in image[np.flatnonzero(image.any(axis=1))[0], :8]]
    return {
        "exposure": part[0] + 4096 * part[1],
        "delay": part[2] + 4096 * part[3],
        "clock": part[4],
        "row": part[6],
        "shutter": part[7],
    }


def assert_made_with(frame: Frame, offset_us: float = 0.0) -> None:
    applied = frame.stamp.applied
    assert applied is not None
    truth = made_with(frame.image)
    assert truth["exposure"] == round(applied.exposure_us)
    assert CLOCKS_PER_LINE / truth["clock"] == pytest.approx(applied.line_time_us)
    first = 0 if frame.stamp.rows is None else frame.stamp.rows[0]
    start_us = applied.delay_us - applied.exposure_us / 2 + offset_us + first * applied.line_time_us
    turns = (truth["delay"] - start_us) / PERIOD_US
    assert turns == pytest.approx(round(turns), abs=2e-4)


def test_it_is_found_with_its_serial_number(library: Stub) -> None:
    assert missing_ueye() == ""
    (found,) = find_ueye()
    assert (found.where, found.name, found.problem) == (SERIAL, "IDS UI-3250CP-C-HQ", "")
    library.plug(False)
    assert find_ueye() == []
    with pytest.raises(CameraError, match=r"No uEye camera has the serial number '4103123456' \(there are: none\)"):
        open_ueye(SERIAL, make_rig())


def test_one_in_use_is_told(library: Stub) -> None:
    library.occupy(True)
    assert "another program" in find_ueye()[0].problem
    with pytest.raises(CameraError, match="UI-3250CP-C-HQ 4103123456 is in use by another program"):
        open_ueye(SERIAL, make_rig())
    library.occupy(False)
    open_ueye(SERIAL, make_rig()).close()


@pytest.mark.parametrize(("mosaic", "form"), [(True, "bayer_gr12"), (False, "mono12")])
def test_twelve_bits_of_the_sensor_as_they_are(library: Stub, mosaic: bool, form: str) -> None:
    library.fresh(mosaic)
    # rows of 600 bytes, of which the stub keeps the next 64 bytes apart
    with Stream(open_ueye(SERIAL, make_rig(size=(300, 240)))) as stream:
        frame = next_frame(stream)
        rows, columns = np.mgrid[:240, :300]
        np.testing.assert_array_equal(frame.image[1:], ((rows * 7 + columns) & 4095)[1:])
        assert made_with(frame.image)["shutter"] == 1, "rolling"
    camera = open_ueye(SERIAL, make_rig())
    assert (camera.info.pixel_format, camera.info.max_count) == (form, 4095)
    can = camera.info.can
    assert all((can.line_time, can.delay, can.exposure, can.trigger, can.rows))
    camera.close()
    assert library.faults() == (0, "")


def test_the_ladder_is_what_rig_and_camera_share(library: Stub) -> None:
    camera = open_ueye(SERIAL, make_rig(line=PixelClocks(CLOCKS_PER_LINE, (7.0, 50.0, 51.0, 78.0, 126.0, 200.0))))
    assert camera.info.limits is not None
    assert camera.info.limits.line == PixelClocks(CLOCKS_PER_LINE, (50.0, 78.0))
    camera.close()
    with pytest.raises(CameraError, match="none of them is on the rig file's ladder"):
        open_ueye(SERIAL, make_rig(line=PixelClocks(CLOCKS_PER_LINE, (7.0, 51.0))))
    with pytest.raises(CameraError, match="clocks_per_line and ladder_mhz"):
        open_ueye(SERIAL, make_rig(line=LineTimes(5.0, 100.0, 0.1)))
    open_ueye(SERIAL, make_rig()).close()


@pytest.mark.parametrize("offset_us", [0.0, 7000.0, 16250.0])
@pytest.mark.parametrize(
    ("clock", "delay_us", "exposure_us"),
    [(78, 600, 500), (78, 300, 15570), (52, 15749, 940), (48, 16781, 4122), (128, -16000, 100), (10, 33000, 50000)],
)
def test_the_camera_gets_the_start_for_the_centre_asked_for(
    library: Stub, offset_us: float, clock: int, delay_us: float, exposure_us: float
) -> None:
    camera = open_ueye(SERIAL, make_rig(offset_us))
    asked = gate(CLOCKS.line_time_us(clock), delay_us, exposure_us)
    applied = camera.configure(asked)
    row_us = applied.line_time_us
    assert abs(applied.exposure_us - exposure_us) <= row_us / 2 + 1e-6
    assert applied.exposure_us / row_us == pytest.approx(round(applied.exposure_us / row_us))
    assert abs(applied.delay_us - delay_us) <= 0.51, "the middle stays, whatever became of the exposure"
    with Stream(camera) as stream:
        assert_made_with(next_frame(stream), offset_us)
    assert library.faults() == (0, "")


def test_changes_in_mid_stream_break_no_rule_and_no_frame_has_the_wrong_gate(library: Stub) -> None:
    rng = np.random.default_rng(7)
    library.trigger(500)
    checked = 0
    with Stream(open_ueye(SERIAL, make_rig(7000.0, size=(64, 48)))) as stream:
        asked = gate(CLOCKS.line_time_us(78), 600.0, 500.0)
        for _ in range(250):
            kind = int(rng.integers(3))
            line_us = CLOCKS.line_time_us(float(rng.choice(LADDER))) if kind == 0 else asked.line_time_us
            exposure_us = float(rng.integers(100, 2000)) if kind == 1 else asked.exposure_us
            asked = gate(line_us, float(rng.integers(-16000, 33000)), exposure_us)
            stream.submit(asked)
            for _ in range(int(rng.integers(1, 8))):
                frame = next_frame(stream)
                if frame.stamp.settled and frame.stamp.applied is not None:
                    assert_made_with(frame, 7000.0)
                    checked += 1
        assert_made_with(settled_frame(stream, asked), 7000.0)
        assert stream.counters.errors == 0
    assert checked > 100
    assert library.faults() == (0, ""), "nothing was set in the wrong order, out of range or in mid-stream"
    assert library.memories == 0


def test_only_the_delay_is_changed_while_it_runs(library: Stub) -> None:
    camera = open_ueye(SERIAL, make_rig())
    device: Any = camera._device
    camera.configure(gate(CLOCKS.line_time_us(78), 600.0, 500.0))
    camera.start()
    memory = device._memory
    camera.configure(gate(CLOCKS.line_time_us(78), 900.0, 500.0))
    assert device._memory is memory
    camera.configure(gate(CLOCKS.line_time_us(78), 900.0, 800.0))
    assert device._memory is not memory
    memory = device._memory
    camera.configure(gate(CLOCKS.line_time_us(50), 900.0, 800.0))
    assert device._memory is not memory
    camera.close()
    assert library.faults() == (0, "")


def test_the_edge_of_the_trigger_is_kept_when_it_comes_back(library: Stub) -> None:
    camera = open_ueye(SERIAL, make_rig(size=(64, 48)))
    image = np.zeros((48, 64), np.uint16)
    assert library.trigger_mode == 0x1002
    camera.start()
    until(lambda: camera.read(image, 0.2) is not None)
    camera.trigger_on("falling")
    assert library.trigger_mode == 0x1001
    library.plug(False)
    with pytest.raises(CameraGoneError):
        camera.configure(gate(CLOCKS.line_time_us(50), 600.0, 2000.0))
    library.plug(True)
    until(lambda: camera.read(image, 0.2) is not None)
    assert library.trigger_mode == 0x1001
    camera.trigger_on("rising")
    assert library.trigger_mode == 0x1002
    camera.close()
    assert library.faults() == (0, "")


def test_frames_that_waited_keep_the_intervals_of_the_cameras_clock(library: Stub) -> None:
    library.trigger(100)
    camera = open_ueye(SERIAL, make_rig(size=(64, 48)))
    camera.configure(gate(CLOCKS.line_time_us(128), 600.0, 500.0))
    camera.start()
    image = np.zeros((48, 64), np.uint16)

    def take() -> float:
        while (stamp := camera.read(image, 1.0)) is None:
            pass
        return stamp.time_s

    for _ in range(10):
        take()
    began = library.frames
    until(lambda: library.frames > began + 6)
    # they all wait in the memory, so they arrive at once
    assert min(np.diff([take() for _ in range(5)])) > 0.005
    camera.close()


def test_frames_that_nobody_took_in_time_are_a_gap(library: Stub) -> None:
    library.trigger(200)
    camera = open_ueye(SERIAL, make_rig(size=(64, 48)))
    camera.configure(gate(CLOCKS.line_time_us(128), 600.0, 500.0))
    camera.start()
    image = np.zeros((48, 64), np.uint16)

    def take() -> int:
        while (stamp := camera.read(image, 1.0)) is None:
            pass
        return stamp.sequence

    first = take()
    began = library.frames
    until(lambda: library.frames > began + 40)
    # eight frames wait in the memory; those after them were lost
    taken = [take() for _ in range(20)]
    assert taken[-1] - first >= 50
    assert max(np.diff([first, *taken])) > 20
    camera.close()


def test_rows_keep_their_gate(library: Stub) -> None:
    asked = gate(CLOCKS.line_time_us(78), 600.0, 500.0)
    camera = open_ueye(SERIAL, make_rig(7000.0))
    with Stream(camera) as stream:
        stream.submit(asked)
        settled_frame(stream, asked)
        assert camera.set_rows(51, 98) == (50, 98)
        frame = settled_frame(stream, asked)
        while frame.stamp.rows is None:
            frame = settled_frame(stream, asked)
        assert made_with(frame.image)["row"] == 50
        assert_made_with(frame, 7000.0)
        assert not frame.image[:50].any()
        assert not frame.image[98:].any()
    assert library.faults() == (0, "")


def test_a_trigger_that_never_comes_is_no_fault(library: Stub) -> None:
    library.trigger(0)
    with Stream(open_ueye(SERIAL, make_rig())) as stream:
        time.sleep(1.5)
        assert stream.running
        assert stream.error is None
        library.trigger(60)
        next_frame(stream)


def test_running_by_itself_it_needs_no_trigger(library: Stub) -> None:
    library.trigger(0)
    camera = open_ueye(SERIAL, make_rig(), OpenOptions(triggered=False, rate_hz=50.0))
    assert "without the projector's trigger" in camera.info.can.delay.missing
    library.trigger(1)  # the stand-in makes frames by itself at its own rate
    with Stream(camera) as stream:
        stream.submit(gate(CLOCKS.line_time_us(78), 600.0, 5000.0))
        until(lambda: stream.counters.made > 5)
    assert library.faults() == (0, "")


def test_ten_times_unplugged_in_mid_stream(library: Stub) -> None:
    asked = gate(CLOCKS.line_time_us(50), 600.0, 2000.0)
    with Stream(open_ueye(SERIAL, make_rig(size=(64, 48)))) as stream:
        stream.submit(asked)
        settled_frame(stream, asked)
        slowest_s = 0.0
        for round_ in range(10):
            lost = stream.counters.lost
            library.plug(False)
            until(lambda: stream.error is not None)
            if round_ % 3 == 0:
                time.sleep(0.2)
            library.plug(True)
            plugged_s, made = time.monotonic(), stream.counters.made
            until(lambda made=made: stream.counters.made > made)
            slowest_s = max(slowest_s, time.monotonic() - plugged_s)
            assert_made_with(settled_frame(stream, asked))
            assert stream.error is None
            assert stream.counters.lost > lost, "the gap shows"
        print(f"ten unpluggings, back within {slowest_s:.2f} s, {stream.counters}")
    assert library.faults() == (0, "")


def test_the_stand_in_is_strict(library: Stub) -> None:
    """What the driver never does: it would show."""
    ueye = importlib.import_module("pyueye.ueye")
    camera = open_ueye(SERIAL, make_rig())
    camera.start()
    clock = ctypes.c_uint(51)
    assert ueye.is_PixelClock(1, 6, clock, 4) == 125
    assert library.faults() == (1, "pixel clock")
    assert ueye.is_Exposure(1, 12, ctypes.c_double(1e9), 8) == 125
    assert library.faults() == (1, "exposure")
    assert ueye.is_Exposure(1, 12, ctypes.c_double(1.0), 8) == 0
    assert library.faults() == (1, "exposure while live")
    image = np.zeros((240, 320), np.uint16)
    while camera.read(image, 0.2) is not None:
        pass
    frames = library.frames
    time.sleep(0.2)
    assert library.frames == frames, "frozen"
    camera.close()


@pytest.mark.parametrize(("gone", "sentence"), [("pyueye", "slopegate[ueye]"), ("library", "IDS Software Suite")])
def test_without_package_or_library_it_says_which(gone: str, sentence: str) -> None:
    if find_spec("pyueye") is None:
        pytest.skip("the extra ueye (pyueye) is not installed")
    stop = "sys.modules['pyueye'] = None; " if gone == "pyueye" else ""
    code = f"import sys; {stop}from slopegate.drivers.cameras.ueye import missing_ueye; print(missing_ueye())"
    environment = {name: value for name, value in os.environ.items() if name != "PYUEYE_DLL_PATH"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert sentence in done.stdout
    assert done.stderr == ""
