"""One suite for every camera: a new one is done when it passes. `KINDS` says how each is made."""

from __future__ import annotations

import gc
import math
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol, get_args

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import fake_gige
import ueye_stub
import viky
from rigs import LADDER, PROJECTOR, plain_rig, shutter
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, LineTimes, PixelClocks, ShutterLimits, gate
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.aravis import open_aravis
from slopegate.drivers.cameras.believed import BelievedCamera, any_gate
from slopegate.drivers.cameras.faults import Faults, FaultyCamera
from slopegate.drivers.cameras.gentl import open_gentl
from slopegate.drivers.cameras.ueye import open_ueye
from slopegate.drivers.cameras.video import open_video
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.film import create_film, make_film_manifest, open_film
from slopegate.drivers.captures.film_camera import FilmCamera
from slopegate.drivers.captures.film_recorder import FilmLimits
from slopegate.drivers.captures.film_run import run_film
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.captures.storage import open_capture
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.device_rig import fixed_gate
from slopegate.drivers.contract.frame import (
    Ability,
    CameraInfo,
    FrameStamp,
    OpenOptions,
    PixelFormat,
    TriggerEdge,
    exposed_s,
)
from slopegate.drivers.stream.stream import Stream
from slopegate.resources.examples.own_camera import StripeCamera
from small_capture import RIG as SMALL_RIG
from small_capture import camera as small_camera
from small_capture import lit_slices, record

RIG = plain_rig(64, 48, 66.7, shutter(PixelClocks(996.67, LADDER)))


class Make(Protocol):
    """Opens the camera, which may be one that cannot be opened twice at a time."""

    def __call__(self, rig: Rig, **chosen: Any) -> Camera:
        """`chosen`: `pixel_format` and `rate_hz`, as far as `info.can` says that they can be chosen."""
        ...


Maker = Callable[[pytest.FixtureRequest, Path], Make]


def virtual(request: pytest.FixtureRequest, folder: Path) -> Make:
    scene = Scene("a wall", objects=(plane("wall", (0.0, 0.0, 1.2), (4.0, 3.0), turn()),), ambient=0.1)
    return lambda rig, **chosen: VirtualCamera(rig, scene, **{"rate_hz": 50.0, **chosen})


def faulty(request: pytest.FixtureRequest, folder: Path) -> Make:
    """What wraps another camera keeps the contract too; with jitter, but nothing lost."""
    inner = virtual(request, folder)
    return lambda rig, **chosen: FaultyCamera(inner(rig, **chosen), Faults(jitter_us=50.0))


def believed(request: pytest.FixtureRequest, folder: Path) -> Make:
    """Of a rig that is believed: its trigger has two edges."""

    scene = Scene("a wall", objects=(plane("wall", (0.0, 0.0, 1.2), (4.0, 3.0), turn()),), ambient=0.1)

    def make(rig: Rig, **chosen: Any) -> Camera:
        inner = VirtualCamera(any_gate(rig), scene, **{"rate_hz": 50.0, **chosen})
        return BelievedCamera(inner, rig.camera.shutter, rig)

    return make


def playback(request: pytest.FixtureRequest, folder: Path) -> Make:
    path = request.getfixturevalue("capture_path")
    return lambda rig, **chosen: PlaybackCamera(open_capture(path), **{"rate_hz": 50.0, **chosen})


def film(request: pytest.FixtureRequest, folder: Path) -> Make:
    """Of a fast camera, so that it plays fast."""
    source = small_camera(rate_hz=200.0)
    wanted = lit_slices(source)[4]
    made = create_film(folder / "film", make_film_manifest("A scene", SMALL_RIG, source.info, wanted))
    ended = run_film(source, made, FilmLimits(frames=5), lambda *_: lambda: None, print)
    assert ended.state == "done"
    return lambda rig, **chosen: FilmCamera(open_film(folder / "film"))


def video_file(request: pytest.FixtureRequest, folder: Path) -> Make:
    path = folder / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48))
    assert writer.isOpened()
    for k in range(7):
        writer.write(np.full((48, 64, 3), 30 * k, np.uint8))
    writer.release()
    return lambda rig, **chosen: open_video(str(path), rig)


