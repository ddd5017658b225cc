"""Against aravis' own fake camera, a GigE Vision server that nobody here wrote, in a network namespace."""

from __future__ import annotations

import importlib
import math
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import fake_gige
from fake_gige import MEMORY, FakeCamera, rolling_shutter
from rigs import plain_rig, shutter
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import LineTimes, PixelClocks, Steps, gate
from slopegate.drivers.cameras import aravis as driver
from slopegate.drivers.cameras.aravis import find_aravis, missing_aravis, open_aravis
from slopegate.drivers.cameras.device_camera import DeviceCamera
from slopegate.drivers.cameras.pixels import layout_of, unpack
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.stream.stream import Stream
from waiting import next_frame, until

HERE = Path(__file__)
PERIOD_US = 16666.7
CLOCKS = PixelClocks(996.67, (5.0, 10.0, 50.0, 78.0, 100.0, 128.0, 200.0))


def make_rig(size: tuple[int, int] = (512, 512), line: PixelClocks | LineTimes = CLOCKS, offset_us: float = 0.0) -> Rig:
    return plain_rig(*size, 500.0, shutter(line, exposure=Steps(1, 50000, 1), offset_us=offset_us))


@pytest.mark.timeout(900)
def test_this_and_the_camera_contract_inside_a_namespace() -> None:
    contract = str(HERE.parents[1] / "contract" / "test_contract.py")
    said = fake_gige.run_inside(str(HERE), contract, "-k", "aravis", "-m", "not slow")
    passed = re.search(r"(\d+) passed", said)
    assert passed, said
    assert int(passed[1]) >= 33, said


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_long_ones_inside_a_namespace() -> None:
    contract = str(HERE.parents[1] / "contract" / "test_contract.py")
    arguments = (str(HERE), contract, "-k", "aravis", "-m", "slow", "-s", "--timeout=600")
    print(fake_gige.run_inside(*arguments, timeout_s=800.0))


def test_its_bindings_are_loaded_without_a_word() -> None:
    said = "from slopegate.drivers.cameras.aravis import missing_aravis; print(missing_aravis())"
    done = subprocess.run([sys.executable, "-W", "always", "-c", said], capture_output=True, text=True, check=True)
    if done.stdout.strip():
        pytest.skip(done.stdout.strip())
    assert "DynamicImporter" not in done.stderr


def test_without_aravis_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.import_module

    def without(name: str, package: str | None = None) -> Any:
        if name.startswith("gi"):
            raise ImportError("No module named 'gi'")
        return real(name, package)

    monkeypatch.setattr(driver.importlib, "import_module", without)
    assert "apt-get install" in missing_aravis()
    with pytest.raises(CameraError, match="aravis is not here"):
        open_aravis("Anything", make_rig())
    with pytest.raises(CameraError, match="aravis is not here"):
        find_aravis()


class PaddedStream:
    """An ArvStream whose one buffer has three bytes behind each row, and chunk data behind the image."""

    def __init__(self, rows: np.ndarray, code: int) -> None:
        self._raw = np.pad(rows, ((0, 0), (0, 3)), constant_values=99).tobytes() + b"\xcc" * 40
        self._rows, self._code = rows, code
        self.back: list[Any] = []

    def timeout_pop_buffer(self, wait_us: int) -> Any:
        """A buffer, as aravis' bindings show it."""
        facts = {"status": 0, "image_data": self._raw, "timestamp": 5_000_000, "frame_id": 7, "image_padding": (3, 0)}
        facts |= {"image_width": 4, "image_height": len(self._rows), "image_pixel_format": self._code}
        return SimpleNamespace(**{f"get_{name}": lambda value=value: value for name, value in facts.items()})

    def push_buffer(self, buffer: Any) -> None:
        """It may be filled again."""
        self.back.append(buffer)


@pytest.mark.parametrize("name", ["Mono8", "Mono12p", "BayerRG12Packed", "Mono16"])
def test_rows_are_as_long_as_the_buffer_says(name: str) -> None:
    codes = {"Mono8": 0x01080001, "Mono12p": 0x010C0047, "BayerRG12Packed": 0x010C002B, "Mono16": 0x01100007}
    layout = layout_of(name)
    assert layout is not None
    rows = np.arange(16 * layout.bytes_of(4), dtype=np.uint8).reshape(16, -1)
    plain, found = np.zeros((16, 4), np.uint16), np.zeros((16, 4), np.uint16)
    unpack(rows.ravel(), layout, plain)
    transport = object.__new__(driver.AravisTransport)
    transport._stream = stream = PaddedStream(rows, codes[name])
    transport._aravis = SimpleNamespace(BufferStatus=SimpleNamespace(SUCCESS=0))
    assert transport.fetch(lambda block: unpack(block.data, layout, found), 1.0)
    np.testing.assert_array_equal(found, plain)
    assert len(stream.back) == 1


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., FakeCamera]]:
    yield from fake_gige.serving(tmp_path)


