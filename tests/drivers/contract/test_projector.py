"""What may be shown, and from which camera frame on it counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slopegate.core.rig.patterns import Raster
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.contract.projector import ProjectorError, Showing, check_picture, read_picture
from slopegate.drivers.files.images import save_image

RASTER = Raster(64, 48)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_a_file_is_shown_number_by_number(tmp_path: Path, suffix: str, shape: tuple[int, ...]) -> None:
    picture = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    path = tmp_path / f"picture{suffix}"
    save_image(path, picture)
    assert np.array_equal(read_picture(path, RASTER), picture)


def test_another_size_is_refused_with_both_sizes(tmp_path: Path) -> None:
    path = tmp_path / "big.png"
    save_image(path, np.zeros((768, 1024), np.uint8))
    with pytest.raises(ProjectorError) as caught:
        read_picture(path, RASTER)
    assert str(caught.value) == (
        "big.png has 1024 x 768 pixels and the projector has 64 x 48: patterns are shown pixel by pixel, so the sizes"
        " must be the same"
    )


def test_sixteen_bits_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.png"
    save_image(path, np.zeros((48, 64), np.uint16))
    with pytest.raises(ProjectorError, match=r"deep\.png has uint16 pixels of shape 48 x 64: a projector shows 8-bit"):
        read_picture(path, RASTER)


@pytest.mark.parametrize("name", ["missing.png", "notes.txt", "damaged.png", ""])
def test_what_is_no_picture_is_a_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path / "damaged.png").write_bytes(b"\x89PNG nothing more")
    with pytest.raises(ProjectorError, match=r"is missing|is no picture|cannot be decoded"):
        read_picture(tmp_path / name, RASTER)


def test_two_channels_are_refused() -> None:
    with pytest.raises(ProjectorError, match="Pattern 3 has uint8 pixels of shape 48 x 64 x 2"):
        check_picture(np.zeros((48, 64, 2), np.uint8), RASTER, "Pattern 3")


def test_a_frame_counts_when_its_first_row_began_after_the_pattern_was_certain() -> None:
    showing = Showing(0, drawn_s=10.0, certain_from_s=10.05)
    stamp = FrameStamp(7, 10.10, None, None)
    assert showing.certainly_in(stamp, transfer_us=49_000)
    assert not showing.certainly_in(stamp, transfer_us=51_000)