def video_folder(request: pytest.FixtureRequest, folder: Path) -> Make:
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((48, 64), 9999 * k, np.uint16))
    return lambda rig, **chosen: open_video(str(folder), rig, OpenOptions(rate_hz=50.0))


def aravis(request: pytest.FixtureRequest, folder: Path) -> Make:
    if not fake_gige.inside():
        pytest.skip("runs in a network namespace of its own, from test_aravis.py")
    description = folder / "camera.xml"
    description.write_text(fake_gige.rolling_shutter())
    server = fake_gige.FakeCamera(description=description)
    request.addfinalizer(server.kill)
    return lambda rig, **chosen: open_aravis(server.where, rig, OpenOptions(**{"pixel_format": "Mono8", **chosen}))


def aravis_free(request: pytest.FixtureRequest, folder: Path) -> Make:
    """The fake camera as it is, without a gate but for its exposure time."""
    if not fake_gige.inside():
        pytest.skip("runs in a network namespace of its own, from test_aravis.py")
    server = fake_gige.FakeCamera()
    request.addfinalizer(server.kill)
    free: dict[str, Any] = {"triggered": False, "rate_hz": 50.0}
    return lambda rig, **chosen: open_aravis(server.where, rig, OpenOptions(**{**free, **chosen}))


def gentl(request: pytest.FixtureRequest, folder: Path) -> Make:
    viky.install(request)
    return lambda rig, **chosen: open_gentl(viky.RED, rig, OpenOptions(**{"rate_hz": 100.0, **chosen}))


def ueye(request: pytest.FixtureRequest, folder: Path) -> Make:
    ueye_stub.stub().fresh()
    return lambda rig, **chosen: open_ueye(ueye_stub.SERIAL, rig, OpenOptions(**chosen))


def ueye_free(request: pytest.FixtureRequest, folder: Path) -> Make:
    ueye_stub.stub().fresh(mosaic=False)
    return lambda rig, **chosen: open_ueye(ueye_stub.SERIAL, rig, OpenOptions(triggered=False, **chosen))


def example(request: pytest.FixtureRequest, folder: Path) -> Make:
    """The driver that ships as an example of one."""
    return lambda rig, **chosen: StripeCamera(rig)


KINDS: dict[str, Maker] = {
    "virtual": virtual,
    "faulty": faulty,
    "believed": believed,
    "playback": playback,
    "film": film,
    "video file": video_file,
    "video folder": video_folder,
    "aravis": aravis,
    "aravis free": aravis_free,
    "gentl": gentl,
    "ueye": ueye,
    "ueye free": ueye_free,
    "example": example,
}


@pytest.fixture(scope="session")
def capture_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("contract") / "capture")[0].path


SLOW = {"aravis free", "ueye free"}
"""Left to make test-slow, for others try nearly the same."""


@pytest.fixture(params=[pytest.param(kind, marks=[pytest.mark.slow] * (kind in SLOW)) for kind in KINDS])
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Make:
    return KINDS[request.param](request, tmp_path)


@pytest.fixture
def camera(make: Make) -> Iterator[Camera]:
    camera = make(RIG)
    yield camera
    camera.close()


def frame_buffer(info: CameraInfo, fill: int = 65535) -> NDArray[np.uint16]:
    return np.full((info.height, info.width), fill, np.uint16)


def take(camera: Camera, buffer: NDArray[np.uint16] | None = None, within_s: float = 100.0) -> FrameStamp:
    buffer = frame_buffer(camera.info) if buffer is None else buffer
    end = time.monotonic() + within_s
    while (stamp := camera.read(buffer, 0.5)) is None:
        assert time.monotonic() < end, "no frame came"
    return stamp