def open_and_close(server: FakeCamera, options: OpenOptions) -> DeviceCamera:
    camera = open_aravis(server.where, make_rig(), options)
    camera.close()
    return camera


def free(rate_hz: float = 100.0, pixel_format: str = "Mono8") -> OpenOptions:
    return OpenOptions(triggered=False, pixel_format=pixel_format, rate_hz=rate_hz)


def register(camera: DeviceCamera, name: str) -> int:
    """Straight from the server's memory, past the camera's description and the driver."""
    device: Any = camera._device
    return int(device._transport._device.read_register(MEMORY[name]))


def brightest(exposure_us: float) -> int:
    """What the fake camera's ramp of 0..254 reaches at this exposure."""
    return int(min(255.0, max(0.0, 254 * (1 + math.log10(exposure_us / 10000)))))


def test_it_is_found(serve: Callable[..., FakeCamera]) -> None:
    server = serve()
    (found,) = find_aravis()
    assert (found.kind, found.family, found.where, found.name) == ("camera", "aravis", server.where, "Aravis Fake")
    assert "127.0.0.1" in found.detail


@pytest.mark.parametrize("where", ["Nobody-1", pytest.param("127.0.0.7", marks=pytest.mark.slow)])
def test_one_that_is_not_there_is_told(serve: Callable[..., FakeCamera], where: str) -> None:
    serve()
    with pytest.raises(CameraError, match=where):
        open_aravis(where, make_rig())


def test_what_it_cannot_do_has_reasons(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve().where, make_rig(), free())
    info = camera.info
    assert (info.width, info.height, info.pixel_format, info.max_count) == (512, 512, "mono8", 255)
    assert info.can.exposure
    assert not info.can.line_time
    assert "no pixel clock" in info.can.line_time.missing
    assert "without the projector's trigger" in info.can.delay.missing
    assert info.limits is not None
    assert info.limits.exposure_us == Steps(10, 50000, 1)
    camera.close()


@pytest.mark.parametrize(
    ("asked", "form", "size"),
    [("Mono8", "mono8", (512, 512)), ("Mono16", "mono16", (1600, 1200)), ("BayerGR8", "bayer_gr8", (512, 512))],
)
def test_frames_come_as_the_camera_made_them(
    serve: Callable[..., FakeCamera], asked: str, form: str, size: tuple[int, int]
) -> None:
    camera = open_aravis(serve().where, make_rig(size), free(20.0, asked))
    assert camera.info.pixel_format == form
    camera.configure(gate(10.0, 0.0, 10000.0))
    camera.start()
    image = np.zeros((size[1], size[0]), np.uint16)
    while camera.read(image, 1.0) is None:
        pass
    camera.close()
    assert image.max() > 200
    if form == "mono8":
        # the fake camera's picture: a diagonal ramp that moves on by one every frame
        rows, columns = np.mgrid[: size[1], : size[0]]
        np.testing.assert_array_equal(image, (rows + columns + int(image[0, 0])) % 255)


def test_a_size_that_the_camera_lacks_gives_all_that_it_has(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve().where, make_rig((4000, 3000)), free())
    assert (camera.info.width, camera.info.height) == (2048, 2048)
    camera.close()


