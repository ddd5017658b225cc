"""Watches whether frames come, and says so when they stop and when they come again."""

from __future__ import annotations

from slopegate.app.session.session import Session
from slopegate.app.session.source import Source
from slopegate.app.views.live_view import LiveView
from slopegate.app.widgets.messages import MessageStrip
from slopegate.drivers.stream.stream import Stream

STALE_S = 1.0
"""With an error and no frame for so long, the picture is marked as old."""
SILENT_S = 3.0
"""With no frame for so long, the picture is marked as old even without an error."""


class Connection:
    """Called by the window's timer. A picture that is not live any more is veiled and says since when."""

    def __init__(self, session: Session, view: LiveView, messages: MessageStrip) -> None:
        self._session, self._view, self._messages = session, view, messages
        self._stream: Stream | None = None
        self._made = 0
        self._heard_s = 0.0
        self._error = ""
        self._since_s = 0.0
        self._who = ""
        self._said: set[str] = set()
        """The messages that were shown of this stream's errors."""

    def look(self, now_s: float) -> None:
        """See what has changed since the last call, and say so."""
        session, source, stream = self._session, self._session.source, self._session.stream
        made = 0 if stream is None else stream.counters.made
        if stream is not self._stream:
            self._stream, self._made, self._heard_s, self._error = stream, made, now_s, ""
            if self._messages.text in self._said:  # it was about the stream before
                self._messages.hide()
            self._said.clear()
        elif made != self._made:
            self._made, self._heard_s = made, now_s
        if source is None or session.paused:
            return
        if stream is None:
            self._view.set_stale(f"{source.scene.name} has been let go")
            return
        self._tell(source, stream, now_s)
        self._veil(source, stream, now_s - self._heard_s)

    def _tell(self, source: Source, stream: Stream, now_s: float) -> None:
        """Say an error once, when it comes, and when it has ended."""
        trouble = source.camera.trouble
        error = stream.error or trouble
        if error == self._error:
            return
        if not self._error:
            self._since_s = now_s
        self._error = error
        if error:
            self._who = "The board" if error == trouble else _called(source)
            said = f"{error.rstrip('.')}.{' Trying again by itself.' if stream.running else ''}"
            self._said.add(said)
            self._messages.say(said)
        elif self._messages.text in self._said:
            self._messages.say(f"{self._who} is back after {now_s - self._since_s:.1f} s.", "note")

    def _veil(self, source: Source, stream: Stream, silent_s: float) -> None:
        if self._error and silent_s > STALE_S:
            after = "connecting again by itself" if stream.running else "the camera has stopped"
            self._view.set_stale(f"Not live: no frame for {silent_s:.0f} s, {after}")
        elif silent_s > SILENT_S:
            waits = source.is_device and source.camera.info.can.trigger
            hint = ". The camera waits for the projector's sync signal; Devices (Ctrl+D) can end that" if waits else ""
            self._view.set_stale(f"Not live: no frame for {silent_s:.0f} s{hint}")
        else:
            self._view.set_stale("")


def _called(source: Source) -> str:
    """What to call the camera in a message; a virtual one has the name of its scene."""
    return source.camera.info.name if source.is_device else "The virtual camera"
