"""The folder of an acquisition: what is written is read back, and what is damaged is refused."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from rigs import FINE_LINES, check_rig
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.noise import FrameNoise
from slopegate.core.transport.sliced import Entries, SliceTransport
from slopegate.drivers.captures.model import Gate
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.transports.model import StageFacts, TransportRecord
from slopegate.drivers.transports.storage import (
    TransportFolder,
    _read_arrays,
    create_transport,
    is_transport,
    make_transport,
    open_transport,
)

RIG = check_rig(8, FINE_LINES)
SHAPE = RIG.camera.lens.height, RIG.camera.lens.width
RASTER = Raster(RIG.projector.lens.width, RIG.projector.lens.height)
INFO = CameraInfo("c", SHAPE[1], SHAPE[0], "mono12", 4095, 40.0, RIG.camera.shutter)
SETTINGS = whole_period(RIG, upright_line_time(RIG))
GATE = Gate.of(SETTINGS)


def folder_in(path: Path, slices: int = 2) -> TransportFolder:
    made = make_transport(
        "s", RIG, INFO, BlockGrid(RASTER, 4, 2), "hadamard", [SETTINGS] * slices, counts_per_unit=900.0
    )
    return create_transport(path, made)


def record_of(index: int, empty: bool = False) -> TransportRecord:
    return TransportRecord(
        index=index, asked=GATE, applied=GATE, empty=empty,
        stages=[StageFacts(name="codes", patterns=8, frames=8, grid=(4, 2))],
        entries=0 if empty else 2, left_out=0.0, unexplained=None, noise_counts=0.0, saturated_share=0.0,
        nonlinear_share=0.0, started="2026-01-01T00:00:00Z", ended="2026-01-01T00:00:01Z", seconds=1.0, lost=0,
        duplicated=0, discarded=0,
    )  # fmt: skip


def transport() -> SliceTransport:
    pixels = SHAPE[0] * SHAPE[1]
    starts = np.full(pixels + 1, 2, np.int64)
    starts[:2] = 0
    fine = Entries(BlockGrid(RASTER, 4, 2), starts, np.array([1, 5], np.int32), np.array([0.5, 0.25], np.float32))
    nothing = np.zeros(0, np.int32), np.zeros(0, np.float32)
    coarse = Entries(BlockGrid(RASTER, 2, 2), np.zeros(pixels + 1, np.int64), *nothing)
    return SliceTransport(np.arange(pixels, dtype=np.float32).reshape(SHAPE), (fine, coarse))


def test_a_slice_is_read_back_to_the_bit(tmp_path: Path) -> None:
    folder, written = folder_in(tmp_path / "t"), transport()
    folder.write_slice(record_of(1), written)
    found = open_transport(tmp_path / "t")
    assert found.missing() == [0]
    assert not found.complete
    assert found.records() == {1: record_of(1)}
    back = found.slice(1)
    np.testing.assert_array_equal(back.total, written.total)
    for got, wanted in zip(back.layers, written.layers, strict=True):
        assert got.grid == wanted.grid
        for name in ("starts", "block", "value"):
            np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))
    with pytest.raises(StorageError, match=r"slice 0 .* has not been taken"):
        found.slice(0)


def test_equal_slices_make_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        folder_in(tmp_path / name).write_slice(record_of(0), transport())
    assert (tmp_path / "a/slice_0000.npz").read_bytes() == (tmp_path / "b/slice_0000.npz").read_bytes()


def test_an_empty_slice_is_taken_and_dark(tmp_path: Path) -> None:
    folder = folder_in(tmp_path / "t", 1)
    folder.write_slice(record_of(0, empty=True), None)
    assert folder.complete
    assert not folder.slice(0).total.any()


def test_even_images_come_back(tmp_path: Path) -> None:
    folder = folder_in(tmp_path / "t")
    assert folder.white() is None
    assert folder.dark() is None
    folder.write_even(np.full(SHAPE, 2, np.float32), np.full(SHAPE, 40, np.float32), FrameNoise(16.0, 0.5))
    white, dark = folder.white(), folder.dark()
    assert white is not None
    assert dark is not None
    assert (white == 2).all()
    assert (dark == 40).all()
    assert folder.noise() == FrameNoise(16.0, 0.5)


@pytest.mark.parametrize("number", [7.0, 0.5, 0.25])
def test_a_damaged_slice_is_refused(tmp_path: Path, number: float) -> None:
    folder = folder_in(tmp_path / "t")
    folder.write_slice(record_of(0), transport())
    path = tmp_path / "t/slice_0000.npz"
    data = bytearray(path.read_bytes())
    data[data.index(np.float32(number).tobytes())] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(StorageError, match=r"slice_0000.npz is (damaged|missing)"):
        folder.slice(0)


def test_entries_that_contradict_themselves_are_refused(tmp_path: Path) -> None:
    folder, good = folder_in(tmp_path / "t"), transport()
    layer = good.layers[0]
    bad = Entries(layer.grid, layer.starts, np.array([1, 8], np.int32), layer.value)
    folder.write_slice(record_of(0), SliceTransport(good.total, (bad,)))
    with pytest.raises(StorageError, match="damaged"):
        folder.slice(0)


def test_it_is_told_apart_from_other_folders(tmp_path: Path) -> None:
    folder_in(tmp_path / "t")
    assert is_transport(tmp_path / "t")
    assert is_transport(tmp_path / "t/transport.json")
    assert not is_transport(tmp_path)
    with pytest.raises(StorageError, match=r"is no light transport: it has no transport.json"):
        open_transport(tmp_path)
    with pytest.raises(StorageError, match="is not empty: an acquisition of light transport needs"):
        folder_in(tmp_path / "t")


def test_another_rig_cannot_go_on_with_it(tmp_path: Path) -> None:
    folder = folder_in(tmp_path / "t")
    folder.require_begun_with(RIG, INFO, RASTER)
    with pytest.raises(StorageError, match="begun with another scene, camera, projector or rig"):
        folder.require_begun_with(check_rig(16, FINE_LINES), INFO, RASTER)
    with pytest.raises(StorageError, match="begun with another"):
        folder.require_begun_with(RIG, INFO, Raster(10, 10))


def test_a_killed_process_leaves_nothing_behind(tmp_path: Path) -> None:
    folder = folder_in(tmp_path / "t")
    folder.write_slice(record_of(0), transport())
    for index in (0, 1):
        folder.raw_path(index).mkdir()
    (tmp_path / "t/.slice_0001.npz.1234.part").write_bytes(b"half")
    folder.clean()
    assert sorted(path.name for path in (tmp_path / "t").iterdir() if path.name != ".lock") == [
        "raw_0000", "slice_0000.json", "slice_0000.npz", "transport.json",
    ]  # fmt: skip


def test_a_small_file_of_arrays_cannot_ask_for_much(tmp_path: Path) -> None:
    bomb, liar = tmp_path / "bomb.npz", tmp_path / "liar.npz"
    np.savez_compressed(bomb, image=np.zeros((4000, 4000), np.float32))
    assert bomb.stat().st_size < 100_000
    with pytest.raises(StorageError, match=r"bomb.npz is damaged: it would unpack to more than it holds"):
        _read_arrays(bomb)
    np.savez(tmp_path / "small.npz", image=np.zeros((3, 4), np.float32))
    with zipfile.ZipFile(tmp_path / "small.npz") as file:
        member = file.read("image.npy")
    with zipfile.ZipFile(liar, "w") as file:
        file.writestr("image.npy", member.replace(b"(3, 4), }           ", b"(3, 999999999999), }"))
    with pytest.raises(StorageError, match=r"liar.npz is damaged or cannot be read"):
        _read_arrays(liar)
    (tmp_path / "none.npz").write_bytes(b"\x93NUMPY no zip")
    with pytest.raises(StorageError, match=r"none.npz is damaged or cannot be read"):
        _read_arrays(tmp_path / "none.npz")
