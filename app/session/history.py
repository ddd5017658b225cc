"""Gates that were wanted before: undo and redo, however each of them was set."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtGui import QGuiApplication

from slopegate.app.session.session import Change, Intent, Session
from slopegate.app.session.source import Source

MOST: Final = 200
"""Steps that are kept; the oldest is forgotten."""
ONE_STEP_S: Final = 0.3
"""Changes that follow one another faster, as those of a key held down do, are one step."""
LOOK_MS: Final = 50


def _button_down() -> bool:
    return QGuiApplication.mouseButtons() != Qt.MouseButton.NoButton


class GateHistory(QObject):
    """Follows the session's gate. All changes during one drag of the mouse are one step.

    It begins anew with another scene or camera, and goes on where the same one is opened with other options.
    """

    changed = Signal()
    """Whether there is anything to undo or redo may have changed."""

    def __init__(
        self,
        session: Session,
        parent: QObject | None = None,
        clock: Callable[[], float] = time.monotonic,
        button_down: Callable[[], bool] = _button_down,
    ) -> None:
        super().__init__(parent)
        self._session, self._clock, self._button_down = session, clock, button_down
        self._steps: list[Intent] = []
        self._at = -1
        self._open = self._dragged = False
        """Whether the next change may still belong to the last step, and whether that is a drag."""
        self._last_s = -ONE_STEP_S
        self._source: Source | None = session.source
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        session.changed.connect(self._on_changed)

    @property
    def can_undo(self) -> bool:
        """Whether a gate from before can come back."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether one that was undone can."""
        return self._at < len(self._steps) - 1

    def undo(self) -> None:
        """Ask for the gate from before."""
        if self.can_undo:
            self._go(self._at - 1)

    def redo(self) -> None:
        """Ask for the gate that was undone last."""
        if self.can_redo:
            self._go(self._at + 1)

    def _go(self, there: int) -> None:
        before, self._at = self._at, there
        self._seal()
        if not self._session.ask(self._steps[there]):
            self._at = before
        self.changed.emit()

    def _on_changed(self, change: Change) -> None:
        intent, source = self._session.intent, self._session.source
        if intent is None or source is None:
            return
        if Change.SOURCE in change:
            known, self._source = self._source, source
            if known is None or known.rig != source.rig or not source.shows_the_same(known):
                self._steps, self._at = [], -1
            self._seal()
        if Change.GATE in change:
            self._note(intent)

    def _note(self, intent: Intent) -> None:
        if self._at >= 0 and intent == self._steps[self._at]:
            return
        now_s, dragged = self._clock(), self._button_down()
        same = self._dragged if dragged else now_s - self._last_s < ONE_STEP_S
        goes_on = self._open and self._at > 0 and same
        del self._steps[self._at + (0 if goes_on else 1) :]
        self._steps.append(intent)
        del self._steps[:-MOST]
        self._at, self._last_s, self._open = len(self._steps) - 1, now_s, True
        self._dragged = dragged
        if dragged:
            self._timer.start(LOOK_MS)
        self.changed.emit()

    def _look(self) -> None:
        if not self._button_down():
            self._seal()

    def _seal(self) -> None:
        """End the last step: what changes next is another one."""
        self._open = self._dragged = False
        self._timer.stop()
