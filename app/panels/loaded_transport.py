"""The light transport that is open in the window, with all of its slices in memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from slopegate.app.session.describe import number
from slopegate.app.session.loading import Loader, Progress
from slopegate.app.transports import OpenTransport, open_transport
from slopegate.core.gating.gate import slab_if_any
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.sliced import SliceTransport
from slopegate.drivers.contract.frame import filters
from slopegate.drivers.files.durable import StorageError


@dataclass(frozen=True, eq=False)
class LoadedTransport:
    """What panels need of the transport that is open. Slices that have not been acquired yet are dark."""

    opened: OpenTransport
    names: tuple[str, ...]
    """What each slice is called: its number from 1, and where it lies."""

    @property
    def slices(self) -> tuple[SliceTransport, ...]:
        """In the order of acquisition."""
        return self.opened.slices

    @property
    def raster(self) -> Raster:
        """The projector's pixels."""
        return self.opened.folder.grid.raster

    @property
    def mosaic(self) -> str:
        """Colour filters of the camera's first two rows and columns, such as RGGB; empty for a grey one."""
        return filters(self.opened.folder.manifest.camera.pixel_format)


class Transports(QObject):
    """Reads folders of light transport, one at a time, and keeps the last one."""

    opened = Signal()
    """`loaded` is another one."""
    said = Signal(str)
    """What is being read, or why it cannot be, in one sentence."""
    failed = Signal(str)
    """The latter alone, for those who see no panel."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.loaded: LoadedTransport | None = None
        self._loader: Loader[LoadedTransport] = Loader(lambda _: None, self)
        self._loader.progressed.connect(lambda share, text: self.said.emit(text))
        self._loader.finished.connect(self._on_loaded)
        self._loader.failed.connect(self.said)
        self._loader.failed.connect(self.failed)

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
    """Read all that is in a folder. Raises StorageError where no slice is."""
    opened = open_transport(path)
    if len(opened.missing) == len(opened.gates):
        raise StorageError(f"{path} has no finished slice yet: resume its acquisition")
    progress.step(0.0, f"Reading {path.name} ...")
    names = tuple(slice_name(opened.rig, place, gate) for place, gate in enumerate(opened.gates))
    loaded = LoadedTransport(opened, names)
    assert loaded.slices  # reads them, here and not in the window's thread
    return loaded


def slice_name(rig: Rig, place: int, settings: GateSettings | None) -> str:
    """A slice's number from 1, and its distance where it has one."""
    slab = None if settings is None else slab_if_any(rig, settings).slab
    where = "" if slab is None or slab.distance_m is None else f" at {number(slab.distance_m)} m"
    return f"Slice {place + 1}{where}"
