"""Panel that relights acquired light transport slice by slice, and shows where the light of a pixel comes from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QHBoxLayout

from slopegate.app.panels.loaded_transport import LoadedTransport
from slopegate.app.panels.panel import Desk
from slopegate.app.panels.relight_layers import LayerList
from slopegate.app.panels.transport_view import TransportView, grid_of_views
from slopegate.app.session.loading import Newest
from slopegate.app.widgets.light_pictures import peaks_picture, white_level
from slopegate.app.widgets.picture_view import PictureView
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.transport.relight import LiveRelight, SliceLight
from slopegate.core.transport.weights import Weighting

VIEW_PX = 800
"""Width of the pictures: no more of them is seen."""
LEAST = 1e-6
"""Share of the brightest light below which light of a block is rounding."""
TOLD = 0.005
"""Share of a pixel's light from which a slice is named."""
RELIT, BY_BLOCK = "Relit", "Lit by one block"
OF_PIXEL, DUAL = "Light of one pixel", "Dual image"
WEIGHTS: dict[Weighting, tuple[str, str]] = {
    "tiling": ("Plain sum", "Every slice counts once: exact where slices tile what is lit"),
    "least-squares": ("Least squares", "As even as can be over all that is lit, for slices that leave gaps or overlap"),
    "paper": ("As in the paper", "|dz/dt_d|, the paper's equation 15, to compare with"),
}
HINT = "Click a pixel to see which light reaches it, or the projector's picture to see what a block of it lights."


@dataclass(frozen=True)
class Question:
    """What the two pictures are to show."""

    places: tuple[int, ...]
    """The slices that are seen."""
    block: tuple[int, int] | None
    """Column and row of the projector whose block alone is lit; None: the camera's picture is the relit one."""
    pixel: tuple[int, int] | None
    """Column and row of the camera whose light is asked for; None: the dual image is."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What they show, RGB (h, w, 3), and what there is to say of it."""

    camera: Bytes | None
    projector: Bytes
    text: str


class Relit:
    """The light transport that is shown, with its live picture and its weights. Any worker may ask for weights."""

    def __init__(self, loaded: LoadedTransport) -> None:
        self.loaded = loaded
        self._live = LiveRelight(loaded.slices, None, loaded.mosaic)
        self._white = white_level(loaded.opened.floodlit())
        height, width = loaded.opened.shape
        self._picture = np.zeros((height, width, 3), np.uint8)
        self._weights: dict[Weighting, tuple[float, ...]] = {}

    def paint(self, weighting: Weighting, lights: Sequence[SliceLight]) -> Bytes:
        """The scene under these lights, RGB (h, w, 3), at most VIEW_PX wide; for one worker at a time."""
        self._live.weigh(self.weights(weighting))
        for place, light in enumerate(lights):
            self._live.light(place, light)
        self._live.paint(self._white, self._picture)
        height, width = self._picture.shape[:2]
        if width <= VIEW_PX:
            return self._picture.copy()
        size = VIEW_PX, max(1, round(height * VIEW_PX / width))
        return np.asarray(cv2.resize(self._picture, size, interpolation=cv2.INTER_AREA), np.uint8)

    def weights(self, weighting: Weighting) -> tuple[float, ...]:
        """How much each slice counts. Raises InputError where the rule leaves that open."""
        if weighting not in self._weights:
            self._weights[weighting] = self.loaded.opened.weights(weighting)
        return self._weights[weighting]

    def likeness(self, weighting: Weighting) -> str:
        """How like the captured fully lit image the slices are, all white and weighed, in a sentence."""
        found = self.loaded.opened.agreement(weighting)
        if found is None:
            return "No fully lit image was captured to compare with."
        if math.isinf(found.psnr_db):
            return "All slices together are the captured white to the last bit."
        return f"PSNR {found.psnr_db:.1f} dB, SSIM {found.ssim:.4f} against the captured white."


