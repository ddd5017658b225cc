"""Airlight: the light that fog scatters once, prepared so that any gate costs a few look-ups a pixel.

The exact integral (`airlight_kernels`) is laid once into a table of prefix sums over inverse depth (`airlight_table`),
coarse across the image, where airlight is smooth; a gate reads two profiles of it a camera row (`airlight_gate`).
Surfaces cut it at full resolution, and what they keep the projector's light from is missing (`lit_depth`).

Against `airlight_exact`, as a share of what the brightest ray gets without a gate, 180 nodes and rays 1/100 of the
picture's width apart (a quarter of 400 pixels; four times finer at 1600): at most 1e-3, RMS 1e-4, on ideal and general
rigs, projectors beside the camera and distorted lenses, for fog up to 3 per metre. Where rays enter fog through a side
that they nearly run along: 2e-2 and 5e-4. On rigs that are not ideal, fog of 50 per metre misses by up to 1.2e-2 and of
1000 per metre by up to 0.16 in single pixels, RMS 4e-3. Borders of shadows are blurred over two coarse rays, and moved
by up to half a node's step. Thinner things than two pixels of the projector may cast no shadow.

A pattern is taken as its means over what lies between nodes and between coarse rays (`airlight_pattern`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.gating.gate import RowWindows
from slopegate.core.light import airlight_gate as gate
from slopegate.core.light import airlight_table as table
from slopegate.core.light.airlight_exact import make_optics
from slopegate.core.light.airlight_gate import EdgePixels, Profiles, ProjectorRows, RowEdges
from slopegate.core.light.airlight_kernels import Optics
from slopegate.core.light.airlight_pattern import pattern_sums, show
from slopegate.core.light.airlight_table import TILE, AirTable, Bend, Limits
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
"""Rows and columns of the tables of a distorted projector's lines."""
_SLOPES: Final = 33
"""Projector rows at which the slopes that coarse rays meet them at are kept."""
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

    `add` uses room of its own: one call at a time.
    """

    def __init__(
        self, rig: Rig, scene: Scene, inverse_depth: Singles, time_s: float, size: TableSize, samples: int
    ) -> None:
        """Use `prepare_airlight`, which fills the table."""
        medium, lens = medium_of(scene.fog), rig.camera.lens
        if medium is None:
            raise ValueError("a scene without fog has no airlight")
        self._rig, self._medium, self._optics, self._bend = rig, medium, make_optics(rig), make_bend(rig.projector.lens)
        self._samples, self._inverse_depth = samples, inverse_depth.copy()
        self._shade = LitDepth(rig, scene, time_s)
        directions = coarse_rays(rig, size.pixels)
        spans = np.empty((*directions.shape[:2], 2))
        table.fill_spans(self._optics, medium, self._bend, directions, spans)
        self._reach = _with_neighbours(spans)
        # Behind the farthest surface of a row nothing is seen; but of what rests behind what moves nothing is known.
        seen_to = np.zeros(len(spans)) if scene.moving else _farthest(inverse_depth, size.pixels)
        rows = _row_nodes(self._optics, medium, directions, self._reach, seen_to)
        turned, offset = to_projector_axes(rig, directions)
        seen = np.ascontiguousarray(turned.transpose(0, 2, 1), np.float32)
        height, width = directions.shape[:2]
        light = np.zeros((height, size.nodes + 1, width), np.float32)
        self.table = AirTable(light, rows, directions, seen, size.pixels)
        self._rows = self._projector_rows(offset)
        # The light between nodes without shadows: kept where shadows may move, else of one row at a time.
        self._cells = np.empty((height if scene.moving else 1, size.nodes, width), np.float32)
        self._limits = _empty_limits(lens)
        nobody = np.zeros(0, np.int32), np.zeros((0, 1, 1), np.float32), np.zeros(lens.height + 1, np.int64)
        self._edges, self._edge_depths = EdgePixels(*nobody), np.zeros(0, np.float32)
        self._pattern: Singles | None = None
        # The sums with everything lit, once a pattern was shown.
        self._everything: Singles | None = None
        # Where pixels end in the table, once they were looked up for a pattern.
        self._ends: Singles | None = None
        self._room = _empty_profiles(width, lens.width)

    @property
    def name(self) -> PartName:
        """Which part it is."""
        return "airlight"

    @property
    def memory_bytes(self) -> int:
        """What the table and its planes take."""
        arrays: list[NDArray[np.floating]] = [
            *self.table[:4],
            *self._limits,
            self._rows.slopes,
            self._cells,
            self._edges.beyond,
            self._edge_depths,
            *(kept for kept in (self._everything, self._ends) if kept is not None),
        ]
        return sum(array.nbytes for array in (*arrays, self._inverse_depth, self._shade.map.nearest))

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add what these windows record of it to out: `part.LightPart.add`."""
        flat = out.view()
        flat.shape = (len(out), -1)  # raises where that would take a copy, which nobody would see
        made = self.table, self._rows, _row_edges(self._rig.projector.lens, windows), self._limits
        gate.add_gate(*made, self._edges, self._samples, self._room, flat)

    def light_with(self, pattern: Singles | None) -> None:
        """As `LightPart.light_with` says."""
        if pattern is None and self._everything is None:
            return
        self._pattern = pattern
        if self._everything is None:
            self._everything = self.table.light.copy()
        self._show()

    def _show(self) -> None:
        """Fill the table from the one with everything lit, and read it anew where pixels end."""
        if self._everything is None:
            return
        shape = self._inverse_depth.shape
        if self._pattern is None:
            np.copyto(self.table.light, self._everything)
            table.clip(self.table, self._inverse_depth, (0, shape[0], 0, shape[1]), self._limits)
        else:
            show(self._optics, self.table, self._everything, pattern_sums(self._rig, self.table, self._pattern))
            if self._ends is None:
                self._ends = np.empty((4, *shape), np.float32)
                table.fill_ends(self.table, self._inverse_depth, self._limits, self._ends)
            table.clip_at(self.table, self._ends, self._limits)
        self._read_edges()

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Take over where surfaces are now, and which fog lies in the shadow of what moves."""
        rows, columns = region
        self._inverse_depth[rows, columns] = buffers.inverse_depth[rows, columns]
        self._ends = None
        moved = (rows.start, rows.stop, columns.start, columns.stop)
        if len(self._cells) < len(self.table.rows):  # nothing moves, nothing casts another shadow
            table.clip(self.table, self._inverse_depth, moved, self._limits)
            return
        shaded = self._shade.move(time_s)
        own = _beside(self._inverse_depth, self.table)
        lit = self.table if self._everything is None else self.table._replace(light=self._everything)
        made = self._optics, lit, self._shade.map, own, self._cells, self._inverse_depth
        table.follow(*made, moved, shaded, self._limits)
        self._show()

    def fill(self, progress: Progress | None) -> None:
        """Fill the table, coarse row by coarse row, and find what the surfaces cut off."""
        count, own = len(self.table.rows), _beside(self._inverse_depth, self.table)
        for coarse in range(count):
            if progress is not None and not progress(coarse / count):
                raise Cancelled("Preparing airlight was stopped")
            cells = self._cells[coarse % len(self._cells)]
            table.fill_cells(self._optics, self._medium, self.table, self._reach, coarse, cells)
            table.add_up(self._optics, self.table, self._shade.map, own[coarse], coarse, (0, cells.shape[1]), cells)
        made = self._optics, self._medium, self._bend, self.table
        table.fill_limits(*made, self._inverse_depth, self._limits)

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
        self._edge_depths = np.empty(len(flat), np.float32)
        for start in range(0, len(flat), RAYS_PER_BAND):
            part = flat[start : start + RAYS_PER_BAND]
            traced = tracer.trace(part[:, 0], part[:, 1], bodies)
            self._edge_depths[start : start + RAYS_PER_BAND] = traced.inverse_depth
        first = np.searchsorted(rows, np.arange(len(found) + 1)).astype(np.int64)
        self._edges = EdgePixels(columns.astype(np.int32), np.empty((len(rows), n, n), np.float32), first)
        self._read_edges()

    def _read_edges(self) -> None:
        """Read the table where the rays of edge pixels end."""
        made = self._optics, self._medium, self._bend, self.table
        table.fill_edge_pixels(*made, self._edges.column, self._edges.first, self._edge_depths, self._edges.beyond)

    def _projector_rows(self, offset: Doubles) -> ProjectorRows:
        seen = self.table.seen
        slopes = np.zeros((0, 0, 0), np.float32)
        if self._rig.projector.lens.distorted:
            slopes = np.empty((seen.shape[0], _SLOPES, seen.shape[2]), np.float32)
            table.fill_slopes(self._optics, self._bend, self.table, slopes)
        straight = not slopes.size and bool((np.ptp(seen[:, 1:], axis=2) == 0).all())
        return ProjectorRows((float(offset[0]), float(offset[1]), float(offset[2])), slopes, straight)


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
    """The airlight of a scene with fog, as `buffers` show it at this time; grey, so alike whatever the filter.

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