def gates(limits: ShutterLimits) -> list[GateSettings]:
    """Low, middle and high of everything, and what no camera takes as it is."""

    def spread(low: float, high: float) -> tuple[float, float, float]:
        return low, (low + high) / 2, high

    if isinstance(limits.line, LineTimes):
        lines = spread(limits.line.min_us, limits.line.max_us)
    else:
        lines = spread(*map(limits.line.line_time_us, (limits.line.ladder_mhz[0], limits.line.ladder_mhz[-1])))
    delays = spread(limits.delay_us.min, limits.delay_us.max)
    exposures = spread(limits.exposure_us.min, limits.exposure_us.max)
    some = [gate(*numbers) for numbers in zip(lines, delays, exposures, strict=True)]
    some += [gate(*numbers) for numbers in zip(reversed(lines), delays, reversed(exposures), strict=True)]
    return [*some, gate(lines[1], -9e5, 1e-3), gate(1e-6, 9e5, 1e6), gate(1e6, 0.123456789, exposures[1])]


def limits_of(camera: Camera) -> ShutterLimits:
    if camera.info.limits is None:
        pytest.skip("this camera has no gate")
    return camera.info.limits


def settable(camera: Camera) -> ShutterLimits:
    limits = limits_of(camera)
    if fixed_gate(camera.info):
        pytest.skip("this camera's gate is always the same")
    return limits


def threads_and_files() -> tuple[int, int]:
    gc.collect()
    folder = Path("/proc/self/fd")
    return threading.active_count(), len(os.listdir(folder)) if folder.is_dir() else 0


def test_it_says_what_it_is(camera: Camera) -> None:
    info = camera.info
    assert info.name.strip()
    assert info.width >= 1
    assert info.height >= 1
    assert info.pixel_format in get_args(PixelFormat)
    assert info.max_count == 2 ** int(info.pixel_format.lstrip("abcdefghijklmnopqrstuvwxyz_")) - 1
    assert 0 <= info.black_count < info.max_count
    assert camera.info == info


def test_abilities_that_are_missing_say_why(camera: Camera) -> None:
    for ability in vars(camera.info.can).values():
        assert bool(ability) != bool(ability.missing)
        assert bool(ability) or len(ability.missing) > 20, ability
    can = camera.info.can
    assert camera.info.limits is not None or not can.exposure
    assert can.exposure or not (can.line_time or can.delay)


def refused(camera: Camera, ability: Ability, call: Callable[[], object]) -> None:
    with pytest.raises(InputError) as told:
        call()
    assert str(told.value) == f"{camera.info.name}: {ability.missing}"


def test_what_it_cannot_do_is_refused_with_the_reason_that_it_gives(camera: Camera) -> None:
    can = camera.info.can
    camera.start()
    if not can.exposure:
        refused(camera, can.exposure, lambda: camera.configure(gate(10.0, 0.0, 500.0)))
    if not can.rows:
        refused(camera, can.rows, lambda: camera.set_rows(0, camera.info.height))
    if not can.cover:
        refused(camera, can.cover, lambda: camera.cover(True))
    if not can.edge:
        refused(camera, can.edge, lambda: camera.trigger_on("falling"))
    stamp = take(camera)
    assert camera.info.limits is not None or (stamp.asked, stamp.applied) == (None, None)
    assert not fixed_gate(camera.info) or stamp.applied == stamp.asked == take(camera).applied


def test_a_driver_that_makes_no_frames_is_no_camera() -> None:
    class Half(Camera):
        def start(self) -> None:
            """Nothing more."""

    with pytest.raises(TypeError, match="abstract methods"):
        Half()  # type: ignore[abstract]


def test_a_covered_lens_makes_dark_frames(camera: Camera) -> None:
    if not camera.info.can.cover:
        pytest.skip("this camera's lens is covered by hand")
    image, black = frame_buffer(camera.info), camera.info.black_count
    camera.start()
    take(camera, image)
    assert image.mean() > 2 * black
    camera.cover(True)
    assert not take(camera, image).settled
    assert image.mean() < 1.1 * black
    camera.cover(False)
    assert not take(camera, image).settled
    assert image.mean() > 2 * black


def test_frames_that_the_other_edge_may_have_started_are_not_settled(camera: Camera) -> None:
    if not camera.info.can.edge:
        pytest.skip("this camera's trigger edge cannot be chosen")
    camera.start()
    edges: tuple[TriggerEdge, ...] = ("falling", "rising")
    for edge in edges:
        while not take(camera).settled:
            pass
        camera.trigger_on(edge)
        assert not take(camera).settled


