"""The near halo over a plane with a slanted edge, by paths: nothing is taken to be small, constant or tabled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from slopegate.core.gating.gate import RowWindows, recorded_times
from slopegate.core.light.halo import HALO_RADIUS
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Mesh


@dataclass(frozen=True, eq=False)
class SlantedEdge:
    """A plane through `middle`, spanned by unit vectors `across` and `down`; dark where across < 0."""

    middle: Doubles
    across: Doubles
    down: Doubles
    dark: float = 0.05
    bright: float = 0.8

    @property
    def normal(self) -> Doubles:
        return np.cross(self.across, self.down)

    def mesh(self, half_m: float = 3.0) -> Mesh:
        """The same as an object, its sides `half_m` from the middle."""
        texture = np.full((1, 2, 3), self.dark, np.float32)
        texture[0, 1] = self.bright
        sides = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        corners = np.array([self.middle + half_m * (i * self.across + j * self.down) for i, j in sides])
        uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        return Mesh("edge", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), uv=uv, texture=texture)


def slanted_edge(tilt_deg: float, slant_deg: float, distance_m: float, on_side: bool = False) -> SlantedEdge:
    """Tilted about x like a road (top away), its edge `slant_deg` off the upright, or off level when `on_side`."""
    tilt, slant = np.radians(tilt_deg), np.radians(slant_deg + (90 if on_side else 0))
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    across = turn @ np.array([np.cos(slant), np.sin(slant), 0])
    down = turn @ np.array([-np.sin(slant), np.cos(slant), 0])
    return SlantedEdge(np.array([0, 0, distance_m]), across, down)


def _inside(fog: Fog, start: Doubles, end: Doubles) -> tuple[Doubles, Doubles]:
    """Shares first and last of the ways start -> end (N, 3) that lie in the fog; equal where nothing does."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (np.array(fog.lo_m) - start) / (end - start), (np.array(fog.hi_m) - start) / (end - start)
    low, high = np.fmin(one, other), np.fmax(one, other)
    first = np.maximum(low.max(axis=1), 0)
    return first, np.maximum(np.minimum(high.min(axis=1), 1), first)


def _left(fog: Fog, start: Doubles, end: Doubles) -> Doubles:
    first, last = _inside(fog, start, end)
    return np.exp(-fog.extinction_per_m * (last - first) * np.linalg.norm(end - start, axis=1))