def answer(loaded: LoadedTransport, asked: Question) -> Answer:
    """Look into the slices that are seen."""
    opened = loaded.opened
    words = []
    camera = None
    if asked.block is not None:
        column, row = asked.block
        light = _sum(opened.shape, (opened.camera_image(place, column, row) for place in asked.places))
        light[light < LEAST * max(float(one.total.max()) for one in loaded.slices)] = 0
        camera = peaks_picture(light, VIEW_PX)
        words.append(f"The block at column {column}, row {row} lights {np.count_nonzero(light)} pixels.")
    shape = (loaded.raster.height, loaded.raster.width)
    if asked.pixel is None:
        back = _sum(shape, (opened.dual_image(place) for place in asked.places))
    else:
        back = _sum(shape, (opened.projector_image(place, *asked.pixel) for place in asked.places))
        words.append(pixel_text(loaded, asked.places, *asked.pixel))
    return Answer(camera, peaks_picture(back, VIEW_PX), " ".join(words) or HINT)


def pixel_text(loaded: LoadedTransport, places: Sequence[int], column: int, row: int) -> str:
    """How a pixel's light is shared out among the slices that are seen."""
    light = {place: float(loaded.slices[place].total[row, column]) for place in places}
    whole = sum(light.values())
    where = f"Column {column}, row {row}"
    if whole <= 0:
        return f"{where}: no light in these slices."
    most = sorted(light, key=lambda place: -light[place])[:3]
    told = [place for place in most if light[place] > TOLD * whole]
    shares = ", ".join(f"{loaded.names[place]} {light[place] / whole:.0%}" for place in told)
    return f"{where}: {shares}."


def _sum(shape: tuple[int, ...], images: Iterable[Singles]) -> Singles:
    total = np.zeros(shape, np.float32)
    for image in images:
        total += image
    return total