def span_of(camera: Camera, what: str) -> tuple[float, float]:
    """Two values far apart of what a gate has; of a capture those that it holds."""
    limits, line = limits_of(camera), limits_of(camera).line
    if isinstance(camera, PlaybackCamera | FilmCamera):
        held = [getattr(settings, f"{what}_us") for settings in camera.settings]
        return min(held), max(held)
    if what == "line_time" and isinstance(line, LineTimes):
        return line.min_us, line.max_us
    if what == "line_time" and isinstance(line, PixelClocks):
        return line.line_time_us(line.ladder_mhz[-1]), line.line_time_us(line.ladder_mhz[0])
    steps, half_us = limits.delay_us if what == "delay" else limits.exposure_us, PROJECTOR.period_us / 2
    return steps.nearest(half_us / 2), steps.nearest(half_us)


@pytest.mark.parametrize("what", ["line_time", "delay", "exposure"])
def test_what_of_a_gate_it_can_be_told_is_what_changes(camera: Camera, what: str) -> None:
    """And what it cannot be told stays as it is, whatever is asked for."""
    name, able = f"{what}_us", getattr(camera.info.can, what)
    low, high = span_of(camera, what)
    middle = camera.settings[0] if isinstance(camera, PlaybackCamera | FilmCamera) else gates(limits_of(camera))[1]
    got = [getattr(camera.configure(replace(middle, **{name: value})), name) for value in (low, high)]
    assert (got[0] < got[1]) == (bool(able) and low < high)


def test_formats_and_rates_on_offer_hold_what_it_has_or_say_why_not(camera: Camera) -> None:
    modes, can = camera.info.modes, camera.info.can
    if can.choose_format:
        assert len(set(modes.formats)) == len(modes.formats) > 1
        assert modes.format in modes.formats
    if can.choose_rate:
        assert 0 <= modes.rates_hz[0] < modes.rates_hz[1]
        assert math.isinf(modes.rate_hz) or modes.rates_hz[0] <= modes.rate_hz <= modes.rates_hz[1]


def test_every_format_on_offer_is_what_it_then_sends(make: Make) -> None:
    first = make(RIG)
    first.close()
    modes, can = first.info.modes, first.info.can
    for name in modes.formats if can.choose_format else ():
        camera = make(RIG, pixel_format=name)
        try:
            info = camera.info
            assert (info.modes.format, info.modes.formats) == (name, modes.formats)
            assert re.sub("[^a-z]", "", name.lower()).startswith(re.sub("[^a-z]", "", info.pixel_format))
            assert str(info.max_count.bit_length()) in name
            camera.start()
            image = frame_buffer(info)
            take(camera, image)
            assert image.max() <= info.max_count
        finally:
            camera.close()
    if can.choose_format:
        with pytest.raises((CameraError, ValueError), match="Mono99"):
            make(RIG, pixel_format="Mono99")
        make(RIG).close()  # the refusal has let it go


def test_a_rate_on_offer_is_what_it_then_has(make: Make) -> None:
    first = make(RIG)
    first.close()
    if not first.info.can.choose_rate:
        pytest.skip("this camera's rate cannot be chosen")
    for rate_hz in (25.0, 40.0):
        camera = make(RIG, rate_hz=rate_hz)
        try:
            assert camera.info.modes.rate_hz == pytest.approx(rate_hz, rel=1e-3)
            camera.start()
            take(camera)
        finally:
            camera.close()


def test_no_frame_before_the_start_nor_after_the_end(camera: Camera) -> None:
    buffer = frame_buffer(camera.info, 7)
    for step in (lambda: None, camera.start, camera.stop, camera.start, camera.close):
        step()
        if step == camera.start:
            take(camera)
        else:
            started = time.monotonic()
            assert camera.read(buffer, 60.0) is None
            assert time.monotonic() - started < 30.0, "it returned at once"
            assert (buffer == 7).all()


