"""The near halo: light of a lit surface that fog turns on its way to the camera (`halo` says who draws the rest).

Fog lays a blur over what stands in it. The light arrives in the row of the pixel in which it is seen and shares that
row's window, but it was lit by the projector row of the pixel that it comes from. So a gate cuts the halo across rows,
and only there: this is why a gated image of an edge is sharper, and not only richer in contrast.

`ScatterSums` adds up all pairs of pixels. It is exact but for what it takes to be true: between surface and ray nothing
stands, surfaces are matt and flat over a pixel, and inside the halo rays enter the fog at about the same distance. What
fog turns several times comes on top of what it turns once, by a factor of distance and angle (`several_turns`).

`Scatter` is for live images. The halo of each place becomes a sum of Gaussians, whose weights follow from its distance,
tilt and fog; of a Gaussian the sum over columns and that over rows can be taken one after the other, the one with the
gate's weights and the other without. Wide Gaussians are summed over wider cells. Measured against the sums over planes
tilted by up to 70 degrees, in shares of the brightest halo: root mean square below 1.5 % fully lit and 2.5 % behind
thin gates, the mean within 1 and 3 % of itself, and at most 14 % next to sharp edges. And it does not know that what
stands far in front of a bright surface has little fog before it: it lays the whole halo of the surface over it.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from slopegate.core.exposure.blur import blur_along, gaussian_taps
from slopegate.core.exposure.kernels import TILE
from slopegate.core.exposure.patterned import patterned
from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.halo import HALO_RADIUS, MOST_TURNS
from slopegate.core.light.part import Filter
from slopegate.core.light.scatter_cells import (
    HaloCells,
    HaloLots,
    enlarge,
    fill_cells,
    gather_spans,
    relight,
    weigh_cells,
    widen,
)
from slopegate.core.light.scatter_kernels import HaloLaw, RayEnds, Senders, Turns, enter, halo_sums
from slopegate.core.light.several_turns import WIDEST_ANGLE, make_several
from slopegate.core.render.fog import Medium, medium_of
from slopegate.core.render.render import Buffers, Cancelled, Progress, Region
from slopegate.core.render.tracing import point
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.scene.scene import Scene

MOST_THICKNESS = 100.0
"""Optical thickness beyond which no light is left."""

_Q_LOW, _Q_STEP, _Q_COUNT = -6.0, 1 / 64, 20 * 64
_X_COUNT = 17


def make_turns(g: float, most_x: float) -> Turns:
    """Tables for x up to most_x. Between entries values are off by at most 2e-6 and (most_x / 90)^2 of themselves."""
    x = np.linspace(0.0, max(most_x, 1e-9), _X_COUNT)
    edges = _Q_LOW + _Q_STEP * np.arange(_Q_COUNT)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    q = (edges[:-1, None] + 0.5 * _Q_STEP * (1 + nodes)).ravel()
    # dT = sin T dq. Written with 1 - cos T, so that a g close to 1 loses nothing.
    cosine, sine = np.tanh(q), 1 / np.cosh(q)
    rest = (1 - g) ** 2 + 2 * g * sine * np.exp(-q)  # 1 - cos T = sin T tan(T / 2)
    density = (1 - g * g) / (4 * np.pi * rest**1.5) * sine * np.exp(-x[:, None] * np.exp(-q))
    tables = []
    for factor in (cosine, sine):
        cells = (density * factor).reshape(len(x), -1, 3) @ weights * (0.5 * _Q_STEP)
        sums = np.zeros((len(x), _Q_COUNT))
        sums[:, :-1] = np.cumsum(cells[:, ::-1], axis=1)[:, ::-1]
        tables.append(sums)
    return Turns(np.stack(tables, axis=2), float(x[1]), _Q_LOW, _Q_STEP)


def make_source(lens: Lens, inverse_depth: Singles, slopes: bool = True) -> Senders:
    """What the pixels (H, W) of this camera show as senders of light.

    slopes False: every surface faces the camera, for depth that is too noisy to differentiate.
    """
    columns, rows = np.meshgrid(np.arange(lens.width + 1.0), np.arange(lens.height + 1.0))
    x, y = lens.normalise(columns[:-1, :-1] + 0.5, rows[:-1, :-1] + 0.5)
    corner_x, corner_y = lens.normalise(columns, rows)
    (ax, ay), (bx, by) = ((c[1:, 1:] - c[:-1, :-1], c[1:, :-1] - c[:-1, 1:]) for c in (corner_x, corner_y))
    steradian = np.abs(ax * by - ay * bx) / 2 / (1 + x * x + y * y) ** 1.5
    if slopes:
        log_x, log_y = _slopes(lens, inverse_depth)
    else:
        # The plane across the ray: its inverse depth is proportional to 1 + x x0 + y y0.
        log_x, log_y = x / (1 + x * x + y * y), y / (1 + x * x + y * y)
    single = (a.astype(np.float32) for a in (x, y, inverse_depth, steradian, log_x, log_y))
    return Senders(*single)


def _slopes(lens: Lens, inverse_depth: Singles) -> tuple[Doubles, Doubles]:
    """Gradient of log inverse depth by tangents, exact on planes; 0 where there is no surface."""
    w = inverse_depth.astype(np.float64)
    across, down = (_step(w, w > 0, axis) for axis in (1, 0))
    scale = np.divide(1, w, out=np.zeros_like(w), where=w > 0)
    return across * lens.fx * scale, down * lens.fy * scale


def _step(values: Doubles, known: Bools, axis: int) -> Doubles:
    """What values (H, W) change by from one pixel to the next: of the steps before and after it the smaller, or 0."""
    step = np.where(np.delete(known, 0, axis) & np.delete(known, -1, axis), np.diff(values, axis=axis), np.inf)
    edge = np.full_like(np.take(values, [0], axis=axis), np.inf)
    before, after = np.concatenate([edge, step], axis), np.concatenate([step, edge], axis)
    smaller = np.where(np.abs(after) < np.abs(before), after, before)
    return np.where(np.isfinite(smaller), smaller, 0.0)


def rows_in_pixel(rig: Rig, projector_row: Singles) -> Singles:
    """How many projector rows light a pixel (H, W); where its neighbours are unlit, what it would span at infinity."""
    r, lit = projector_row.astype(np.float64), projector_row >= 0
    spanned = np.abs(_step(r, lit, 0)) + np.abs(_step(r, lit, 1))
    spanned = np.where(spanned > 0, spanned, rig.projector.lens.fy / rig.camera.lens.fy)
    # A blurred projector lights from a few rows more: a wider span of the same variance.
    return np.sqrt(spanned**2 + 12 * rig.projector.blur_px**2).astype(np.float32)


def make_sink(rig: Rig, medium: Medium, source: Senders) -> RayEnds:
    """Where the camera's rays are in fog before they meet their surfaces."""
    sink = RayEnds(np.empty_like(source.x), np.empty_like(source.x))
    enter(medium, point(rig.camera_centre_m), source, sink)
    return sink


