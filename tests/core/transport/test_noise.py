"""The noise of decoded transport."""

from __future__ import annotations

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.transport.noise import FrameNoise


def test_a_sensors_noise_falls_with_the_frames_that_are_averaged() -> None:
    sensor = SensorModel(electrons_per_count=2.0, read_noise_e=8.0)
    assert FrameNoise.of(sensor) == FrameNoise(16.0, 0.5)
    assert FrameNoise.of(sensor, 4) == FrameNoise(4.0, 0.125)