def test_frames_are_whole_and_counted(camera: Camera) -> None:
    begun_s = time.monotonic()
    camera.start()
    stamps = []
    for _ in range(12):
        buffer = frame_buffer(camera.info, 65535)
        stamps.append(take(camera, buffer))
        if camera.info.max_count < 65535:
            assert buffer.max() <= camera.info.max_count
        assert begun_s - 0.1 < stamps[-1].time_s < time.monotonic() + 0.1
    numbers = [stamp.sequence for stamp in stamps]
    assert all(a < b for a, b in pairwise(numbers))
    times = [stamp.time_s for stamp in stamps]
    assert all(a < b for a, b in pairwise(times))


def test_frames_are_stamped_with_the_start_of_row_0(camera: Camera) -> None:
    """No frame is here before its last row has been exposed, and none is stamped long before it is here."""
    limits = camera.info.limits
    if limits is not None and camera.info.can.exposure:
        camera.configure(replace(gates(limits)[1], exposure_us=limits.exposure_us.nearest(20_000.0)))
    camera.start()
    ages_s = []
    for _ in range(8):
        stamp = take(camera)
        here_s = time.monotonic()
        assert (stamp.applied is not None) == (limits is not None)
        ages_s.append(here_s - exposed_s(stamp.applied, camera.info.height) - stamp.time_s)
    assert min(ages_s) > -1e-3, "jitter that is imitated may be that much"
    assert min(ages_s) < 0.5
    if camera.info.can.rows:
        first, last = camera.set_rows(camera.info.height // 2, camera.info.height // 2 + 4)
        while (stamp := take(camera)).rows != (first, last):
            assert time.monotonic() < here_s + 60.0
        assert stamp.time_s + exposed_s(stamp.applied, last) < time.monotonic() + 1e-3, "row 0, although it is not read"


def test_every_pixel_is_written(camera: Camera) -> None:
    camera.start()
    low, high = frame_buffer(camera.info, 0), frame_buffer(camera.info, 65535)
    lows, highs = np.zeros(low.shape, bool), np.zeros(low.shape, bool)
    for _ in range(5):
        low.fill(0)
        high.fill(65535)
        take(camera, low)
        take(camera, high)
        lows |= low != 0
        highs |= high != 65535
    assert (lows | highs).all()


def test_a_wrong_buffer_is_refused_and_the_next_frame_comes(camera: Camera) -> None:
    height, width = camera.info.height, camera.info.width
    camera.start()
    for shape in ((height + 1, width), (width, height + 2), (height, width, 1), (height * width,)):
        with pytest.raises(ValueError, match="buffer"):
            camera.read(np.zeros(shape, np.uint16), 1.0)
    with pytest.raises(ValueError, match="buffer"):
        camera.read(np.zeros((height, width), np.uint8), 1.0)  # type: ignore[arg-type]
    take(camera)


def test_a_timeout_is_kept_and_leaves_the_buffer(camera: Camera) -> None:
    camera.start()
    take(camera)
    buffer = frame_buffer(camera.info, 7)
    end = time.monotonic() + 100.0
    while True:
        buffer.fill(7)
        started = time.monotonic()
        stamp = camera.read(buffer, 0.0)
        waited_s = time.monotonic() - started
        if stamp is None:
            assert (buffer == 7).all()
            if waited_s < 0.5:
                return
        assert time.monotonic() < end, "always a frame, or it waited for one"


def test_stop_wakes_a_waiting_read(camera: Camera) -> None:
    camera.start()
    take(camera)
    buffer = frame_buffer(camera.info)
    ended = threading.Event()

    def read_on() -> None:
        while camera.read(buffer, 60.0) is not None:
            pass
        ended.set()

    reader = threading.Thread(target=read_on)
    reader.start()
    time.sleep(0.1)
    camera.stop()
    assert ended.wait(30.0), "half of what it would have waited for"
    reader.join()


def test_starting_stopping_and_closing_can_be_repeated(camera: Camera) -> None:
    first = -1
    for _ in range(3):
        camera.start()
        camera.start()
        stamp = take(camera)
        assert stamp.sequence > first
        first = stamp.sequence
        camera.stop()
        camera.stop()
    camera.close()
    camera.close()
    camera.stop()


def test_opening_and_closing_leaves_nothing_behind(make: Make) -> None:
    def once() -> None:
        camera = make(RIG)
        camera.start()
        take(camera)
        camera.close()

    once()
    before = threads_and_files()
    for _ in range(4):
        once()
    end = time.monotonic() + 60.0
    while any(now > then for now, then in zip(threads_and_files(), before, strict=True)):
        assert time.monotonic() < end, (threads_and_files(), before)
        time.sleep(0.01)


def test_what_is_applied_is_possible_and_stays(camera: Camera) -> None:
    limits = limits_of(camera)
    for asked in gates(limits):
        try:
            applied = camera.configure(asked)
        except ValueError:
            continue
        row_us = applied.line_time_us  # in which many sensors count their exposure
        assert limits.exposure_us.min - row_us <= applied.exposure_us <= limits.exposure_us.max + row_us
        assert applied.line_time_us == pytest.approx(limits.line.nearest(applied.line_time_us), rel=1e-6)
        again = camera.configure(applied)
        assert again.line_time_us == pytest.approx(applied.line_time_us)
        assert again.exposure_us == pytest.approx(applied.exposure_us)
        shift = (again.delay_us - applied.delay_us) / PROJECTOR.period_us
        assert shift == pytest.approx(round(shift), abs=1e-3)


def test_frames_say_which_gate_made_them(camera: Camera) -> None:
    limits = settable(camera)
    middle = gates(limits)[1]
    first = camera.configure(middle)
    camera.start()
    stamp = take(camera)
    assert (stamp.asked, stamp.applied) == (middle, first)
    short = replace(middle, exposure_us=limits.exposure_us.nearest(limits.exposure_us.min + 500.0))
    before = first
    for asked in (short, middle, short):
        applied = camera.configure(asked)
        stamp = take(camera)
        assert (stamp.asked, stamp.applied) == (asked, applied)
        assert not stamp.settled or applied == before
        before = applied
        frames = 1
        while not stamp.settled:
            stamp = take(camera)
            assert (stamp.asked, stamp.applied) == (asked, applied)
            frames += 1
            assert frames < 20
    camera.configure(short)
    assert take(camera).settled, "the same gate again changes nothing"


def test_a_refused_gate_leaves_the_old_one(camera: Camera) -> None:
    limits = settable(camera)
    kept = camera.configure(gates(limits)[1])
    camera.start()
    for asked in gates(limits)[6:]:
        try:
            kept = camera.configure(asked)
        except ValueError:
            assert take(camera).applied == kept


def test_rows_that_are_not_read_are_black(camera: Camera) -> None:
    info = camera.info
    if not info.can.rows:
        pytest.skip("this camera reads all of its rows")
    camera.start()
    for asked in ((info.height // 3, info.height // 2), (1, 2), (0, info.height), (info.height - 1, info.height)):
        first, last = camera.set_rows(*asked)
        assert 0 <= first <= asked[0] < asked[1] <= last <= info.height
        image = frame_buffer(info)
        stamp = take(camera, image)
        while not stamp.settled:
            stamp = take(camera, image)
        assert stamp.rows == (None if (first, last) == (0, info.height) else (first, last))
        outside = np.concatenate((image[:first], image[last:]))
        assert (outside == round(info.black_count)).all()
        assert (image[first:last] <= info.max_count).all()
    with pytest.raises(ValueError, match="rows"):
        camera.set_rows(0, info.height + 1)
    take(camera)


def test_it_streams(make: Make) -> None:
    camera = make(RIG)
    with Stream(camera) as stream:
        if camera.info.limits is not None and camera.info.can.exposure:
            stream.submit(gates(camera.info.limits)[1])
        end = time.monotonic() + 100.0
        while stream.counters.made < 15:
            assert time.monotonic() < end, stream.error
            time.sleep(0.005)
            stream.newest()
        assert stream.error is None
        assert stream.counters.errors == 0
