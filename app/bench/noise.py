"""Ways to draw a frame's noise, what they cost, and how far they are from the sensor's own distribution.

The exact distribution is a Poisson count of electrons plus a normal read noise, turned into counts and rounded down
after adding one half. Moments, the cumulative probability and correlations are measured on flat frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.app.bench.kernels import expose_hashed
from slopegate.app.bench.number_types import FramePath, default_path
from slopegate.app.bench.subject import GateNumbers, Sight, Subject
from slopegate.core.exposure import kernels
from slopegate.core.exposure.sensor import SensorModel, expose, noise_pool
from slopegate.core.gating.gate import RowWindows
from slopegate.core.rig.arrays import Counts, Doubles, Indices, Singles
from slopegate.core.rig.settings import gate

Make = Callable[[FramePath, int, int], None]
"""make(path, gate, frame number) fills path.out."""

LEVELS: Final = (0.0, 30.0, 300.0, 3000.0)
"""Counts above black of the flat frames."""
FLAT: Final = (200, 320)
LAGS: Final = 32


@dataclass(frozen=True)
class NoiseError:
    """The worst over all levels: mean in counts, standard deviation in percent, cumulative probability, correlation.

    chance is the size of a correlation, and about that of an error of probability, that perfect noise would show.
    """

    mean_counts: float
    deviation_percent: float
    probability: float
    correlation: float
    chance: float


def makers(width: int) -> dict[str, Make]:
    """Every way to draw noise; the first is the program's for live frames, the last the program's for kept images."""
    pool = noise_pool(np.random.default_rng(1), width)
    rng = np.random.default_rng(2)

    def pooled(path: FramePath, index: int, number: int) -> None:
        noise = pool.frame(0, number)
        kernels.expose(path.planes, path.windows[index], path.responses[index], noise, path.out)

    def hashed(path: FramePath, index: int, number: int) -> None:
        seed = np.uint64((number + 1) * 0x9E3779B97F4A7C15 & (2**64 - 1))
        expose_hashed(path.planes, path.windows[index], path.responses[index], seed, path.out)

    def normals(path: FramePath, index: int, number: int) -> None:
        response, light = path.responses[index], _light(path, index)
        spread = np.sqrt(light * response.variance_per_count + response.read_variance)
        value = light + spread * rng.standard_normal(light.shape, np.float32) + response.offset
        path.out[:] = np.clip(np.floor(value), 0, response.max_count)

    def poisson(path: FramePath, index: int, number: int) -> None:
        sensor = path.subject.sensor
        path.out[:] = expose(_light(path, index) / np.float32(sensor.counts_per_unit), sensor, rng)

    return {
        "pooled": pooled,
        "hash of every pixel": hashed,
        "fresh normals, numpy": normals,
        "Poisson and normal, numpy": poisson,
    }


def _light(path: FramePath, index: int) -> Singles:
    """Counts above black, (H, W), before noise."""
    windows, response, rows = path.windows[index], path.responses[index], path.planes.projector_row
    hit = (rows >= windows.low[:, None]) & (rows < windows.high[:, None])
    weight = np.where(hit, windows.inside[:, None], windows.outside[:, None]) * response.direct_step
    light = weight * path.planes.direct + response.ambient_step * path.planes.ambient
    return np.asarray(light, np.float32)


def measure(make: Make, subject: Subject, frames: int) -> NoiseError:
    """Errors of one way to draw noise, over `frames` flat frames at every level."""
    worst = NoiseError(0.0, 0.0, 0.0, 0.0, 0.0)
    for level in LEVELS:
        path = flat_path(subject, level)
        stack = np.empty((frames, *FLAT), np.uint16)
        for number in range(frames):
            make(path, 0, number)
            stack[number] = path.out
        found = _errors(stack, level, subject.sensor)
        worst = NoiseError(*(max(a, b) for a, b in zip(vars(worst).values(), vars(found).values(), strict=True)))
    return worst


def flat_path(subject: Subject, level_counts: float) -> FramePath:
    """Frames of an evenly lit surface, all of which is recorded once."""
    rows, flat = FLAT[0], np.full(FLAT, level_counts / subject.sensor.counts_per_unit, np.float32)
    once = np.ones(rows, np.int32)
    windows = RowWindows(np.zeros(rows), np.ones(rows), once, once)
    sight = Sight(np.zeros(FLAT), flat, np.zeros(FLAT, np.float32), np.ones(FLAT))
    opened = GateNumbers(gate(1.0, 0.0, 1.0), windows, 0.0)
    return default_path(Subject("flat", subject.rig, subject.scene, sight, (opened,), subject.sensor))


def _errors(stack: Counts, level: float, sensor: SensorModel) -> NoiseError:
    variance = level / sensor.electrons_per_count + (sensor.read_noise_e / sensor.electrons_per_count) ** 2 + 1 / 12
    values = stack.astype(np.float64) - (level + sensor.black_count)
    share = np.bincount(stack.reshape(-1), minlength=sensor.max_count + 1) / stack.size
    likely = np.flatnonzero(share)
    span = np.arange(likely[0], likely[-1] + 1)
    exact = cumulative(span, level, sensor)
    return NoiseError(
        abs(float(values.mean())),
        100 * abs(math.sqrt(float(values.var()) / variance) - 1),
        float(np.abs(np.cumsum(share)[span] - exact).max()),
        _correlation(values - values.mean()),
        1 / math.sqrt(stack.size),
    )


def cumulative(counts: Indices, level: float, sensor: SensorModel) -> Doubles:
    """Probability that the exact sensor gives at most these counts (n,), for a mean of `level` counts above black."""
    mean_e = level * sensor.electrons_per_count
    reach = 10 * math.sqrt(mean_e) + 10
    electrons = np.arange(max(0, int(mean_e - reach)), int(mean_e + reach) + 1)
    log_gamma = np.array([math.lgamma(n + 1) for n in electrons])
    # A mean of 0 gives no electrons; its logarithm is never used.
    chance = np.exp(electrons * math.log(mean_e) - mean_e - log_gamma) if mean_e > 0 else (electrons == 0) * 1.0
    limits_e = (counts + 0.5 - sensor.black_count) * sensor.electrons_per_count
    normal = (limits_e[:, None] - electrons) / (sensor.read_noise_e * math.sqrt(2))
    return np.asarray(0.5 * (1 + np.vectorize(math.erf)(normal)) @ chance, np.float64)


def _correlation(values: Doubles) -> float:
    """The largest between pixels up to LAGS apart in a row, one apart in a column, and one frame apart."""
    power = float((values**2).mean())
    pairs = [(values[..., :-lag], values[..., lag:]) for lag in range(1, LAGS + 1)]
    pairs += [(values[:, :-1], values[:, 1:]), (values[:-1], values[1:])]
    return max(abs(float((a * b).mean())) / power for a, b in pairs)
