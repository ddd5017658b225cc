"""How much noise a code leaves in light transport: variances of what is decoded, before anything is acquired."""

from __future__ import annotations

from dataclasses import dataclass

from slopegate.core.exposure.sensor import SensorModel


@dataclass(frozen=True)
class FrameNoise:
    """Noise of one pixel's frame, counts^2: read_variance + variance_per_count x light in counts above the dark."""

    read_variance: float
    variance_per_count: float

    @staticmethod
    def of(sensor: SensorModel, frames: int = 1) -> FrameNoise:
        """Of the mean of this many frames of a sensor."""
        read = (sensor.read_noise_e / sensor.electrons_per_count) ** 2
        return FrameNoise(read / frames, 1 / (sensor.electrons_per_count * frames))
