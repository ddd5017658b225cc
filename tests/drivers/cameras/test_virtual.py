from __future__ import annotations

import math
import threading
import time
import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from fake_time import FakeTime
from rigs import plain_rig, shutter
from slopegate.core.exposure.sensor import SensorModel, mono
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.render import Cancelled, render
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate, quantise
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere
from slopegate.drivers.cameras import virtual
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.frame import FrameStamp, exposed_s

HEIGHT, WIDTH = 120, 160
CLOCKS = PixelClocks(10 * 996.66866, (50.0, 76.0, 78.0, 80.0, 108.0))


def wall(depth_m: float, albedo: float = 0.5) -> Mesh:
    corners = np.array([[-2, -2, depth_m], [2, -2, depth_m], [2, 2, depth_m], [-2, 2, depth_m]], float)
    return Mesh("wall", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (albedo, albedo / 2, albedo / 4))


RIG = plain_rig(WIDTH, HEIGHT, 500 / 3, shutter(CLOCKS))
STILL = Scene("still", objects=(wall(1.3), Sphere("ball", (0.0, 0.0, 1.0), 0.15)), ambient=0.1)
ON_BALL = gate(CLOCKS.line_time_us(78), 2400.0, 700.0)


def moving_scene() -> Scene:
    times = np.array([0.0, 1.0, 2.0])
    positions = np.array([[-0.2, 0, 0], [0.2, 0, 0], [-0.2, 0, 0]], float)
    motion = KeyFrames(times, positions, np.stack([np.eye(3)] * 3), (0.0, 0.0, 0.0))
    ball = Sphere("ball", (0.0, 0.0, 1.0), 0.15, (0.9, 0.9, 0.9), motion)
    return Scene("moving", objects=(wall(1.3, 0.3), ball), ambient=0.1)


def buffer() -> NDArray[np.uint16]:
    return np.zeros((HEIGHT, WIDTH), np.uint16)


def take(camera: VirtualCamera) -> tuple[NDArray[np.uint16], FrameStamp]:
    image = buffer()
    stamp = camera.read(image, 5.0)
    assert stamp is not None
    return image, stamp


def running(scene: Scene = STILL, **options: object) -> VirtualCamera:
    camera = VirtualCamera(RIG, scene, **{"rate_hz": math.inf, **options})  # type: ignore[arg-type]
    camera.start()
    return camera


def test_frames_are_the_gated_scene_in_counts() -> None:
    camera = running(noise=False, sensor=SensorModel(counts_per_unit=1000.0))
    applied = camera.configure(ON_BALL)
    image, stamp = take(camera)
    buffers = render(RIG, STILL)
    count = weights(row_windows(RIG, applied), buffers.projector_row)
    assert 0.01 < count.mean() < 0.5
    radiance = count * mono(buffers.direct) + np.float32(700 / 16666.7) * mono(buffers.ambient)
    np.testing.assert_allclose(image, np.minimum(radiance * 1000 + 40, 4095), atol=0.6)
    assert stamp.skipped_fraction > 0.1


def test_colour_frames_carry_the_mosaic() -> None:
    camera = running(noise=False, sensor=SensorModel(counts_per_unit=1000.0), pixel_format="bayer_rg12")
    camera.configure(gate(CLOCKS.line_time_us(78), 0.0, 16667.0))
    image, _ = take(camera)
    assert camera.info.pixel_format == "bayer_rg12"
    corner = image[:2, :2].astype(float) - 40
    assert corner[0, 0] / corner[0, 1] == pytest.approx(2, rel=0.02)
    assert corner[0, 1] == pytest.approx(corner[1, 0], rel=0.02)
    assert corner[1, 0] / corner[1, 1] == pytest.approx(2, rel=0.02)


def test_settings_are_rounded_to_the_cameras_and_travel_with_the_frame() -> None:
    camera = running()
    take(camera)
    asked = gate(CLOCKS.line_time_us(77.2), 2028.4, 3.0)
    applied = camera.configure(asked)
    assert applied == quantise(RIG.camera.shutter, asked, 16666.7)
    assert applied == gate(CLOCKS.line_time_us(78), 2028.0, 100.0)
    first, second = take(camera)[1], take(camera)[1]
    assert (first.asked, first.applied, first.settled) == (asked, applied, False)
    assert second.settled
    assert [first.sequence, second.sequence] == [1, 2]
    camera.configure(replace(asked, exposure_us=4.0))
    assert take(camera)[1].settled, "nothing changed on the hardware"