def spread_of_pixels(lens: Lens, blur_px: float = 0.0) -> Doubles:
    """What averaging over two pixels' areas, and the lens's blur, make of 1/r, (2 S + 1, 2 S + 1); see `halo_sums`.

    By the polar integral about each offset, in which 1/r is no pole. Beyond S it is 1 within (1/6 + blur^2) / (2 S^2).
    Blur is taken to be narrow against the halo, whose outer end it leaves where it is: one of a tenth of the halo's
    radius loses 2 % of it.
    """
    size, fine, wide = 8 + int(np.ceil(5 * blur_px)), 64, 1.5 * (1 + 5 * blur_px)
    grid = np.arange(-(size + 4) * fine, (size + 4) * fine + 1) / fine
    tent = np.maximum(1 - np.abs(grid), 0)
    if blur_px > 0:
        gauss = np.exp(-0.5 * (grid / blur_px) ** 2)
        tent = np.convolve(tent, gauss / gauss.sum(), mode="same")
    aspect = lens.fx / lens.fy
    nodes = (np.arange(256) + 0.5) / 256
    out = np.empty((2 * size + 1, 2 * size + 1))
    for m in range(size + 1):
        for n in range(size + 1):
            radius = float(np.hypot(n, m * aspect))
            half = np.pi if radius < 2 * wide else np.arcsin(wide / radius)
            angles = np.arctan2(m * aspect, n) + half * (2 * nodes - 1)
            low, high = max(radius - wide, 0.0), radius + wide
            radii = (low + (high - low) * nodes)[:, None]
            weight = np.interp(m - radii * np.sin(angles) / aspect, grid, tent, left=0, right=0)
            weight *= np.interp(n - radii * np.cos(angles), grid, tent, left=0, right=0)
            mean = weight.mean() * 2 * half * (high - low) / aspect
            for i in {size - m, size + m}:
                for j in {size - n, size + n}:
                    out[i, j] = mean * radius if radius else 1 / mean
    return out


