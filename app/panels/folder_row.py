"""The folder that something is recorded into: named after the scene and the time, or by hand."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from os.path import isdir
from pathlib import Path
from typing import Final, Protocol, TypeVar

from PySide6.QtCore import QStandardPaths, Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLineEdit, QPushButton, QWidget

from slopegate.app.session.snapshot import suggested_name
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.durable import StorageError

FREE_S: Final = 2.0
"""How long the answer of a disk to how much it still takes is used: a disk of the network may take its time."""


class SliceFolder(Protocol):
    """A folder that slices are recorded into."""

    def missing(self) -> Sequence[int]:
        """Those that have not been taken."""


Unfinished = TypeVar("Unfinished", bound=SliceFolder)


class FolderRow(QWidget):
    """A line to type a folder into, and a button to choose one."""

    changed = Signal()

    def __init__(
        self,
        what: str,
        hint: str,
        ending: str = "",
        parent: QWidget | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`what` is recorded, such as "the capture"; `ending` is put to names that are suggested."""
        super().__init__(parent)
        self._clock = clock
        self._free: tuple[Path, float, int | None] | None = None
        """What was asked last: the folder, when, and what its disk still takes."""
        self._what, self._ending = what, ending
        self._by_hand = False
        self._chosen_parent: Path | None = None  # the next one goes beside the one named by hand
        self.where, self.browse = QLineEdit(), QPushButton("Folder …")
        self.where.setAccessibleName(f"Folder of {what}")
        self.where.setToolTip(hint)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.browse)
        row.addWidget(self.where, 1)
        self.where.textEdited.connect(self._on_named)
        self.where.textChanged.connect(self.changed)
        self.browse.clicked.connect(self._ask)

    @property
    def named(self) -> bool:
        """Whether any folder is named."""
        return bool(self.where.text().strip())

    @property
    def path(self) -> Path:
        """The folder. A bare name lies beside those that are suggested, wherever the program was started."""
        return self._parent / Path(self.where.text().strip()).expanduser()

    @property
    def _parent(self) -> Path:
        pictures = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.PicturesLocation)
        return self._chosen_parent or Path(pictures) / "slopegate"

    @property
    def free_bytes(self) -> int | None:
        """What the folder's disk still takes, as of `FREE_S` ago at most; None where that cannot be told."""
        folder, now_s = self.path, self._clock()
        if self._free is None or self._free[0] != folder or now_s - self._free[1] >= FREE_S:
            self._free = folder, now_s, self._ask_disk(folder)
        return self._free[2]

    @staticmethod
    def _ask_disk(folder: Path) -> int | None:
        existing = next((path for path in (folder, *folder.parents) if isdir(path)), None)
        try:
            return None if existing is None else shutil.disk_usage(existing).free
        except OSError:
            return None

    def unfinished(self, is_one: Callable[[Path], bool], read: Callable[[Path], Unfinished]) -> Unfinished | None:
        """What the folder named holds, if it is of this kind and lacks slices; None if it cannot be read, too."""
        if not self.named or not is_one(self.path):
            return None
        try:
            found = read(self.path)
        except StorageError:
            return None
        return found if found.missing() else None

    def suggest(self, scene: Scene) -> None:
        """Name a new folder after the scene and the time, unless one was named by hand."""
        if self._by_hand:
            return
        self.where.setText(str(self._parent / f"{Path(suggested_name(scene, datetime.now())).stem}{self._ending}"))

    def used(self) -> None:
        """The folder is full now: another one may be suggested, beside it if it was named by hand."""
        if self._by_hand:
            self._by_hand, self._chosen_parent = False, self.path.parent

    def _on_named(self) -> None:
        self._by_hand = True

    def _ask(self) -> None:
        name = QFileDialog.getExistingDirectory(self, f"A new folder for {self._what}, or an unfinished one")
        if name:
            self._by_hand = True
            self.where.setText(name)
