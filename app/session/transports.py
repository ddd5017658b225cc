"""Light transport in memory: the slices of a folder that are there, ready to be looked at and relit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from slopegate.app.session.describe import number
from slopegate.app.session.loading import Loader, Progress
from slopegate.core.gating.gate import slab_if_any
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.sliced import SliceTransport
from slopegate.drivers.captures.model import Gate
from slopegate.drivers.contract.frame import filters
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.transports.model import TransportManifest
from slopegate.drivers.transports.storage import TransportFolder, open_transport


@dataclass(frozen=True, eq=False)
class LoadedTransport:
    """The finished slices of one folder, all in memory."""

    folder: TransportFolder
    names: tuple[str, ...]
    """What each slice is called: its number in the folder and where it lies."""
    gates: tuple[GateSettings | None, ...]
    slices: tuple[SliceTransport, ...]
    white: Singles | None
    """What the camera saw with the projector fully lit and a gate of a whole period (H, W), in the unit of the slices;
    None where that was not captured."""

    @property
    def manifest(self) -> TransportManifest:
        """What the folder is to contain."""
        return self.folder.manifest

    @property
    def grid(self) -> BlockGrid:
        """The blocks that were asked for."""
        return self.folder.grid

    @property
    def raster(self) -> Raster:
        """The projector's pixels."""
        return self.grid.raster

    @property
    def mosaic(self) -> str:
        """Colour filters of the camera's first two rows and columns, such as RGGB; empty for a grey one."""
        return filters(self.manifest.camera.pixel_format)


class Transports(QObject):
    """Reads folders of light transport, one at a time, and keeps the last one."""

    opened = Signal()
    """`loaded` is another one."""
    said = Signal(str)
    """What is being read, or why it cannot be, in one sentence."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.loaded: LoadedTransport | None = None
        self._loader: Loader[LoadedTransport] = Loader(lambda _: None, self)
        self._loader.progressed.connect(lambda share, text: self.said.emit(text))
        self._loader.finished.connect(self._on_loaded)
        self._loader.failed.connect(self.said)

    def read(self, path: Path) -> None:
        """Open this folder."""
        self._loader.start(lambda progress: load_transport(path, progress))

    def close(self) -> None:
        """Stop what is being read."""
        self._loader.close()

    def _on_loaded(self, loaded: LoadedTransport) -> None:
        self.loaded = loaded
        self.opened.emit()


def load_transport(path: Path, progress: Progress) -> LoadedTransport:
    """Read all slices of a folder that are finished. Raises StorageError where there is none."""
    folder = open_transport(path)
    done = sorted(folder.records())
    if not done:
        raise StorageError(f"{path} has no finished slice yet: resume its acquisition")
    slices = []
    for place, index in enumerate(done):
        progress.step(place / len(done), f"Reading slice {index + 1} of {path.name} ...")
        slices.append(folder.slice(index))
    gates = tuple(_settings(folder.manifest.slices[index]) for index in done)
    names = tuple(slice_name(folder.rig, index, gate) for index, gate in zip(done, gates, strict=True))
    return LoadedTransport(folder, names, gates, tuple(slices), folder.white())


def slice_name(rig: Rig, index: int, settings: GateSettings | None) -> str:
    """A slice's number from 1, and its distance where it has one."""
    slab = None if settings is None else slab_if_any(rig, settings).slab
    where = "" if slab is None or slab.distance_m is None else f" at {number(slab.distance_m)} m"
    return f"Slice {index + 1}{where}"


def _settings(gate: Gate | None) -> GateSettings | None:
    return None if gate is None else gate.settings()
