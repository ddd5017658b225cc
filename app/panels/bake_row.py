"""How far the bake of indirect light is, and a button that stops it or lets it go on."""

from __future__ import annotations

import time
from collections.abc import Callable

from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QVBoxLayout, QWidget

from slopegate.app.session.durations import TimeLeft
from slopegate.drivers.cameras.live_bake import BakeState, LiveBake


class BakeRow(QWidget):
    """One line on a bake, its progress, and its button. Its owner calls `look` from time to time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._bake: LiveBake | None = None
        self._clock, self._left = clock, TimeLeft(clock)
        self.text, self.bar, self.button = QLabel(), QProgressBar(), QPushButton("Stop")
        self.text.setWordWrap(True)
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName("Bake of indirect light")
        self.button.clicked.connect(self._on_button)
        row = QHBoxLayout()
        row.addWidget(self.bar, 1)
        row.addWidget(self.button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(2)
        column.addWidget(self.text)
        column.addLayout(row)
        self.hide()

    def look(self, bake: LiveBake | None) -> None:
        """Show how far this bake is now; None hides the row."""
        another, self._bake = bake is not self._bake, bake
        self.setVisible(bake is not None)
        if bake is None:
            return
        state = bake.state
        if another or state.doing != "baking":
            self._left = TimeLeft(self._clock)
        left = self._left.text(state.share * state.needed, state.needed) if state.doing == "baking" else ""
        if self.text.text() != (said := bake_text(state, left)):
            self.text.setText(said)
        self.bar.setValue(round(100 * state.share))
        running, ended = state.doing in ("beginning", "baking"), state.doing == "stopped"
        self.bar.setVisible(running or ended)
        self.button.setVisible(running or ended)
        self.button.setText("Go on" if ended else "Stop")
        self.button.setToolTip(
            "Trace more paths, so that indirect light gets less grainy"
            if ended
            else "Trace no more; what is shown stays"
        )

    def _on_button(self) -> None:
        if self._bake is None:
            return
        if self._bake.state.doing == "stopped":
            self._bake.start()
        else:
            self._bake.stop()


def bake_text(state: BakeState, left: str = "") -> str:
    """How far a bake is, in a line; `left`: how long it still takes, where that is known."""
    noise = f"noise {state.error_percent:.1f} %"
    said = {
        "beginning": "Indirect light: the first paths are traced",
        "baking": f"Indirect light: {100 * state.share:.0f} %, {noise}{', ' if left else ''}{left}",
        "done": f"Indirect light: ready, {noise}",
        "stopped": f"Indirect light: stopped, {noise}",
        "failed": f"No indirect light: {state.why}",
    }[state.doing]
    return f"{said}. What moves lights others as at time 0." if state.stale and state.doing != "failed" else f"{said}."