def test_the_registers_hold_the_gate_asked_for(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve(rolling_shutter()).where, make_rig((64, 48), offset_us=7000.0))
    info = camera.info
    can = info.can
    assert all((can.line_time, can.delay, can.exposure, can.trigger, can.rows))
    assert info.limits is not None
    assert info.limits.line == PixelClocks(996.67, (10.0, 50.0, 78.0, 100.0, 128.0))
    assert info.pixel_format == "mono12"
    modes = ("SensorShutterMode", "ExposureMode", "DeviceClockSelector", "TriggerModeUnused")
    assert [register(camera, name) for name in modes] == [1, 1, 1, 1]
    for clock, delay_us, exposure_us in ((78, 2028, 500), (52, 15749, 940), (128, -300, 16400), (10, -16000, 30)):
        nearest = min(info.limits.line.ladder_mhz, key=lambda mhz, clock=clock: abs(mhz - clock))
        applied = camera.configure(gate(CLOCKS.line_time_us(clock), delay_us, exposure_us))
        assert register(camera, "DeviceClockFrequency") + 10_000_000 == nearest * 1e6
        assert register(camera, "ExposureTime") == exposure_us
        # the camera is told when row 0 starts; before the trigger means a period later
        start_us = delay_us - exposure_us / 2 + 7000.0
        start_us += PERIOD_US if start_us < 0 else 0.0
        assert abs(register(camera, "TriggerDelay") - start_us) <= 1.0
        assert abs(applied.delay_us - delay_us) <= 1.0
        assert applied.exposure_us == exposure_us
        assert applied.line_time_us == pytest.approx(996.67 / nearest)
    camera.close()


def test_the_edge_of_the_trigger_is_in_its_register(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve(rolling_shutter()).where, make_rig((64, 48)))
    assert register(camera, "TriggerActivation") == 0
    camera.trigger_on("falling")
    assert register(camera, "TriggerActivation") == 1
    camera.trigger_on("rising")
    assert register(camera, "TriggerActivation") == 0
    camera.close()


def test_rows_that_are_read_keep_their_gate(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve(rolling_shutter()).where, make_rig((64, 48)), OpenOptions(pixel_format="BayerRG8"))
    applied = camera.configure(gate(CLOCKS.line_time_us(50), 5000.0, 2000.0))
    assert register(camera, "TriggerDelay") == 4000
    assert camera.set_rows(17, 20) == (16, 20)
    assert (register(camera, "OffsetY"), register(camera, "Height")) == (16, 4)
    # row 16 now begins when it did: 16 line times of 19.93 us later than row 0
    assert abs(register(camera, "TriggerDelay") - 4000 - 16 * applied.line_time_us) <= 1
    camera.configure(gate(CLOCKS.line_time_us(78), 5000.0, 2000.0))
    assert abs(register(camera, "TriggerDelay") - 4000 - 16 * CLOCKS.line_time_us(78)) <= 1
    assert camera.set_rows(0, 48) == (0, 48)
    assert (register(camera, "OffsetY"), register(camera, "Height"), register(camera, "TriggerDelay")) == (0, 48, 4000)
    camera.close()


def test_line_times_are_set_in_the_cameras_own_unit(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve(rolling_shutter("time")).where, make_rig((64, 48), LineTimes(2.0, 50.0, 0.1)))
    assert camera.info.limits is not None
    assert camera.info.limits.line == LineTimes(8.0, 50.0, 0.1)
    applied = camera.configure(gate(12.34, 0.0, 500.0))
    assert applied.line_time_us == pytest.approx(12.3)
    assert register(camera, "LineTime") + 10_000 == 12_300
    camera.close()


def test_a_trigger_that_never_comes_is_no_fault(serve: Callable[..., FakeCamera]) -> None:
    camera = open_aravis(serve(rolling_shutter(triggers=False)).where, make_rig((64, 48)))
    with Stream(camera) as stream:
        time.sleep(1.5)
        assert stream.running
        assert stream.error is None
        assert stream.counters.made == 0


def test_rig_and_camera_without_a_common_exposure_are_told(serve: Callable[..., FakeCamera]) -> None:
    rig = plain_rig(512, 512, 500.0, shutter(CLOCKS, exposure=Steps(1, 5, 1)))
    with pytest.raises(CameraError, match="none in common"):
        open_aravis(serve().where, rig, free())


def test_a_pixel_format_that_is_not_there_is_told_with_those_that_are(serve: Callable[..., FakeCamera]) -> None:
    server = serve()
    with pytest.raises(CameraError, match=r"offers the pixel formats .*Mono8.*: not Mono12"):
        open_aravis(server.where, make_rig(), free(pixel_format="Mono12"))
    open_aravis(server.where, make_rig(), free()).close()


def test_formats_on_offer_are_those_that_are_read_grey_ones_first(serve: Callable[..., FakeCamera]) -> None:
    info = open_and_close(serve(), free()).info
    assert info.modes.formats == ("Mono8", "Mono16", "BayerBG8", "BayerGB8", "BayerGR8", "BayerRG8")
    assert info.can.choose_format


