"""Plots of the gate: its slab in 3D, its section, and its timing."""

from __future__ import annotations

import time
from functools import partial
from typing import Generic, TypeVar

from PySide6.QtCore import QEvent, QTimer
from PySide6.QtGui import QHideEvent, QShowEvent
from PySide6.QtWidgets import QVBoxLayout

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.session import Change, PlaneWish
from slopegate.app.session.source import Source, known_buffers
from slopegate.app.views.section_view import SectionView
from slopegate.app.views.slab_view import SlabView
from slopegate.app.views.timing_view import TimingView
from slopegate.app.views.trigger_text import triggers_text
from slopegate.app.widgets.picture_menu import PictureMenu
from slopegate.app.widgets.theme import is_dark
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene

REFRESH_MS = (30, 500)
"""Least and greatest time between two drawings while a slider moves."""
PLOT_SHARE = 0.12
"""Share of the GUI thread that one plot may take; the rest is the image's (3D drawn in software is slow)."""
LEAST_PX = (280, 200)
"""Width and height that a plot needs with its axes and legend; in a smaller panel it is scrolled."""
TRIGGERS_MS = 250


class PlotPanel(Panel):
    """A plot of the gate. It is drawn only while it is on the screen, and never more often than its share allows."""

    def __init__(self, desk: Desk, view: SlabView | SectionView | TimingView) -> None:
        super().__init__(desk)
        self._plot = view
        self._due = Change(0)
        self._fresh = True
        """Whether it has not been shown yet."""
        self._interval_ms = REFRESH_MS[0]
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._draw)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(view)
        self.setMinimumSize(*LEAST_PX)
        self._dress()
        self.menu = PictureMenu(view, view.accessibleName())
        self.menu.failed.connect(desk.warned)

    def show_source(self, source: Source) -> None:
        """Show another rig and scene, or what has been measured of it."""
        raise NotImplementedError

    def show_gate(self, source: Source, sent: GateSettings, left_out: GateSettings | None) -> None:
        """Show this gate; `left_out` is the one that it is the complement of."""
        raise NotImplementedError

    def follow(self, change: Change) -> None:
        self._due |= change & (Change.SOURCE | Change.GATE | Change.PRESENT | Change.DEPTH)
        if self._due and not self._timer.isActive():
            self._timer.start(self._interval_ms)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if self._fresh:
            self._timer.start(0)  # in a turn of its own: a view that is shown for the first time makes much
        else:
            self._draw()
        self._fresh = False

    def hideEvent(self, event: QHideEvent) -> None:
        self._timer.stop()
        self._missed |= self._due
        self._due = Change(0)

    def _draw(self) -> None:
        self._timer.stop()
        source, present = self._session.source, self._session.present
        due, self._due = self._due, Change(0)
        if source is None or present is None or not due:
            return
        resolved, intent = present
        start_s = time.perf_counter()
        if due & (Change.SOURCE | Change.DEPTH):
            self.show_source(source)
        self.show_gate(source, resolved.sent, resolved.gate if intent.complement else None)
        # a timer of 0 ms comes after the paint events that this has caused
        QTimer.singleShot(0, self, lambda: self._note_cost(time.perf_counter() - start_s))

    def _note_cost(self, cost_s: float) -> None:
        wanted_ms = round(1000 * cost_s * (1 / PLOT_SHARE - 1))
        self._interval_ms = min(max(wanted_ms, REFRESH_MS[0]), REFRESH_MS[1])

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def _dress(self) -> None:
        self._plot.set_dark(is_dark(self.palette()))


SceneView = TypeVar("SceneView", SlabView, SectionView)


class ScenePanel(PlotPanel, Generic[SceneView]):
    """A plot of the slab among what the camera sees of the scene."""

    def __init__(self, desk: Desk, view: SceneView) -> None:
        super().__init__(desk, view)
        self.view: SceneView = view

    def show_source(self, source: Source) -> None:
        self.view.set_scene(source.rig, source.scene, known_buffers(source))

    def let_go(self) -> None:
        source = self._session.source
        if source is not None:
            self.view.set_scene(source.rig, Scene(""), None)

    def show_gate(self, source: Source, sent: GateSettings, left_out: GateSettings | None) -> None:
        self.view.show_gate(source.rig, sent, left_out)


class SlabPanel(ScenePanel[SlabView]):
    """The slab in 3D, among what the camera sees."""

    def __init__(self, desk: Desk) -> None:
        view = SlabView()
        view.setAccessibleName("Slab in 3D")
        super().__init__(desk, view)
        self.menu.offer({name: partial(view.set_view, name) for name in view.views})

    @property
    def settled(self) -> bool:
        return self.view.settled


class SectionPanel(ScenePanel[SectionView]):
    """The slab from the side, where it can be dragged."""

    def __init__(self, desk: Desk) -> None:
        view = SectionView()
        view.setAccessibleName("Section")
        super().__init__(desk, view)
        self.menu.offer({"Fit": view.reset_view})
        self.view.gate_wished.connect(self._on_dragged)

    def reset_view(self) -> None:
        self.view.reset_view()

    def _on_dragged(self, tilt_deg: float, distance_m: float, thickness_m: float) -> None:
        intent = self._session.intent
        # what is drawn under a complement is all but the gate, and no handle for it
        if intent is not None and not intent.complement:
            self._session.ask_wish(PlaneWish(tilt_deg, distance_m, thickness_m))


class TimingPanel(PlotPanel):
    """Projector rows and camera rows against time, and what the frames' stamps tell of the triggers."""

    def __init__(self, desk: Desk) -> None:
        view = TimingView()
        view.setAccessibleName("Timing")
        super().__init__(desk, view)
        self.view = view
        self._clock = QTimer(self)
        self._clock.timeout.connect(self._show_triggers)

    def show_source(self, source: Source) -> None:
        self.view.set_rig(source.rig)

    def show_gate(self, source: Source, sent: GateSettings, left_out: GateSettings | None) -> None:
        self.view.show_gate(source.rig, sent)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._show_triggers()
        self._clock.start(TRIGGERS_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        super().hideEvent(event)
        self._clock.stop()

    def _show_triggers(self) -> None:
        source, stream = self._session.source, self._session.stream
        if source is not None and source.replayed:
            self.view.show_triggers("Triggers: none, for these frames were taken before.")
        elif source is not None and stream is not None and self._live.frame is not None:
            self.view.show_triggers(triggers_text(stream.counters, stream.beat, source.triggered))