def later(settings: GateSettings, late_us: float) -> GateSettings:
    return gate(settings.line_time_us, settings.delay_us + late_us, settings.exposure_us)


@pytest.mark.parametrize("scene", [STILL, moving_scene()], ids=["still", "moving"])
@pytest.mark.parametrize("noise", [False, True])
def test_a_late_trigger_opens_the_gate_late_and_what_was_set_is_told_as_set(scene: Scene, noise: bool) -> None:
    """Also the frame after it is right: nothing of a late gate is kept."""
    late, on_time = running(scene, noise=noise, rate_hz=20.0), running(scene, noise=noise, rate_hz=20.0)
    late.configure(ON_BALL)
    for late_us in (0.0, 0.0, 137.0, 137.0, -412.0, 0.0, 0.0, 20_000.0):
        late.trigger_late(late_us)
        on_time.configure(later(ON_BALL, late_us))
        image, stamp = take(late)
        assert stamp.asked == ON_BALL
        assert stamp.applied == quantise(RIG.camera.shutter, ON_BALL, RIG.projector.period_us)
        np.testing.assert_array_equal(image, take(on_time)[0])


def test_a_late_trigger_opens_late_whatever_is_set_after_it() -> None:
    late, on_time = running(noise=False), running(noise=False)
    late.trigger_late(1e9 + 55.0)
    late.configure(ON_BALL)
    on_time.configure(later(ON_BALL, math.remainder(1e9 + 55.0, RIG.projector.period_us)))
    image, other = take(late)[0], take(on_time)[0]
    assert (image != other).mean() < 1e-3, "shifts are rounded to the hardware's steps in one of the two only"
    assert (image != take(running(noise=False))[0]).any()


