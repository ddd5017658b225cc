"""The numbers in the status bar."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QWidget

from slopegate.app.session.meter import Readings
from slopegate.app.views.trigger_text import jitter_text
from slopegate.core.rig.cadence import Cadence
from slopegate.drivers.contract.tap import Counters


class StatusReadout(QWidget):
    """Rates, frames not shown and lost, triggers, latency, skipped pixels. Numbers change, their places do not.

    In a narrow window the last ones are left out.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 6, 0)
        row.setSpacing(18)
        self.labels: dict[str, QLabel] = {}
        fields = (
            ("camera", "camera 999999 fps", "Frames the camera makes a second"),
            ("shown", "shown 999999 fps", "Frames painted a second"),
            ("dropped", "not shown 99999", "Frames made but never shown, because a newer one was there"),
            (
                "lost",
                "lost 9999 (99999 packets)",
                "Frames that the camera made and that never arrived; packets that went missing on the wire",
            ),
            (
                "triggers",
                "jitter 9999 \u00b5s, missed 9999",
                "How far triggers are off their beat (standard deviation, from the time stamps of frames); how many "
                "of them made no frame",
            ),
            ("latency", "latency 9999 ms", "From a change of settings to the painted frame made with them (median)"),
            (
                "skipped",
                "skipped 100 %",
                "Pixels whose light was not looked at: none can be there, or nothing has changed",
            ),
        )
        for key, widest, hint in fields:
            label = QLabel(widest, self)
            label.setMinimumWidth(label.sizeHint().width())
            label.setToolTip(hint)
            row.addWidget(label)
            self.labels[key] = label
        self.show_readings(Readings(None, None, 0, None, 0.0))
        self.show_no_losses()

    def sizeHint(self) -> QSize:
        row = self.layout()
        assert row is not None
        widths = [label.minimumWidth() + row.spacing() for label in self.labels.values()]
        return QSize(sum(widths), self.labels["camera"].sizeHint().height())

    def minimumSizeHint(self) -> QSize:
        return QSize(self.labels["camera"].minimumWidth(), self.sizeHint().height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        row, used = self.layout(), 0
        assert row is not None
        for label in self.labels.values():
            used += label.minimumWidth() + row.spacing()
            label.setVisible(used <= event.size().width())

    def show_losses(self, counted: Counters, beat: Cadence | None, packets: int, triggered: bool = True) -> None:
        """Show how many frames and packets were lost on the way from the camera, and how regularly it is triggered.

        Without a trigger none can be missed.
        """
        self.labels["lost"].setText(f"lost {counted.lost}" + (f" ({packets} packets)" if packets else ""))
        steady = beat is not None and beat.steady
        parts = [f"jitter {jitter_text(beat)}"] * steady + [f"missed {counted.missed}"] * triggered
        self.labels["triggers"].setText(", ".join(parts))

    def show_replayed(self, lost: int | None) -> None:
        """Show how many frames were lost while what is played was recorded: now there is nothing to lose or to miss."""
        self.show_no_losses()
        if lost is not None:
            self.labels["lost"].setText(f"lost {lost} when recorded")

    def show_no_losses(self) -> None:
        """There is no camera that could lose anything."""
        for key in ("lost", "triggers"):
            self.labels[key].clear()

    def show_readings(self, now: Readings, renders: bool = True) -> None:
        """Show these numbers, and nothing where there is none. `renders`: the camera may skip pixels.

        While no frame is painted, what was counted of earlier ones means nothing.
        """

        def rate(name: str, value: float | None) -> str:
            if value is None:
                return ""
            return f"{name} {value:.1f} fps" if value < 1000.0 else f"{name} {value:.0f} fps"

        runs = now.shown_hz is not None
        texts = {
            "camera": rate("camera", now.camera_hz),
            "shown": rate("shown", now.shown_hz),
            "dropped": f"not shown {now.dropped}" if runs else "",
            "latency": "" if now.latency_ms is None else f"latency {now.latency_ms:.0f} ms",
            "skipped": f"skipped {100 * now.skipped_fraction:.0f} %" if runs and renders else "",
        }
        for key, text in texts.items():
            self.labels[key].setText(text)
