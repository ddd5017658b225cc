"""The near halo: light of a lit surface that fog turns once on its way to the camera (`halo` says who draws the rest).

Fog lays a blur over what stands in it. The light arrives in the row of the pixel in which it is seen and shares that
row's window, but it was lit by the projector row of the pixel that it comes from. So a gate cuts the halo across rows,
and only there: this is why a gated image of an edge is sharper, and not only richer in contrast.

`ScatterSums` adds up all pairs of pixels. It is exact but for what it takes to be true: between surface and ray nothing
stands, surfaces are matt and flat over a pixel, and inside the halo rays enter the fog at about the same distance.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.exposure.sensor import bayer_rg, mono
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.halo import HALO_RADIUS
from slopegate.core.light.part import Filter
from slopegate.core.light.scatter_kernels import HaloLaw, RayEnds, Senders, Turns, enter, halo_sums
from slopegate.core.render.fog import Medium, medium_of
from slopegate.core.render.render import Buffers, Cancelled, Progress
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
    """How many projector rows a pixel (H, W) spans; where its neighbours are unlit, what it would span at infinity."""
    r, lit = projector_row.astype(np.float64), projector_row >= 0
    spanned = np.abs(_step(r, lit, 0)) + np.abs(_step(r, lit, 1))
    return np.where(spanned > 0, spanned, rig.projector.lens.fy / rig.camera.lens.fy).astype(np.float32)


def make_sink(rig: Rig, medium: Medium, source: Senders) -> RayEnds:
    """Where the camera's rays are in fog before they meet their surfaces."""
    sink = RayEnds(np.empty_like(source.x), np.empty_like(source.x))
    enter(medium, point(rig.camera_centre_m), source, sink)
    return sink


def spread_of_pixels(lens: Lens, blur_px: float = 0.0) -> Doubles:
    """What averaging over two pixels' areas, and the lens's blur, make of 1/r, (2 S + 1, 2 S + 1); see `halo_sums`.

    By the polar integral about each offset, in which 1/r is no pole. Beyond S it is within (1/6 + blur^2) / (2 S^2).
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
    ) -> None:
        """`buffers`: what this rig sees of this scene. `progress` is told the share of an `add`, which it can end."""
        self._rig, self._medium, self._progress, self._colours = rig, medium_of(scene.fog), progress, colours
        self._row, self._width = buffers.projector_row, rows_in_pixel(rig, buffers.projector_row)
        self._light = sent_light(buffers.direct, colours)
        if self._medium is None:
            return
        self._law = make_law(rig, self._medium, buffers, scene.capture is None)

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


def make_law(rig: Rig, medium: Medium, buffers: Buffers, slopes: bool) -> HaloLaw:
    """The law of all pairs; slopes as for `make_source`."""
    lens = rig.camera.lens
    source = make_source(lens, buffers.inverse_depth, slopes)
    turns = make_turns(medium.g, most_x(medium, source))
    scattering, extinction = medium.scattering, medium.extinction
    sink, pixel = make_sink(rig, medium, source), (1 / lens.fx, 1 / lens.fy)
    return HaloLaw(turns, scattering, extinction, source, sink, spread_of_pixels(lens), pixel)


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


def most_x(medium: Medium, source: Senders) -> float:
    """Largest sigma_t h of any pair in a halo, where light is left to speak of."""
    nearest = float(source.inverse_depth[source.inverse_depth > 0].min(initial=np.inf))
    longest = float(np.sqrt(1 + source.x**2 + source.y**2).max()) / nearest
    return HALO_RADIUS * min(medium.extinction * longest, MOST_THICKNESS)
