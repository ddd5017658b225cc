"""What the plots show of a scene and of a gate, as plain arrays: no Qt here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from slopegate.app.session.describe import meaning_text, measured
from slopegate.core.gating.gate import Slab, recorded_times, row_windows, slab_if_any
from slopegate.core.gating.slab_mesh import Piece, bend_m, piece_triangles, slab_pieces
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Singles
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.rig import Rig, camera_view, projector_view
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Mesh, Scene

EMPTY_DEPTHS_M = (0.3, 2.0)
MAX_POINTS = 16_000
SECTION_POINTS = 3_000
_EVEN = (0.7548776662466927, 0.5698402909980532)
"""Steps whose multiples fill a square evenly: 1 / p and 1 / p^2 with p^3 = p + 1."""
LEAVING = 6.0
"""A slab that goes on beyond the scene is drawn so many times farther than the scene reaches: out of the view."""


class CameraBuffers(Protocol):
    """The part of the renderer's buffers that the plots read."""

    @property
    def projector_row(self) -> Singles: ...
    @property
    def inverse_depth(self) -> Singles: ...
    @property
    def direct(self) -> Singles: ...


@dataclass(frozen=True, eq=False)
class Cloud:
    """Surface points seen by the camera: world positions (N, 3), colours (N, 3) 0..1, and what gates them.

    camera_row (N,) is the whole pixel row; projector_row (N,) is -1 where the projector does not reach.
    """

    positions: Doubles
    colours: Singles
    camera_row: Indices
    projector_row: Doubles


NO_CLOUD = Cloud(np.empty((0, 3)), np.empty((0, 3), np.float32), np.empty(0, np.int64), np.empty(0))


@dataclass(frozen=True)
class PlotExtent:
    """The part of the world that a plot shows, metres; depths along z from the camera."""

    z_min: float
    z_max: float
    y_min: float
    y_max: float
    floor: float
    """World y of the lowest surface, where a floor grid belongs."""


NOWHERE = PlotExtent(0.3, 2.0, -0.7, 0.7, 0.7)


