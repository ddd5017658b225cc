"""How much noise codes leave in light transport: variances of what is decoded, known before anything is acquired.

In counts^2, for one pixel, with r the read variance of a frame, g its variance per count of light, S the pixel's fully
lit light, T that of one block, N blocks and M the order of the codes' matrix. Frames of half the blocks see S / 2.

| codes | one block alone | the sum of all | the sum of a random half |
| --- | --- | --- | --- |
| impulse | r + g T | N r + g S | N r / 2 + g S / 2 |
| Hadamard, M = N | 4 r / M + 2 g S / M | r + g S | (3/2 - 1/N) r + (1 - 1/2N) g S |
| with spare columns, S | N/(N+1) 4 r / M + 2 g S / M | the same | N/M (r + g S / 2) |
| Gray, n bits | (2 r + g S) / (n + 1) | the same | half of it |

Hadamard codes without a spare column: block 0 has r + g S, for its matrix column is all ones. The sum of all blocks is
then the frame with all on and nothing else; with spare columns it is made of all frames. What this leaves out is a
share of 1 / N. At equal frames, an impulse is repeated count / N times.

The gain of Hadamard codes over impulses in one block is sqrt(N) / 2 where read noise rules and sqrt(N T / (2 S)) where
shot noise does, which is a loss unless a pixel's light comes from few blocks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.transport.codes import CodedPatterns

Use = Literal["column", "floodlit", "relit"]
"""What is made of transport: the light of one block, that of all, or that of a random half of the blocks."""


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


@dataclass(frozen=True)
class PixelLight:
    """A pixel's light in counts above the dark: `total` with all blocks on, `column` of the one that is asked for."""

    total: float
    column: float


def variance(codes: CodedPatterns, use: Use, light: PixelLight, noise: FrameNoise) -> float:
    """Expected variance, counts^2, of what is decoded from one frame a pattern; see the table above."""
    n, m = codes.grid.count, codes.count + 1 if codes.kind == "s" else codes.count
    read, shot = noise.read_variance, noise.variance_per_count * light.total
    if codes.kind == "impulse":
        return _of_impulses(n, light, noise)[use]
    if codes.kind == "gray":
        column = floodlit = (2 * read + shot) / (m // 2)
        relit = column / 2
    elif m > n:
        column = floodlit = n / (n + 1) * 4 * read / m + 2 * shot / m
        relit = n / m * (read + shot / 2)
    else:
        column, floodlit = (4 * read + 2 * shot) / m, read + shot
        relit = (1.5 - 1 / n) * read + (1 - 0.5 / n) * shot
    return {"column": column, "floodlit": floodlit, "relit": relit}[use]


def noise_gain(codes: CodedPatterns, use: Use, light: PixelLight, noise: FrameNoise) -> float:
    """How many times smaller the standard deviation is than that of impulses in as many frames.

    Raises ZeroDivisionError where there is no noise to compare.
    """
    n = codes.grid.count
    impulses = _of_impulses(n, light, noise)[use] * n / codes.count
    return math.sqrt(impulses / variance(codes, use, light, noise))


def _of_impulses(n: int, light: PixelLight, noise: FrameNoise) -> dict[Use, float]:
    """Variances of what one frame each of n impulses gives."""
    read, per_count = noise.read_variance, noise.variance_per_count
    floodlit = n * read + per_count * light.total
    return {"column": read + per_count * light.column, "floodlit": floodlit, "relit": floodlit / 2}