def test_without_faults_windows_are_made_once_a_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a trigger that may be late costs: nothing, where none ever is."""
    camera = running()
    take(camera)
    made = []
    monkeypatch.setattr(virtual, "row_windows", lambda *given: made.append(given) or row_windows(*given))
    for _ in range(5):
        camera.trigger_late(0.0)
        take(camera)
    assert not made
    camera.configure(ON_BALL)
    take(camera)
    assert len(made) == 1


def test_equal_seeds_make_equal_frames() -> None:
    def three(seed: int) -> list[NDArray[np.uint16]]:
        camera = running(seed=seed)
        camera.configure(ON_BALL)
        return [take(camera)[0] for _ in range(3)]

    np.testing.assert_array_equal(three(3), three(3))
    assert (np.array(three(3)) != np.array(three(4))).mean() > 0.5


def test_pacing_keeps_the_rate_and_never_rushes() -> None:
    fake = FakeTime()
    camera = running(rate_hz=20.0, clock=fake.clock, sleep=fake.sleep)
    times = [take(camera)[1].time_s for _ in range(5)]
    np.testing.assert_allclose(np.diff(times), 0.05)
    fake.now_s += 0.33
    times = [take(camera)[1].time_s for _ in range(4)]
    np.testing.assert_allclose(np.diff(times), 0.05, err_msg="a late camera starts a new beat")


def test_a_frame_that_is_not_due_is_a_time_out() -> None:
    fake = FakeTime()
    camera = running(rate_hz=20.0, clock=fake.clock, sleep=fake.sleep)
    take(camera)
    image = buffer()
    assert camera.read(image, 0.02) is None
    assert not image.any()
    assert fake.slept_s == [pytest.approx(0.02)]
    stamp = take(camera)[1]
    assert stamp.time_s + exposed_s(stamp.applied, camera.info.height) == pytest.approx(100.05)


def test_stop_wakes_a_waiting_read() -> None:
    camera = running(rate_hz=0.001)
    take(camera)
    result: list[FrameStamp | None] = []
    thread = threading.Thread(target=lambda: result.append(camera.read(buffer(), 600.0)))
    thread.start()
    time.sleep(0.05)
    assert thread.is_alive()
    camera.stop()
    thread.join(60.0)
    assert not thread.is_alive()
    assert result == [None]
    assert camera.read(buffer(), 1.0) is None


def test_no_frames_before_the_start() -> None:
    assert VirtualCamera(RIG, STILL).read(buffer(), 0.0) is None


def test_only_a_camera_that_runs_free_makes_frames_on_demand() -> None:
    assert VirtualCamera(RIG, STILL, rate_hz=math.inf).info.modes.on_demand
    assert not VirtualCamera(RIG, STILL, rate_hz=500.0).info.modes.on_demand


def test_preparing_can_be_cancelled_and_repeated() -> None:
    camera = VirtualCamera(RIG, STILL, rate_hz=math.inf)
    shares: list[float] = []
    with pytest.raises(Cancelled):
        camera.prepare(lambda share: False)
    assert camera.buffers is None
    camera.prepare(lambda share: shares.append(share) or True)
    assert shares == sorted(shares)
    assert camera.buffers is not None
    assert camera.sensor is not None
    camera.start()
    take(camera)


def test_gain_fits_the_scene() -> None:
    camera = running(noise=False)
    camera.configure(gate(CLOCKS.line_time_us(78), 0.0, 16667.0))
    image, _ = take(camera)
    assert np.percentile(image, 99.5) == pytest.approx(0.8 * 4095, rel=0.02)


@pytest.mark.parametrize("pixel_format", ["mono12", "bayer_rg12"])
def test_moving_objects_look_as_if_rendered_anew(pixel_format: str) -> None:
    scene, sensor = moving_scene(), SensorModel(counts_per_unit=1000.0)
    camera = running(scene, rate_hz=10.0, noise=False, sensor=sensor, pixel_format=pixel_format, sleep=lambda s: None)
    camera.configure(ON_BALL)
    frames = [take(camera)[0] for _ in range(9)]
    assert any((a != b).any() for a, b in pairwise(frames))
    for index in (0, 3, 8):
        other = VirtualCamera(RIG, scene, sensor, rate_hz=10.0, noise=False, pixel_format=pixel_format)  # type: ignore[arg-type]
        other.number_frames_from(index)
        other.configure(ON_BALL)
        other.start()
        np.testing.assert_array_equal(take(other)[0], frames[index])


def test_brighter_ambient_entering_the_view_is_not_cut_off() -> None:
    motion = KeyFrames(
        np.array([0.0, 1.0]), np.array([[9.0, 0, 0], [0.0, 0, 0]]), np.stack([np.eye(3)] * 2), (0, 0, 0), False
    )
    ball = Sphere("ball", (0.0, 0.0, 1.0), 0.15, (0.9, 0.9, 0.9), motion)
    scene = Scene("entering", objects=(wall(1.3, 0.1), ball), ambient=1.0)
    camera = running(scene, rate_hz=1.0, noise=False, sensor=SensorModel(counts_per_unit=1000.0), sleep=lambda s: None)
    camera.configure(gate(CLOCKS.line_time_us(78), 9000.0, 8000.0))
    take(camera)
    image, _ = take(camera)
    assert image[HEIGHT // 2, WIDTH // 2] == pytest.approx(40 + 0.9 * 1000 * 8000 / 16666.7, abs=1.5)


def test_a_frame_allocates_nothing_of_its_size() -> None:
    camera = running()
    camera.configure(ON_BALL)
    image = buffer()
    tracemalloc.start()
    for _ in range(500):  # the compiler's call cache fills with some 50 kB of small objects
        camera.read(image, 1.0)
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for _ in range(100):
        camera.read(image, 1.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - before < 16384 < image.nbytes / 2


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((HEIGHT, WIDTH), np.uint8),
        np.zeros((WIDTH, HEIGHT), np.uint16),
        np.zeros((HEIGHT, 2 * WIDTH), np.uint16)[:, ::2],
    ],
    ids=["dtype", "shape", "strided"],
)
def test_a_buffer_that_does_not_fit_is_refused(wrong: NDArray[np.uint16]) -> None:
    with pytest.raises(ValueError, match="buffer"):
        running().read(wrong, 1.0)


@pytest.mark.parametrize("options", [{"rate_hz": 0.0}, {"rate_hz": float("nan")}, {"pixel_format": "mono8"}])
def test_impossible_options_are_named(options: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        VirtualCamera(RIG, STILL, **options)  # type: ignore[arg-type]


RASTER = (RIG.projector.lens.height, RIG.projector.lens.width)
EVERYTHING = gate(CLOCKS.line_time_us(78), 0.0, 16666.7)


def speckle(seed: int = 1) -> NDArray[np.float32]:
    return np.random.default_rng(seed).integers(0, 256, RASTER).astype(np.float32) / 255


def under(scene: Scene, picture: NDArray[np.float32], time_s: float = 0.0) -> NDArray[np.float32]:
    """Direct light of every pixel, looked up one by one."""
    seen = render(RIG, scene, time_s)
    rows, columns = (np.floor(place).astype(int) for place in (seen.projector_row, seen.projector_column))
    return np.where(rows >= 0, picture[rows, columns], 0).astype(np.float32) * mono(seen.direct)


@pytest.mark.parametrize("skip", [True, False])
def test_the_projector_shows_a_pattern_from_the_next_frame_on(skip: bool) -> None:
    camera = running(noise=False, sensor=SensorModel(counts_per_unit=1000.0), skip=skip)
    camera.configure(EVERYTHING)
    full = take(camera)[0]
    room = mono(render(RIG, STILL).ambient)
    for picture in (speckle(1), speckle(2), np.zeros(RASTER, np.float32)):
        camera.light_with(picture)
        expected = np.minimum((under(STILL, picture) + room) * 1000 + 40, 4095)
        np.testing.assert_allclose(take(camera)[0], expected, atol=0.7)
        np.testing.assert_allclose(take(camera)[0], expected, atol=0.7)
    camera.light_with(None)
    np.testing.assert_array_equal(take(camera)[0], full)


def test_all_on_by_a_pattern_is_all_on_to_the_last_bit() -> None:
    camera = running(noise=False)
    camera.configure(ON_BALL)
    full = take(camera)[0]
    camera.light_with(np.ones(RASTER, np.float32))
    np.testing.assert_array_equal(take(camera)[0], full)


def test_the_gain_is_chosen_with_everything_lit() -> None:
    usual = running(noise=False)
    take(usual)
    dark = VirtualCamera(RIG, STILL, rate_hz=math.inf, noise=False)
    dark.light_with(np.zeros(RASTER, np.float32))
    dark.start()
    image = take(dark)[0]
    assert dark.sensor == usual.sensor
    assert image.max() < 0.2 * take(usual)[0].max()


def test_a_pattern_follows_what_moves() -> None:
    """As a camera that renders every frame anew shows it, before and behind the moving ball."""
    frames: list[list[NDArray[np.uint16]]] = []
    for skip in (True, False):
        fake = FakeTime()
        camera = running(moving_scene(), noise=False, skip=skip, rate_hz=5.0, clock=fake.clock, sleep=fake.sleep)
        camera.configure(EVERYTHING)
        camera.light_with(speckle())
        frames.append([take(camera)[0] for _ in range(4)])
    assert (frames[0][0] != frames[0][3]).mean() > 0.02
    np.testing.assert_array_equal(frames[0], frames[1])


def test_the_light_of_a_gate_is_that_of_the_pattern() -> None:
    camera = running(shown=("direct",))
    camera.light_with(speckle())
    take(camera)
    found = camera.light_by_part(EVERYTHING)["direct"]
    np.testing.assert_allclose(found, under(STILL, speckle()), rtol=1e-6)


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="is not one of a projector of 1280 x 720 pixels"):
        running().light_with(np.ones((720, 1000), np.float32))


def test_frames_are_numbered_anew_and_their_noise_follows() -> None:
    camera = running(seed=5)
    first = [take(camera) for _ in range(3)]
    camera.number_frames_from(1)
    again = [take(camera) for _ in range(2)]
    assert [stamp.sequence for _, stamp in again] == [3, 4]
    np.testing.assert_array_equal([image for image, _ in again], [image for image, _ in first[1:]])
    camera.number_frames_from(1 << 40)
    far, stamp = take(camera)
    assert stamp.sequence == 5
    assert (far != again[0][0]).mean() > 0.5


def test_only_the_parts_that_are_to_be_shown_are() -> None:
    camera = running(noise=False, shown=("direct",), sensor=SensorModel(counts_per_unit=1000.0))
    camera.configure(EVERYTHING)
    expected = np.minimum(mono(render(RIG, STILL).direct) * 1000 + 40, 4095)
    np.testing.assert_allclose(take(camera)[0], expected, atol=0.7)
