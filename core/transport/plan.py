"""What an acquisition of light transport will take, before it starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.adaptive import most_patterns
from slopegate.core.transport.codes import CodedPatterns, CodeKind, make_codes
from slopegate.core.transport.gray import gray_patterns
from slopegate.core.transport.noise import FrameNoise, PixelLight, noise_gain

Asked = Literal["hadamard", "s", "impulse", "gray", "adaptive"]
EVEN_REPEATS: Final = 16
"""Times that black, and all on, are shown: once for the whole acquisition, and for every slice that is decoded from
Hadamard codes and the like, whose every entry depends on them."""
PAIR: Final = 2
"""A pattern and its inverse, which tell whether light adds up."""
_PAPER_S: Final = {(4, 2): 50.0, (32, 32): 900.0, (512, 512): 14_400.0}
_ENTRIES: Final = 4
"""That a pixel is taken to keep of a slice that it is lit in."""


@dataclass(frozen=True)
class TransportPlan:
    """What is to be expected."""

    frames: int
    """That are used, at most: dark slices end after black and all on, adaptive codes when all light is explained."""
    seconds: float
    """While frames come; decoding not included."""
    bytes: int
    """On the disk at a time, at most: the raw frames of one slice and the transport of all."""
    noise_gain: float
    """How much less noise one block's light has than if blocks were lit one at a time, in as many frames: a factor.

    Of a pixel at half of the sensor's range that sees one block, as in direct light; of adaptive codes at their best.
    """
    paper_seconds: float | None
    """What the paper took for this grid (4x2 blocks with one gate, 32x32 with five, 512x512); None for other grids."""


def is_adaptive(codes: Asked, grid: BlockGrid) -> bool:
    """Whether adaptive patterns are asked for, and are fewer than full Hadamard codes; else those are shown."""
    return codes == "adaptive" and most_patterns(grid) < _coded("hadamard", grid)


def even_repeats(codes: Asked, grid: BlockGrid) -> int:
    """How often a slice is shown black and all on."""
    return 1 if codes == "gray" or is_adaptive(codes, grid) else EVEN_REPEATS


def slice_frames(codes: Asked, grid: BlockGrid, frames: int) -> int:
    """Frames of a slice, at most. `frames` are summed for each pattern."""
    if codes == "gray":
        return frames * gray_patterns(grid).count
    if codes == "adaptive":
        return frames * (most_patterns(grid) if is_adaptive(codes, grid) else _coded("hadamard", grid))
    return frames * _coded(codes, grid)


def _coded(codes: CodeKind, grid: BlockGrid) -> int:
    return 2 * EVEN_REPEATS + PAIR + make_codes(codes, grid).count


def plan_transport(
    codes: Asked,
    grid: BlockGrid,
    shape: tuple[int, int],
    slices: int,
    frames: int,
    frame_s: float,
    wait_s: float,
    sensor: SensorModel | None = None,
) -> TransportPlan:
    """Of an acquisition with a camera of `shape` (H, W) and so many slices.

    frames: summed for each pattern. frame_s: seconds from frame to frame. wait_s: seconds from showing a pattern until
    a frame can begin that surely sees it. sensor: whose noise is expected; None: a typical one.
    """
    one = slice_frames(codes, grid, frames)
    count = 2 * EVEN_REPEATS * frames + slices * one
    pixels = shape[0] * shape[1]
    patterns = one // frames
    raw = pixels * patterns * (2 if frames <= 16 else 4)
    kept = slices * pixels * (12 + 8 * _ENTRIES)
    shown = 2 + slices * (patterns - 2 * (even_repeats(codes, grid) - 1))
    seconds = count * frame_s + shown * wait_s
    gain = _gain(codes, grid, sensor or SensorModel())
    return TransportPlan(count, seconds, raw + kept, gain, _PAPER_S.get((grid.columns, grid.rows)))


def _gain(codes: Asked, grid: BlockGrid, sensor: SensorModel) -> float:
    """See `TransportPlan.noise_gain`."""
    half = (sensor.max_count - sensor.black_count) / 2
    asked: CodedPatterns
    if codes == "gray" or is_adaptive(codes, grid):
        asked = gray_patterns(grid)
    else:
        asked = make_codes("hadamard" if codes == "adaptive" else codes, grid)
    return noise_gain(asked, "column", PixelLight(half, half), FrameNoise.of(sensor))