class ScatterSums:
    """The part `scatter`, summed over all pairs of pixels: exact, and slow. A few seconds for 400 x 300 pixels."""

    name: Final = "scatter"

    def __init__(
        self,
        rig: Rig,
        scene: Scene,
        buffers: Buffers,
        colours: Filter,
        progress: Progress | None = None,
        max_order: int | None = None,
    ) -> None:
        """`buffers`: what this rig sees of this scene. `progress` is told the share of an `add`, which it can end.

        max_order: how often light may change its direction, the surface included; None for as often as `halo` says.
        """
        self._rig, self._medium, self._progress, self._colours = rig, medium_of(scene.fog), progress, colours
        self._row, self._width = buffers.projector_row, rows_in_pixel(rig, buffers.projector_row)
        self._light = sent_light(buffers.direct, colours)
        if self._medium is None:
            return
        spread = spread_of_pixels(rig.camera.lens, rig.camera.blur_px)
        self._law = make_law(rig, self._medium, buffers, scene.capture is None, spread, turns_within(max_order))

    def add(self, windows: RowWindows, out: Singles) -> None:
        """As `LightPart.add` says. Raises Cancelled when `progress` returns False, and then nothing is added."""
        medium = self._medium
        if medium is None or medium.scattering == 0 or not self._light.any():
            return
        lens, found = self._rig.camera.lens, np.zeros_like(self._light)
        held = windows.low, windows.high, windows.inside.astype(np.float32), windows.outside.astype(np.float32)
        for first in range(0, lens.height, 16):
            if self._progress is not None and not self._progress(first / lens.height):
                raise Cancelled("Rendering was stopped")
            lit_by = self._row, self._width
            halo_sums(self._law, self._light, lit_by, held, (first, min(first + 16, lens.height)), found)
        out += seen_light(found, self._colours)


def make_law(rig: Rig, medium: Medium, buffers: Buffers, slopes: bool, spread: Doubles, most_turns: int) -> HaloLaw:
    """The law of all pairs; slopes as for `make_source`, spread from `spread_of_pixels` for sums over them."""
    lens = rig.camera.lens
    source = make_source(lens, buffers.inverse_depth, slopes)
    sink, pixel = make_sink(rig, medium, source), (1 / lens.fx, 1 / lens.fy)
    turns = make_turns(medium.g, most_x(medium, source, HALO_RADIUS))
    wide = make_turns(medium.g, most_x(medium, source, WIDEST_ANGLE))
    several = make_several(medium, wide, source, sink, most_turns)
    return HaloLaw(turns, several, medium.scattering, medium.extinction, source, sink, spread, pixel)


def turns_within(max_order: int | None) -> int:
    """How often fog may turn what `scatter` draws, where light changes its direction at most so often."""
    return MOST_TURNS if max_order is None else min(max_order - 1, MOST_TURNS)


def sent_light(direct: Singles, colours: Filter) -> Singles:
    """Direct light (H, W, 3) as planes (H, W, C) whose halos have to be known: one where that is enough."""
    if colours == "mono":
        return mono(direct)[:, :, None]
    grey = bool((direct[:, :, :1] == direct).all())
    return np.ascontiguousarray(direct[:, :, :1]) if grey else direct


