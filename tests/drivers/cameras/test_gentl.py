from __future__ import annotations

import importlib
import sys
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import viky
from rigs import plain_rig, shutter
from slopegate.core.rig.settings import PixelClocks
from slopegate.drivers.cameras import gentl as driver
from slopegate.drivers.cameras.gentl import find_gentl, missing_gentl, open_gentl
from slopegate.drivers.cameras.pixels import bits_of
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.stream.stream import Stream
from waiting import until

LIMITS = shutter(PixelClocks(996.67, (50.0, 78.0)))


RIG = plain_rig(300, 200, 500.0, LIMITS)


@pytest.fixture
def producer(request: pytest.FixtureRequest) -> None:
    viky.install(request)


@pytest.mark.usefixtures("producer")
def test_every_camera_of_the_producer_is_found() -> None:
    assert missing_gentl() == ""
    found = find_gentl()
    assert [camera.where for camera in found] == [viky.RED, viky.GREEN, "VikyTL_DEV_blue"]
    assert {camera.family for camera in found} == {"gentl"}
    assert found[0].name == "Machine Vision Games Ltd. Viky"


@pytest.mark.usefixtures("producer")
def test_the_rigs_raster_is_set_and_every_pixel_arrives() -> None:
    camera = open_gentl(viky.RED, RIG)
    assert (camera.info.width, camera.info.height) == (300, 200)
    assert camera.info.pixel_format == "mono8"
    assert camera.info.limits is None
    assert "no exposure time" in camera.info.can.exposure.missing
    camera.start()
    images = []
    for _ in range(8):
        image = np.zeros((200, 300), np.uint16)
        while camera.read(image, 1.0) is None:
            pass
        images.append(image)
    camera.close()
    # white ground, a darker ball, which moves
    assert all(np.median(image) == 255 and 10 < (image < 255).sum() < 20000 for image in images)
    assert any((one != other).any() for one, other in pairwise(images))


@pytest.mark.usefixtures("producer")
def test_two_cameras_stream_at_once_and_looking_disturbs_neither() -> None:
    options = OpenOptions(rate_hz=50.0)
    with Stream(open_gentl(viky.RED, RIG, options)) as red, Stream(open_gentl(viky.GREEN, RIG, options)) as green:
        until(lambda: min(red.counters.made, green.counters.made) > 10)
        assert len(find_gentl()) == 3
        with pytest.raises(CameraError, match=r"Viky is in use"):
            open_gentl(viky.GREEN, RIG)
        made = red.counters.made, green.counters.made
        until(lambda: red.counters.made > made[0] + 10 and green.counters.made > made[1] + 10)
        assert red.counters.errors == green.counters.errors == 0


@pytest.mark.usefixtures("producer")
def test_it_streams_at_the_producers_full_rate() -> None:
    with Stream(open_gentl(viky.RED, plain_rig(800, 800, 500.0, LIMITS), OpenOptions(rate_hz=200.0))) as stream:
        until(lambda: stream.counters.made > 0)
        before, started = stream.counters, time.monotonic()
        until(lambda: stream.counters.made + stream.counters.lost > before.made + before.lost + 100)
        after, seconds = stream.counters, time.monotonic() - started
    print(f"viky: {(after.made - before.made) / seconds:.1f} frames a second, {after.lost} lost")
    assert after.errors == 0


@pytest.mark.usefixtures("producer")
def test_one_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(CameraError, match=r"no camera|sees a camera 'Nobody' \(it sees: VikyTL_DEV_red"):
        open_gentl("Nobody", RIG)


@pytest.mark.usefixtures("producer")
def test_a_pixel_format_that_is_not_there_leaves_the_camera_free() -> None:
    with pytest.raises(CameraError, match="not Mono12"):
        open_gentl(viky.RED, RIG, OpenOptions(pixel_format="Mono12"))
    open_gentl(viky.RED, RIG).close()


@pytest.mark.usefixtures("producer")
def test_a_refusal_is_not_taken_for_a_loss() -> None:
    camera = open_gentl(viky.RED, RIG)
    device: Any = camera._device
    features = device._transport.features
    for wrong in (
        lambda: features.set_number("Width", 1e6),
        lambda: features.choose("PixelFormat", "Mono99"),
        lambda: features.number("NoSuchFeature"),
    ):
        with pytest.raises(CameraError, match="Viky") as refused:
            wrong()
        assert not isinstance(refused.value, CameraGoneError)
    assert not features.has("NoSuchFeature")
    assert not features.writable("NoSuchFeature")
    device._transport.check()
    camera.close()


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.import_module

    def without(name: str, package: str | None = None) -> Any:
        if name.startswith(("harvesters", "genicam")):
            raise ImportError(f"No module named {name!r}")
        return real(name, package)

    monkeypatch.setattr(driver.importlib, "import_module", without)
    assert "slopegate[gentl]" in missing_gentl()
    with pytest.raises(CameraError, match="harvesters"):
        open_gentl("Anything", RIG)


