"""The plots beside the image, made only after the first image is on the screen."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, Qt, QTimer
from PySide6.QtWidgets import QLabel, QSizePolicy, QSplitter, QStackedWidget, QTabWidget, QVBoxLayout, QWidget
from slopegate.app.session.session import Change, PlaneWish, Session
from slopegate.app.session.source import known_buffers
from slopegate.app.views.trigger_text import triggers_text
from slopegate.app.widgets.theme import is_dark
from slopegate.core.rig.cadence import Cadence
from slopegate.drivers.contract.tap import Counters

if TYPE_CHECKING:
    from slopegate.app.views.section_view import SectionView
    from slopegate.app.views.slab_view import SlabView
    from slopegate.app.views.timing_view import TimingView

REFRESH_MS = (30, 500)
"""Least and greatest time between two refreshes while a slider moves."""
PLOTS_SHARE = 0.2
"""Share of the GUI thread that the plots may take; the rest is the image's (3D drawn in software is slow)."""

LEAST_HEIGHT = 230
"""Pixels of a plot with its tabs, axes and legend: the window shrinks no further."""


class PlotsPanel(QWidget):
    """Slab in 3D above, y-z section and timing below."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self._pending = Change(0)
        self._interval_ms = REFRESH_MS[0]
        self.splitter = QSplitter(Qt.Orientation.Vertical)
        self.splitter.setChildrenCollapsible(False)
        self._note = QLabel("The plots follow the first image ...")
        self._note.setAlignment(Qt.AlignmentFlag.AlignCenter)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self._note)
        self.setMinimumWidth(320)
        self.slab: SlabView | None = None
        self.section: SectionView | None = None
        self.timing: TimingView | None = None
        self.tabs = QTabWidget()
        self.top, self._no_slab = QStackedWidget(), QLabel()
        self._no_slab.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._no_slab.setWordWrap(True)
        self._no_slab.setMargin(24)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._refresh)
        session.changed.connect(self._on_changed)

    def build(self) -> None:
        """Import pyqtgraph and make the plots; harmless when done."""
        if self.slab is not None:
            return
        from slopegate.app.views.section_view import SectionView
        from slopegate.app.views.slab_view import SlabView
        from slopegate.app.views.timing_view import TimingView

        self.slab, self.section, self.timing = SlabView(), SectionView(), TimingView()
        self.section.gate_wished.connect(self._on_dragged)
        self.tabs.addTab(self.section, "Sectio&n y\u2013z")
        self.tabs.addTab(self.timing, "Ti&ming")
        self.top.addWidget(self.slab)
        self.top.addWidget(self._no_slab)
        self.splitter.addWidget(self.top)
        self.splitter.addWidget(self.tabs)
        for index, view in enumerate((self.top, self.tabs)):
            view.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Ignored)
            view.setMinimumHeight(LEAST_HEIGHT)
            self.splitter.setStretchFactor(index, 1)
        column = self.layout()
        assert column is not None
        self._note.hide()
        column.addWidget(self.splitter)
        self.reset_layout()
        self._dress()
        self._pending = Change.SOURCE | Change.GATE
        self._refresh()

    def reset_layout(self) -> None:
        """Equal halves, and the whole section in its view."""
        self.splitter.setSizes([1000, 1000])
        if self.section is not None:
            self.section.reset_view()

    def show_triggers(self, counted: Counters, beat: Cadence | None, triggered: bool) -> None:
        """What the frames' stamps tell of their triggers."""
        if self.timing is not None and self.timing.isVisible():
            self.timing.show_triggers(triggers_text(counted, beat, triggered))

    def _on_dragged(self, tilt_deg: float, distance_m: float, thickness_m: float) -> None:
        intent = self._session.intent
        # what is drawn under a complement is all but the gate, and no handle for it
        if intent is not None and not intent.complement:
            self._session.ask_wish(PlaneWish(tilt_deg, distance_m, thickness_m))

    def _on_changed(self, change: Change) -> None:
        self._pending |= change
        if (
            self.slab is not None
            and change & (Change.SOURCE | Change.GATE | Change.DEPTH)
            and not self._timer.isActive()
        ):
            self._timer.start(self._interval_ms)

    def _refresh(self) -> None:
        source, resolved, pending = self._session.source, self._session.resolved, self._pending
        self._pending = Change(0)
        if source is None or resolved is None or self.slab is None or self.section is None or self.timing is None:
            return
        if pending & (Change.SOURCE | Change.DEPTH):
            buffers = known_buffers(source)
            self.slab.set_scene(source.rig, source.scene, buffers)
            self.section.set_scene(source.rig, source.scene, buffers)
            self.timing.set_rig(source.rig)
            self._no_slab.setText(f"No slab to show.\n\n{source.no_slab}")
            hidden = self.top.currentIndex() == 1
            self.top.setCurrentIndex(1 if source.no_slab else 0)
            for tab in (self.section, self.timing):
                allow_tab(self.tabs, tab, source.no_slab)
            if hidden and not source.no_slab:
                self.tabs.setCurrentWidget(self.section)
        start_s = time.perf_counter()
        intent = self._session.intent
        left_out = resolved.gate if intent is not None and intent.complement else None
        self.slab.show_gate(source.rig, resolved.sent, left_out)
        self.section.show_gate(source.rig, resolved.sent, left_out)
        self.timing.show_gate(source.rig, resolved.sent)
        # a timer of 0 ms comes after the paint events that this has caused
        QTimer.singleShot(0, self, lambda: self._note_cost(time.perf_counter() - start_s))

    def _note_cost(self, cost_s: float) -> None:
        wanted_ms = round(1000 * cost_s * (1 / PLOTS_SHARE - 1))
        self._interval_ms = min(max(wanted_ms, REFRESH_MS[0]), REFRESH_MS[1])

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def _dress(self) -> None:
        dark = is_dark(self.palette())
        for view in (self.slab, self.section, self.timing):
            if view is not None:
                view.set_dark(dark)


def allow_tab(tabs: QTabWidget, tab: QWidget, missing: str) -> None:
    """Switch a tab off, with the reason for all who point at it; on again with an empty one."""
    index = tabs.indexOf(tab)
    tabs.setTabEnabled(index, not missing)
    tabs.setTabToolTip(index, missing)
