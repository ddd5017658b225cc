"""Ways to compare with: plain numpy, OpenCV only, ray casting for every frame, and row by row as in the paper."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slopegate.app.bench.number_types import edge_error, number_types
from slopegate.app.bench.subject import Subject, to_counts
from slopegate.app.bench.variant import Variant, array_bytes, fine_response, gate_response, read_fine
from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.sensor import Plates, expose_fast, mono, noise_pool
from slopegate.core.gating.gate import RowWindows, row_windows, weights
from slopegate.core.render.render import render
from slopegate.core.rig.arrays import Counts, Doubles, Ints, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene


def variants(subject: Subject, skip: bool = True) -> list[Variant]:
    """All baselines of one subject; without `skip` every ray is cast."""
    cast = cast_every_frame(subject, skip)
    return [plain_numpy(subject), opencv_only(subject), cast, *row_by_row_variants(subject)]


def plain_numpy(subject: Subject) -> Variant:
    """The formulas written down in numpy, on whole arrays; without noise."""
    rows, (direct, ambient) = subject.sight.row.astype(np.float32), (subject.sight.direct, subject.sight.ambient)
    sensor = subject.sensor

    def counts(index: int) -> Doubles:
        gate = subject.gates[index]
        light = weights(gate.windows, rows) * direct + gate.periods * ambient
        return to_counts(light, sensor)

    def run(index: int) -> Counts:
        return np.floor(counts(index) + 0.5).astype(np.uint16)

    edges = edge_error(subject, number_types(subject.rig.projector.lens.height)[1].drawn)
    return Variant("baseline", "straightforward numpy", run, counts, None, edges, array_bytes(rows, direct, ambient))


class OpenCvFrame:
    """A frame by OpenCV's functions alone, into arrays made once; without noise."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject
        self._rows = subject.sight.row.astype(np.float32)
        gain = subject.sensor.counts_per_unit
        self._direct, self._ambient = subject.sight.direct * gain, subject.sight.ambient * gain
        self._low, self._high, self._weight, self._light = (np.empty(subject.shape, np.float32) for _ in range(4))
        self._hit = np.empty(subject.shape, np.uint8)
        self.frame = np.empty(subject.shape, np.uint16)
        self._edges = [_columns(gate.windows) for gate in subject.gates]

    def _weigh(self, index: int) -> None:
        low, last, inside, outside = self._edges[index]
        width = self._subject.shape[1]
        cv2.repeat(low, 1, width, dst=self._low)
        cv2.repeat(last, 1, width, dst=self._high)
        cv2.inRange(self._rows, self._low, self._high, dst=self._hit)
        cv2.repeat(outside, 1, width, dst=self._weight)
        cv2.repeat(inside, 1, width, dst=self._low)
        cv2.copyTo(self._low, self._hit, dst=self._weight)
        cv2.multiply(self._direct, self._weight, dst=self._light)

    def run(self, index: int) -> None:
        """The frame: OpenCV rounds to the nearest count."""
        self._weigh(index)
        self._add_ambient(index, self.frame, cv2.CV_16U)
        cv2.threshold(self.frame, self._subject.sensor.max_count, 0, cv2.THRESH_TRUNC, dst=self.frame)

    def counts(self, index: int) -> Doubles:
        """The same before rounding."""
        self._weigh(index)
        self._add_ambient(index, self._light, cv2.CV_32F)
        return np.minimum(self._light, self._subject.sensor.max_count).astype(np.float64)

    def _add_ambient(self, index: int, out: NDArray[Any], kind: int) -> None:
        periods, black = self._subject.gates[index].periods, self._subject.sensor.black_count
        cv2.addWeighted(self._light, 1.0, self._ambient, periods, black, dst=out, dtype=kind)

    def kept_bytes(self) -> int:
        """All arrays."""
        arrays = (self._rows, self._direct, self._ambient, self._low, self._high, self._weight, self._light)
        return array_bytes(arrays, self._hit, self.frame)


def opencv_only(subject: Subject) -> Variant:
    """The frame made with OpenCV's functions alone."""
    frame = OpenCvFrame(subject)
    edges = edge_error(subject, number_types(subject.rig.projector.lens.height)[1].drawn)
    return Variant("baseline", "OpenCV only", frame.run, frame.counts, None, edges, frame.kept_bytes())