class RelightPanel(TransportView):
    """The relit picture, live, beside the projector's side of the transport; below them the slices as layers."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.relit: Relit | None = None
        """What is shown; None before anything was opened."""
        self._block: tuple[int, int] | None = None
        self._pixel: tuple[int, int] | None = None
        self._picture: Bytes | None = None
        self._asked: Question | None = None
        self._painter: Newest[Bytes] = Newest(self)
        self._looker: Newest[Answer] = Newest(self)
        self._meter: Newest[str] = Newest(self)
        self._make_widgets()
        self._arrange()
        self._connect()
        self.show_transport()

    @property
    def busy(self) -> bool:
        """Whether anything is being worked out."""
        return any(worker.busy for worker in (self._painter, self._looker, self._meter))

    def _make_widgets(self) -> None:
        self.weights, self.camera_mode, self.projector_mode = ChoiceBox(), ChoiceBox(), ChoiceBox()
        for rule, (name, hint) in WEIGHTS.items():
            self.weights.addItem(name, rule)
            self.weights.setItemData(self.weights.count() - 1, hint, Qt.ItemDataRole.ToolTipRole)
        self.camera_mode.addItems([RELIT, BY_BLOCK])
        self.projector_mode.addItems([DUAL, OF_PIXEL])
        hints: list[tuple[ChoiceBox, str, str]] = [
            (
                self.weights,
                "Weights of the slices",
                "How much each slice counts, so that all together are the whole light",
            ),
            (self.camera_mode, "Camera's picture", "The relit scene, or what the marked block of the projector lights"),
            (self.projector_mode, "Projector's picture", "The scene as the projector sees it, or what lights a pixel"),
        ]
        for box, name, hint in hints:
            box.setAccessibleName(name)
            box.setToolTip(hint)
        self.camera = PictureView("What the camera sees", "to see which light reaches it")
        self.projector = PictureView("What the projector shows", "to see what its block lights")
        self.layers = LayerList()
        self.text, self.likeness = Sentence(), Sentence()

    def _arrange(self) -> None:
        grid = grid_of_views(self.body, [(self.camera_mode, self.camera), (self.projector_mode, self.projector)])
        grid.addWidget(self.text, 2, 0, 1, 2)
        grid.addWidget(self.layers, 3, 0, 1, 2)
        weights = QHBoxLayout()
        weights.addWidget(self.weights)
        weights.addWidget(self.likeness, 1)
        grid.addLayout(weights, 4, 0, 1, 2)
        grid.setRowStretch(3, 2)

    def _connect(self) -> None:
        self._painter.finished.connect(self._on_painted)
        self._looker.finished.connect(self._on_answer)
        self._meter.finished.connect(self._on_compared)
        for worker, label in ((self._painter, self.text), (self._looker, self.text), (self._meter, self.likeness)):
            worker.failed.connect(label.setText)
        self.layers.changed.connect(self._on_lights)
        self.layers.failed.connect(self.text.setText)
        self.weights.activated.connect(self._weigh)
        self.camera_mode.activated.connect(self._on_mode)
        self.projector_mode.activated.connect(self._on_mode)
        self.camera.picked.connect(self._on_pixel)
        self.projector.picked.connect(self._on_block)

    def begin(self, loaded: LoadedTransport) -> None:
        """Show this transport, all white, unless it is shown already."""
        if self.relit is not None and self.relit.loaded is loaded:
            return
        for worker in (self._painter, self._meter, self._looker):
            worker.cancel()
        self.relit = Relit(loaded)
        self._block = self._pixel = self._picture = self._asked = None
        self.camera.show_picture(None)
        self.projector.show_picture(None)
        self.camera_mode.setCurrentText(RELIT)
        self.projector_mode.setCurrentText(DUAL)
        self.layers.show_slices(loaded.names, loaded.raster)
        self._weigh()
        self._look()

    def _weigh(self) -> None:
        """Let the slices count as is chosen, and say how like the captured white they are then."""
        relit, rule = self.relit, self.weights.currentData()
        if relit is not None:
            self.likeness.setText("Comparing with the captured white \u2026")
            self._meter.want(lambda _: relit.likeness(rule))
            self._paint()

    def _on_compared(self, sentence: str) -> None:
        self.likeness.setText(sentence)

    def _paint(self) -> None:
        """Show the lights as they are now; what is chosen meanwhile is shown next."""
        relit, rule, lights = self.relit, self.weights.currentData(), self.layers.lights
        if relit is not None:
            self._painter.want(lambda _: relit.paint(rule, lights))

    def _on_painted(self, picture: Bytes) -> None:
        self._picture = picture
        self._show_relit()

    def _show_relit(self) -> None:
        if self.relit is not None and self._picture is not None and self.camera_mode.currentText() == RELIT:
            height, width = self.relit.loaded.opened.shape
            self.camera.show_picture(self._picture, (width, height))

    def _on_lights(self) -> None:
        self._paint()
        self._look()

    def _on_pixel(self, column: int, row: int) -> None:
        self._pixel = (column, row)
        self.projector_mode.setCurrentText(OF_PIXEL)
        self._look()

    def _on_block(self, column: int, row: int) -> None:
        self._block = (column, row)
        self.camera_mode.setCurrentText(BY_BLOCK)
        self._look()

    def _on_mode(self) -> None:
        """Where nothing is marked yet, the middle is."""
        if self.camera_mode.currentText() == BY_BLOCK and self._block is None:
            self.projector.pick(*self.projector.middle)
        if self.projector_mode.currentText() == OF_PIXEL and self._pixel is None:
            self.camera.pick(*self.camera.middle)
        self._show_relit()
        self._look()

    def _look(self) -> None:
        """Find what the two pictures are to show, if that is something else than they do."""
        relit = self.relit
        if relit is None:
            return
        loaded = relit.loaded
        by_block, of_pixel = self.camera_mode.currentText() == BY_BLOCK, self.projector_mode.currentText() == OF_PIXEL
        places = tuple(place for place, light in enumerate(self.layers.lights) if light.visible)
        asked = Question(places, self._block if by_block else None, self._pixel if of_pixel else None)
        if asked != self._asked:
            self._asked = asked
            self._looker.want(lambda _: answer(loaded, asked))

    def _on_answer(self, found: Answer) -> None:
        relit = self.relit
        if relit is None:
            return
        raster, (height, width) = relit.loaded.raster, relit.loaded.opened.shape
        if found.camera is not None and self.camera_mode.currentText() == BY_BLOCK:  # it may come late
            self.camera.show_picture(found.camera, (width, height))
        self.projector.show_picture(found.projector, (raster.width, raster.height))
        self.text.setText(found.text)

    def closeEvent(self, event: QCloseEvent) -> None:
        self.layers.end()
        for worker in (self._painter, self._meter, self._looker):
            worker.close()
        event.accept()