def seen_light(planes: Singles, colours: Filter) -> Singles:
    """Halos (H, W, C) as an image of the filter, (H, W) or (H, W, 3)."""
    if colours == "rgb":
        return np.broadcast_to(planes, (*planes.shape[:2], 3))
    return planes[:, :, 0] if planes.shape[2] == 1 else bayer_rg(planes)


def most_x(medium: Medium, source: Senders, widest: float) -> float:
    """Largest sigma_t h of any pair whose rays are up to `widest` apart (a sine), where light is left to speak of."""
    nearest = float(source.inverse_depth[source.inverse_depth > 0].min(initial=np.inf))
    longest = float(np.sqrt(1 + source.x**2 + source.y**2).max()) / nearest
    return widest * min(medium.extinction * longest, MOST_THICKNESS)


class _Gaussian(NamedTuple):
    """One of the Gaussians: its deviation in cells, and how many halvings of the columns its own cells are wide."""

    sigma: float
    halvings: int


class _Layer(NamedTuple):
    """What one Gaussian adds: for every colour two lots, and the taps down the columns and along the rows."""

    lots: tuple[tuple[HaloLots, ...], ...]
    down: Singles
    along: Singles
    halvings: int


class _Blocks(NamedTuple):
    """Cells of one size, in rows and columns of pixels, and the weights of all Gaussians in them, as `weigh_cells`."""

    cells: HaloCells
    size: tuple[int, int]
    weights: Doubles


MOST_CELLS_ACROSS = 20.0
"""HaloCells of the live halo to its radius, at least."""
FINEST, RATIO, WIDEST = 0.65, 1.7, 0.36
"""Deviations of its Gaussians: the smallest in cells, each to the next, the largest in radii of the halo."""


