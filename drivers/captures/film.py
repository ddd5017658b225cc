"""Recordings at one gate on disk: a folder with a manifest and the frames as stacks of TIFF pages.

    recording.json        the manifest: rig, camera and gate; written first, never changed
    frames_0000.tif ...   the raw counts, one page a frame, at most 2 GB each; 8 bits where the counts fit, else 16
    ended.json            how many frames there are and were lost, and why it ended; missing if the process was killed
    preview.mp4           to look at: at most 640 pixels wide, brightened; or preview.webp; or none
    .lock                 empty; locked by the process that records here

Each page holds its frame's record as JSON in its description, the first page of every file the manifest, too. A page is
there whole or not at all (`tiff_stack`), and the frames are the pages: there is no list that could disagree with them.
TIFF was chosen over Zarr because a frame can be added by one short write behind the last one, whatever stops the
program, and because nearly every program opens it.
"""

from __future__ import annotations

import json
import re
from contextlib import suppress
from datetime import UTC, datetime
from os.path import isfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.cameras.video import RECORDING
from slopegate.drivers.captures.model import CameraFacts, FilmEnd, FilmFrame, FilmManifest, Gate
from slopegate.drivers.captures.storage import (
    LOCK,
    begin_folder,
    check_new_folder,
    claim,
    read_manifest,
    rig_of,
    software,
)
from slopegate.drivers.captures.tiff_stack import Page, TiffStack, damaged, pages_of
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.files.durable import StorageError, reason
from slopegate.drivers.files.rig_files import rig_to_toml

MANIFEST: Final = RECORDING
END: Final = "ended.json"
PREVIEWS: Final = ("preview.mp4", "preview.webp")
LAPSE_HZ: Final = 20.0
"""Frames a second at which a time lapse, or a single frame, is shown."""
_OWN: Final = re.compile(r"recording\.json|ended\.json|preview\.(mp4|webp)|frames_\d+\.tif|\.lock|\..*\.part")


def is_film(path: Path) -> bool:
    """Whether this is the folder of a recording at one gate, or its manifest."""
    return isfile(path / MANIFEST) or (path.name == MANIFEST and isfile(path))


class FilmFolder:
    """One recording. Frames are counted when it is opened; `look_again` counts anew."""

    def __init__(self, path: Path, manifest: FilmManifest, rig: Rig) -> None:
        """Use `create_film` or `open_film`."""
        self.path, self.manifest, self.rig = path, manifest, rig
        self._pages: list[Page] = []
        self.look_again()

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of every frame."""
        return self.manifest.camera.height, self.manifest.camera.width

    @property
    def dtype(self) -> type[np.uint8] | type[np.uint16]:
        """Of the pixels on the disk."""
        return np.uint8 if self.manifest.camera.max_count <= np.iinfo(np.uint8).max else np.uint16

    @property
    def files(self) -> list[Path]:
        """The files with frames, in order."""
        return sorted(self.path.glob("frames_*.tif"))

    def file(self, number: int) -> Path:
        """The file of this number, whether or not it is there."""
        return self.path / f"frames_{number:04d}.tif"

    def __len__(self) -> int:
        """How many frames there are."""
        return len(self._pages)

    def look_again(self) -> None:
        """Count the frames that are on the disk now. Raises StorageError for a file that is damaged."""
        self._pages = [page for path in self.files for page in pages_of(path)]

    def frame(self, number: int, into: Counts | None = None) -> Counts:
        """The counts (H, W) uint16 of a frame, from 0. Raises StorageError."""
        page = self._page(number)
        if page.shape != self.shape or page.bits != 8 * np.dtype(self.dtype).itemsize:  # before anything is read
            raise damaged(page.path)
        image = np.empty(self.shape, np.uint16) if into is None else into
        image[:] = page.pixels()
        return image

    def record(self, number: int) -> FilmFrame:
        """Everything about a frame but its pixels. Raises StorageError."""
        page = self._page(number)
        try:
            return FilmFrame.model_validate(json.loads(page.text())["record"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise damaged(page.path) from None

    @property
    def rate_hz(self) -> float:
        """Frames a second to show it at: as they came, or `LAPSE_HZ` of a time lapse. Raises StorageError."""
        count = len(self)
        if count < 2 or self.manifest.every_s is not None:
            return LAPSE_HZ
        seconds = self.record(count - 1).time_s - self.record(0).time_s
        return min(max((count - 1) / seconds, 0.1), 1000.0) if seconds > 0 else LAPSE_HZ

    @property
    def end(self) -> FilmEnd | None:
        """How it ended; None while it is being recorded, and where the process was killed."""
        path = self.path / END
        if not isfile(path):
            return None
        return read_manifest(self.path, END, FilmEnd, 1, "recording")

    def counted(self) -> FilmEnd:
        """How it ended; of a recording that was cut short, what its frames tell. Raises StorageError."""
        found = self.end
        if found is not None:
            return found
        records = [self.record(number) for number in range(len(self))]
        seconds = records[-1].time_s - records[0].time_s if records else 0.0
        return FilmEnd(
            frames=len(records),
            lost_by_camera=sum(record.lost_by_camera for record in records),
            lost_by_disk=sum(record.lost_by_disk for record in records),
            repeated=0,
            seconds=max(seconds, 0.0),
            bytes=sum(path.stat().st_size for path in self.files),
            ended="It was cut short: the program was ended from outside, or the power failed",
        )

    @property
    def preview(self) -> Path | None:
        """The film to look at, where there is one."""
        return next((self.path / name for name in PREVIEWS if isfile(self.path / name)), None)

    def text(self, record: FilmFrame, first: bool) -> bytes:
        """The description of a page; that of a file's first one tells of the recording, too."""
        facts: dict[str, Any] = {"record": record.model_dump(mode="json")}
        if first:
            facts["recording"] = self.manifest.model_dump(mode="json")
        return json.dumps(facts, allow_nan=False).encode("ascii")

    def _page(self, number: int) -> Page:
        if not 0 <= number < len(self._pages):
            raise StorageError(f"{self.path} has no frame {number}: it has {len(self._pages)}")
        return self._pages[number]


