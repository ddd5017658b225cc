"""The table of panels and workspaces: a new panel is one file in this room and one line here."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

from PySide6.QtWidgets import QPushButton

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.source import Source
from slopegate.app.widgets.checked import MarkWhenChecked
from slopegate.app.widgets.number_box import NumberBox

Needs = Literal["", "timing", "gate", "plane"]
"""What a source must have for a panel to be of use: rows whose timing is known, a gate that can be set, a gate that can
be set by where its slab lies, or nothing."""


@dataclass(frozen=True)
class PanelSpec:
    """One panel: how it is named, which workspace it belongs to, and where its class is.

    Panels of one `row` of a workspace are tabs of one group at first, in the order of the table.
    """

    key: str
    """Names the panel in remembered layouts: it must not change."""
    title: str
    workspace: str
    row: int
    place: str
    """Module in this room and class. Imported when the panel is first shown: plots would delay the first image."""
    needs: Needs = ""
    keys: str = ""
    """Shortcut that brings the panel to the front."""
    late: str = ""
    """Another module that the panel imports when it is made, and that may be missing."""
    first: str = ""
    """Module and function of what takes long when the panel is first made: called while the first scene is loaded."""

    def missing(self, source: Source | None) -> str:
        """Why this source has nothing for the panel, in one sentence; empty when it has."""
        if source is None or not self.needs:
            return ""
        return {"timing": source.no_timing, "gate": source.no_gate, "plane": source.no_plane}[self.needs]

    @property
    def module(self) -> str:
        """The module that the panel comes from."""
        return f"slopegate.app.panels.{self.place.split(':')[0]}"

    def prefetch(self) -> None:
        """Import what the panel needs, in any thread, so that making it does not have to."""
        import_module(self.module)
        if self.late:
            with suppress(Exception):  # the panel does without it, and says so
                import_module(self.late)

    def begin(self) -> None:
        """Do what takes long the first time, such as loading the graphics driver; in the window's thread."""
        if self.first:
            module, function = self.first.split(":")
            getattr(import_module(module), function)()

    def make(self, desk: Desk) -> Panel:
        """The panel itself.

        Its buttons and labels have no Alt keys: those belong to what is always on the screen, and there are more
        buttons than letters.
        """
        made: Panel = getattr(import_module(self.module), self.place.split(":")[1])(desk)
        for box in made.findChildren(NumberBox):
            box.refused.connect(desk.refused)
            box.typed.connect(desk.typed)
            box.withdrawn.connect(desk.withdrawn)
        for button in made.findChildren(QPushButton):
            if button.isCheckable():
                MarkWhenChecked(button)
        return made


@dataclass(frozen=True)
class Workspace:
    """A named arrangement of panels for one kind of work."""

    key: str
    title: str
    keys: str
    """Shortcut that switches to it."""
    hint: str

    @property
    def panels(self) -> tuple[PanelSpec, ...]:
        """The panels that belong to it."""
        return tuple(spec for spec in PANELS if spec.workspace == self.key)


PANELS = (
    PanelSpec(
        "slab",
        "Slab in 3D",
        "gate",
        0,
        "plots:SlabPanel",
        "timing",
        late="slopegate.app.views.gl_view",
        first="slopegate.app.views.opengl:opengl_missing",
    ),
    PanelSpec("section", "Section y\u2013z", "gate", 1, "plots:SectionPanel", "timing", "Alt+N"),
    PanelSpec("timing", "Timing", "gate", 1, "plots:TimingPanel", "timing", "Alt+M"),
    PanelSpec("mask", "Mask", "gate", 1, "mask:MaskPanel", "gate"),
    PanelSpec("search", "Search", "gate", 1, "search:SearchPanel", "plane"),
    PanelSpec("alarm", "Alarm", "gate", 1, "alarm:AlarmPanel"),
    PanelSpec("measure", "Measure", "gate", 1, "measure:MeasurePanel"),
    PanelSpec("depth", "Depth", "capture", 0, "depth:DepthPanel", "plane"),
    PanelSpec("capture", "Capture viewer", "capture", 0, "capture_view:CaptureView"),
    PanelSpec("slices", "Slices", "capture", 1, "capture:CapturePanel", "gate"),
    PanelSpec("record", "Record", "capture", 1, "record:RecordPanel"),
    PanelSpec("light", "Light", "light", 0, "light:LightPanel"),
    PanelSpec("fog", "Fog", "light", 0, "fog:FogPanel"),
    PanelSpec("skin", "Skin", "light", 0, "skin:SkinPanel"),
    PanelSpec("transport", "Transport", "transport", 0, "transport:TransportPanel"),
    PanelSpec("relight", "Relight", "transport", 0, "relight:RelightPanel"),
    PanelSpec("composite", "Composite", "transport", 0, "composite:CompositePanel"),
    PanelSpec("calibrate", "Calibrate", "rig", 0, "calibrate:CalibratePanel"),
)

WORKSPACES = (
    Workspace("gate", "Gate", "Alt+1", "Set the gate, see where its slab lies, and find a gate for a target"),
    Workspace("capture", "Capture", "Alt+2", "Measure depth, record slices, and look at captures"),
    Workspace("light", "Light", "Alt+3", "See the light that fog, skin and other surfaces add to the direct"),
    Workspace("transport", "Transport", "Alt+4", "Acquire light transport by slices, relight and composite with it"),
    Workspace("rig", "Rig", "Alt+5", "Find the numbers of a camera and a projector, with their errors"),
)
