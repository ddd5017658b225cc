"""Airlight: the light that fog scatters once, prepared so that any gate costs a few look-ups a pixel.

The exact integral (`airlight_kernels`) is laid once into a table of prefix sums over inverse depth (`airlight_table`),
coarse across the image, where airlight is smooth; a gate reads two profiles of it a camera row (`airlight_gate`).
Limits cut it at full resolution, and what they keep the projector's light from is missing (`lit_depth`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from slopegate.core.gating.gate import RowWindows
from slopegate.core.light import airlight_gate as gate
from slopegate.core.light import airlight_table as table
from slopegate.core.light.airlight_exact import make_optics
from slopegate.core.light.airlight_gate import EdgePixels, Profiles, ProjectorRows, RowEdges
from slopegate.core.light.airlight_kernels import Optics
from slopegate.core.light.airlight_table import TILE, AirTable, Limits
from slopegate.core.light.lit_depth import LitDepth
from slopegate.core.light.part import Filter, PartName
from slopegate.core.render.fog import Medium, medium_of
from slopegate.core.render.render import Buffers, Cancelled, Progress, Region, make_tracer
from slopegate.core.render.tracing import RAYS_PER_BAND
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.rig.triangulate import to_projector_axes
from slopegate.core.scene.scene import Scene

_NEAREST_PER_M: Final = 1e9
"""Largest inverse depth of a node: 1 nm before the camera."""
_HALF_WAY: Final = 0.7
"""Optical depth beyond the near end at which half of a dense fog's light is come by."""
_BEND: Final = 65
"""Rows and columns of the table of a distorted projector's slopes."""
_CREASE: Final = 1e-3
"""Second difference of inverse depth, as a share of it, from which on a pixel's rays are looked at one by one."""


@dataclass(frozen=True)
class TableSize:
    """How fine the table is: pixels from one coarse ray to the next, and steps along each."""

    pixels: int = 4
    nodes: int = 180

    def __post_init__(self) -> None:
        require(1 <= self.pixels <= TILE, "pixels", self.pixels, f"a whole number from 1 to {TILE}")
        require(2 <= self.nodes <= 10000, "nodes", self.nodes, "a whole number from 2 to 10000")