def halo_by_paths(
    rig: Rig, edge: SlantedEdge, fog: Fog, windows: RowWindows, pixel: tuple[int, int], paths: int, seed: int
) -> tuple[float, float]:
    """Mean and standard error of the near halo in the pixel (row, column), by `paths` paths."""
    rng, eye = np.random.default_rng(seed), rig.camera_centre_m
    row, column = pixel
    u = rng.random((5, paths))
    view = rig.camera_rays(column + u[0], row + u[1])
    # A second ray beside it, by polar coordinates in tangents, meets the surface that sends the light.
    radius, angle = HALO_RADIUS * u[2], 2 * np.pi * u[3]
    beside = view.copy()
    beside[:, 0] += radius * np.cos(angle)
    beside[:, 1] += radius * np.sin(angle)
    ended, reach = (((edge.middle - eye) @ edge.normal) / (v @ edge.normal) for v in (view, beside))
    source = eye + reach[:, None] * beside
    # dA cos = |v|^2 depth^2 d(solid angle); per tangents: solid angle = radius d radius d angle / |v|^3.
    gap = np.linalg.norm(beside, axis=1)
    facing = np.abs(beside @ edge.normal) / gap
    area = radius * HALO_RADIUS * 2 * np.pi / gap**3 * (reach * gap) ** 2 / facing
    # Places on the first ray, closer together where it passes the source.
    end = eye + ended[:, None] * view
    first, last = _inside(fog, np.broadcast_to(eye, end.shape), end)
    along = view / np.linalg.norm(view, axis=1)[:, None]
    length = np.linalg.norm(end - eye, axis=1)
    near = ((source - eye) * along).sum(axis=1)
    off = np.linalg.norm(source - eye - near[:, None] * along, axis=1)
    low, high = np.arctan((first * length - near) / off), np.arctan((last * length - near) / off)
    at = low + (high - low) * u[4]
    s = near + off * np.tan(at)
    spot = eye + s[:, None] * along
    to = spot - source
    rho = np.linalg.norm(to, axis=1)
    normal = edge.normal if (eye - edge.middle) @ edge.normal > 0 else -edge.normal
    leaving = np.maximum(to @ normal / rho, 0)
    cosine = -(to * along).sum(axis=1) / rho
    phase = (1 - fog.g**2) / (4 * np.pi * (1 + fog.g**2 - 2 * fog.g * cosine) ** 1.5)
    lamp = rig.projector_centre_m
    projector_column, projector_row, _ = rig.to_projector(source)
    raster = rig.projector.lens
    lit = (projector_row >= 0) & (projector_row < raster.height)
    lit &= (projector_column >= 0) & (projector_column < raster.width)
    albedo = np.where((source - edge.middle) @ edge.across < 0, edge.dark, edge.bright)
    sent = albedo * np.abs((source - lamp) @ edge.normal) / (source - lamp)[:, 2] ** 3
    sent *= _left(fog, np.broadcast_to(lamp, source.shape), source)
    sent *= recorded_times(windows, np.full(paths, row), np.where(lit, projector_row, -1))
    inner = HALO_RADIUS / 2
    share = np.where(radius < inner, 1, 0.5 + 0.5 * np.cos(np.pi * (radius - inner) / inner))
    left = _left(fog, source, spot) * _left(fog, np.broadcast_to(eye, spot.shape), spot)
    step = (high - low) * (off**2 + (s - near) ** 2) / off
    value = sent * share * area * leaving / rho**2 * fog.scattering_per_m * phase * left * step
    return float(value.mean()), float(value.std() / np.sqrt(paths))


@njit(cache=True, nogil=True)
def _turned(
    along: tuple[float, float, float], g: float, rng: np.random.Generator
) -> tuple[tuple[float, float, float], float]:
    """A direction that fog turns (Henyey and Greenstein), and the cosine of the turn."""
    dx, dy, dz = along
    u = rng.random()
    s = (1 - g * g) / (1 - g + 2 * g * u)
    cosine = (1 + g * g - s * s) / (2 * g) if abs(g) > 1e-4 else 1 - 2 * u
    sine, phi = np.sqrt(max(1 - cosine * cosine, 0.0)), 2 * np.pi * rng.random()
    # Any two axes across the direction.
    ax, ay, az = (0.0, -dz, dy) if abs(dx) < 0.7 else (dz, 0.0, -dx)
    n = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / n, ay / n, az / n
    bx, by, bz = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
    u, v = sine * np.cos(phi), sine * np.sin(phi)
    turned = cosine * dx + u * ax + v * bx, cosine * dy + u * ay + v * by, cosine * dz + u * az + v * bz
    return turned, cosine


@njit(cache=True)
def _walk_pixels(
    scene: tuple[float, float, float, float, float],
    optics: tuple[float, float, float, float, float, float],
    fog: tuple[float, float, float],
    windows: tuple[Doubles, Doubles, Doubles, Doubles],
    place: tuple[int, int],
    paths: int,
    rng: np.random.Generator,
    out: Doubles,
) -> None:
    distance, half, roll, dark, bright = scene
    focal, cx, cy, blur, baseline, raster = optics
    scattering, g, near = fog
    low, high, inside, outside = windows
    turn_cos, turn_sin = np.cos(roll), np.sin(roll)
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = 0.0
            for _ in range(paths):
                row, column = place[0] + k, place[1] + j
                x = (column + rng.random() + blur * rng.standard_normal() - cx) / focal
                y = (row + rng.random() + blur * rng.standard_normal() - cy) / focal
                norm = np.sqrt(x * x + y * y + 1)
                dx, dy, dz = x / norm, y / norm, 1 / norm
                px, py, pz = near / dz * dx, baseline / 2 + near / dz * dy, near
                for _turn in range(60):
                    reach = (distance - pz) / dz if dz > 0 else np.inf
                    free = -np.log(1 - rng.random()) / scattering
                    if free < reach:
                        px, py, pz = px + free * dx, py + free * dy, pz + free * dz
                        if pz < near:
                            break
                        (dx, dy, dz), _ = _turned((dx, dy, dz), g, rng)
                        continue
                    if reach == np.inf:
                        break
                    px, py = px + reach * dx, py + reach * dy
                    lit_by = 1000.0 * (py + baseline / 2) / distance + raster / 2
                    if 0 <= lit_by < raster:
                        across, down = turn_cos * px + turn_sin * py, turn_cos * py - turn_sin * px
                        albedo = bright if abs(across) < half and abs(down) < half else dark
                        way = np.sqrt(px * px + (py + baseline / 2) ** 2 + distance * distance)
                        weight = inside[row] if low[row] <= lit_by < high[row] else outside[row]
                        total += weight * albedo / distance**2 * np.exp(-scattering * way * (1 - near / distance))
                    break
            out[k, j] = total / paths


