"""Frames, time, memory and error of every way to acquire light transport, and noise by codes against theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, get_args

from slopegate.app.bench.report import number
from slopegate.app.bench.run import Say
from slopegate.app.bench.session import describe_machine
from slopegate.app.bench.transport_noise import GainRow, gains
from slopegate.app.bench.transport_truth import impulse_light, make_case, shown
from slopegate.app.bench.transport_ways import Acquired, acquire
from slopegate.app.session.aligned import aligned
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.variants import binned_rig
from slopegate.core.scene.scene import Scene
from slopegate.core.transport.codes import CodeKind
from slopegate.drivers.transports.model import CodeName

TRANSPORT_SCENES: Final = ("three_targets", "foggy_room")
"""Measured where no scene is named: one of matt surfaces alone, and one with all that fog adds. A quick run takes the
first."""
FULL_CODES: Final = "hadamard"
"""What frames and error of the other ways are compared with."""
GAIN_CODES: Final[tuple[CodeKind, ...]] = ("hadamard", "s")
GAIN_GRID: Final = 8, 8
SEED: Final = 5
WARM_BINNING: Final = 25


@dataclass(frozen=True)
class TransportSize:
    """How much a run does. binning: camera pixels taken together each way; blocks: columns and rows of the grid;
    slices; patterns: random ones that are relit; draws: of the noise of every pixel."""

    binning: int
    blocks: tuple[int, int]
    slices: int
    patterns: int
    draws: int


FULL: Final = TransportSize(5, (32, 32), 2, 20, 4)
QUICK: Final = TransportSize(10, (16, 16), 2, 5, 8)


@dataclass(frozen=True)
class TransportRow:
    """One way to acquire one scene.

    frames: used, of all slices; wall_s and core_s: with decoding. relit_db: mean PSNR of random patterns, relit,
    against the camera's frames of them, without noise; worst_db: the least; noisy_db: the mean of one with noise.
    peak_mb: memory beyond what the scene takes; kept_mb: of the transport; left_out: share of its energy that is not
    kept, in the worst slice.
    """

    scene: str
    codes: str
    grid: str
    width: int
    height: int
    slices: int
    frames: int
    wall_s: float
    core_s: float
    relit_db: float
    worst_db: float
    noisy_db: float
    peak_mb: float
    kept_mb: float
    left_out: float


@dataclass(frozen=True)
class SceneGains:
    """Noise by codes on one scene's light."""

    scene: str
    rows: list[GainRow]


@dataclass(frozen=True)
class TransportBench:
    """All figures of a run."""

    machine: dict[str, Any]
    rows: list[TransportRow]
    gains: list[SceneGains]


def run_transport(scenes: Sequence[tuple[str, Rig, Scene]], extent: TransportSize, say: Say) -> TransportBench:
    """Acquire these scenes, each with a name and a rig, in every way."""
    rows, found = [], []
    _warm_up(scenes[0])
    for name, rig, scene in scenes:
        case = make_case(name, binned_rig(rig, extent.binning), scene, extent.blocks, extent.slices, extent.patterns)
        say(f"{name}: what the camera sees of {extent.patterns} random patterns")
        truth = shown(case, case.pictures)
        for codes in get_args(CodeName):
            say(f"{name}: {codes}, without noise")
            clean = acquire(case, codes, truth, None)
            say(f"{name}: {codes}, with noise")
            rows.append(
                _row(case.name, codes, str(case.grid), truth.lit.shape, clean, acquire(case, codes, truth, SEED))
            )
        say(f"{name}: noise by codes")
        grid = BlockGrid(case.grid.raster, *GAIN_GRID)
        found.append(SceneGains(name, gains(impulse_light(case, grid), grid, GAIN_CODES, extent.draws, SEED)))
    return TransportBench(describe_machine(), rows, found)


def _warm_up(one: tuple[str, Rig, Scene]) -> None:
    """Compile what acquiring and decoding need."""
    name, rig, scene = one
    case = make_case(name, binned_rig(rig, WARM_BINNING), scene, (8, 4), 1, 1)
    truth = shown(case, case.pictures)
    for codes in get_args(CodeName):
        acquire(case, codes, truth, None)


def _row(name: str, codes: str, grid: str, shape: tuple[int, ...], clean: Acquired, noisy: Acquired) -> TransportRow:
    slices, height, width = shape
    return TransportRow(
        name,
        codes,
        grid,
        width,
        height,
        slices,
        clean.frames,
        clean.wall_s,
        clean.core_s,
        _mean(clean.relit_db),
        min(clean.relit_db),
        _mean(noisy.relit_db),
        max(clean.peak_mb, noisy.peak_mb),
        clean.kept_mb,
        clean.left_out,
    )


def _mean(values: tuple[float, ...]) -> float:
    return sum(values) / len(values)


HEADINGS = (
    "codes", "frames", "of full", "wall s", "core s", "relit dB", "worst", "with noise", "peak MB", "kept MB",
    "left out, %",
)  # fmt: skip
GAIN_HEADINGS = (
    "codes, noise",
    *(f"{use}, {what}" for use in ("column", "floodlit", "relit") for what in ("theory", "drawn")),
)
LEGEND = (
    "frames: of all slices; of full: as a share of those of Hadamard codes; s: with decoding.",
    "relit: PSNR of random patterns of blocks, relit, against the camera's frames of them, mean and worst without"
    " noise, and the mean of an acquisition with noise.",
    "peak: memory beyond the scene's own; kept: the transport's; left out: share of its energy, in the worst slice.",
    "noise: signal to noise over that of impulses in as many frames, for one block, the fully lit image and a random"
    " half of the blocks; read: where the camera's own noise rules; shot: where the light's does.",
)


def as_text(bench: TransportBench) -> str:
    """All figures in aligned columns, two tables a scene."""
    found = bench.machine
    parts = [f"{found['processor']}, {found['cores']} cores, {found['system']}, numpy {found['numpy']}"]
    for scene in bench.gains:
        rows = [row for row in bench.rows if row.scene == scene.scene]
        full = next(row.frames for row in rows if row.codes == FULL_CODES)
        one = rows[0]
        parts.append(f"{scene.scene}: {one.width} x {one.height} pixels, {one.slices} slices, {one.grid} blocks")
        parts += [
            aligned(HEADINGS, [_cells(row, full) for row in rows]),
            aligned(GAIN_HEADINGS, _gain_cells(scene.rows)),
        ]
    return "\n\n".join([*parts, "\n".join(LEGEND)])


def _cells(row: TransportRow, full: int) -> list[str]:
    figures = (row.wall_s, row.core_s, row.relit_db, row.worst_db, row.noisy_db, row.peak_mb, row.kept_mb)
    share = number(row.frames / full)
    return [row.codes, number(float(row.frames)), share, *map(number, figures), number(100 * row.left_out)]


def _gain_cells(rows: list[GainRow]) -> list[list[str]]:
    lines: dict[str, list[str]] = {}
    for row in rows:
        lines.setdefault(f"{row.codes}, {row.regime}", []).extend([number(row.theory), number(row.measured)])
    return [[name, *cells] for name, cells in lines.items()]