def to_plot(points_m: ArrayLike) -> Doubles:
    """World (x right, y down, z forward) -> plot axes (x right, z forward, up), any shape (..., 3)."""
    points = np.asarray(points_m, np.float64)
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def cloud(rig: Rig, buffers: CameraBuffers, limit: int = MAX_POINTS) -> Cloud:
    """At most `limit` of the surface points seen, on a regular grid of pixels."""
    height, width = buffers.inverse_depth.shape
    step = max(1, math.ceil(math.sqrt(height * width / limit)))
    return _sampled(rig, buffers, np.arange(step // 2, height, step), np.arange(step // 2, width, step))


def side_cloud(rig: Rig, buffers: CameraBuffers, limit: int = SECTION_POINTS) -> Cloud:
    """At most `limit` of the surface points seen, spread evenly over the whole picture, no two in line: for the side
    view, where a grid would leave stripes."""
    height, width = buffers.inverse_depth.shape
    turns = np.outer(np.arange(limit) + 0.5, _EVEN) % 1.0
    return _at_pixels(rig, buffers, (turns[:, 0] * height).astype(np.int64), (turns[:, 1] * width).astype(np.int64))


def _sampled(rig: Rig, buffers: CameraBuffers, rows: Indices, columns: Indices) -> Cloud:
    row, column = (index.ravel() for index in np.meshgrid(rows, columns, indexing="ij"))
    return _at_pixels(rig, buffers, row, column)


def _at_pixels(rig: Rig, buffers: CameraBuffers, row: Indices, column: Indices) -> Cloud:
    """The surface points that these pixels (n,) see."""
    w = buffers.inverse_depth[row, column].astype(np.float64)
    seen = w > 0
    row, column, w = row[seen], column[seen], w[seen]
    positions = rig.camera_centre_m + rig.camera_rays(column + 0.5, row + 0.5) / w[:, None]
    colours = _display(buffers.direct[row, column], positions[:, 2])
    return Cloud(positions, colours, row, buffers.projector_row[row, column].astype(np.float64))


def _display(direct: Singles, z: Doubles) -> Singles:
    """Light made visible: the fall-off with distance taken out, brightest 2 % at white, gamma 2.2, shadows grey."""
    albedo = direct * (z * z)[:, None].astype(np.float32)
    lit = albedo.max(axis=1, initial=0) > 0
    if not lit.any():
        return np.full_like(albedo, 0.4)
    white = float(np.percentile(albedo[lit].max(axis=1), 98))
    shown = np.power(np.clip(albedo / white, 0, 1), 1 / 2.2)
    return np.where(lit[:, None], 0.15 + 0.85 * shown, 0.3).astype(np.float32)


def recorded(rig: Rig, settings: GateSettings, points: Cloud) -> Bools:
    """Which points the gate records, (N,)."""
    return recorded_times(row_windows(rig, settings), points.camera_row, points.projector_row) > 0


def depth_range(rig: Rig, scene: Scene, points: Cloud) -> tuple[float, float]:
    """Depths from the camera between which the slab is drawn: a margin round the scene, or a default when empty.

    It begins no farther away than the baseline, before which the two fields of view hardly meet: a slab may wait in
    front of all that is there now.
    """
    z = points.positions[:, 2] if points.positions.size else _object_points(scene)[:, 2]
    z = z - rig.camera_centre_m[2]
    z = z[z > 0]
    if not z.size:
        return EMPTY_DEPTHS_M
    low, high = np.percentile(z, (0.5, 99.5))
    return min(0.4 * float(low), max(rig.baseline_m, 0.05 * float(low))), 1.15 * float(high)


def _object_points(scene: Scene) -> Doubles:
    parts = [
        item.vertices
        if isinstance(item, Mesh)
        else np.asarray(item.centre_m) + item.radius_m * np.array([[0, 0, -1], [0, 0, 1.0]])
        for item in scene.objects
    ]
    return np.concatenate(parts) if parts else np.empty((0, 3))


def extent(rig: Rig, scene: Scene, points: Cloud) -> PlotExtent:
    """What the plots have to show: both centres and both fields of view over the scene's depths."""
    z_min, z_max = depth_range(rig, scene, points)
    views = np.concatenate([camera_view(rig, z_max), projector_view(rig, z_max)])
    y = views[:, 1]
    low = points.positions if points.positions.size else _object_points(scene)
    floor = float(np.percentile(low[:, 1], 99.5)) if low.size else float(y.max())
    return PlotExtent(z_min, z_max, float(y.min()), float(y.max()), floor)


def ticks(span: float, about: int = 6) -> Doubles:
    """Round values 0, step, ... up to `span`, about so many of them, steps of 1, 2 or 5 times a power of ten."""
    raw = span / about
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw * (1 - 1e-9))
    return np.asarray(np.arange(math.floor(span / step + 1e-9) + 1) * step, np.float64)


def read_out(slab: Slab, left_out: bool = False, bend: float | None = 0.0) -> str:
    """Distance, thickness and tilt on the axis as one short line; `left_out` where all but this slab is recorded.

    bend: metres by which it leaves its plane somewhere in the picture; not said where it is 0 or unknown.
    """
    distance, thickness = "beyond infinity", "unlimited"
    if slab.distance_m is not None:
        distance = length(slab.distance_m, slab.error("distance_m"))
    if slab.thickness_m is not None:
        thickness = length(slab.thickness_m, slab.error("thickness_m"))
    off = slab.error("tilt_deg")
    tilt = f"{round(slab.tilt_deg, 1) + 0.0:+.1f}" if off is None else _signed(slab.tilt_deg, off)
    turned = f" · turned {slab.turn_deg:+.1f}°" if abs(slab.turn_deg) >= 0.05 else ""
    bent = f" · bend {length(bend)}" if bend else ""
    return f"{'all but ' if left_out else ''}distance {distance} · thickness {thickness} · tilt {tilt}°{turned}{bent}"


def _signed(value: float, error: float) -> str:
    return f"{'+' if value >= 0 else ''}{measured(value, error)}"


@dataclass(frozen=True, eq=False)
class GatePicture:
    """What the plots show of a gate: its space and its slab, and what is said of it below."""

    pieces: tuple[Piece, ...]
    slab: Slab | None
    """None where it is no slab, or where that cannot be told."""
    named: Slab | None
    """The slab that the caption names: of a complement, what it leaves out."""
    caption: str
    """Two lines always: the picture must not jump when a remark comes and goes."""
    why: str = ""
    """Why there is no slab, in a sentence."""


def gate_picture(
    rig: Rig,
    settings: GateSettings,
    left_out: GateSettings | None,
    depths_m: tuple[float, float],
    column: float | None = None,
) -> GatePicture:
    """The gate between two depths from the camera, or along a camera column; `left_out`: it is that gate's complement.

    Where gates are no slabs, no space is shown: what they keep does not depend on where it is.
    """
    found = slab_if_any(rig, settings)
    pieces = () if no_slabs(rig) else slab_pieces(rig, settings, *drawn_depths(found.slab, depths_m), column)
    if not any(_reaches(piece, rig.camera_centre_m[2] + depths_m[1]) for piece in pieces):
        pieces = ()
    named = found if left_out is None else slab_if_any(rig, left_out)
    if found.slab is None or named.slab is None:
        caption = f"{meaning_text(rig, settings)}\nNo slab: point here to read why"
        return GatePicture(pieces, found.slab, named.slab, caption, found.why or named.why)
    note = remark(found.slab, bool(pieces), depths_m)
    bend = _bend_m(rig, settings if left_out is None else left_out, depths_m)
    caption = f"{read_out(named.slab, left_out is not None, bend)}\n{note}"
    return GatePicture(pieces, found.slab, named.slab, caption)


def _reaches(piece: Piece, z_m: float) -> bool:
    """Whether anything drawn of a piece is nearer than this."""
    corners = np.concatenate([piece.far, piece.near]).reshape(-1, 3)[piece_triangles(piece).ravel()]
    return bool((corners[:, 2] < z_m).any())


@lru_cache(maxsize=4)
def _bend_m(rig: Rig, settings: GateSettings, depths_m: tuple[float, float]) -> float | None:
    """`bend_m`, found once for both plots."""
    return bend_m(rig, settings, *depths_m)


def drawn_depths(slab: Slab | None, depths_m: tuple[float, float]) -> tuple[float, float]:
    """Between which depths a slab is drawn: beyond the scene's, so that it leaves the view, where it goes on there."""
    beyond = slab is not None and (slab.far_m is None or slab.far_m > depths_m[1])
    return (depths_m[0], LEAVING * depths_m[1]) if beyond else depths_m


def length(metres: float, error_m: float | None = None) -> str:
    """A length in the unit that reads best, with its standard error where that is known."""
    if error_m is not None:
        if abs(metres) < 0.1:
            return f"{measured(metres * 1000, error_m * 1000)} mm"
        return f"{measured(metres, error_m)} m"
    if abs(metres) < 0.1:
        return f"{metres * 1000:.1f} mm"
    return f"{metres:.3f} m" if abs(metres) < 10 else f"{metres:.0f} m"


def remark(slab: Slab, drawn: bool, depths_m: tuple[float, float]) -> str:
    """One sentence on a slab that is not where one would look for it; empty when there is nothing to say."""
    if drawn:
        return "" if slab.far_m is not None or slab.near_m is None else "The slab reaches to infinity."
    blanking = [warning for warning in slab.warnings if "blanking" in warning]
    if slab.near_m is None:
        return "The slab lies behind the rig: nothing in front of it is recorded."
    if slab.near_m > depths_m[1]:
        return f"The slab lies beyond the scene, from {length(slab.near_m)}."
    if slab.far_m is not None and slab.far_m < depths_m[0]:
        return f"The slab lies in front of the scene, up to {length(slab.far_m)}."
    if blanking:
        return "The camera looks while the projector is blank: nothing is recorded."
    return "The slab lies outside what camera and projector both see."


def view_axes(azimuth_deg: float, elevation_deg: float) -> Doubles:
    """Rows right, up and towards the viewer (3, 3) in plot axes, for a viewer at this azimuth and elevation."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    ca, sa, ce, se = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def fit_distance(points: Doubles, axes: Doubles, half_width: float, half_height: float) -> float:
    """How far from the origin a viewer must stand to see all (N, 3) points; half sizes of the view at distance 1."""
    right, up, towards = axes @ points.T
    return float(np.max(np.maximum(np.abs(right) / half_width, np.abs(up) / half_height) + towards))


def floor_lines(rig: Rig, shown: PlotExtent) -> tuple[Doubles, Doubles, float]:
    """A metre grid on the floor: line ends (N, 2, 3) in world metres, depth labels, half width in metres.

    Lines stand at the labelled depths and as far apart sideways.
    """
    depths = ticks(shown.z_max)
    step = depths[1] if depths.size > 1 else shown.z_max
    camera = rig.camera.lens
    reach = max(camera.cx, camera.width - camera.cx) / camera.fx * shown.z_max
    half = math.ceil(reach / step) * step
    sideways = np.arange(-round(half / step), round(half / step) + 1) * step
    floor = shown.floor
    across = [[[-half, floor, z], [half, floor, z]] for z in depths]
    along = [[[x, floor, 0.0], [x, floor, depths[-1]]] for x in sideways]
    return np.array(across + along), depths, float(half)


def piece_lines(far: Doubles, near: Doubles) -> Doubles:
    """The edges of a piece's two sides (R, C, 3) and the four lines that join their corners, as ends (N, 3)."""
    ends = [(0, 0), (0, -1), (-1, 0), (-1, -1)]
    joins = np.array([side[index] for index in ends for side in (far, near)])
    return np.concatenate([_rim(far), _rim(near), joins])


def _rim(side: Doubles) -> Doubles:
    ring = np.concatenate([side[0], side[1:, -1], side[-1, -2::-1], side[-2::-1, 0]])
    return np.stack([ring[:-1], ring[1:]], axis=1).reshape(-1, 3)


def dragged(wish: Doubles, start: Doubles, now: Doubles, turning: bool) -> Doubles:
    """Tilt (degrees), distance and thickness (metres) of a slab pulled from one point of the section to another.

    Points are z and height. Pulled, the slab keeps its tilt and moves with the pointer; turning, it turns about the
    axis with the pointer, kept within 85 degrees. The distance stays above 1 % of what it was.
    """
    tilt_deg, distance_m, thickness_m = wish
    if turning:
        first, last = (math.atan2(at[1], at[0] - distance_m) for at in (start, now))
        turn_deg = math.remainder(math.degrees(first - last), 360.0)
        return np.array([min(max(tilt_deg + turn_deg, -85.0), 85.0), distance_m, thickness_m])
    dz, dy = now - start
    moved = distance_m + dz - dy * math.tan(math.radians(tilt_deg))
    return np.array([tilt_deg, max(moved, 0.01 * distance_m), thickness_m])