def _with_neighbours(spans: Doubles) -> Doubles:
    """Spans (h, w, 2) that reach as far as those of the neighbours, across corners too."""
    lit = spans[..., 1] > spans[..., 0]
    first = np.pad(np.where(lit, spans[..., 0], np.inf), 1, constant_values=np.inf)
    last = np.pad(np.where(lit, np.minimum(spans[..., 1], _NEAREST_PER_M), 0.0), 1)
    for axis in (0, 1):
        before, here, after = (
            tuple(slice(*ends) if k == axis else slice(None) for k in (0, 1)) for ends in ((-2,), (1, -1), (2, None))
        )
        first = np.minimum(np.minimum(first[before], first[here]), first[after])
        last = np.maximum(np.maximum(last[before], last[here]), last[after])
    return np.stack([np.where(last > 0, first, 0.0), last], axis=-1)


def _farthest(inverse_depth: Singles, pixels: int) -> Doubles:
    """Least inverse depth of the surfaces about each coarse row, (h,)."""
    count = ceil(len(inverse_depth) / pixels)
    padded = np.full(count * pixels, np.inf)
    padded[: len(inverse_depth)] = inverse_depth.min(axis=1)
    least = np.pad(padded.reshape(count, pixels).min(axis=1), 1, constant_values=np.inf)
    return np.asarray(np.minimum(least[1:], least[:-1]))