def test_a_format_that_is_taken_and_not_kept_is_an_error(serve: Callable[..., FakeCamera]) -> None:
    server = serve(rolling_shutter(pretends="Mono14"))
    with pytest.raises(CameraError, match="was told the pixel format Mono14 and has Mono8"):
        open_and_close(server, free(pixel_format="Mono14"))
    assert open_and_close(server, OpenOptions(triggered=False)).info.pixel_format == "mono12"


def test_a_rate_is_set_and_read_back(serve: Callable[..., FakeCamera]) -> None:
    server = serve(rolling_shutter(triggers=False))
    assert math.isinf(open_and_close(server, free(math.inf)).info.modes.rate_hz)
    for asked, period_us, switch in ((40.0, 25_000, 1), (1e6, 5_000, 1), (0.1, 1_000_000, 1), (math.inf, 1_000_000, 0)):
        camera = open_aravis(server.where, make_rig(), free(asked))
        assert (register(camera, "FramePeriod"), register(camera, "AcquisitionFrameRateEnable")) == (period_us, switch)
        assert camera.info.modes.rate_hz == (1e6 / period_us if switch else math.inf)
        assert camera.info.modes.rates_hz == (1.0, 200.0)
        camera.close()
    # what is not asked for stays as it was
    left = open_and_close(server, OpenOptions(triggered=False, rate_hz=8.0))
    assert open_and_close(server, OpenOptions(triggered=False)).info.modes.rate_hz == left.info.modes.rate_hz == 8.0
    triggered = open_and_close(server, OpenOptions(rate_hz=30.0)).info.can
    assert not triggered.choose_rate
    assert "sync signal" in triggered.choose_rate.missing
    assert open_and_close(server, OpenOptions(triggered=False)).info.modes.rate_hz == 8.0


def test_a_second_client_is_turned_away_and_the_first_goes_on(serve: Callable[..., FakeCamera]) -> None:
    server = serve(rolling_shutter())
    rig, mono = (
        make_rig((64, 48)),
        OpenOptions(pixel_format="Mono8"),
    )  # small frames at a low rate, so that none is lost
    with Stream(open_aravis(server.where, rig, mono)) as stream:
        next_frame(stream)
        with pytest.raises(CameraError, match="in use by another program"):
            open_aravis(server.where, rig, mono)
        made = stream.counters.made
        until(lambda: stream.counters.made > made + 10)
        assert stream.counters.errors == 0
        assert stream.counters.lost == 0
    open_aravis(server.where, rig, mono).close()


def test_exposure_changes_live_and_no_frame_has_the_wrong_one(serve: Callable[..., FakeCamera]) -> None:
    rng = np.random.default_rng(3)
    checked = 0
    with Stream(open_aravis(serve().where, make_rig(), free())) as stream:
        for _ in range(40):
            stream.submit(gate(10.0, 0.0, float(rng.integers(1500, 9000))))
            for _ in range(int(rng.integers(1, 12))):
                frame = next_frame(stream)
                if frame.stamp.settled and frame.stamp.applied is not None:
                    assert int(frame.image.max()) == brightest(frame.stamp.applied.exposure_us)
                    checked += 1
        assert stream.counters.errors == 0
    assert checked > 60


def run_at_full_rate(serve: Callable[..., FakeCamera], seconds: float) -> None:
    """512 x 512 at 100 frames a second; GigE Vision's 16-bit frame numbers begin at 65300 and wrap round."""
    with Stream(open_aravis(serve().where, make_rig(), free())) as stream:
        next_frame(stream)
        started, before = time.monotonic(), stream.counters
        time.sleep(seconds)
        after = stream.counters
        rate = (after.made - before.made) / (time.monotonic() - started)
        print(f"full rate: {after.made} received, {after.lost} lost, {rate:.1f} a second over {seconds:g} s")
        sent = after.made - before.made + after.lost - before.lost
        assert sent > 30 * seconds
        assert after.lost <= 0.1 * sent
        assert after.errors == 0


def test_its_frame_numbers_wrap_round_at_the_full_rate(serve: Callable[..., FakeCamera]) -> None:
    with Stream(open_aravis(serve().where, make_rig(), free())) as stream:
        until(lambda: stream.counters.made > 300)
        print(f"full rate: {stream.counters.made} received, {stream.counters.lost} lost")
        assert stream.counters.errors == 0
        assert stream.counters.lost < 10_000, "a number that seems to jump back is no loss of tens of thousands"


