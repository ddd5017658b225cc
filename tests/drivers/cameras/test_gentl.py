from __future__ import annotations

import importlib
import sys
import time
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


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("offset", [0, 5])
def test_padding_between_rows_is_left_out(padding: int, offset: int) -> None:
    """No producer at hand pads its rows."""
    rows = np.arange(24, dtype=np.uint8).reshape(4, 6)
    raw = b"\xee" * offset + np.pad(rows, ((0, 0), (0, padding)), constant_values=99).tobytes()
    buffer = SimpleNamespace(
        raw_buffer=raw, size=len(raw), size_filled=len(raw), height=4, width=6, image_offset=offset, padding_x=padding
    )
    np.testing.assert_array_equal(driver._pixels(buffer), rows.ravel())
