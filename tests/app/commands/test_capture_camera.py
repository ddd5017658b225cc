"""`slopegate capture --camera` on the stand-in for a uEye, whose frames tell what made them; and every refusal."""

from __future__ import annotations

import io
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import viky
from cli_calls import refusal, report
from rigs import LADDER
from slopegate.app.cli import main
from slopegate.app.commands import capture_camera
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.drivers.cameras import gentl
from slopegate.drivers.cameras.device_camera import DeviceCamera
from slopegate.drivers.cameras.ueye import open_ueye
from slopegate.drivers.captures.recorder import COVER, UNCOVER
from slopegate.drivers.captures.storage import CaptureFolder, open_capture
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.devices import catalog
from slopegate.drivers.files.rig_files import rig_to_toml
from slopegate.drivers.stream import stream
from small_window import small_rig
from sync_instruments import DelayGenerator645
from ueye_stub import CLOCKS_PER_LINE, SERIAL, Stub, stub

Capture = pytest.CaptureFixture[str]
UEYE = ("--camera", f"ueye:{SERIAL}")
DELAYS = ("--delays-us", "9000,6000,4000", "--exposure-us", "1234", "--clock-mhz", "78")
NO_PORT = ("--board", "serial:nowhere")
PATIENCE_S = 60.0


@pytest.fixture
def library() -> Stub:
    loaded = stub()
    loaded.fresh()
    return loaded


@pytest.fixture
def rig() -> Rig:
    return small_rig(PixelClocks(CLOCKS_PER_LINE, LADDER))


@pytest.fixture
def home(tmp_path: Path, rig: Rig) -> Path:
    (tmp_path / "rig.toml").write_text(rig_to_toml(rig), "utf-8")
    return tmp_path


def words(home: Path, *more: str) -> list[str]:
    return ["capture", "--rig", str(home / "rig.toml"), "--out", str(home / "c"), *more]


def made_with(folder: CaptureFolder, index: int) -> dict[str, int]:
    """What the stand-in wrote into the first pixels of a frame: the settings that it really had."""
    e_low, e_high, d_low, d_high, clock, *_ = (int(value) for value in folder.total(index)[0, :8])
    return {"exposure_us": e_low + (e_high << 12), "start_us": d_low + (d_high << 12), "clock_mhz": clock}


def test_every_slice_was_made_with_the_settings_in_its_record(library: Stub, capsys: Capture, home: Path) -> None:
    said = report(capsys, *words(home, *UEYE, *DELAYS))
    assert (said["scene"], said["taken"], said["missing"]) == (f"IDS UI-3250CP-C-HQ {SERIAL}", 3, [])
    folder = open_capture(home / "c")
    for index, record in folder.records().items():
        applied, really = record.applied, made_with(folder, index)
        assert record.asked == folder.manifest.slices[index]
        # the sensor exposes whole rows, so neither exposure nor delay is what was asked for to the microsecond
        assert applied.exposure_us != record.asked.exposure_us == 1234.0
        assert really["exposure_us"] == pytest.approx(applied.exposure_us, abs=0.51)
        assert really["start_us"] == pytest.approx(applied.delay_us - applied.exposure_us / 2, abs=1e-6)
        assert applied.delay_us == pytest.approx(record.asked.delay_us, abs=1.0)
        assert CLOCKS_PER_LINE / really["clock_mhz"] == pytest.approx(applied.line_time_us)
    assert library.faults() == (0, "")
    assert library.memories == 0


def test_a_range_tiles(library: Stub, capsys: Capture, home: Path) -> None:
    said = report(capsys, *words(home, *UEYE, "--near-m", "0.3", "--far-m", "1.2", "--count", "3", "--frames", "2"))
    assert said["share_edges"]
    assert said["frames_used"] == 6
    assert [item["frames"] for item in said["slices"]] == [2, 2, 2]