def make_film_manifest(
    scene: str, rig: Rig, info: CameraInfo, gate: GateSettings | None, every_s: float | None = None
) -> FilmManifest:
    """The manifest of a new recording. Raises InputError for a pace that is none."""
    require(every_s is None or 0 < every_s < 1e9, "every_s", every_s, "a number of seconds above 0")
    return FilmManifest(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        software=software(),
        scene=scene,
        rig_toml=rig_to_toml(rig),
        camera=CameraFacts.of(info),
        gate=None if gate is None else Gate.of(gate),
        every_s=every_s,
    )


def check_new_film(path: Path, overwrite: bool = False) -> None:
    """Raise StorageError unless a recording can be made there: a new or empty folder, or one to be overwritten."""
    if overwrite and is_film(path):
        foreign = sorted(item.name for item in path.iterdir() if not _OWN.fullmatch(item.name))
        if foreign:
            raise StorageError(f"{path} is not overwritten: {foreign[0]} is no part of a recording")
        return
    if is_film(path):
        raise StorageError(
            f"{path} holds a recording already: take another folder, or allow to overwrite it (--overwrite)"
        )
    check_new_folder(path, "a recording")


def create_film(path: Path, manifest: FilmManifest, overwrite: bool = False) -> FilmFolder:
    """Make the folder of a recording. `overwrite`: what a recording left there is removed. Raises StorageError."""
    check_new_film(path, overwrite)
    if overwrite and is_film(path):
        with claim(path):
            _remove(path)
    begin_folder(path, MANIFEST, manifest, "a recording")
    return FilmFolder(path, manifest, rig_of(path / MANIFEST, manifest.rig_toml, manifest.camera))


def _remove(path: Path) -> None:
    """Take a recording out of its folder; the manifest goes last, so that it can be tried again."""
    try:
        for item in sorted(path.iterdir(), key=lambda item: item.name == MANIFEST):
            if item.name != LOCK:
                item.unlink()
    except OSError as error:
        raise StorageError(reason(path, error)) from None


def open_film(path: Path) -> FilmFolder:
    """The recording in a folder (or of a manifest file), as long as it is now. Raises StorageError."""
    folder = path.parent if path.name == MANIFEST else path
    manifest = read_manifest(folder, MANIFEST, FilmManifest, 1, "recording")
    return FilmFolder(folder, manifest, rig_of(folder / MANIFEST, manifest.rig_toml, manifest.camera))


class FilmWriter:
    """Adds frames to a recording, and begins another file where one is full. Raises StorageError."""

    def __init__(self, folder: FilmFolder) -> None:
        self._folder = folder
        self._stack: TiffStack | None = None
        self._files = self._bytes_before = 0

    @property
    def bytes(self) -> int:
        """Of all frames on the disk."""
        return self._bytes_before + (0 if self._stack is None else self._stack.bytes)

    def add(self, image: Counts, record: FilmFrame) -> None:
        """Write a frame (H, W) and its record; when this returns, it is kept, whatever becomes of the process."""
        narrow = self._folder.dtype is np.uint8
        pixels: Bytes | Counts = image.astype(np.uint8) if narrow else image
        text = self._folder.text(record, first=self._stack is None)
        if self._stack is not None and not self._stack.room_for(pixels, text):
            self.close()
            text = self._folder.text(record, first=True)
        if self._stack is None:
            self._stack = TiffStack(self._folder.file(self._files))
            self._files += 1
        self._stack.add(pixels, text)

    def sync(self) -> None:
        """Force what has been added to the disk."""
        if self._stack is not None:
            self._stack.sync()

    def close(self) -> None:
        """End the file that is being written. Harmless when closed."""
        if self._stack is not None:
            stack, self._stack = self._stack, None
            self._bytes_before += stack.bytes
            stack.sync()
            stack.close()

    def let_go(self) -> None:
        """Close the file after an error, whatever the disk says. Harmless when closed."""
        if self._stack is not None:
            with suppress(StorageError):
                self._stack.close()
