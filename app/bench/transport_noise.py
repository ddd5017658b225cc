"""Noise of light transport by codes, measured by drawing frames: what each kind gains over one block at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, get_args

import numpy as np

from slopegate.core.rig.arrays import Bools, Doubles, Indices
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.codes import CodeKind, Codes, make_codes
from slopegate.core.transport.decode import decode
from slopegate.core.transport.noise import FrameNoise, PixelLight, Use, noise_gain

REGIMES: Final = {"read": FrameNoise(900.0, 0.0), "shot": FrameNoise(0.0, 1.0)}
"""Noise of a frame in electrons: where the camera's own rules, and where that of the light itself does."""
HALVES: Final = 8
"""Random halves of the blocks, and as many that are the rest of them."""
USES: Final[tuple[Use, ...]] = get_args(Use)


@dataclass(frozen=True)
class GainRow:
    """Signal to noise by codes over that by impulses, in as many frames of one exposure: as derived, and as drawn.

    use: what is made of the transport; regime: which noise rules.
    """

    codes: str
    use: str
    regime: str
    theory: float
    measured: float


def gains(light: Doubles, grid: BlockGrid, kinds: Sequence[CodeKind], draws: int, seed: int) -> list[GainRow]:
    """Of pixels with this light of each block of a grid, (blocks, P) in electrons; each drawn P x draws times."""
    column = 1 + light[1:].argmax(axis=0)  # block 0 may have the noise of a whole frame
    half = np.random.default_rng(seed).integers(0, 2, (HALVES, grid.count)) > 0
    halves = np.concatenate([half, ~half])
    means = PixelLight(float(light.sum(axis=0).mean()), float(light[column, np.arange(light.shape[1])].mean()))
    dots, rows = make_codes("impulse", grid), []
    for regime, noise in REGIMES.items():
        plain = _spreads(dots, light, noise, column, halves, draws, seed)
        for kind in kinds:
            codes = make_codes(kind, grid)
            found = _spreads(codes, light, noise, column, halves, draws, seed + 1)
            for use in USES:
                measured = math.sqrt(plain[use] * grid.count / codes.count / found[use])
                rows.append(GainRow(kind, use, regime, noise_gain(codes, use, means, noise), measured))
    return rows


def _spreads(
    codes: Codes, light: Doubles, noise: FrameNoise, column: Indices, halves: Bools, draws: int, seed: int
) -> dict[Use, float]:
    """Variance, electrons^2, of what is made of decoded light, mean over pixels and draws."""
    patterns = np.stack([codes.values(number).ravel() for number in range(codes.count)]).astype(np.float64)
    rng, exact = np.random.default_rng(seed), patterns @ light
    pixels, sums = np.arange(light.shape[1]), dict.fromkeys(USES, 0.0)
    for _ in range(draws):
        frames = rng.poisson(exact).astype(np.float64) if noise.variance_per_count else exact.copy()
        frames += rng.normal(0.0, math.sqrt(noise.read_variance), frames.shape)
        error = decode(codes, np.ascontiguousarray(frames, np.float32)) - light
        one, whole, relit = error[column, pixels], error.sum(axis=0), halves @ error
        for use, values in zip(USES, (one, whole, relit), strict=True):
            sums[use] += float((values.astype(np.float64) ** 2).mean()) / draws
    return sums