def square_by_walks(
    rig: Rig,
    scene: tuple[float, float, float, float, float],
    fog: Fog,
    windows: RowWindows,
    box: tuple[int, int, int, int],
    paths: int,
    seed: int = 1,
) -> Doubles:
    """Direct light and all that fog turns, any number of times, between target and camera: random walks from there.

    scene: metres to a target across the axis, half the side of its bright square, the square's roll in radians, albedo
    around and on it. box: x0, y0, x1, y1 in pixels. Each walk starts anywhere in its pixel, off by the lens's blur, and
    is recorded in the window of that pixel's row. Only fog that absorbs nothing, and is everywhere
    from a z on; the check rig's projector.
    """
    lens = rig.camera.lens
    optics = lens.fx, lens.cx, lens.cy, rig.camera.blur_px, rig.baseline_m, float(rig.projector.lens.height)
    held = tuple(np.asarray(w, np.float64) for w in (windows.low, windows.high, windows.inside, windows.outside))
    x0, y0, x1, y1 = box
    out = np.zeros((y1 - y0, x1 - x0))
    _walk_pixels(
        scene,
        optics,
        (fog.scattering_per_m, fog.g, max(fog.lo_m[2], 0.0)),
        held,
        (y0, x0),
        paths,
        np.random.default_rng(seed),
        out,
    )
    return out


@njit(cache=True)
def _land(
    scattering: float,
    g: float,
    near: float,
    edges: Doubles,
    turns: tuple[int, float],
    paths: int,
    rng: np.random.Generator,
    out: Doubles,
) -> None:
    for _ in range(paths):
        px, py, pz, dx, dy, dz = 0.0, 0.0, near, 0.0, 0.0, 1.0
        least = 1.0
        for turn in range(turns[0] + 1):
            if turn > 1 and least < turns[1]:
                break
            reach = (1.0 - pz) / dz if dz > 0 else np.inf
            free = -np.log(1 - rng.random()) / scattering
            if free >= reach:
                sine = np.hypot(px + reach * dx, py + reach * dy)
                angle = np.arctan(sine)
                if turn >= 1 and angle < edges[-1]:
                    out[np.searchsorted(edges, angle, side="right") - 1] += 1.0
                break
            px, py, pz = px + free * dx, py + free * dy, pz + free * dz
            if pz < near:
                break
            (dx, dy, dz), cosine = _turned((dx, dy, dz), g, rng)
            least = min(least, cosine)


def landed_by_walks(
    fog: Fog, edges: Doubles, turns: tuple[int, float], paths: int, seed: int = 1
) -> tuple[Doubles, Doubles]:
    """Where walks from the camera along the axis meet a wall at 1 m: per steradian, by rings of angle; its error.

    edges (N + 1,): the rings' angles; turns: their greatest number, from 1 on, and the least
    cosine of each where there are several. Fog absorbs nothing and is everywhere from its
    near side on.
    """
    out = np.zeros(len(edges) - 1)
    _land(fog.scattering_per_m, fog.g, max(fog.lo_m[2], 0.0), edges, turns, paths, np.random.default_rng(seed), out)
    area = -2 * np.pi * np.diff(np.cos(edges)) * paths
    return out / area, np.sqrt(out) / area