class Scatter:
    """The part `scatter` for live images, of the same light as `ScatterSums`."""

    name: Final = "scatter"

    def __init__(self, rig: Rig, scene: Scene, buffers: Buffers, colours: Filter, max_order: int | None = None) -> None:
        """`buffers`: what this rig sees of this scene. max_order: as for `ScatterSums`."""
        self._rig, self._colours = rig, colours
        self._layers, self._total, self._patterned = list[_Layer](), list[Singles](), False
        medium, light = medium_of(scene.fog), sent_light(buffers.direct, colours)
        if medium is None or medium.scattering == 0 or not light.any():
            return
        lens = rig.camera.lens
        self._raster = rig.projector.lens.height
        self._size = cell_size(lens)
        # Of their own: what moves keeps its halo.
        self._light, self._row, self._column = (
            array.copy() for array in (light, buffers.projector_row, buffers.projector_column)
        )
        law = make_law(rig, medium, buffers, scene.capture is None, np.zeros((1, 1)), turns_within(max_order))
        spans = rows_in_pixel(rig, buffers.projector_row)
        self._gaussians = choose_gaussians(HALO_RADIUS * lens.fx / self._size)
        steps, fit = fit_gaussians(HALO_RADIUS * lens.fx / self._size, self._gaussians)
        self._blocks: dict[int, _Blocks] = {}
        for halvings in sorted({each.halvings for each in self._gaussians}):
            size = self._size, self._size << halvings
            cells = make_cells(law, light, buffers.projector_row, spans, size)
            weights = np.zeros((*cells.first.shape, len(self._gaussians), 2))
            weigh_cells(law, cells, size, steps * (self._size / lens.fx), fit, weights)
            self._blocks[halvings] = _Blocks(cells, size, weights)
        self._lay({halvings: blocks.cells for halvings, blocks in self._blocks.items()})

    def _lay(self, cells: dict[int, HaloCells]) -> None:
        """Take the light of these cells, by how many halvings they are wide."""
        self._layers = [
            self._layer(cells[each.halvings], self._blocks[each.halvings].weights[..., place, :], each)
            for place, each in enumerate(self._gaussians)
        ]
        self._total = [
            self._summed(colour, tuple(np.full(self._rows, v, np.float32) for v in (-1e9, 1e9, 1, 1)))
            for colour in range(self._light.shape[2])
        ]

    def _layer(self, cells: HaloCells, weights: Doubles, each: _Gaussian) -> _Layer:
        """Its light, and its taps less the blur that cells and what is drawn between them add by themselves."""
        camera, wide = self._rig.camera, 2**each.halvings
        lots = tuple(
            tuple(make_lots(cells, weights[lot], lot, colour, wide) for lot in range(2))
            for colour in range(cells.light.shape[3])
        )
        added = (camera.blur_px / self._size) ** 2 - 0.25 * (1 - self._size**-2)
        stretch = (camera.lens.fy / camera.lens.fx) ** 2
        down = np.sqrt(max(stretch * each.sigma**2 + added, 0))
        along = np.sqrt(max(each.sigma**2 + added - (wide * wide - 1) / 3, 0)) / wide
        return _Layer(lots, gaussian_taps(float(down), 3.0), gaussian_taps(float(along), 3.0), each.halvings)

    @property
    def _rows(self) -> int:
        return len(self._layers[0].lots[0][0].light)

    def add(self, windows: RowWindows, out: Singles) -> None:
        """As `LightPart.add` says."""
        if not self._layers:
            return
        # Of what the window takes and what it leaves the smaller is summed, and the whole known.
        middles = np.minimum(np.arange(self._rows) * self._size + self._size // 2, len(out) - 1)
        low, high = windows.low[middles], windows.high[middles]
        taken = np.clip(high, 0, self._raster) - np.clip(low, 0, self._raster)
        inside, outside = (w[middles].astype(np.float32) for w in (windows.inside, windows.outside))
        base = np.where(2 * taken > self._raster, inside, outside)
        held = low.astype(np.float32), high.astype(np.float32), inside - base, outside - base
        planes = [out] if self._colours == "mono" else [np.zeros(out.shape[:2], np.float32) for _ in self._total]
        lines = np.empty((2, self._total[0].shape[1] * self._size), np.float32)
        for colour, (total, plane) in enumerate(zip(self._total, planes, strict=True)):
            cells = base[:, None] * total
            if held[2].any() or held[3].any():
                cells += self._summed(colour, held)
            # What is taken from the whole may leave a rounding below nothing.
            enlarge(np.maximum(cells, 0), self._size, lines, plane)
        if self._colours != "mono":
            out += seen_light(np.stack(planes, axis=2), self._colours)

    def light_with(self, pattern: Singles | None) -> None:
        """As `LightPart.light_with` says: each pixel sends what the pattern leaves of its direct light."""
        unchanged = pattern is None and not self._patterned
        self._patterned = pattern is not None
        if not self._layers or unchanged:
            return
        lit = {halvings: blocks.cells for halvings, blocks in self._blocks.items()}
        if pattern is not None:
            sent = patterned(self._light, self._row, self._column, pattern, self._rig.projector.blur_px)
            for halvings, (cells, size, _) in self._blocks.items():
                light = np.empty_like(cells.light)
                relight(sent, self._row, size, cells.border, light)
                lit[halvings] = cells._replace(light=light)
        self._lay(lit)

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Nothing: what moves keeps the halo of the time that this was prepared for."""

    def _summed(self, colour: int, windows: tuple[Singles, ...]) -> Singles:
        """The halo in cells, of one colour; windows as `gather_spans` takes them."""
        low, high, hit, miss = windows
        # The first Gaussian has the narrowest cells.
        rows, columns = self._layers[0].lots[0][0].light.shape
        widest = max(layer.halvings for layer in self._layers)
        planes = [np.zeros((rows, -(-columns // 2**halvings)), np.float32) for halvings in range(widest + 1)]
        for layer in self._layers:
            down = np.zeros_like(planes[layer.halvings])
            for lot in layer.lots[colour]:
                gather_spans(lot, (low, high, hit, miss), layer.down, down)
            line = np.empty(down.shape[1] + len(layer.along) - 1, np.float32)
            blur_along(down, layer.along, line, planes[layer.halvings])
        for halvings in range(widest, 0, -1):
            widen(planes[halvings], planes[halvings - 1])
        return planes[0]


def cell_size(lens: Lens) -> int:
    """Pixels along a side of the live halo's cells: odd, so that a cell has a middle row whose window is its own."""
    across = int(HALO_RADIUS * lens.fx / MOST_CELLS_ACROSS)
    return max(1, across - (across + 1) % 2)


def choose_gaussians(radius: float) -> list[_Gaussian]:
    """Gaussians for a halo of this radius in cells."""
    widest = max(WIDEST * radius, FINEST)
    count = 1 + max(int(np.ceil(np.log(widest / FINEST) / np.log(RATIO))), 0)
    sigmas = FINEST * (widest / FINEST) ** (np.arange(count) / max(count - 1, 1))
    return [_Gaussian(float(sigma), max(int(np.log2(sigma)), 0)) for sigma in sigmas]


def fit_gaussians(radius: float, gaussians: list[_Gaussian]) -> tuple[Doubles, tuple[Doubles, Doubles]]:
    """Where to look at a halo, (S,) cells, and the matrices (J, S) from what is seen there to weights of the Gaussians.

    The first is for the mean over directions: least squares over the area, and the same light in all. The second is for
    what falls down more than up.
    """
    edges = np.concatenate([[0.0], np.geomspace(min(0.2, 0.2 * radius), radius, 25)])
    steps = np.sqrt(edges[1:] * np.maximum(edges[:-1], 0.25 * edges[1:]))
    beyond = np.linspace(1.02, 1.5, 8) * radius
    area = np.pi * np.diff(edges**2)
    sigmas = np.array([each.sigma for each in gaussians])

    def heights(at: Doubles) -> Doubles:
        return np.asarray(np.exp(-0.5 * (at[:, None] / sigmas) ** 2) / (2 * np.pi * sigmas**2), np.float64)

    scale, outside = np.sqrt(area)[:, None], np.sqrt(2 * np.pi * beyond * np.gradient(beyond))[:, None]
    found = []
    # A Gaussian that leans is a Gaussian times the distance, downwards.
    for weight, whole, per in ((1e3, np.ones((1, len(sigmas))), area), (0.0, np.zeros((1, len(sigmas))), 0 * area)):
        factor, factor_beyond = (1.0, 1.0) if weight else (steps[:, None], beyond[:, None])
        parts = [heights(steps) * factor * scale, heights(beyond) * factor_beyond * outside, weight * whole]
        seen = np.concatenate([np.diag(scale[:, 0]), np.zeros((len(beyond), len(steps))), weight * per[None]])
        found.append(np.linalg.pinv(np.concatenate(parts), rcond=1e-10) @ seen)
    return steps, (found[0], found[1])


def make_cells(law: HaloLaw, light: Singles, row: Singles, spans: Singles, size: tuple[int, int]) -> HaloCells:
    """Light (H, W, C) in cells of `size` rows and columns."""
    shape = 2, -(-light.shape[0] // size[0]), -(-light.shape[1] // size[1])
    colours = light.shape[2]
    dims = shape, shape, (*shape, colours), (*shape, 7), shape[1:]
    cells = HaloCells(*(np.zeros(each, np.float32) for each in dims))
    fill_cells(law, light, row, spans.astype(np.float32), size, cells)
    return cells


def make_lots(cells: HaloCells, weights: Doubles, lot: int, colour: int, wide: int) -> HaloLots:
    """One lot of the cells with its Gaussian's weights (H, W, 2), spread over `wide` of the narrowest."""
    light, leaning = ((cells.light[lot, :, :, colour] * weights[:, :, i] / wide).astype(np.float32) for i in range(2))
    first, last = cells.first[lot], cells.last[lot]
    scale = np.divide(1, last - first, out=np.zeros_like(first), where=last > first)
    padded = -(-light.shape[1] // TILE) * TILE - light.shape[1]
    low = np.pad(np.where(light != 0, first, np.inf), ((0, 0), (0, padded)), constant_values=np.inf)
    high = np.pad(np.where(light != 0, last, -np.inf), ((0, 0), (0, padded)), constant_values=-np.inf)
    tiles = (len(light), -1, TILE)
    return HaloLots(
        first,
        last,
        scale,
        light,
        leaning,
        low.reshape(tiles).min(axis=2).astype(np.float32),
        high.reshape(tiles).max(axis=2).astype(np.float32),
    )
