"""The plan of an acquisition, beside what the paper took."""

from __future__ import annotations

import pytest

from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.plan import Asked, even_repeats, is_adaptive, plan_transport, slice_frames

RASTER = Raster(1280, 720)
SMALL, USUAL, FINE = (BlockGrid(RASTER, *size) for size in ((4, 2), (32, 32), (512, 512)))


@pytest.mark.parametrize(
    ("codes", "grid", "frames"),
    [
        ("hadamard", USUAL, 1024 + 34),
        ("s", USUAL, 1151 + 34 + 128),
        ("impulse", USUAL, 1024 + 34),
        ("gray", FINE, 38),
        ("gray", USUAL, 22),
        ("adaptive", USUAL, 105),
        ("adaptive", FINE, 2000),
        ("adaptive", SMALL, 8 + 34),
    ],
)
def test_frames_of_a_slice(codes: Asked, grid: BlockGrid, frames: int) -> None:
    assert slice_frames(codes, grid, 1) == frames
    assert slice_frames(codes, grid, 3) == 3 * frames


def test_adaptive_patterns_are_shown_only_where_they_are_fewer() -> None:
    assert is_adaptive("adaptive", USUAL)
    assert not is_adaptive("adaptive", SMALL)
    assert not is_adaptive("hadamard", USUAL)
    assert [even_repeats(codes, USUAL) for codes in ("hadamard", "gray", "adaptive")] == [16, 1, 1]
    assert even_repeats("adaptive", SMALL) == 16


def test_the_plan_adds_up_and_names_what_the_paper_took() -> None:
    plan = plan_transport("hadamard", USUAL, (1200, 1600), 5, 1, 0.05, 0.1)
    assert plan.frames == 32 + 5 * 1058
    assert plan.seconds == pytest.approx(plan.frames * 0.05 + (2 + 5 * (1058 - 30)) * 0.1)
    assert plan.bytes < 6e9
    assert plan.paper_seconds == 900
    assert plan_transport("gray", SMALL, (512, 512), 1, 1, 0.05, 0.0).paper_seconds == 50
    assert plan_transport("gray", FINE, (1200, 1600), 2, 1, 0.05, 0.0).paper_seconds == 14_400
    assert plan_transport("gray", BlockGrid(RASTER, 16, 9), (1200, 1600), 2, 1, 0.05, 0.0).paper_seconds is None


def test_sums_of_many_frames_take_twice_the_disk() -> None:
    few, many = (plan_transport("hadamard", USUAL, (1200, 1600), 1, frames, 0.05, 0.0) for frames in (16, 17))
    kept = few.bytes - 1058 * 1200 * 1600 * 2
    assert many.bytes - kept == 2 * (few.bytes - kept)