class Airlight:
    """What fog scatters once towards the camera: `part.LightPart`. Grey, so alike for every filter.

    `add` uses room of its own: one call at a time. Moving objects: `follow` takes over where surfaces are, and with a
    time, whose shadows fall where.
    """

    def __init__(
        self, rig: Rig, scene: Scene, inverse_depth: Singles, time_s: float, size: TableSize, samples: int
    ) -> None:
        """Use `prepare_airlight`, which fills the table."""
        medium = medium_of(scene.fog)
        assert medium is not None
        self._rig, self._optics, self._medium = rig, make_optics(rig), medium
        lens = rig.camera.lens
        self._samples = samples
        self._shade = LitDepth(rig, scene, time_s)
        self._inverse_depth = inverse_depth.copy()
        directions = coarse_rays(rig, size.pixels)
        self._spans, self._partly, self._lit = _spans(self._optics, medium, directions)
        shape = directions.shape[:2]
        seen = np.ascontiguousarray(to_projector_axes(rig, directions)[0].transpose(0, 2, 1), np.float32)
        rows = _row_nodes(self._optics, medium, directions, self._spans)
        light = np.zeros((shape[0], size.nodes + 1, shape[1]), np.float32)
        self.table = AirTable(light, rows, directions, seen, size.pixels)
        self._raster = _raster(rig, self.table)
        # The light between nodes without shadows: kept where shadows may move, else of one row at a time.
        self._cells = np.empty((shape[0] if scene.moving else 1, size.nodes, shape[1]), np.float32)
        tiles = (lens.height, ceil(lens.width / TILE))
        planes = np.zeros((lens.height, lens.width), np.float32), np.zeros(tiles, np.float32)
        self._limits = Limits(planes[0], planes[1], planes[1].copy())
        self._edges = EdgePixels(
            np.zeros(0, np.int32), np.zeros((0, 1, 1), np.float32), np.zeros(lens.height + 1, np.int64)
        )
        profile = [np.zeros(shape[1], np.float32) for _ in range(6)]
        first, last, *others = profile
        self._room = Profiles(first, last, others[0], others[1], others[2], others[3], np.zeros(lens.width, np.float32))

    @property
    def name(self) -> PartName:
        """Which part it is."""
        return "airlight"

    @property
    def memory_bytes(self) -> int:
        """What the table and its planes take."""
        arrays = (*self.table[:4], *self._limits, self._cells, self._edges.surface, self._inverse_depth)
        return sum(array.nbytes for array in arrays)

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add what these windows record of it to out: `part.LightPart.add`."""
        if not self._lit:
            return
        flat = out.view()
        flat.shape = (len(out), -1)  # raises where that would take a copy, which nobody would see
        edges = _row_edges(self._rig.projector.lens, windows)
        gate.add_gate(self.table, self._raster, edges, self._limits, self._edges, self._samples, self._room, flat)

    def follow(self, buffers: Buffers, region: Region) -> None:
        """Take over where the surfaces in a region are now. Shadows in the fog stay as they were."""
        box = (region.rows.start, region.rows.stop, region.columns.start, region.columns.stop)
        self._inverse_depth[region.rows, region.columns] = buffers.inverse_depth[region.rows, region.columns]
        self._clip(box)

    def _clip(self, box: table.Box) -> None:
        table.fill_limits(self._optics, self._medium, self.table, self._partly, self._inverse_depth, box, self._limits)

    def fill(self, progress: Progress | None) -> None:
        """Fill the table, coarse row by coarse row, and find what the surfaces cut off."""
        count = len(self.table.rows)
        for coarse in range(count):
            if progress is not None and not progress(coarse / count):
                raise Cancelled("Preparing airlight was stopped")
            cells = self._cells[coarse % len(self._cells)]
            table.fill_cells(self._optics, self._medium, self.table, self._spans, coarse, cells)
            table.add_up(self._optics, self.table, self._shade.map, coarse, (0, cells.shape[1]), cells)
        height, width = self._inverse_depth.shape
        self._clip((0, height, 0, width))

    def look_closer(self, scene: Scene, time_s: float) -> None:
        """Give the pixels in which surfaces end samples x samples rays with surfaces of their own."""
        found: Bools = np.empty(self._inverse_depth.shape, np.bool_)
        table.find_edges(self._inverse_depth, _CREASE, found)
        rows, columns = np.nonzero(found)
        n = self._samples
        offsets = (np.arange(n) + 0.5) / n
        places = np.empty((len(rows), n, n, 2))
        places[..., 0] = columns[:, None, None] + offsets
        places[..., 1] = rows[:, None, None] + offsets[:, None]
        flat = places.reshape(-1, 2)
        tracer = make_tracer(self._rig, scene)
        bodies = tracer.still() + tracer.moving(time_s)
        light = np.empty(len(flat), np.float32)
        for start in range(0, len(flat), RAYS_PER_BAND):
            band = slice(start, start + RAYS_PER_BAND)
            inverse = tracer.trace(flat[band, 0], flat[band, 1], bodies).inverse_depth.astype(np.float64)
            table.fill_edge_pixels(
                self._optics, self._medium, self.table, self._partly, flat[band], inverse, light[band]
            )
        first = np.searchsorted(rows, np.arange(len(found) + 1)).astype(np.int64)
        self._edges = EdgePixels(columns.astype(np.int32), light.reshape(-1, n, n), first)


def prepare_airlight(
    rig: Rig,
    scene: Scene,
    buffers: Buffers,
    light_filter: Filter,
    time_s: float = 0.0,
    progress: Progress | None = None,
    size: TableSize | None = None,
    samples: int = 1,
) -> Airlight:
    """The airlight of a scene whose fog scatters, as `buffers` show it at this time; grey, whatever the filter.

    samples: rays a pixel along each axis, for images that are kept: rows of rays share the camera row's window, and
    pixels in which surfaces end get rays of their own (thinner things than a pixel are missed). `progress` is told the
    share done; Cancelled is raised when it returns False.
    """
    airlight = Airlight(rig, scene, buffers.inverse_depth, time_s, size or TableSize(), samples)
    airlight.fill(progress)
    if samples > 1:
        airlight.look_closer(scene, time_s)
    return airlight


def coarse_rays(rig: Rig, pixels: int) -> Doubles:
    """Directions (h, w, 3), z = 1, of the rays through every so many corners of pixels, the last one or beyond it."""
    lens = rig.camera.lens
    columns, rows = (pixels * np.arange(ceil(size / pixels) + 1.0) for size in (lens.width, lens.height))
    return rig.camera_rays(columns, rows[:, None])


def _spans(optics: Optics, medium: Medium, directions: Doubles) -> tuple[Doubles, bool, bool]:
    """Where coarse rays are lit (h, w, 2), least and greatest w; whether some are nowhere; whether any is.

    Those beside lit ones carry on what these are: between them the table is linear, and `light_before` cuts it off
    pixel by pixel.
    """
    spans = np.empty((*directions.shape[:2], 2))
    table.fill_spans(optics, medium, directions, spans)
    spans[..., 1] = np.minimum(spans[..., 1], _NEAREST_PER_M)
    lit = spans[..., 1] > spans[..., 0]
    height, width = lit.shape
    total, count = np.zeros_like(spans), np.zeros(lit.shape)
    padded, among = np.pad(spans, ((1, 1), (1, 1), (0, 0))), np.pad(lit, 1)
    for down in range(3):
        for across in range(3):
            place = slice(down, down + height), slice(across, across + width)
            total += padded[place] * among[place][..., None]
            count += among[place]
    beside = ~lit & (count > 0)
    spans[beside] = total[beside] / count[beside, None]
    return spans, not lit.all(), bool(lit.any())


def _row_nodes(optics: Optics, medium: Medium, directions: Doubles, spans: Doubles) -> Doubles:
    """`AirTable.rows`: where the nodes of each coarse row stand."""
    lit = spans[..., 1] > spans[..., 0]
    some = lit.any(axis=1)
    if not some.any():
        return np.tile([0.0, 1.0, 0.0, 1.0], (len(spans), 1))
    first = spans[..., 0].min(axis=1, where=lit, initial=np.inf)
    last = spans[..., 1].max(axis=1, where=lit, initial=0.0)
    # Rows in which nothing is lit take the nearest one's: the nodes between them and it are interpolated.
    rows = np.arange(len(spans))
    nearest = rows[some][np.abs(rows[:, None] - rows[some]).argmin(axis=1)]
    first, last = first[nearest], last[nearest]
    middle = directions[nearest, np.argmax(lit[nearest], axis=1)]
    # Thin fog: half of the nodes up to the middle in tau. Dense fog: up to where half of its light is passed.
    tau = 0.5 * (first / (first + optics.kappa) + last / (last + optics.kappa))
    beam = np.linalg.norm(middle - np.minimum(last, 1e3)[:, None] * np.array(optics.offset), axis=1)
    fading = medium.extinction * (np.linalg.norm(middle, axis=1) + beam)
    half = np.maximum(optics.kappa * tau / (1 - tau), 1 / (1 / last + _HALF_WAY / fading))
    p = (first + last - 2 * half) / (last - half)
    q = last * (half - first) / (last - half) - first
    return np.stack([first, last, p, q], axis=1)


def _raster(rig: Rig, made: AirTable) -> ProjectorRows:
    """The projector's rows for `airlight_gate`."""
    lens = rig.projector.lens
    offset = to_projector_axes(rig, made.directions[0, 0])[1]
    o = (float(offset[0]), float(offset[1]), float(offset[2]))
    if not lens.distorted:
        straight = bool((np.ptp(made.seen[:, 1:], axis=2) == 0).all())
        return ProjectorRows(o, 0.0, 1.0, np.zeros((0, 0)), straight)
    # Along each row of the raster x/z rises with the column: y/z at even x/z by linear interpolation.
    columns, rows = np.linspace(0, lens.width, 16 * _BEND), np.linspace(0, lens.height, _BEND)
    x, y = lens.normalise(columns, rows[:, None])
    even = np.linspace(x.min(), x.max(), _BEND)
    bend = np.stack([np.interp(even, x[i], y[i]) for i in range(_BEND)])
    return ProjectorRows(o, float(even[0]), float(even[-1]), bend, False)


def _row_edges(lens: Lens, windows: RowWindows) -> RowEdges:
    edges = np.stack([windows.low, windows.high], axis=1)
    part = (windows.inside - windows.outside).astype(np.float32)
    return RowEdges((edges - lens.cy) / lens.fy, edges / lens.height, part, windows.outside.astype(np.float32))