def _columns(windows: RowWindows) -> tuple[Singles, Singles, Singles, Singles]:
    """low <= r < high as columns of low <= r <= the float32 below high, and both weights."""
    exact = kernel_windows(windows)
    last = np.nextafter(exact.high, np.float32(-np.inf))
    low, last, inside, outside = (
        np.ascontiguousarray(part[:, None], np.float32) for part in (exact.low, last, exact.inside, exact.outside)
    )
    return low, last, inside, outside


def cast_every_frame(subject: Subject, skip: bool = True) -> Variant:
    """Nothing cached: cast one ray per pixel, and gate and expose what it meets, for every frame."""
    noise = noise_pool(np.random.default_rng(0), subject.shape[1]).frame(0, 0)
    out = np.empty(subject.shape, np.uint16)

    def cast() -> Plates:
        buffers = render(subject.rig, subject.scene, skip=skip)
        return Plates(buffers.projector_row, mono(buffers.direct), mono(buffers.ambient), subject.sensor)

    def run(index: int) -> None:
        gate = subject.gates[index]
        expose_fast(cast(), kernel_windows(gate.windows), gate.periods, noise, out)

    kept: list[Plates] = []

    def counts(index: int) -> Doubles:
        kept.extend([] if kept else [cast()])
        gate, silent = subject.gates[index], noise._replace(step=np.float32(0))
        fine = fine_response(gate_response(kept[0], gate))
        kernels.expose(kept[0].planes, kernel_windows(gate.windows), fine, silent, out)
        return read_fine(out, subject)

    edges = edge_error(subject, number_types(subject.rig.projector.lens.height)[1].drawn)
    return Variant(
        "ray casting", "cast every frame, 1 ray", run, counts, None, edges, array_bytes(out), gates=1, slow=True
    )


def row_by_row(rig: Rig, scene: Scene, settings: GateSettings, projector_rows: Iterable[int]) -> Doubles:
    """The paper's simulation: light one projector row, render, keep the camera rows exposed at that moment, add up.

    Returns luminance (H, W) float64 of the projector's light alone. The row counts as lit at the middle of its time.
    """
    windows = row_windows(rig, settings)
    total = np.zeros((rig.camera.lens.height, rig.camera.lens.width))
    for row in projector_rows:
        buffers = render(rig, scene)
        add_rows(windows, mono(buffers.direct), buffers.projector_row, [row], total)
    return total


def add_rows(
    windows: RowWindows, direct: Singles, lit_by: Singles, projector_rows: Iterable[int], total: Doubles
) -> None:
    """Add what these projector rows, one after the other, light of `direct` (H, W) to `total`."""
    whole = np.floor(lit_by)
    for row in projector_rows:
        total += row_weights(windows, row)[:, None] * np.where(whole == row, direct, 0)


def row_weights(windows: RowWindows, row: int) -> Ints:
    """How often each camera row records a projector row that is lit as a whole: `gate.weights`, row by row."""
    hit = (windows.low <= row + 0.5) & (row + 0.5 < windows.high)
    return np.where(hit, windows.inside, windows.outside)


def row_by_row_variants(subject: Subject) -> list[Variant]:
    """One projector row of it, as a share of all; and all rows on rays cast once."""
    rig, scene = subject.rig, subject.scene
    count = rig.projector.lens.height

    def counts(index: int) -> Doubles:
        # The sum over all rows in closed form: each pixel's light comes from one row, and has that row's weight.
        gate, row = subject.gates[index], subject.sight.row
        middles = np.where(row < 0, -1, np.floor(row) + 0.5)
        light = weights(gate.windows, middles) * subject.sight.direct.astype(np.float64)
        return to_counts(light + gate.periods * subject.sight.ambient, subject.sensor)

    def one_row(index: int) -> Doubles:
        return row_by_row(rig, scene, subject.gates[index].settings, [count // 2])

    lit_by = subject.sight.row.astype(np.float32)

    def some_rows(index: int) -> None:
        add_rows(
            subject.gates[index].windows, subject.sight.direct, lit_by, range(0, count, 12), np.zeros(lit_by.shape)
        )

    edges = edge_error(subject, lambda edge: np.ceil(edge - 0.5))
    kept = array_bytes(subject.sight.direct, lit_by)
    return [
        Variant("baseline", "row by row", one_row, counts, None, edges, kept, 1 / count, gates=1, slow=True),
        Variant("baseline", "row by row, cast once", some_rows, counts, None, edges, kept, 1 / 12, gates=1, slow=True),
    ]