def test_a_python_without_its_library_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def without(name: str, package: str | None = None) -> Any:
        raise ImportError("libpython3.11.so.1.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(driver.importlib, "import_module", without)
    assert missing_gentl().endswith(f"apt-get install libpython{sys.version_info[0]}.{sys.version_info[1]}.")


def test_without_a_producer_it_says_where_one_would_be(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    viky.need_gentl()
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(tmp_path))
    assert "No GenTL producer" in missing_gentl()
    with pytest.raises(CameraError, match="No GenTL producer"):
        open_gentl("Anything", RIG)


MONO8, MONO12P, MONO16, MONO12PACKED = 0x01080001, 0x010C0047, 0x01100007, 0x010C0006


def a_buffer(rows: np.ndarray, width: int, padding: int, offset: int = 0, chunks: int = 0, **more: Any) -> Any:
    """A buffer as harvesters shows it, with rows (H, bytes) and chunk data behind them, which its size counts."""
    raw = b"\xee" * offset + np.pad(rows, ((0, 0), (0, padding)), constant_values=99).tobytes() + b"\xcc" * chunks
    facts = {"size": len(raw), "size_filled": len(raw), "image_offset": offset, "padding_x": padding, **more}
    return SimpleNamespace(raw_buffer=raw, height=len(rows), width=width, **facts)


@pytest.mark.parametrize("chunks", [0, 3, 40])
@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("offset", [0, 5])
@pytest.mark.parametrize(("code", "width"), [(MONO8, 8), (MONO16, 4), (MONO12P, 4), (MONO12PACKED, 4), (0, 8)])
def test_rows_are_as_long_as_the_payload_says(code: int, width: int, offset: int, padding: int, chunks: int) -> None:
    """No producer at hand pads its rows."""
    per_row = width * (bits_of(code) or 8) // 8
    rows = np.arange(16 * per_row, dtype=np.uint8).reshape(16, per_row)
    found = driver._pixels(a_buffer(rows, width, padding, offset, chunks, pixel_format=code))
    np.testing.assert_array_equal(found[: rows.size], rows.ravel())


def test_without_a_number_of_its_format_the_cameras_own_bits_count() -> None:
    rows = np.arange(64, dtype=np.uint8).reshape(8, 8)
    np.testing.assert_array_equal(driver._pixels(a_buffer(rows, 4, 4, chunks=30), bits=16), rows.ravel())


def test_the_padding_of_the_last_row_may_be_missing_but_no_pixel() -> None:
    rows = np.arange(64, dtype=np.uint8).reshape(8, 8)
    buffer = a_buffer(rows, 8, 4)
    buffer.size_filled -= 4
    np.testing.assert_array_equal(driver._pixels(buffer), rows.ravel())
    buffer.size_filled -= 1
    with pytest.raises(CameraError, match="a frame of 8 rows of 8 bytes and 4 between came with 91"):
        driver._pixels(buffer)
    with pytest.raises(CameraError, match="rows of 5 pixels of 12 bits are padded, but end within a byte"):
        driver._pixels(a_buffer(rows, 5, 4, pixel_format=MONO12P))


class SeenTwice:
    """harvesters' Harvester where two interfaces see one camera, and the first of them may not open it."""

    def __init__(self, infos: list[Any], busy: int) -> None:
        self.device_info_list, self._busy, self.tried = infos, busy, 0

    def update(self) -> None:
        """Nothing changes."""

    def create(self, info: Any) -> Any:
        """Refuses the first ones."""
        self.tried += 1
        if self.tried <= self._busy:
            raise type("AccessDeniedException", (Exception,), {})("in use")
        return SimpleNamespace(through=info.tl_type)


def seen(id_: str, serial: str, through: str) -> Any:
    return SimpleNamespace(id_=id_, vendor="Maker", model="M1", serial_number=serial, tl_type=through)


@pytest.mark.parametrize("busy", [0, 1, 2])
@pytest.mark.parametrize("ids", [("dev", "dev"), ("dev", "dev-on-eth1")])
def test_a_camera_seen_through_two_interfaces_is_one_and_opens(ids: tuple[str, str], busy: int) -> None:
    producers = object.__new__(driver.Producers)
    infos = [seen(ids[0], "007", "eth0"), seen("other", "", "usb"), seen(ids[1], "007", "eth1")]
    producers._harvester, producers._lock, producers._open = SeenTwice(infos, busy), threading.Lock(), 0
    assert [camera.where for camera in producers.find()] == ["dev", "other"]
    if busy == 2:
        with pytest.raises(CameraError, match="Maker M1 is in use"):
            producers.open(ids[1])
        return
    acquirer, name = producers.open(ids[1])
    assert (acquirer.through, name) == (("eth0", "eth1")[busy], "Maker M1 007")


def test_the_case_of_chunk_data_behind_padding(shared: Callable[[str], Path]) -> None:
    text = (shared("cases/gentl_chunk_behind_padding") / "case.py").read_text()
    exec(text.replace("from slopegate.drivers import gentl", "from slopegate.drivers.cameras import gentl"), {})
