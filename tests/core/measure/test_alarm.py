"""The proximity alarm: when it goes off, that it stays off or on, and what level noise does not reach."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.exposure.sensor import SensorModel, expose
from slopegate.core.measure.alarm import QUIET_FRAMES, Alarm, AlarmZone, Trip, bright_share, quiet_level


def frame(bright: int, height: int = 20, width: int = 30) -> np.ndarray:
    image = np.full((height, width), 50, np.uint16)
    image.ravel()[:bright] = 900
    return image


def test_it_goes_off_at_the_share_and_again_when_it_was_quiet() -> None:
    alarm = Alarm(AlarmZone(0, 0, 30, 20, 100.0, 10 / 600))
    flicker, pause = [300, *[0] * (QUIET_FRAMES - 1)], [0]
    trips = []
    for sequence, bright in enumerate((0, 9, 10, *flicker, *flicker, *pause, 12, 0)):
        before, alarm = alarm, alarm.after(frame(bright), sequence, 0.5 * sequence)
        trips += [alarm.trip] * (alarm.trips - before.trips)
    assert trips == [Trip(2, 1.0, 10 / 600), Trip(4 + 2 * QUIET_FRAMES, 2.0 + QUIET_FRAMES, 12 / 600)]
    assert alarm.share == 0
    assert alarm.frames == 6 + 2 * QUIET_FRAMES


@given(
    x0=st.integers(0, 20),
    y0=st.integers(0, 15),
    x1=st.integers(21, 30),
    y1=st.integers(16, 20),
    seed=st.integers(0, 99),
)
def test_only_the_region_counts(x0: int, y0: int, x1: int, y1: int, seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 200, (20, 30)).astype(np.uint16)
    expected = sum(image[y, x] > 100 for y in range(y0, y1) for x in range(x0, x1)) / ((x1 - x0) * (y1 - y0))
    assert bright_share(image, AlarmZone(x0, y0, x1, y1, 100.0, 1.0)) == pytest.approx(expected)


def test_a_quiet_scene_stays_quiet_at_the_learnt_level_and_a_hand_does_not() -> None:
    rng = np.random.default_rng(0)
    light = np.full((200, 300), 0.01, np.float32)
    sensor = SensorModel()
    level = quiet_level(expose(light, sensor, rng), (0, 0, 300, 200))
    watch = AlarmZone(0, 0, 300, 200, level, 1 / 60_000)
    quiet = Alarm(watch)
    for sequence in range(50):
        quiet = quiet.after(expose(light, sensor, rng), sequence, 0.0)
    assert quiet.trip is None
    light[50:60, 50:60] = 0.2
    assert quiet.after(expose(light, sensor, rng), 51, 0.0).trip is not None


@pytest.mark.parametrize(
    ("box", "share", "field"),
    [((5, 0, 5, 10), 0.1, "x0"), ((0, -1, 5, 10), 0.1, "y0"), ((0, 0, 5, 10), 0.0, "least_share")],
)
def test_impossible_watches_are_refused(box: tuple[int, int, int, int], share: float, field: str) -> None:
    with pytest.raises(ValueError, match=field):
        AlarmZone(*box, 100.0, share)


def test_a_region_beyond_the_image_is_refused() -> None:
    with pytest.raises(ValueError, match="x1"):
        bright_share(frame(0), AlarmZone(0, 0, 31, 20, 100.0, 0.1))
    with pytest.raises(ValueError, match="region"):
        quiet_level(frame(0), (5, 5, 5, 9))