def test_the_dark_frame_asks_for_hands_and_goes_on_with_enter(
    library: Stub, capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n\n"))
    assert main([*words(home, *UEYE, *DELAYS), "--dark", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err.splitlines() == [f"{COVER} with Enter", f"{UNCOVER} with Enter"]
    assert json.loads(out)["dark"]["frames"] == 2
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    (home / "c" / "slice_0001.tif").unlink()
    assert report(capsys, *words(home, *UEYE, "--resume"))["frames_used"] == 1


def test_without_hands_there_is_no_dark_frame(
    library: Stub, capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    assert main([*words(home, *UEYE, *DELAYS), "--dark"]) == 2
    asked, sentence = capsys.readouterr().err.splitlines()
    assert asked.startswith(COVER)
    assert sentence.endswith("standard input has ended; 0 of 3 slices are kept")


def test_a_pulled_cable_ends_the_capture_and_another_call_goes_on(
    library: Stub, capsys: Capture, home: Path, begun: Callable[[], None]
) -> None:
    plan = ("--delays-us", ",".join(map(str, range(9000, 3000, -750))), "--exposure-us", "2000", "--frames", "10")
    puller = threading.Thread(target=lambda: (begun(), library.plug(False)))
    puller.start()
    sentence = refusal(capsys, *words(home, *UEYE, *plan, "--wait-s", "2"))
    puller.join()
    folder = open_capture(home / "c")
    kept = 8 - len(folder.missing())
    assert 1 <= kept < 8
    assert f"{kept} of 8 slices are kept" in sentence
    assert "did not open" in refusal(capsys, *words(home, *UEYE, "--resume"))
    library.plug(True)
    assert report(capsys, *words(home, *UEYE, "--resume"))["frames_used"] == 10 * (8 - kept)
    assert folder.missing() == []


@pytest.fixture
def generator(tmp_path: Path) -> Iterator[DelayGenerator645]:
    made = DelayGenerator645(tmp_path / "port")
    yield made
    made.close()


def test_a_board_makes_the_delay(
    library: Stub, capsys: Capture, home: Path, rig: Rig, generator: DelayGenerator645
) -> None:
    port = ("--board", f"serial:{generator.link}", "--board-settings", "output=2,width_us=50")
    report(capsys, *words(home, *UEYE, *DELAYS, *port))
    sent_us = [float(line.split(",")[2]) * 1e6 for line in generator.lines if line.startswith("DLAY 4,0,")]
    folder, period_us = open_capture(home / "c"), rig.projector.period_us
    for index, record in folder.records().items():
        applied, camera_us = record.applied, made_with(folder, index)["start_us"]
        assert min(camera_us, period_us - camera_us) < 10, "the camera's own delay only makes up for its whole rows"
        by_board_us = applied.delay_us - applied.exposure_us / 2 - camera_us
        off_us = [(sent - by_board_us + period_us / 2) % period_us - period_us / 2 for sent in sent_us]
        assert min(map(abs, off_us)) < 0.51
        assert applied.delay_us == pytest.approx(record.asked.delay_us, abs=0.51)
    assert generator.delays[5] == (4, pytest.approx(50e-6))
    assert generator.violations == []


def test_a_board_that_vanishes_ends_the_capture_and_another_call_goes_on(
    library: Stub, capsys: Capture, home: Path, generator: DelayGenerator645, begun: Callable[[], None]
) -> None:
    plan = ("--delays-us", ",".join(map(str, range(9000, 3000, -750))), "--exposure-us", "2000", "--frames", "10")
    port = ("--board", str(generator.link), "--board-settings", "dialect=dg645")
    puller = threading.Thread(target=lambda: (begun(), generator.unplug()))
    puller.start()
    sentence = refusal(capsys, *words(home, *UEYE, *plan, *port, "--wait-s", "2"))
    puller.join()
    folder = open_capture(home / "c")
    kept = 8 - len(folder.missing())
    assert 1 <= kept < 8
    assert f"; {kept} of 8 slices are kept" in sentence
    assert str(generator.link) in sentence
    generator.plug()
    assert report(capsys, *words(home, *UEYE, *port, "--resume"))["frames_used"] == 10 * (8 - kept)


@pytest.fixture
def begun(home: Path) -> Callable[[], None]:
    """Waits until the first slice is on the disk."""

    def wait() -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not (home / "c" / "slice_0000.tif").exists() and time.monotonic() < end_s:
            time.sleep(0.005)

    return wait


class Hanging:
    """A camera that never comes back from waiting for its first frame, as when a vendor's library hangs."""

    trouble = ""

    def __init__(self, camera: DeviceCamera, released: threading.Event) -> None:
        self.info, self.configure, self.start, self.stop = camera.info, camera.configure, camera.start, camera.stop
        self._camera, self._released, self._lock = camera, released, threading.Lock()

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        with self._lock:
            self._released.wait(PATIENCE_S)
        return None

    def close(self) -> None:
        with self._lock:
            self._camera.close()


def test_a_camera_that_hangs_is_left_behind(
    library: Stub, capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    monkeypatch.setitem(catalog.OPEN, "hanging", lambda where, rig, _: Hanging(open_ueye(where, rig), released))
    monkeypatch.setattr(stream, "JOIN_S", 0.2)
    monkeypatch.setattr(capture_camera, "CLOSE_S", 0.2)
    assert main(words(home, "--camera", f"hanging:{SERIAL}", *DELAYS, "--wait-s", "0.5")) == 2
    warning, sentence = capsys.readouterr().err.splitlines()
    released.set()
    assert "did not stop within 0.2 seconds" in warning
    assert sentence.startswith("slopegate: IDS UI-3250CP-C-HQ 4103123456 has sent no frame for 0.5 s")
    assert sentence.endswith("; 0 of 3 slices are kept")


def test_a_trigger_that_never_comes_is_not_waited_for(library: Stub, capsys: Capture, home: Path) -> None:
    library.trigger(0)
    sentence = refusal(capsys, *words(home, *UEYE, *DELAYS, "--wait-s", "0.5"))
    assert "has sent no frame for 0.5 s: without the projector's sync signal" in sentence


def test_a_rig_of_another_size_is_rough_and_said_so(library: Stub, capsys: Capture, home: Path, rig: Rig) -> None:
    lens = rig.camera.lens.resized(2000, 1500)
    wide = replace(rig, camera=replace(rig.camera, lens=lens))
    (home / "rig.toml").write_text(rig_to_toml(wide), "utf-8")
    assert main(words(home, *UEYE, "--delays-us", "9000", "--exposure-us", "500")) == 0
    out, err = capsys.readouterr()
    assert out.startswith("1 of 1 slices of IDS")
    assert err.startswith("warning: IDS")
    assert "the rig file describes 2000 \u00d7 1500: tilts and distances are only rough" in err
    assert err.count("\n") == 1
    assert open_capture(home / "c").shape == (1200, 1600)


def test_another_rig_or_kind_of_pixel_cannot_resume(library: Stub, capsys: Capture, home: Path, rig: Rig) -> None:
    report(capsys, *words(home, *UEYE, *DELAYS))
    (home / "c" / "slice_0001.tif").unlink()
    library.fresh(mosaic=False)
    assert "was begun with another" in refusal(capsys, *words(home, *UEYE, "--resume"))
    library.fresh()
    (home / "rig.toml").write_text(rig_to_toml(replace(rig, projector_offset_m=(0.0, -0.2, 0.0))), "utf-8")
    assert "was begun with another" in refusal(capsys, *words(home, *UEYE, "--resume"))


def test_a_pixel_format_is_kept_to(library: Stub, capsys: Capture, home: Path) -> None:
    eight = (*UEYE, "--pixel-format", "BayerGR8")
    report(capsys, *words(home, *eight, *DELAYS))
    folder = open_capture(home / "c")
    assert (folder.manifest.camera.pixel_format, folder.manifest.camera.max_count) == ("bayer_gr8", 255)
    (folder.path / "slice_0001.tif").unlink()
    assert "bayer_gr8): it cannot be resumed" in refusal(capsys, *words(home, *UEYE, "--resume"))
    assert report(capsys, *words(home, *eight, "--resume"))["frames_used"] == 1


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ((), "give a SCENE ('slopegate scenes' lists some) or --camera ('slopegate devices')"),
        (("table", *UEYE, *DELAYS), f"a SCENE (table) and --camera (ueye:{SERIAL}) exclude each other"),
        (("table", "--wait-s", "2"), "--wait-s is for a camera"),
        (("table", "--board", "serial:COM3"), "--board is for a camera"),
        (("table", "--pixel-format", "Mono8"), "--pixel-format is for a camera"),
        ((*UEYE, *DELAYS, "--pixel-format", "Mono9"), "offers the pixel formats"),
        ((*UEYE, *DELAYS, "--board-settings", "output=1"), "give --board too"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "output"), "'output' must be NAME=VALUE with one of"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "delay_us=3"), "'delay_us=3' must be NAME=VALUE with one of"),
        ((*UEYE, *DELAYS, *NO_PORT), "serial:nowhere did not open"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "dialect=morse"), "dialect is 'morse': it must be one of"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "dialect=t560,output=9"), "has outputs 1 to 4"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "dialect=t560,output=a"), "--board-settings: output is 'a'"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "dialect=t560,width_us=1e9"), "width_us is 1000000000"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "dialect=authors"), "it sets no delay"),
        ((*UEYE, *DELAYS, *NO_PORT, "--board-settings", "dialect=t560", "--wait-s", "0.2"), "nowhere"),
        (UEYE, "how far the camera sees is not known"),
        ((*UEYE, *DELAYS, "--no-noise"), "--no-noise and --seed are for a SCENE"),
        ((*UEYE, *DELAYS, "--seed", "0"), "--no-noise and --seed are for a SCENE"),
        ((*UEYE, *DELAYS, "--wait-s", "0"), "must be"),
        ((*UEYE, "--near-m", "1"), "--near-m and --far-m belong together"),
        (("--camera", "nowhere", *DELAYS), "'nowhere' is no camera: it must be FAMILY:WHERE"),
        (("--camera", "basler:1", *DELAYS), "basler:1 did not open: There is no camera driver 'basler'"),
        (("--camera", "ueye:99", *DELAYS), "ueye:99 did not open: No uEye camera has the serial number '99'"),
        (("--camera", "virtual:virtual", *DELAYS), "only looks at scenes: give a SCENE"),
        (("--camera", "video:0", *DELAYS), "video:0 cannot record with a gate: A video source has no shutter"),
        ((*UEYE, "--resume"), "is missing"),
        ((*UEYE, "--line-time-us", "30", *DELAYS[:4], "--rig", "none.toml"), "none.toml"),
    ],
)
def test_refusals(library: Stub, capsys: Capture, home: Path, more: tuple[str, ...], sentence: str) -> None:
    assert sentence in refusal(capsys, *words(home, *more))
    assert not (home / "c").exists()


def test_slices_that_the_camera_cannot_make_leave_it_closed(library: Stub, capsys: Capture, home: Path) -> None:
    plan = ("--near-m", "1", "--far-m", "1.2", "--count", "90")
    assert "count is 90: it must be at most" in refusal(capsys, *words(home, *UEYE, *plan))
    assert not (home / "c").exists()
    report(capsys, *words(home, *UEYE, *DELAYS))


def test_a_camera_without_an_exposure_is_refused(request: pytest.FixtureRequest, capsys: Capture, home: Path) -> None:
    viky.install(request)
    sentence = refusal(capsys, *words(home, "--camera", f"gentl:{viky.RED}", *DELAYS))
    assert "cannot record with a gate: The camera has no exposure time that can be set." in sentence
    assert not (home / "c").exists()


def test_a_missing_extra_is_named(capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "harvesters.core", None)
    monkeypatch.setattr(gentl, "producers", gentl.Producers)
    sentence = refusal(capsys, *words(home, "--camera", "gentl:any", *DELAYS))
    assert "gentl:any did not open: GenTL needs the Python packages harvesters and genicam: pip install" in sentence
