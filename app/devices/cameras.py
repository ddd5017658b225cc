"""Opens the window's real cameras, remembers them, and opens them again when trigger, delay or mode are changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from slopegate.app.devices.hub import DeviceHub
from slopegate.app.session.holding import Needs
from slopegate.app.session.opening import Opener
from slopegate.app.session.session import Change, Session
from slopegate.app.session.source import Options
from slopegate.app.widgets.messages import MessageStrip
from slopegate.drivers.contract.families import Address
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.devices.catalog import VIRTUAL
from slopegate.drivers.scenes.scene_files import shipped_scenes

_CHANGING = "Changing the camera"


class Cameras(QObject):
    """Connects the device list, the opener and the session. Every call to a device is in the opener's thread."""

    refused = Signal()
    """A change was refused: the camera stays as it was."""

    def __init__(
        self,
        session: Session,
        opener: Opener,
        hub: DeviceHub,
        messages: MessageStrip,
        options: Callable[[], Options],
        may_end: Callable[[Needs, str], bool],
        parent: QObject | None = None,
    ) -> None:
        """`may_end` asks whether what holds something may be ended for what the sentence begins with."""
        super().__init__(parent)
        self._session, self._opener, self._hub = session, opener, hub
        self._may_end = may_end
        self._messages, self._options = messages, options
        self._waiting: tuple[Address, bool] | None = None
        self._scene: Path | None = None
        self._made = hub.way()
        opener.settled.connect(self._on_settled)
        opener.failed.connect(self._on_not_opened)
        opener.cancelled.connect(self._on_not_opened)
        session.changed.connect(self._on_changed)
        hub.changed.connect(self._on_hub)

    def open(self, address: Address, keep_gate: bool = False) -> None:
        """Stream from this camera as soon as it is open. The virtual camera brings back the last scene."""
        if not self._may_stop(f"Opening {address}"):
            return
        if address.family == VIRTUAL.key:
            self.close()
            return
        self._messages.hide()
        self._made = self._hub.way()
        way = self._hub.way_to_open(address)
        self._open(address, [way, OpenOptions(way.triggered)], keep_gate)

    def change_options(self, options: Options) -> None:
        """Build the virtual camera anew; a capture, search or sweep that uses the one that runs is asked about."""
        if self._may_stop(_CHANGING):
            self._messages.hide()
            self._opener.reopen(options)

    def change_mode(self, pixel_format: str | None, rate_hz: float | None) -> None:
        """Open the running device again with another pixel format or rate; None leaves what it has.

        Where it refuses that, it goes on as it was.
        """
        running, source = self._hub.running, self._session.source
        if running is None or source is None:
            self._refuse("The camera is not connected: connect it again, then change it.")
            return
        before, modes = self._hub.way_to_open(running), source.camera.info.modes
        if pixel_format in (None, modes.format):  # what was never chosen stays so
            pixel_format = before.pixel_format
        if rate_hz in (None, modes.rate_hz):
            rate_hz = before.rate_hz
        wanted = replace(before, pixel_format=pixel_format, rate_hz=rate_hz)
        if wanted == before or not self._may_stop(_CHANGING):
            return
        if self._opener.busy:
            self._refuse("A camera or scene is being opened: choose again when it is there.")
            return
        self._messages.hide()
        self._open(running, [wanted, before, OpenOptions(before.triggered)], keep_gate=True)

    def _open(self, address: Address, ways: list[OpenOptions], keep_gate: bool) -> None:
        self._opener.open_camera(address, self._options(), ways, self._hub.with_delay, keep_gate)

    def _may_stop(self, doing: str) -> bool:
        allowed = self._may_end("source", doing)
        if not allowed:
            self.refused.emit()
        return allowed

    def _refuse(self, sentence: str) -> None:
        self._messages.say(sentence, "warning")
        self.refused.emit()

    def open_later(self, wanted: Address | None) -> None:
        """Open this camera, or the remembered one, when the scene that is being opened is there or has failed.

        So the window has a picture even where the camera hangs or is not there.
        """
        address = wanted or self._hub.remembered_camera
        if address is not None:
            self._waiting = (address, wanted is None)

    def close(self) -> None:
        """Go back to the last scene."""
        source = self._session.source
        if source is not None and source.is_device:
            self._opener.open(self._scene or shipped_scenes()[0].path, self._options())

    def _on_settled(self) -> None:
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self.open(*waiting)

    def _on_not_opened(self) -> None:
        """A camera that was closed to be opened again, and did not open, does not run any more."""
        if self._session.stream is None:
            self._hub.set_running(None, forget=False)

    def _on_changed(self, change: Change) -> None:
        source = self._session.source
        if Change.SOURCE not in change or source is None:
            return
        if isinstance(source.where, Address):
            if source.opened is not None:
                self._hub.keep_mode(source.where, source.opened)
            self._hub.set_running(source.where)
        else:
            if not source.is_device:
                self._scene = source.where
            self._hub.set_running(None, forget=self._waiting is None)
        if source.remark:
            self._messages.say(source.remark, "warning")

    def _on_hub(self) -> None:
        """Open the camera again when another trigger or delay was chosen."""
        running = self._hub.running
        if running is not None and self._hub.way() != self._made:
            self.open(running, keep_gate=True)