@pytest.mark.slow
def test_it_streams_at_the_full_rate_for_minutes(serve: Callable[..., FakeCamera]) -> None:
    run_at_full_rate(serve, 120.0)


def run_through_kills(serve: Callable[..., FakeCamera], pauses_s: list[float]) -> None:
    server = serve()
    asked = gate(10.0, 0.0, 5000.0)
    threads = threading.active_count()
    with Stream(open_aravis(server.where, make_rig(), free())) as stream:
        stream.submit(asked)
        until(lambda: next_frame(stream).stamp.settled)
        for pause_s in pauses_s:
            server.kill()
            time.sleep(pause_s)
            server.start()
            started, made, lost = time.monotonic(), stream.counters.made, stream.counters.lost
            until(lambda made=made: stream.counters.made > made + 5)
            back_s = time.monotonic() - started
            frame = next_frame(stream)
            while not frame.stamp.settled:
                frame = next_frame(stream)
            assert stream.running
            assert stream.error is None
            assert frame.stamp.asked == asked
            assert int(frame.image.max()) == brightest(5000.0), "the gate was set again"
            assert stream.counters.lost > lost, "the gap shows"
            print(f"killed for {pause_s:g} s, frames again {back_s:.2f} s after the restart, {stream.counters}")
    until(lambda: threading.active_count() <= threads + 1)


def test_a_server_killed_in_mid_stream_is_found_again(serve: Callable[..., FakeCamera]) -> None:
    run_through_kills(serve, [0.0, 1.0])


@pytest.mark.slow
def test_ten_kills(serve: Callable[..., FakeCamera]) -> None:
    run_through_kills(serve, [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 0.0, 1.5, 12.0])


@pytest.mark.slow
def test_while_it_is_gone_the_stream_says_so_and_can_be_closed(serve: Callable[..., FakeCamera]) -> None:
    server = serve()
    stream = Stream(open_aravis(server.where, make_rig(), free()))
    stream.start()
    next_frame(stream)
    server.kill()
    until(lambda: stream.error is not None)
    assert "Aravis" in str(stream.error)
    started = time.monotonic()
    stream.close()
    assert time.monotonic() - started < 8.0
    with pytest.raises(CameraError):
        open_aravis(server.where, make_rig(), free())


@pytest.mark.slow
def test_a_configuration_while_it_is_gone_is_kept_for_later(serve: Callable[..., FakeCamera]) -> None:
    server = serve()
    with Stream(open_aravis(server.where, make_rig(), free())) as stream:
        next_frame(stream)
        server.kill()
        stream.submit(gate(10.0, 0.0, 4000.0))
        until(lambda: stream.error is not None)
        server.start()
        until(lambda: stream.error is None and stream.counters.made > 20)
        frame = next_frame(stream)
        while not frame.stamp.settled:
            frame = next_frame(stream)
        assert int(frame.image.max()) == brightest(4000.0)


def test_frames_that_lack_packets_are_never_shown(serve: Callable[..., FakeCamera]) -> None:
    with Stream(open_aravis(serve(lost_per_thousand=2).where, make_rig(), free(50.0))) as stream:
        stream.submit(gate(10.0, 0.0, 10000.0))
        rows, columns = np.mgrid[:512, :512]
        whole, packets = 0, 0
        end = time.monotonic() + 100.0
        while whole <= 20 or stream.counters.lost <= 5 or packets <= 5:
            assert time.monotonic() < end, stream.counters
            frame = next_frame(stream)
            if frame.stamp.settled:
                ramp = (rows + columns + int(frame.image[0, 0])) % 255
                np.testing.assert_array_equal(frame.image, ramp)
                whole += 1
            packets = frame.stamp.lost_packets
        counters = stream.counters
        print(f"lossy: {counters.made} whole, {counters.lost} lost, {packets} packets lost")
        assert counters.errors == 0


def test_a_lost_device_is_told_apart_from_a_refusal(serve: Callable[..., FakeCamera]) -> None:
    server = serve()
    camera = open_aravis(server.where, make_rig(), free())
    device: Any = camera._device
    features = device._transport.features
    for wrong in (lambda: features.set_number("ExposureTimeAbs", 1e9), lambda: features.choose("PixelFormat", "RGB99"),
                  lambda: features.number("NoSuchFeature")):  # fmt: skip
        with pytest.raises(CameraError) as refused:
            wrong()
        assert not isinstance(refused.value, CameraGoneError)
    server.kill()
    with pytest.raises(CameraGoneError):
        features.number("Width")
    camera.close()
