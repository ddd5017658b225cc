"""A camera that plays a recording at one gate, over and over, at the pace at which it was taken."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.drivers.captures.film import FilmFolder
from slopegate.drivers.contract.camera import Camera, CameraError, check_buffer, unable
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, FrameStamp, Modes, exposed_s
from slopegate.drivers.files.durable import StorageError

_PLAIN = Ability("This was recorded with a camera without a gate.")
_FIXED = Ability("The gate is fixed by the recording.")
_UNTRIGGERED = Ability("A recording is played at the pace at which it was taken.")
_KEPT = Ability("A recording keeps the pixel format that it was taken with.")


class FilmCamera(Camera):
    """A camera whose frames are those of a recording, with the gate that was applied then and with no other."""

    def __init__(self, folder: FilmFolder, *, clock: Callable[[], float] = time.monotonic) -> None:
        """Raises StorageError for a recording without frames."""
        if not len(folder):
            raise StorageError(f"{folder.path} has no frame yet: there is nothing to play")
        self.folder, self._clock = folder, clock
        manifest, facts = folder.manifest, folder.manifest.camera
        self.gate = None if manifest.gate is None else _gate(folder)
        """The gate that was applied; None for a camera without one."""
        self.ended = folder.end
        """How it ended, with what was lost meanwhile; None where it was cut short."""
        rate_hz = folder.rate_hz
        missing, trigger = (_PLAIN, _PLAIN) if self.gate is None else (_FIXED, _UNTRIGGERED)
        self._info = CameraInfo(
            name=f"{manifest.scene} (recorded)",
            width=facts.width,
            height=facts.height,
            pixel_format=facts.pixel_format,
            max_count=facts.max_count,
            black_count=facts.black_count,
            limits=None if self.gate is None else folder.rig.camera.shutter,
            can=Abilities(missing, missing, missing, trigger, choose_format=_KEPT),
            modes=Modes(facts.pixel_format, (facts.pixel_format,), rate_hz, replayed=True),
        )
        self._period_s = 1 / rate_hz
        self._asked = self.gate
        self._place = self._sequence = 0
        self._due_s = 0.0
        self._stopped = threading.Event()
        self._stopped.set()

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of the camera that took the recording."""
        return self._info

    @property
    def settings(self) -> tuple[GateSettings, ...]:
        """The one gate that there is; none of a camera without one."""
        return () if self.gate is None else (self.gate,)

    def configure(self, settings: GateSettings) -> GateSettings:
        """The recording's own gate may be asked for, as it was applied or rounded to what its rig can do."""
        if self.gate is None or settings not in (self.gate, self._rounded(self.gate)):
            raise unable(self._info, self._info.can.exposure)
        self._asked = settings
        return self.gate

    def start(self) -> None:
        """Play, from where it was stopped."""
        self._stopped.clear()
        self._due_s = self._clock()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """The next frame at its time; after the last one comes the first."""
        check_buffer(self._info, buffer)
        wait_s = self._due_s - self._clock()
        if self._stopped.wait(max(0.0, min(wait_s, timeout_s))) or wait_s > timeout_s:
            return None
        try:
            self.folder.frame(self._place, buffer)
        except StorageError as error:
            raise CameraError(str(error)) from None
        time_s = self._clock() - exposed_s(self.gate, self._info.height)
        stamp = FrameStamp(self._sequence, time_s, self._asked, self.gate)
        self._place = (self._place + 1) % len(self.folder)
        self._sequence += 1
        self._due_s = max(self._due_s + self._period_s, self._clock())
        return stamp

    def stop(self) -> None:
        """Play no more."""
        self._stopped.set()

    def close(self) -> None:
        """Stop: no file is held open."""
        self.stop()

    def _rounded(self, gate: GateSettings) -> GateSettings:
        rig = self.folder.rig
        return quantise(rig.camera.shutter, gate, rig.projector.period_us)


def _gate(folder: FilmFolder) -> GateSettings:
    asked, applied = folder.manifest.gate, folder.record(0).applied
    found = applied or asked
    assert found is not None
    return found.settings()
