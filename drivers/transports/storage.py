"""Light transport on disk: a folder with a manifest and two files per slice, which is there whole or not at all.

    transport.json           the manifest; written first, never changed
    white.npz, dark.npz      one image each: all on, and projector black, through a gate of one period
    slice_0000.npz           the transport of one slice
    slice_0000.json          its record, written last: a slice without it has not been taken
    raw_0000                 Zarr 3: the frames of the slice under way, or kept on request
    .lock                    empty; locked by the process that acquires here

Every file is written whole or not at all (`files.durable`): killing the process at any moment loses the slice in
flight and no other. Equal transports make equal files to the byte.
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from os.path import isfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.noise import FrameNoise
from slopegate.core.transport.sliced import Entries, SliceTransport
from slopegate.drivers.captures.model import CameraFacts, Gate
from slopegate.drivers.captures.storage import (
    begin_folder,
    check_new_folder,
    read_manifest,
    rig_of,
    software,
)
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.files.durable import StorageError, remove_parts, replacing, write_durably
from slopegate.drivers.files.npy_headers import promised
from slopegate.drivers.files.reading import decoding
from slopegate.drivers.files.rig_files import rig_to_toml
from slopegate.drivers.transports.model import TRANSPORT_VERSION, CodeName, TransportManifest, TransportRecord

TRANSPORT: Final = "transport.json"
WHITE: Final = "white.npz"
BLACK: Final = "dark.npz"
_WHAT: Final = "an acquisition of light transport"


def is_transport(path: Path) -> bool:
    """Whether this is the folder of an acquisition of light transport, or its manifest."""
    return isfile(path / TRANSPORT) or (path.name == TRANSPORT and isfile(path))


class TransportFolder:
    """One acquisition. Every call looks into the folder anew, so it can be read while it is being filled."""

    def __init__(self, path: Path, manifest: TransportManifest, rig: Rig) -> None:
        """Use `create_transport` or `open_transport`."""
        self.path, self.manifest, self.rig = path, manifest, rig

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of every image."""
        return self.manifest.camera.height, self.manifest.camera.width

    @property
    def grid(self) -> BlockGrid:
        """The blocks that were asked for."""
        return BlockGrid(Raster(*self.manifest.raster), *self.manifest.grid)

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return not self.missing()

    def record(self, index: int) -> TransportRecord | None:
        """The record of a slice; None while it has not been taken, or when it cannot be read."""
        try:
            return TransportRecord.model_validate_json(self._record_path(index).read_bytes())
        except (OSError, ValidationError):
            return None

    def records(self) -> dict[int, TransportRecord]:
        """The slices taken so far, by rising index."""
        found = ((index, self.record(index)) for index in range(len(self.manifest.slices)))
        return {index: record for index, record in found if record is not None}

    def missing(self) -> list[int]:
        """Indices of the slices that have not been taken."""
        taken = self.records()
        return [index for index in range(len(self.manifest.slices)) if index not in taken]

    def slice(self, index: int) -> SliceTransport:
        """The transport of a slice; of an empty one, no light. Raises StorageError for a missing or damaged one."""
        record = self.record(index)
        if record is None:
            raise StorageError(f"slice {index} of {self.path} has not been taken")
        if record.empty:
            return SliceTransport(np.zeros(self.shape, np.float32), ())
        path = self._slice_path(index)
        arrays = _read_arrays(path)
        with decoding(StorageError(f"{path} is damaged: it does not hold a slice's transport")):
            layers: list[Entries] = []
            while f"grid_{len(layers)}" in arrays:
                columns, rows = (int(value) for value in arrays[f"grid_{len(layers)}"])
                grid = BlockGrid(Raster(*self.manifest.raster), columns, rows)
                names = (f"{name}_{len(layers)}" for name in ("starts", "block", "value"))
                layers.append(_checked(Entries(grid, *(arrays[name] for name in names)), self.shape))
            return SliceTransport(self._image(arrays["total"]), tuple(layers))

    def white(self) -> Singles | None:
        """All on through a gate of one period, ambient light taken off, (H, W) float32 in the unit of slices.

        Of a camera without a gate, as it sees it. None while it has not been taken.
        """
        return self._plain(WHITE)

    def dark(self) -> Singles | None:
        """Mean counts (H, W) float32 with the projector black, as `white` does; None: not taken."""
        return self._plain(BLACK)

    def unfinished(self) -> str:
        """One sentence about the slices that are missing; empty when none is."""
        missing, total = len(self.missing()), len(self.manifest.slices)
        return f"{self.path.name} is unfinished: {missing} of {total} slices are missing" if missing else ""

    def require_begun_with(self, rig: Rig, info: CameraInfo, raster: Raster) -> None:
        """Raise StorageError unless this rig, camera and projector began it, so that what they take fits."""
        manifest = self.manifest
        if (
            self.rig != rig
            or manifest.camera != CameraFacts.of(info)
            or manifest.raster
            != (
                raster.width,
                raster.height,
            )
        ):
            raise StorageError(
                f"{self.path} was begun with another scene, camera, projector or rig ({manifest.scene}, "
                f"{manifest.camera.pixel_format}): it cannot be resumed with this"
            )

    def clean(self) -> None:
        """Remove what a killed process left unfinished. Only for the holder of the `claim`."""
        remove_parts(self.path, alone=True)
        for index in self.missing():
            self.drop_raw(index)

    def raw_path(self, index: int) -> Path:
        """The folder of a slice's frames."""
        return self.path / f"raw_{index:04d}"

    def drop_raw(self, index: int) -> None:
        """Remove a slice's frames. Harmless when there are none."""
        shutil.rmtree(self.raw_path(index), ignore_errors=True)

    def write_slice(self, record: TransportRecord, transport: SliceTransport | None) -> None:
        """Write a slice; None for an empty one. Raises StorageError."""
        if transport is not None:
            arrays: dict[str, NDArray[Any]] = {"total": transport.total}
            for place, layer in enumerate(transport.layers):
                arrays[f"grid_{place}"] = np.array([layer.grid.columns, layer.grid.rows], np.int32)
                for name in ("starts", "block", "value"):
                    arrays[f"{name}_{place}"] = getattr(layer, name)
            _write_arrays(self._slice_path(record.index), arrays)
        write_durably(self._record_path(record.index), record.model_dump_json(indent=1).encode())

    def write_even(self, white: Singles, dark: Singles, noise: FrameNoise) -> None:
        """Write the images of all on, as `white` gives it, and of black, with the noise. Raises StorageError."""
        _write_arrays(self.path / BLACK, {"image": dark})
        variances = np.array([noise.read_variance, noise.variance_per_count])
        _write_arrays(self.path / WHITE, {"image": white, "noise": variances})

    def noise(self) -> FrameNoise | None:
        """Of a single frame, as the acquisition's first frames showed it; None while they have not been taken."""
        path = self.path / WHITE
        if not isfile(path):
            return None
        arrays = _read_arrays(path)
        with decoding(StorageError(f"{path} is damaged: it does not hold the noise")):
            read, per_count = (float(value) for value in arrays["noise"])
            return FrameNoise(read, per_count)

    def _plain(self, name: str) -> Singles | None:
        path = self.path / name
        if not isfile(path):
            return None
        arrays = _read_arrays(path)
        with decoding(StorageError(f"{path} is damaged: it does not hold an image")):
            return self._image(arrays["image"])

    def _image(self, image: NDArray[Any]) -> Singles:
        if image.shape != self.shape or image.dtype != np.float32:
            raise ValueError(f"an image of {image.shape} {image.dtype}")
        return image

    def _slice_path(self, index: int) -> Path:
        return self.path / f"slice_{index:04d}.npz"

    def _record_path(self, index: int) -> Path:
        return self.path / f"slice_{index:04d}.json"


