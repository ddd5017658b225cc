"""The fog of a rendered scene: how dense it is, how far one sees in it, and which way it scatters."""

from __future__ import annotations

from dataclasses import replace

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QGroupBox, QLabel, QPushButton, QVBoxLayout, QWidget

from slopegate.app.widgets.controls import Linear, Logarithmic, NumberControl
from slopegate.app.widgets.flow import FlowLayout
from slopegate.core.scene.media import Fog, extinction_of

DENSITY = Logarithmic(0.01, 100.0, 0.001)
VISIBILITY = Logarithmic(0.03, 400.0, 0.001)
FIRST = Fog(1.0)
"""What a clear scene gets first: everything in front of the rig, 1 per metre."""


class FogControls(QGroupBox):
    """Density, visibility and g. They hold the fog that is wanted; what is shown follows when it has been prepared."""

    wished = Signal(object)
    """A Fog, or None for clear air."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Fog", parent)
        self._fog = FIRST
        self._own: Fog | None = None
        self.on = QCheckBox("Fog in this scene")
        self.on.setToolTip("Fill the scene's box with fog, or look at it in clear air")
        self.own = QPushButton("As in the file")
        self.own.setToolTip("The fog that the scene's file asks for")
        self.density, self.visibility, self.g = (NumberControl(Linear(0.0, 1.0, 1.0), self) for _ in range(3))
        for control, scale in (
            (self.density, DENSITY),
            (self.visibility, VISIBILITY),
            (self.g, Linear(-0.95, 0.95, 0.01, 10)),
        ):
            control.set_scale(scale)
        self.density.describe("Scattering", " /m", "How often light is scattered a metre: 1 / mean free path")
        self.visibility.describe(
            "Visibility", " m", "Where a black thing keeps 2 % of its contrast; sets the scattering"
        )
        self.g.describe("g", "", "Mean cosine of the angle: 0 all ways alike, above 0 forward (water about 0.85)")
        self.state = QLabel()
        self.state.setWordWrap(True)
        self._arrange()
        self.on.toggled.connect(self._tell)
        self.own.clicked.connect(lambda: self._take(self._own))
        self.density.edited.connect(lambda value: self._change(replace(self._fog, scattering_per_m=value)))
        self.visibility.edited.connect(self._on_visibility)
        self.g.edited.connect(lambda value: self._change(replace(self._fog, g=value)))

    def _arrange(self) -> None:
        grid = QGridLayout()
        grid.setColumnStretch(1, 1)
        for line, control in enumerate((self.density, self.visibility, self.g)):
            for place, widget in enumerate((control.label, control.slider, control.spin)):
                grid.addWidget(widget, line, place)
            control.slider.setMinimumWidth(60)
        column = QVBoxLayout(self)
        column.addLayout(FlowLayout([self.on, self.own]))
        column.addLayout(grid)
        column.addWidget(self.state)

    @property
    def fog(self) -> Fog | None:
        """The fog that is wanted; None for clear air."""
        return self._fog if self.on.isChecked() else None

    def show_fog(self, fog: Fog | None, own: Fog | None) -> None:
        """Show this fog, and take `own` as that of the file."""
        self._own = own
        self._fog = fog or own or self._fog
        with QSignalBlocker(self.on):
            self.on.setChecked(fog is not None)
        self._show()

    def say(self, text: str) -> None:
        """What is being done, or why it was not."""
        self.state.setText(text)
        self.state.setVisible(bool(text))

    def _take(self, fog: Fog | None) -> None:
        self.show_fog(fog, self._own)
        self._tell()

    def _change(self, fog: Fog) -> None:
        self._fog = fog
        with QSignalBlocker(self.on):
            self.on.setChecked(True)
        self._tell()

    def _on_visibility(self, metres: float) -> None:
        wanted = extinction_of(metres) - self._fog.absorption_per_m
        self._change(replace(self._fog, scattering_per_m=max(wanted, DENSITY.low)))

    def _tell(self) -> None:
        self._show()
        self.wished.emit(self.fog)

    def _show(self) -> None:
        self.density.show_value(self._fog.scattering_per_m)
        self.visibility.show_value(self._fog.visibility_m)
        self.g.show_value(self._fog.g)
        self.own.setEnabled(self.fog != self._own)
