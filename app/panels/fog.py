"""Panel for fog: how dense it is on the bench, what gates make of it, and how well a target is seen through it."""

from __future__ import annotations

from PySide6.QtCore import QTimer
from PySide6.QtGui import QCloseEvent, QHideEvent, QShowEvent
from PySide6.QtWidgets import QLabel, QVBoxLayout

from slopegate.app.panels.fog_controls import FogControls
from slopegate.app.panels.fog_likeness import LikenessBox
from slopegate.app.panels.fog_ways import WaysBox
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.holding import Hold
from slopegate.app.session.loading import Newest
from slopegate.app.session.session import Change
from slopegate.app.session.source import Source, in_fog
from slopegate.core.scene.media import Fog

LOOK_MS = 500
REAL_FOG = "The fog before a camera is what it is. What is measured below works with every camera."


class FogPanel(Panel):
    """Fog of rendered scenes by sliders, four ways to look through it, and what frames of any camera tell."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._known: Source | None = None
        """The source that is shown."""
        self.note = QLabel(REAL_FOG)
        self.note.setWordWrap(True)
        self.controls, self.ways, self.likeness = FogControls(), WaysBox(), LikenessBox(desk)
        self._preparer: Newest[Source] = Newest(self, Source.close)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        for widget in (self.note, self.controls, self.ways, self.likeness):
            column.addWidget(widget)
        column.addStretch(1)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self.likeness.look)
        self.controls.wished.connect(self._prepare)
        self._preparer.progressed.connect(self._on_progress)
        self._preparer.finished.connect(self._on_prepared)
        self._preparer.failed.connect(self._on_failed)

    @property
    def busy(self) -> bool:
        """Whether a fog is being prepared, pictures are made or a sweep is under way."""
        return self._preparer.busy or self.ways.busy or self.likeness.busy

    def follow(self, change: Change) -> None:
        source, resolved = self._session.source, self._session.resolved
        if source is None or resolved is None:
            return
        known, self._known = self._known, source
        same = known is not None and source.shows_the_same(known)
        if Change.SOURCE in change:
            self._show_source(source, same)
            self.likeness.follow(same)
        self.likeness.render_reference()
        self.likeness.refresh()
        if change & (Change.SOURCE | Change.GATE):
            self._want_pictures()

    def let_go(self) -> None:
        known, source = self._known, self._session.source
        same = known is not None and source is not None and source.shows_the_same(known)
        self._known = source if same else None
        self.likeness.follow(same)
        if not same:
            self._preparer.cancel()
            self.ways.forget()

    def _want_pictures(self) -> None:
        source, resolved = self._session.source, self._session.resolved
        if source is not None and resolved is not None and source.rendered is not None:
            self.ways.want(source, resolved.gate)

    def _show_source(self, source: Source, same: bool) -> None:
        rendered = source.rendered is not None
        self.controls.setVisible(rendered)
        self.ways.setVisible(rendered)
        self.note.setVisible(not rendered)
        if not same:
            self._preparer.cancel()
            self.ways.forget()
            self.controls.show_fog(source.scene.fog, source.scene.fog)
            self.controls.say("")

    def _prepare(self, fog: Fog | None) -> None:
        source, held = self._session.source, self._session.held("source")
        if held is not None:
            self._stay(held)
        elif source is not None and source.rendered is not None:
            self.ways.hold()
            if source.rendered.baking is not None:  # it bakes what is to be replaced
                source.rendered.baking.stop()
            self._preparer.want(lambda progress: in_fog(source, fog, progress))

    def _on_progress(self, share: float, text: str) -> None:
        self.controls.say(f"Preparing this fog: {100 * share:.0f} %. The picture is the one from before.")

    def _stay(self, held: Hold) -> None:
        """Keep the fog that is shown, because something uses its picture."""
        source = self._session.source
        if source is not None:
            self.controls.show_fog(source.scene.fog, source.scene.fog if self._known is None else self._known.scene.fog)
        self.controls.say(held.sentence)

    def _on_prepared(self, made: Source) -> None:
        now, held = self._session.source, self._session.held("source")
        if now is None or held is not None or not made.shows_the_same(now):
            made.close()
            if held is not None:
                self._stay(held)
            return
        self.controls.say("")
        self._session.adopt(made, self._session.intent)

    def _on_failed(self, sentence: str) -> None:
        self.controls.say(sentence)
        source = self._session.source
        if source is not None and source.rendered is not None and source.rendered.baking is not None:
            source.rendered.baking.start()
        self.ways.release()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.likeness.outline(True)
        self.likeness.render_reference()
        self.likeness.look()
        self._want_pictures()
        self._timer.start(LOOK_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        self._timer.stop()
        self.ways.pause()
        self.likeness.pause()
        self.likeness.outline(False)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._preparer.close()
        self.ways.close_worker()
        self.likeness.close_workers()
        event.accept()
