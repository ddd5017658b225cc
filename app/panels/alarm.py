"""Panel for the proximity alarm: what lights up inside the gate's slab sets it off; each time is kept in a list."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QColor, QHideEvent, QImage, QPixmap
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
)

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.panel_state import Box, Values, numbers_text, text_box
from slopegate.app.session.alarm_memory import AlarmMemory, SceneLevel
from slopegate.app.session.describe import frames_text, number
from slopegate.app.session.saving import Saver
from slopegate.app.session.session import Change
from slopegate.app.session.snapshot import save_numbered, save_snapshot, snapshot_metadata
from slopegate.app.session.source import Source
from slopegate.app.views.draw_tools import RectangleTool
from slopegate.app.views.overlay import RegionLayer
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox, NumberBox
from slopegate.app.widgets.paint import level_table
from slopegate.core.measure.alarm import Alarm, AlarmZone, Trip, quiet_level
from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import Frame
from slopegate.drivers.stream.alarm_watch import AlarmWatcher, Held

LOOK_MS = 50
_PREVIEW_PX = (144, 108)
_REGION = QColor("#64b5f6")
MOST_EVENTS = 200
"""Events in the list; the oldest leave it for new ones."""
MOST_BYTES = 64_000_000
"""Memory for the full frames of events: older events keep their small picture only."""
MOST_SAVED, MOST_SAVED_BYTES = 1000, 4_000_000_000
"""Pictures that are saved by themselves since the alarm was armed, and their size before packing."""
USUAL_LEVEL, USUAL_SHARE_PERCENT = 300 / 4095, 0.05
"""What sets the alarm off in a scene for which nothing was set: level over the largest count, and share."""

State = Literal["ALARM", "Armed", "Held", "Waiting", "Not armed"]
_HELD: Final[dict[Held, str]] = {
    "": "",
    "gate": "The gate has moved: the level is for the one before. Go back to it, or learn and arm.",
    "light": "Other parts of the light are shown: the level is for those before. Switch them back, or learn and arm.",
}
_PAPER: Final[dict[State, str]] = {
    "ALARM": "#b3261e",
    "Armed": "#15803d",
    "Held": "#8a5a00",
    "Waiting": "#8a5a00",
    "Not armed": "#6b7280",
}


def held_text(why: str) -> str:
    """What is told beyond the panel."""
    return f"The alarm is held. {why}"


class AlarmLight(QLabel):
    """Shows the state of the alarm in large letters."""

    def show_state(self, state: State) -> None:
        """Show this one."""
        self.setText(state)
        self.setStyleSheet(
            f"background: {_PAPER[state]}; color: #ffffff; font-size: 15pt; font-weight: bold; padding: 4px 10px;"
        )


def thumbnail(counts: Counts, table: Bytes, size_px: tuple[int, int]) -> QPixmap:
    """Counts (H, W) through a table of greys (65536,) as a picture that fits into this width and height."""
    grey = np.ascontiguousarray(table[counts])
    height, width = grey.shape
    picture = QImage(grey.data, width, height, width, QImage.Format.Format_Grayscale8).copy()
    keep, smooth = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
    return QPixmap.fromImage(picture).scaled(*size_px, keep, smooth)


@dataclass(eq=False)
class AlarmEvent:
    """One time that the alarm went off: its first frame, if memory still has it, and a small picture of it."""

    trip: Trip
    when: datetime
    facts: dict[str, Any]
    """What is saved with the frame."""
    small: QPixmap
    frame: Frame | None

    @property
    def title(self) -> str:
        """Its time, for the list."""
        return f"{self.when:%H:%M:%S}  {number(100 * self.trip.share, 2)} %"

    @property
    def text(self) -> str:
        """All about it, in a line."""
        when = f"{self.when:%Y-%m-%d %H:%M:%S}.{self.when.microsecond // 1000:03d}"
        return f"{when}, frame {self.trip.sequence}: {100 * self.trip.share:.3f} % of the region was bright."


class AlarmPanel(Panel):
    """Region, level and share to watch for. Once armed it judges every frame of the camera, shown or hidden."""

    tripped = Signal(object)
    """The Trip, once for each event."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._memory = AlarmMemory(desk.settings_folder)
        self._box: Box | None = None
        self._watcher: AlarmWatcher | None = None
        self._events: deque[AlarmEvent] = deque()
        self._saved = self._saved_bytes = 0
        self._gone_off = False
        """Since it was armed, or the list cleared."""
        self._waiting = False
        """The camera is being opened; the alarm is armed when it is there."""
        self._held = ""
        """Why frames are not judged, in a sentence; empty while they are."""
        self._source = desk.session.source
        """The source of the frames that are watched."""
        self._saver = Saver(self)
        fate = "Nothing is watched any more, and the list of events is lost; pictures that were saved stay."
        self._armed = desk.session.hold("the armed alarm", fate, self.stop)
        self.layer, self.tool = RegionLayer(desk.live.view), RectangleTool(desk.live.view)
        self._make_widgets()
        self._recalled = self._level()
        """What was set in this scene when it came: only what differs is remembered."""
        self._arrange()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._connect()
        self._recall_level()
        self._refresh()
        self.detail.setText(self._memory.notice)

    def _make_widgets(self) -> None:
        self.choose, self.whole = QPushButton("Choose region"), QPushButton("Whole image")
        self.choose.setCheckable(True)
        self.choose.setToolTip("Drag a rectangle over the live image")
        self.level, self.share = CountBox(), NumberBox()
        self.level.setRange(0, 4095)
        self.level.setValue(round(USUAL_LEVEL * 4095))
        self.level.setSuffix(" counts")
        self.level.setAccessibleName("Level")
        self.level.setToolTip("A pixel brighter than this has something in it. It is remembered for each scene.")
        self.share.setRange(0.001, 100.0)
        self.share.setDecimals(3)
        self.share.setValue(USUAL_SHARE_PERCENT)
        self.share.setSuffix(" %")
        self.share.setAccessibleName("Share")
        self.share.setToolTip("Share of the region's pixels that sets the alarm off")
        self.learn = QPushButton("Learn")
        self.learn.setToolTip("Set the level above everything in the frame on show; do it while nothing is in the slab")
        self.arm, self.reset, self.save = QPushButton("Arm"), QPushButton("Disarm"), QPushButton("Save frame ...")
        self.arm.setToolTip("Watch every frame of the gate that is set now")
        self.save.setToolTip("Save the frame of the event that is chosen, with its settings")
        self.state, self.detail = AlarmLight(), QLabel()
        self.detail.setWordWrap(True)
        self.preview = QLabel()
        self.preview.setFixedSize(*_PREVIEW_PX)
        self.preview.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.preview.setAccessibleName("The frame that set the alarm off")
        self.list, self.clear = QListWidget(), QPushButton("Clear list")
        self.list.setAccessibleName("Events")
        self.list.setToolTip(f"The last {MOST_EVENTS} times that it went off; choose one to see its picture")
        self.list.setMinimumSize(136, 48)  # a line and the scroll bar
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Ignored)
        self.keep, self.folder = QCheckBox("Save to"), QPushButton("Folder ...")
        self.keep.setToolTip(
            f"Save the first frame of every event as TIFF with its settings: at most {MOST_SAVED} pictures or "
            f"{MOST_SAVED_BYTES // 1_000_000_000} GB, then arm again"
        )
        self.where = ElidedLabel()

    def _arrange(self) -> None:
        form = QFormLayout()
        form.addRow("Region", FlowLayout([self.choose, self.whole]))
        form.addRow("Level", FlowLayout([self.level, self.learn]))
        form.addRow("Share", FlowLayout([self.share]))
        left = QVBoxLayout()
        left.addLayout(form)
        left.addLayout(FlowLayout([self.arm, self.reset]))
        left.addWidget(self.state)
        left.addWidget(self.detail)
        left.addStretch(1)
        seen = QHBoxLayout()
        seen.addWidget(self.list, 1)
        seen.addWidget(self.preview)
        right = QVBoxLayout()
        right.addLayout(seen, 1)
        right.addLayout(FlowLayout([self.save, self.clear, self.keep, self.folder]))
        right.addWidget(self.where)
        across = QHBoxLayout(self)
        across.setContentsMargins(6, 6, 6, 6)
        across.addLayout(left, 1)
        across.addLayout(right, 1)

    def _connect(self) -> None:
        self.choose.toggled.connect(lambda on: self.tool.start() if on else self.tool.stop())
        self.tool.ended.connect(lambda: self.choose.setChecked(False))
        self.tool.chosen.connect(lambda *box: self._set_box(box))
        self.whole.clicked.connect(lambda: self._set_box(None))
        self.learn.clicked.connect(self._learn)
        self.arm.clicked.connect(self.start)
        self.reset.clicked.connect(self.stop)
        self.save.clicked.connect(self._ask_where)
        self.clear.clicked.connect(self.clear_list)
        self.list.currentRowChanged.connect(self._show_event)
        self.keep.toggled.connect(self._on_keep)
        self.folder.clicked.connect(self._ask_folder)
        self._saver.finished.connect(lambda path: self.where.set_full_text(f"Saved {path}"))
        self._saver.failed.connect(self._on_save_failed)
        self._session.changed.connect(self._on_source)

    @property
    def alarm(self) -> Alarm | None:
        """What the alarm is watching and whether it has gone off; None while it is not armed."""
        return None if self._watcher is None else self._watcher.alarm

    @property
    def events(self) -> tuple[AlarmEvent, ...]:
        """The times that it went off, the first one first."""
        return tuple(self._events)

    def start(self) -> None:
        """Arm with the gate that is set now: from the next frame on every one is judged."""
        if self._held:
            self._let_go()
        stream, box, source = self._session.stream, self._wanted_box(), self._session.source
        self._waiting = stream is None
        if stream is None:
            self.detail.setText("The camera is being opened; the alarm is armed as soon as it is there.")
            self._refresh()
        if stream is None or source is None or box is None or self._watcher is not None:
            return
        zone = AlarmZone(*box, float(self.level.value()), self.share.value() / 100)
        self._watcher, self._held, self._gone_off = AlarmWatcher(zone, self._gate(), light_of(source)), "", False
        stream.watch(self._watcher)
        self._saved = self._saved_bytes = 0
        self._keep_level()
        self._timer.start(LOOK_MS)
        self._refresh()

    def stop(self) -> None:
        """Disarm; the list of events stays."""
        self._let_go()
        self._waiting, self._held, self._gone_off = False, "", False
        self._source = self._session.source
        self.detail.clear()
        self._refresh()

    def clear_list(self) -> None:
        """Forget all events."""
        self._events.clear()
        self._gone_off = False
        self.list.clear()
        self.preview.clear()
        self.detail.clear()
        self._refresh()

    def _let_go(self) -> None:
        self._timer.stop()
        watcher, self._watcher = self._watcher, None
        if watcher is not None:
            if self._session.stream is not None:
                self._session.stream.detach(watcher)
            self._note_events(watcher)  # in the last moment

    def _gate(self) -> GateSettings | None:
        """The gate whose frames are judged; None where the camera has none."""
        source, resolved = self._session.source, self._session.resolved
        if source is None or resolved is None or source.camera.info.limits is None:
            return None
        return resolved.sent

    def _wanted_box(self) -> Box | None:
        source = self._session.source
        whole = None if source is None else (0, 0, source.camera.info.width, source.camera.info.height)
        return self._box or whole

    def kept_state(self) -> Values:
        """The fields, and the region where it is not the whole image."""
        return super().kept_state() | ({} if self._box is None else {"region": numbers_text(self._box)})

    def set_state(self, values: Values) -> None:
        """Set the fields and the region, unless frames are judged by others."""
        source = self._session.source
        if self._watcher is not None or source is None:
            return
        super().set_state(values)
        self._set_box(text_box(values.get("region"), source.shape))

    def _set_box(self, box: Box | None) -> None:
        self._box = box
        self.choose.setChecked(False)
        source = self._session.source
        if box is None or source is None:
            self.layer.show_region(None, _REGION)
        else:
            self.layer.show_box(box, source.shape, _REGION)

    def _learn(self) -> None:
        if (image := self._live.view.image) is not None and (box := self._wanted_box()) is not None:
            self.level.setValue(round(quiet_level(image, box)))
            self._keep_level()

    def _look(self) -> None:
        watcher = self._watcher
        if watcher is None:
            return
        self._note_events(watcher)
        self._hold(self._why_held(watcher))
        if watcher.failure:
            self._let_go()
            self._end_watch(watcher.failure)
        elif self.isVisible() and not self._held and not self._gone_off:
            alarm = watcher.alarm
            bright = f"{100 * alarm.share:.3f} % of the region is bright"
            self.detail.setText(f"{bright}; {frames_text(alarm.frames)} watched.")
        self._refresh()

    def _why_held(self, watcher: AlarmWatcher) -> str:
        """Why frames are not judged; empty while they are."""
        setting = self._session.held("gate")
        if watcher.held == "gate" and setting is not None:
            return f"{setting.by.capitalize()} sets the gate: the alarm goes on when its own gate is back."
        if watcher.held == "gate" and self._gate() == watcher.gate:
            return self._held  # its gate is on the way back
        return _HELD[watcher.held]

    def _hold(self, why: str) -> None:
        """Frames are not judged, for this reason, or are again where it is empty."""
        if why == self._held:
            return
        self._desk.withdrawn.emit(held_text(self._held))
        self._held = why
        self.detail.setText(why)
        if why and not self.isVisible():
            self._desk.warned.emit(held_text(why))

    def _note_events(self, watcher: AlarmWatcher) -> None:
        source = self._source
        for trip, frame in watcher.take():
            if source is None:
                continue
            when = datetime.now() - timedelta(seconds=time.monotonic() - trip.time_s)
            levels = self._live.levels
            table = level_table(levels.black.value(), levels.white.value(), levels.srgb.isChecked())
            small = thumbnail(frame.image, table, _PREVIEW_PX)
            facts = snapshot_metadata(source.rig, source.scene, source.place, source.camera.info, frame.stamp)
            facts |= {"alarm_share": trip.share, "alarm_time": when.isoformat(timespec="milliseconds")}
            event = AlarmEvent(trip, when, facts, small, frame)
            self._gone_off = True
            self._add(event)
            self._save_by_itself(event, frame.image)
            if not self.isVisible():
                self._desk.warned.emit(f"ALARM at {event.text}")
            self.tripped.emit(trip)

    def _add(self, event: AlarmEvent) -> None:
        """Put an event into the list, and let go of what is too much."""
        follows = self.list.currentRow() == self.list.count() - 1
        self._events.append(event)
        self.list.addItem(QListWidgetItem(event.title))
        if len(self._events) > MOST_EVENTS:
            self._events.popleft()
            self.list.takeItem(0)
        held = 0
        for each in reversed(self._events):
            held += 0 if each.frame is None else each.frame.image.nbytes
            if held > MOST_BYTES:
                each.frame = None
        if follows:
            self.list.setCurrentRow(self.list.count() - 1)

    def _show_event(self) -> None:
        event = self._chosen()
        if event is not None:
            self.preview.setPixmap(event.small)
            self.detail.setText(event.text)
        self._refresh()

    def _end_watch(self, why: str) -> None:
        """Say that nothing is watched; a camera that was let go to be opened anew is watched again after that."""
        if self._session.stream is None:
            self.start()
            return
        self.detail.setText(f"Not watched any more: {why}")
        self._desk.warned.emit(f"The alarm is off, nothing is watched any more: {why.rstrip('.')}.")

    def _state(self) -> State:
        if self._waiting:
            return "Waiting"
        if self._held:
            return "Held"
        if self._gone_off:
            return "ALARM"
        return "Not armed" if self._watcher is None else "Armed"

    def _refresh(self) -> None:
        if self._watcher is not None or self._waiting:
            self._armed.begin("program")
        else:
            self._armed.end()
        armed = (self._watcher is not None or self._waiting) and not self._held
        self.arm.setEnabled(not armed and self._session.source is not None)
        self.reset.setEnabled(armed or bool(self._held) or self._gone_off)
        chosen = self._chosen()
        self.save.setEnabled(chosen is not None and chosen.frame is not None)
        self.clear.setEnabled(bool(self._events))
        for widget in (self.choose, self.whole, self.level, self.share, self.learn):
            widget.setEnabled(not armed)
        self.state.show_state(self._state())

    def _chosen(self) -> AlarmEvent | None:
        row = self.list.currentRow()
        return self._events[row] if 0 <= row < len(self._events) else None

    def _ask_where(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save the frame of the alarm", "alarm.tif", "TIFF (*.tif)")
        if name:
            self.save_to(Path(name))

    def save_to(self, path: Path) -> None:
        """Write the frame of the event that is chosen, with its settings inside, in a thread of its own."""
        event = self._chosen()
        if event is not None and event.frame is not None:
            image, facts = event.frame.image, event.facts
            self._saver.start(lambda _: save_snapshot(path, image, facts, raw=False))

    def _on_keep(self, on: bool) -> None:
        if on and not self._memory.folder:
            self._ask_folder()
        self.keep.setChecked(on and bool(self._memory.folder))
        self.where.set_full_text(self._memory.folder if self.keep.isChecked() else "")

    def _ask_folder(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "A folder for the pictures of events", self._memory.folder)
        if name:
            self.keep_in(Path(name))

    def keep_in(self, folder: Path) -> None:
        """Save the first frame of every event to this folder from now on."""
        self._say(self._memory.keep_folder(str(folder)))
        self.keep.setChecked(True)
        self.where.set_full_text(str(folder))

    def _save_by_itself(self, event: AlarmEvent, image: Counts) -> None:
        if not self.keep.isChecked():
            return
        if self._saved >= MOST_SAVED or self._saved_bytes + image.nbytes > MOST_SAVED_BYTES:
            size = f"{number(self._saved_bytes / 1e9, 1)} GB"
            self._on_save_failed(f"{self._saved} pictures of {size} are saved: no more are until it is armed again.")
            return
        self._saved, self._saved_bytes = self._saved + 1, self._saved_bytes + image.nbytes
        folder, facts, when = Path(self._memory.folder), event.facts, event.when
        self._saver.start(lambda _: save_numbered(folder, image, facts, when))

    def _on_save_failed(self, sentence: str) -> None:
        if self.where.text() != sentence:
            self.where.set_full_text(sentence)
            self._desk.warned.emit(f"The alarm's picture is not saved: {sentence}")

    def _on_source(self, change: Change) -> None:
        if Change.GATE in change and Change.SOURCE not in change and self._watcher is not None:
            self._look()
        if Change.SOURCE not in change:
            return
        old, new = self._source, self._session.source
        same = old is not None and new is not None and new.shows_the_same(old)
        wanted = self._watcher is not None or self._waiting
        self._let_go()
        if not same:
            self._set_box(None)
            self._keep_level()
        self._source, self._waiting, self._held = new, False, ""
        if same:
            self._scale_level()
        else:
            self._recall_level()
        if wanted and old is not None and new is not None:
            self._go_on(old, new, same)
        self._refresh()

    def _go_on(self, old: Source, new: Source, same: bool) -> None:
        """Watch what was opened anew, unless it looks otherwise now."""
        if same and not _looks_alike(old, new):
            self._hold("The camera's noise, format or scene is another now: learn the level again, then arm.")
            self._desk.warned.emit("The alarm is held: the camera's noise, format or scene is another now.")
        elif same:
            self.start()
        if self._watcher is None and not self._held:
            self._end_watch(self.detail.text() if same else "another scene or camera is looked at")

    def _place(self) -> str:
        """Where the frames come from, by which levels are remembered."""
        return "" if self._source is None else str(self._source.where)

    def _recall_level(self) -> None:
        """Set what is remembered for the scene, on the scale of its camera's counts."""
        source = self._source
        if source is None:
            return
        most = source.camera.info.max_count
        kept = self._memory.level(self._place())
        level = USUAL_LEVEL if kept is None else kept.level_count / kept.max_count
        self.level.setMaximum(most)
        self.level.setValue(round(level * most))
        self.share.setValue(USUAL_SHARE_PERCENT if kept is None else kept.share_percent)

        self._recalled = self._level()

    def _scale_level(self) -> None:
        """Keep the level at the same share of the camera's largest count."""
        source, top = self._session.source, self.level.maximum()
        if source is not None and source.camera.info.max_count != top:
            level = round(self.level.value() * source.camera.info.max_count / top)
            self.level.setMaximum(source.camera.info.max_count)
            self.level.setValue(level)

    def _level(self) -> SceneLevel:
        return SceneLevel(
            level_count=self.level.value(), max_count=round(self.level.maximum()), share_percent=self.share.value()
        )

    def _keep_level(self) -> None:
        """Remember what was set in this scene, if anything was."""
        if self._place() and self._level() != self._recalled:
            self._recalled = self._level()
            self._say(self._memory.keep_level(self._place(), self._recalled))

    def _say(self, trouble: str) -> None:
        if trouble:
            self._desk.warned.emit(trouble)

    def hideEvent(self, event: QHideEvent) -> None:
        self.choose.setChecked(False)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._let_go()
        self._armed.end()
        self._keep_level()
        self._saver.close()
        event.accept()


def light_of(source: Source) -> Callable[[], object]:
    """Tells the parts of the light that frames of this source show now; always the same for a camera."""
    rendered = source.rendered
    return (lambda: None) if rendered is None else (lambda: rendered.smooth.lit)


def _looks_alike(old: Source, new: Source) -> bool:
    """Whether equal light makes equal counts: the same scene, noise and pixel format."""
    alike = old.options.noise == new.options.noise and old.options.pixel_format == new.options.pixel_format
    return alike and (new.is_device or old.scene is new.scene)
