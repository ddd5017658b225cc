"""A camera that plays a capture: for each gate it shows the slice that was taken with the nearest one."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np

from slopegate.core.measure.stack import StackSummary
from slopegate.core.render.render import Buffers
from slopegate.core.rig.arrays import Counts, Doubles, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.captures.summary import by_delay, summarise
from slopegate.drivers.contract.camera import Camera, CameraError, check_buffer
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, FrameStamp, Modes, exposed_s
from slopegate.drivers.files.durable import StorageError


class PlaybackCamera(Camera):
    """A camera that plays a capture, so that a capture can be used wherever live frames can.

    A frame is the mean of the slice's frames, rounded to whole counts; a slice of a single frame comes back bit for
    bit. Slices that are added after the camera was made are not shown.
    """

    def __init__(
        self,
        folder: Capture,
        *,
        rate_hz: float = 20.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
    ) -> None:
        """`rate_hz` infinite: as fast as it is read. `sleep` None: wait, or until `stop`. Raises StorageError."""
        require(rate_hz > 0, "rate_hz", rate_hz, "a number above 0")
        self.folder = folder
        self.records = tuple(by_delay(folder))
        """What was taken, by rising delay."""
        if not self.records:
            raise StorageError(f"{folder.path} has no slice yet: there is nothing to play")
        self._period_s, self._clock = 1 / rate_hz, clock
        self._stopped = threading.Event()
        self._stopped.set()
        self._sleep: Callable[[float], object] = self._stopped.wait if sleep is None else sleep
        facts = folder.manifest.camera
        self._info = CameraInfo(
            name=f"{folder.manifest.scene} (captured)",
            width=facts.width,
            height=facts.height,
            pixel_format=facts.pixel_format,
            max_count=facts.max_count,
            black_count=facts.black_count,
            limits=folder.rig.camera.shutter,
            can=Abilities(
                choose_format=Ability("A capture keeps the pixel format that it was taken with."), choose_rate=Ability()
            ),
            modes=Modes(
                facts.pixel_format, (facts.pixel_format,), rate_hz, on_demand=math.isinf(rate_hz), replayed=True
            ),
        )
        self._place = 0
        self._asked = self.settings[0]
        self._image: Counts | None = None
        self._sequence, self._due_s, self._settled = 0, 0.0, True
        self._dark_mean: Singles | None = None
        self._buffers: Buffers | None = None
        self.summary: StackSummary | None = None
        """All slices together; None before `prepare`."""

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of the camera that took the capture."""
        return self._info

    @property
    def settings(self) -> tuple[GateSettings, ...]:
        """The gates that were applied, by rising delay."""
        return tuple(record.applied.settings() for record in self.records)

    @property
    def buffers(self) -> Buffers | None:
        """The scene as the slices show it, for read-outs of depth; None before `prepare`."""
        return self._buffers

    def prepare(self, progress: Callable[[float], bool]) -> None:
        """Read every slice once. `progress` is told the share done; Cancelled is raised when it returns False."""
        summary = summarise(self.folder, progress)
        light = np.maximum(summary.total, 0) * np.float32(1 / self._info.max_count)
        lit = np.where(summary.projector_row >= 0, light, 0).astype(np.float32)
        direct = np.repeat(lit[:, :, None], 3, axis=2)
        unknown = np.full_like(summary.projector_row, -1)
        self._buffers = Buffers(summary.projector_row, unknown, summary.inverse_depth, direct, np.zeros_like(direct))
        self.summary = summary

    def light(self, place: int) -> Singles:
        """Counts above the dark (H, W) of a slice, by its place in `settings`. Raises StorageError."""
        index = self.records[place].index
        assert index is not None
        return self.folder.mean(index) - self._dark()

    def pixel_light(self, column: int, row: int) -> Doubles:
        """Counts above the dark of one pixel in every slice, in the order of `settings`. Raises StorageError."""
        indices = [record.index for record in self.records if record.index is not None]
        return self.folder.pixel_means(indices, row, column) - float(self._dark()[row, column])

    def nearest(self, settings: GateSettings) -> int:
        """The place of the slice whose gate is nearest, by the time that the edges lie apart over the whole image."""
        applied, middle = self.settings, self._info.height / 2

        def apart(place: int) -> float:
            other = applied[place]
            tilt = middle * abs(other.line_time_us - settings.line_time_us)
            shift = abs(other.delay_us - settings.delay_us + middle * (other.line_time_us - settings.line_time_us))
            return tilt + shift + abs(other.exposure_us - settings.exposure_us) / 2

        return min(range(len(applied)), key=apart)

    def _dark(self) -> Singles:
        if self._dark_mean is None:
            self._dark_mean = self.folder.dark_mean()
        return self._dark_mean

    def configure(self, settings: GateSettings) -> GateSettings:
        """Show the slice with the nearest gate from the next frame on; its own gate is returned."""
        place = self.nearest(settings)
        if place != self._place:
            self._place, self._image, self._settled = place, None, False
        self._asked = settings
        return self.settings[place]

    def start(self) -> None:
        """Begin to make frames."""
        self._due_s = self._clock()
        self._stopped.clear()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """Fill `buffer` (height, width) uint16 when the next frame is due; None after time-out or `stop`."""
        check_buffer(self._info, buffer)
        wait_s = self._due_s - self._clock()
        if wait_s > 0:
            self._sleep(min(wait_s, timeout_s))
        if self._stopped.is_set() or wait_s > timeout_s:
            return None
        now_s = self._clock()
        self._due_s = max(self._due_s + self._period_s, now_s)
        if self._image is None:
            self._image = self._load()
        np.copyto(buffer, self._image)
        applied = self.records[self._place].applied.settings()
        time_s = now_s - exposed_s(applied, self._info.height)
        stamp = FrameStamp(self._sequence, time_s, self._asked, applied, self._settled)
        self._sequence += 1
        self._settled = True
        return stamp

    def stop(self) -> None:
        """Make no more frames; wakes a waiting `read`. May come from any thread."""
        self._stopped.set()

    def close(self) -> None:
        """Stop and let the images go."""
        self.stop()
        self._image = self._buffers = self.summary = None

    def _load(self) -> Counts:
        index = self.records[self._place].index
        assert index is not None
        try:
            return np.rint(self.folder.mean(index)).astype(np.uint16)
        except StorageError as error:
            raise CameraError(str(error)) from None
