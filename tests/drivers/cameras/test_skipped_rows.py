"""Frames that leave out work must be those that do all of it, and say how much was left out."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from fake_time import FakeTime
from rigs import plain_rig, shutter
from slopegate.core.exposure.kernels import TILE
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.gating.gate import Reach, lit_rows, row_windows, seen_reach, weights
from slopegate.core.render.render import render
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere
from slopegate.drivers.cameras.virtual import VirtualCamera, frame_rate_hz
from slopegate.drivers.contract.frame import Abilities, FrameStamp, exposed_s

HEIGHT, WIDTH, PERIOD_US = 120, 160, 16666.7
CLOCKS = PixelClocks(10 * 996.66866, (50.0, 76.0, 78.0, 80.0, 108.0))
BLACK = 40


def wall(depth_m: float) -> Mesh:
    corners = np.array([[-2, -2, depth_m], [2, -2, depth_m], [2, 2, depth_m], [-2, 2, depth_m]], float)
    return Mesh("wall", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), (0.5, 0.3, 0.2))


def scene(ambient: float = 0.1, moving: bool = False) -> Scene:
    """A ball before a wall; it comes and goes for a second and then rests for another."""
    positions = np.array([[-0.2, 0, 0], [0.2, 0.1, 0], [-0.2, 0, 0], [-0.2, 0, 0]], float)
    motion = KeyFrames(np.array([0, 0.5, 1.0, 2.0]), positions, np.stack([np.eye(3)] * 4), (0, 0, 0))
    ball = Sphere("ball", (0.0, 0.0, 1.0), 0.15, (0.9, 0.6, 0.5), motion if moving else None)
    return Scene("scene", objects=(wall(1.3), ball), ambient=ambient)


RIG = plain_rig(WIDTH, HEIGHT, 500 / 3, shutter(CLOCKS))
ON_BALL = gate(CLOCKS.line_time_us(78), 2400.0, 700.0)
LEANING = gate(CLOCKS.line_time_us(50), -1700.0, 400.0)
FLOOD = gate(CLOCKS.line_time_us(78), 9000.0, 17000.0)


def running(of: Scene, **options: object) -> VirtualCamera:
    sensor = SensorModel(counts_per_unit=1000.0)
    camera = VirtualCamera(RIG, of, sensor, **{"rate_hz": 20.0, "sleep": lambda s: None, **options})  # type: ignore[arg-type]
    camera.start()
    return camera


def take(camera: VirtualCamera) -> tuple[NDArray[np.uint16], FrameStamp]:
    image = np.full((HEIGHT, WIDTH), 7, np.uint16)
    stamp = camera.read(image, 5.0)
    assert stamp is not None
    return image, stamp


@pytest.mark.parametrize(
    ("moving", "noise", "pixel_format"),
    [*product([False, True], [False, True], ["mono12"]), (True, True, "bayer_rg12")],
)
def test_frames_are_the_same_without_skipping(moving: bool, noise: bool, pixel_format: str) -> None:
    options = {"noise": noise, "pixel_format": pixel_format}
    ours = running(scene(moving=moving), **options)
    honest = running(scene(moving=moving), skip=False, **options)
    skipped = []
    for index, settings in enumerate([ON_BALL] * 5 + [LEANING] * 4 + [FLOOD] * 4 + [ON_BALL] * 4):
        for camera in (ours, honest):
            assert camera.configure(settings) == settings
            camera.cover(index == 7)
        (image, stamp), (expected, full) = take(ours), take(honest)
        np.testing.assert_array_equal(image, expected, err_msg=f"frame {index}")
        assert (full.skipped_fraction, full.cast_fraction) == (0.0, 1.0)
        assert moving or stamp.cast_fraction == 0.0
        skipped.append(stamp.skipped_fraction)
    assert np.mean(skipped) > 0.3


@pytest.mark.parametrize("settings", [ON_BALL, LEANING, FLOOD], ids=["on the ball", "leaning", "flood"])
def test_what_is_called_skipped_really_gives_no_light(settings: GateSettings) -> None:
    camera = running(scene(ambient=0.0))
    camera.configure(settings)
    stamp = take(camera)[1]
    rows = render(RIG, scene()).projector_row
    count = weights(row_windows(RIG, settings), rows)
    tiles = [count[:, left : left + TILE] for left in range(0, WIDTH, TILE)]
    dark = sum(tile.shape[1] * int((tile == 0).all(axis=1).sum()) for tile in tiles)
    assert stamp.skipped_fraction <= dark / count.size
    assert stamp.skipped_fraction >= 0.9 * dark / count.size


def test_a_frame_that_cannot_differ_is_made_once() -> None:
    camera = running(scene(), noise=False)
    camera.configure(ON_BALL)
    first, second, third = take(camera), take(camera), take(camera)
    assert first[1].skipped_fraction == second[1].skipped_fraction < 1
    for _ in range(3):
        image, stamp = take(camera)
        np.testing.assert_array_equal(image, first[0])
        assert stamp.skipped_fraction == third[1].skipped_fraction == 1
    camera.configure(LEANING)
    image, stamp = take(camera)
    assert stamp.skipped_fraction < 1
    assert (image != first[0]).any()
    noisy = running(scene())
    assert [take(noisy)[1].skipped_fraction < 1 for _ in range(4)] == [True] * 4


def test_a_scene_at_rest_is_made_once_too() -> None:
    """The ball stops after a second, 20 frames, and goes on after another."""
    camera = running(scene(moving=True), noise=False)
    camera.configure(ON_BALL)
    stamps = [take(camera)[1] for _ in range(44)]
    assert [stamp.skipped_fraction == 1 for stamp in stamps] == [False] * 22 + [True] * 19 + [False] * 3
    assert [0 < stamp.cast_fraction < 0.5 for stamp in stamps[1:]] == [True] * 20 + [False] * 20 + [True] * 3


@pytest.mark.parametrize("noise", [False, True])
def test_rows_read_alone_are_those_of_the_whole_frame(noise: bool) -> None:
    part, whole = running(scene(), noise=noise), running(scene(), noise=noise)
    for asked, applied in [((33, 59), (32, 60)), ((0, 120), (0, 120)), ((119, 120), (116, 120)), ((7, 7), (4, 8))]:
        for camera in (part, whole):
            camera.configure(ON_BALL)
        assert part.set_rows(*asked) == applied
        first, last = applied
        everything = applied == (0, HEIGHT)
        (image, stamp), expected = take(part), take(whole)[0]
        assert stamp.rows == (None if everything else applied)
        assert stamp.settled is False
        np.testing.assert_array_equal(image[first:last], expected[first:last])
        assert (image[:first] == BLACK).all()
        assert (image[last:] == BLACK).all()
        assert everything or stamp.skipped_fraction >= 1 - (last - first) / HEIGHT
        assert part.set_rows(*asked) == applied
        assert take(part)[1].settled
        take(whole)


@pytest.mark.parametrize("rows", [(-1, 8), (8, 4), (0, 121)])
def test_rows_that_are_not_there_are_refused(rows: tuple[int, int]) -> None:
    camera = running(scene())
    with pytest.raises(ValueError, match="rows"):
        camera.set_rows(*rows)
    assert take(camera)[1].rows is None


@pytest.mark.parametrize("known", [False, True], ids=["roughly", "exactly"])
def test_rows_left_out_hold_no_light(known: bool) -> None:
    """Without ambient light and noise a frame of the rows that can be lit is the whole frame, whatever the gate."""
    dark = scene(ambient=0.0)
    reach = seen_reach(render(RIG, dark).projector_row)
    if not known:
        reach = Reach(reach.low - 40.0, reach.high + 40.0)
    part, whole = running(dark, noise=False), running(dark, noise=False, skip=False)
    rng = np.random.default_rng(1)
    read = []
    for _ in range(40):
        asked = gate(
            CLOCKS.line_time_us(rng.choice(CLOCKS.ladder_mhz)), rng.uniform(-4000, 8000), rng.uniform(100, 3000)
        )
        applied = part.configure(asked)
        whole.configure(asked)
        first, last = part.set_rows(*lit_rows(row_windows(RIG, applied), reach))
        np.testing.assert_array_equal(take(part)[0], take(whole)[0])
        read.append((last - first) / HEIGHT)
    assert min(read) < 0.1
    assert max(read) > 0.8


def test_fewer_rows_come_faster() -> None:
    line_us = CLOCKS.line_time_us(78)

    def rate(rows: int, exposure_us: float = 400.0, rate_hz: float = 20.0) -> float:
        return frame_rate_hz(RIG, gate(line_us, 0.0, exposure_us), rows, rate_hz)

    assert rate(120) == 20
    assert rate(100) == pytest.approx(24), "what the link carries"
    assert rate(60) == pytest.approx(40)
    assert rate(20) == pytest.approx(1e6 / PERIOD_US), "once a period of the projector"
    assert rate(0) == pytest.approx(1e6 / PERIOD_US)
    assert rate(20, 20000.0) == pytest.approx(0.5e6 / PERIOD_US), "every other one while the exposure lasts longer"
    # 119 rows take 15.2 ms to read: with a long exposure that is two periods and no faster than the whole frame's 60.
    assert rate(119, 3000.0, 60.0) == 60
    assert rate(119, 3000.0, 20.0) == pytest.approx(20 * 120 / 119)


def test_a_cropped_camera_keeps_its_beat_and_the_scenes_time() -> None:
    fake = FakeTime()
    camera = running(scene(moving=True), rate_hz=20.0, clock=fake.clock, sleep=fake.sleep)
    camera.configure(ON_BALL)

    def arrived() -> float:
        stamp = take(camera)[1]
        return stamp.time_s + exposed_s(stamp.applied, HEIGHT if stamp.rows is None else stamp.rows[1])

    times = [arrived() for _ in range(3)]
    camera.set_rows(40, 100)
    times += [arrived() for _ in range(4)]
    camera.set_rows(0, HEIGHT)
    times += [arrived() for _ in range(3)]
    np.testing.assert_allclose(np.diff(times), [0.05, 0.05] + [0.025] * 4 + [0.05] * 3)
    # Every frame shows the instant at which it was made.
    latest = 0.05 * 2 + 0.025 * 4 + 0.05 * 3
    assert camera._beat.scene_time_s(10) == pytest.approx(latest + 0.05)


def test_a_camera_says_whether_it_can_read_fewer_rows() -> None:
    camera = running(scene())
    assert camera.info.can.rows
    assert "rows" in Abilities().rows.missing