def _beside(inverse_depth: Singles, made: AirTable) -> Singles:
    """Least inverse depth (h, w) of the pixels beside each coarse ray."""
    height, width = inverse_depth.shape
    rows = made.step * np.arange(made.seen.shape[0])
    columns = made.step * np.arange(made.seen.shape[2])
    below, right = np.minimum(rows, height - 1), np.minimum(columns, width - 1)
    above, left = np.clip(rows - 1, 0, height - 1), np.clip(columns - 1, 0, width - 1)
    corners = [inverse_depth[row[:, None], column] for row in (above, below) for column in (left, right)]
    return np.asarray(np.minimum.reduce(corners))


def _row_nodes(optics: Optics, medium: Medium, directions: Doubles, spans: Doubles, seen_to: Doubles) -> Doubles:
    """`AirTable.rows`: where the nodes of each coarse row stand, none beyond the w that is seen_to (h,)."""
    lit = spans[..., 1] > spans[..., 0]
    some = lit.any(axis=1)
    if not some.any():
        return np.tile([0.0, 1.0, 0.0, 1.0], (len(spans), 1))
    first = spans[..., 0].min(axis=1, where=lit, initial=np.inf)
    last = spans[..., 1].max(axis=1, where=lit, initial=0.0)
    first = np.minimum(np.maximum(first, seen_to), 0.999 * last)
    # Rows in which nothing is lit take the nearest one's: the nodes between them and it are interpolated.
    rows = np.arange(len(spans))
    nearest = rows[some][np.abs(rows[:, None] - rows[some]).argmin(axis=1)]
    first, last = first[nearest], last[nearest]
    # Half of the nodes up to the middle in tau; in dense fog up to where half of its light is passed.
    tau = 0.5 * (first / (first + optics.kappa) + last / (last + optics.kappa))
    middle = directions[nearest, np.argmax(lit[nearest], axis=1)]
    beam = np.linalg.norm(middle - np.minimum(last, 1e3)[:, None] * np.array(optics.offset), axis=1)
    fading = medium.extinction * (np.linalg.norm(middle, axis=1) + beam)
    half = np.maximum(optics.kappa * tau / (1 - tau), 1 / (1 / last + _HALF_WAY / fading))
    p = (first + last - 2 * half) / (last - half)
    q = last * (half - first) / (last - half) - first
    return np.stack([first, last, p, q], axis=1)


def make_bend(lens: Lens) -> Bend:
    """Where the lines of a distorted projector lie: along each, what is interpolated rises evenly."""
    if not lens.distorted:
        return Bend((0.0, 0.0), (1.0, 1.0), np.zeros((0, 0)), np.zeros((0, 0)))
    even, fine = np.linspace(0, 1, _BEND), np.linspace(0, 1, 16 * _BEND)
    x, y = lens.normalise(fine * lens.width, even[:, None] * lens.height)
    left, right = float(x.min()), float(x.max())
    rows = np.stack([np.interp(left + (right - left) * even, x[i], y[i]) for i in range(_BEND)])
    x, y = lens.normalise(even[:, None] * lens.width, fine * lens.height)
    top, bottom = float(y.min()), float(y.max())
    columns = np.stack([np.interp(top + (bottom - top) * even, y[i], x[i]) for i in range(_BEND)])
    return Bend((left, top), (right, bottom), rows, columns)


def _row_edges(lens: Lens, windows: RowWindows) -> RowEdges:
    edges = np.stack([windows.low, windows.high], axis=1)
    part = (windows.inside - windows.outside).astype(np.float32)
    return RowEdges((edges - lens.cy) / lens.fy, edges / lens.height, part, windows.outside.astype(np.float32))


def _empty_limits(lens: Lens) -> Limits:
    planes, tiles = (lens.height, lens.width), (lens.height, ceil(lens.width / TILE))
    beyond, every, far, near = np.zeros((4, *planes), np.float32)
    least_beyond, most_beyond, least_every = np.zeros((3, *tiles), np.float32)
    return Limits(beyond, every, far, near, least_beyond, most_beyond, least_every)


def _empty_profiles(coarse: int, width: int) -> Profiles:
    low, high, start, end, above, below, first, last = np.zeros((8, coarse), np.float32)
    near, far, pixels = np.zeros((3, width), np.float32)
    return Profiles(low, high, start, end, above, below, first, last, near, far, pixels[None])