def make_transport(
    scene: str,
    rig: Rig,
    info: CameraInfo,
    grid: BlockGrid,
    codes: CodeName,
    gates: Sequence[GateSettings | None],
    *,
    frames: int = 1,
    settle_frames: int = 0,
    counts_per_unit: float | None = None,
    seed: int | None = None,
    parts: Sequence[str] = (),
) -> TransportManifest:
    """The manifest of a new acquisition; its fields say what they mean."""
    return TransportManifest(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        software=software(),
        scene=scene,
        rig_toml=rig_to_toml(rig),
        camera=CameraFacts.of(info),
        raster=(grid.raster.width, grid.raster.height),
        grid=(grid.columns, grid.rows),
        codes=codes,
        frames=frames,
        settle_frames=settle_frames,
        slices=[None if gate is None else Gate.of(gate) for gate in gates],
        counts_per_unit=counts_per_unit,
        seed=seed,
        parts=list(parts),
    )


def create_transport(path: Path, manifest: TransportManifest) -> TransportFolder:
    """Make the folder of a new acquisition. Raises StorageError where it cannot be made or holds something already."""
    rig = rig_of(path, manifest.rig_toml, manifest.camera)
    begin_folder(path, TRANSPORT, manifest, _WHAT)
    return TransportFolder(path, manifest, rig)


def check_new_transport(path: Path) -> None:
    """Raise StorageError now for a folder that a new acquisition cannot have, before any work is done for it."""
    check_new_folder(path, _WHAT)


def open_transport(path: Path) -> TransportFolder:
    """The acquisition in a folder (or of a manifest file). Raises StorageError; missing slices are no error."""
    folder = path.parent if path.name == TRANSPORT else path
    manifest = read_manifest(folder, TRANSPORT, TransportManifest, TRANSPORT_VERSION, "light transport")
    return TransportFolder(folder, manifest, rig_of(folder / TRANSPORT, manifest.rig_toml, manifest.camera))


def _checked(entries: Entries, shape: tuple[int, int]) -> Entries:
    """The entries, or ValueError where they contradict themselves."""
    starts, block, value = entries.starts, entries.block, entries.value
    if [item.dtype.str for item in (starts, block, value)] != ["<i8", "<i4", "<f4"]:
        raise ValueError("numbers of another type")
    if starts.shape != (shape[0] * shape[1] + 1,) or block.shape != value.shape or block.ndim != 1:
        raise ValueError("arrays that do not fit each other")
    if starts[0] != 0 or starts[-1] != block.size or (np.diff(starts) < 0).any():
        raise ValueError("pixels out of order")
    if block.size and not 0 <= block.min() <= block.max() < entries.grid.count:
        raise ValueError("blocks that the grid does not have")
    return entries


def _write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """An .npz file without compression and without times, so that equal arrays make equal files."""
    with replacing(path) as part, zipfile.ZipFile(part, "x") as file:
        for name, array in arrays.items():
            with file.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.ascontiguousarray(array), allow_pickle=False)


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of an .npz file, against their check sums. Raises StorageError."""
    if not isfile(path):
        raise StorageError(f"{path} is missing")
    with decoding(StorageError(f"{path} is damaged or cannot be read")), zipfile.ZipFile(path) as file:
        members = file.infolist()
        if sum(member.file_size for member in members) > path.stat().st_size:  # as written they are not compressed
            raise StorageError(f"{path} is damaged: it would unpack to more than it holds")
        return {member.filename.removesuffix(".npy"): _member(file, member) for member in members}


def _member(file: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of an .npz file, if it is as large as its header promises: room is made for it at once."""
    with file.open(member) as stream:
        _, size_bytes = promised(stream)
        if size_bytes > member.file_size:
            raise ValueError("a header that promises too much")
    with file.open(member) as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
