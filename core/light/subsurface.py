"""Subsurface light: what enters skin at one point and leaves about it, in closed form for every gate.

Across projector rows each Gaussian of a skin's profile is a Gaussian again, of deviation sigma times the rows per mm
along the tangent plane, in the direction in which rows change fastest. A window from row a to row b records

    amount / 2 (erf((b - r) / (sqrt(2) s)) - erf((a - r) / (sqrt(2) s)))

of it, with r the row through the point itself and a, b cut to the raster. What the surface throws back where light fell
is direct light and no part of this.

Model section 8 says more. The skin's curvature, outlines and shadows are in it to first order: where neighbours are not
lit a lobe's light is less by their share and shifted to where the rest goes in, but keeps its width across rows. Root
of the mean square against the plain sum over all lit points, in parts of the mean, on a ball of 40 mm with a lobe of 3
mm: 0.02 fully lit, 0.03 for windows on or beside the row; tests/core/light/test_subsurface.py holds it to that. Shadows
are known to half a pixel of the projector.

Under a pattern each row's part of a Gaussian is taken times the row's mean there, over a box of columns as wide as the
Gaussian is (of equal deviation), as if what goes in about a point were even but for the pattern. Whatever the blocks,
that is 0.03 of the lit mean off (root of the mean square).

Skin behind glass, and what moves after the part was made, are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np

from slopegate.core.exposure.sensor import REC709
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.kernels_subsurface import SkinColumns, SkinPixels, add_gated, add_patterned, dim_ways
from slopegate.core.light.part import Filter, PartName
from slopegate.core.light.skin_points import (
    SkinBody,
    columns_on_skin,
    gathered,
    in_front,
    projected,
    rows_on_skin,
    tangents,
    views,
)
from slopegate.core.light.skin_tiles import SkinWays, in_tiles
from slopegate.core.render.fog import Medium, medium_of
from slopegate.core.render.render import Buffers, Cancelled, Progress, Region
from slopegate.core.render.tracing import Placed, Tracer, point
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.materials import Skin
from slopegate.core.scene.scene import Mesh, Scene, Sphere

_TERMS: Final = 40
"""Terms of the series of `reached`: what follows is below 1e-15 for depths of 0.15 sigma and more."""


class SkinPart(NamedTuple):
    """The pixels that see one skin, and where the projector's columns lie on it."""

    pixels: SkinPixels
    columns: SkinColumns


class Subsurface:
    """The subsurface light of all skin in a scene, prepared for one rig, time and filter."""

    def __init__(self, rows: int, skins: Sequence[SkinPart]) -> None:
        """rows: of the projector's raster."""
        self._rows, self._skins = float(rows), tuple(skins)
        # A pattern's pixels before each column, row by row; None: all on.
        self._sums: Doubles | None = None

    @property
    def name(self) -> PartName:
        """Which part it is."""
        return "subsurface"

    @property
    def count(self) -> int:
        """How many pixels show skin."""
        return sum(len(skin.pixels.row) for skin in self._skins)

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add what these windows record, as `LightPart` says; out must be contiguous."""
        image = out.view()
        image.shape = out.shape[0], -1
        for pixels, columns in self._skins:
            if self._sums is None:
                add_gated(pixels, windows.low, windows.high, windows.inside, windows.outside, self._rows, image)
            else:
                made = windows.low, windows.high, windows.inside, windows.outside
                add_patterned(pixels, columns, self._sums, made, image)

    def light_with(self, pattern: Singles | None) -> None:
        """As `LightPart.light_with` says."""
        self._sums = None
        if pattern is not None:
            self._sums = np.zeros((pattern.shape[0], pattern.shape[1] + 1))
            np.cumsum(pattern, axis=1, out=self._sums[:, 1:])

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Skin keeps the light of the time that it was prepared for, also where something has come before it."""


def prepare_subsurface(
    rig: Rig, scene: Scene, light_filter: Filter, time_s: float = 0.0, progress: Progress | None = None
) -> Subsurface:
    """Find the skin that the camera sees, and how its neighbourhood is lit. A scene without skin costs nothing.

    A pixel shows what its middle sees: this light is smooth within a pixel, but for the skin's outline.
    `progress` is told the share done; Cancelled is raised when it returns False.
    """
    skins = [(item, item.material) for item in scene.objects if isinstance(item.material, Skin) and item.material.lobes]
    found: list[SkinPart] = []
    if skins:
        tracer = Tracer(rig, scene)
        bodies = tracer.still() + tracer.moving(time_s)
        for number, (item, skin) in enumerate(skins):
            if progress is not None and not progress(number / len(skins)):
                raise Cancelled("Preparing the skin was stopped")
            found.append(_pixels(rig, SkinBody(item, skin, time_s), bodies, medium_of(scene.fog), light_filter))
    return Subsurface(rig.projector.lens.height, found)


def _pixels(
    rig: Rig, body: SkinBody, bodies: Sequence[Placed], medium: Medium | None, light_filter: Filter
) -> SkinPart:
    camera, projector = views(rig)
    light = rig.projector_centre_m
    patch = in_front(rig, body.seen(camera, bodies, light))
    points = tangents(rig, patch)
    lobes = body.skin.lobes
    sigmas = [lobe.sigma_mm for lobe in lobes]
    thrown = projected(rig, body.seen(projector, bodies, light))
    lit, drift = gathered(points, thrown, sigmas)
    steepness, curvature = rows_on_skin(points, thrown, max(sigmas))
    if medium is not None:
        dim_ways(medium, point(rig.camera_centre_m), point(light), patch.points, lit)
    weights = np.array([lobe.weight for lobe in lobes]).reshape(-1, 3)
    colours = lit[:, :, None] * _albedo(body, patch.uv)[:, None, :] * weights * _kept(body, patch.uv)
    ways = SkinWays(
        rows=points.place[:, 1].copy(),
        sharpness=1e3 / (math.sqrt(2) * steepness),
        curvature=curvature,
        sigmas_mm=np.array(sigmas),
        drift=1e3 * drift / (math.sqrt(2) * np.array(sigmas)),
    )
    rows, columns = np.divmod(patch.pixels, rig.camera.lens.width)
    amount = _filtered(colours, rows, columns, light_filter)
    pixels = in_tiles(rows, columns, rig.camera.lens.height, ways, amount, float(rig.projector.lens.height))
    return SkinPart(pixels, columns_on_skin(points, steepness))


def _filtered(amount: Doubles, rows: Indices, columns: Indices, light_filter: Filter) -> Singles:
    """Amounts (P, L, 3) of linear colours as the filter's channels, (P, L, 3) or (P, L, 1)."""
    if light_filter == "mono":
        amount = amount @ np.array(REC709)[:, None]
    elif light_filter == "bayer_rg":
        channel = (rows & 1) + (columns & 1)
        amount = np.take_along_axis(amount, channel[:, None, None], axis=2)
    return amount.astype(np.float32)


def _albedo(body: SkinBody, uv: Doubles) -> Singles:
    """Linear albedo (P, 3) at texture coordinates, as the direct light has it."""
    item = body.item
    if not isinstance(item, Mesh) or item.texture is None or item.uv is None:
        return np.tile(np.array(item.albedo, np.float32), (len(uv), 1))
    height, width = item.texture.shape[:2]
    row = np.clip(uv[:, 1] * height, 0, height - 1).astype(int)
    column = np.clip(uv[:, 0] * width, 0, width - 1).astype(int)
    return np.asarray(item.texture[row, column], np.float32)


# Veins.


def reached(depth_mm: float, sigma_mm: float) -> float:
    """Share of a lobe's light that has been as deep as depth_mm.

    Light that comes back is a random walk that starts and ends at the surface. One whose ends are sigma apart along a
    line on the skin has, by the same clock, gone down as a Brownian excursion of variance sigma^2 goes: the chance that
    its greatest depth is beyond d = x sigma is 2 sum (4 k^2 x^2 - 1) exp(-2 k^2 x^2) (Chung 1976).
    """
    x = depth_mm / sigma_mm
    if x < 0.15:
        return 1.0  # to 1e-90: the series itself converges ever more slowly
    k2x2 = (np.arange(1, _TERMS + 1) * x) ** 2
    return float(min(max(2 * np.sum((4 * k2x2 - 1) * np.exp(-2 * k2x2)), 0.0), 1.0))


def _kept(body: SkinBody, uv: Doubles) -> Doubles:
    """Share (P, L, 3) of each lobe's light that veins leave."""
    skin, item = body.skin, body.item
    kept = np.ones((len(uv), len(skin.lobes), 3))
    if skin.veins is None:
        return kept
    scale = _mm_per_texel(item, skin.veins)
    for i, lobe in enumerate(skin.lobes):
        share = reached(skin.depth_mm, lobe.sigma_mm)
        seen = _lookup(_blurred(skin.veins, lobe.sigma_mm / math.sqrt(2), scale), uv)
        kept[:, i] -= share * seen[:, None] * np.array(skin.absorbed)
    return kept


def _mm_per_texel(item: Mesh | Sphere, picture: Singles) -> tuple[float, float]:
    """Millimetres of surface along a step to the right and down in a picture: of a mesh the mean over its area, of a
    sphere where it is widest. Raises InputError for a mesh without texture coordinates."""
    height, width = picture.shape
    if isinstance(item, Sphere):
        return 2e3 * math.pi * item.radius_m / width, 1e3 * math.pi * item.radius_m / height
    if item.uv is None:
        raise InputError(f"{item.name} has veins and no texture coordinates: they must say where the veins are")
    corners, places = item.vertices[item.faces], item.uv[item.faces]
    edges = corners[:, 1:] - corners[:, :1]
    steps = (places[:, 1:] - places[:, :1]) * (width, height)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    flat = np.linalg.det(steps)
    good = (np.abs(flat) > 1e-12) & (area > 0)
    if not good.any():
        return 1.0, 1.0
    per_step = np.linalg.solve(steps[good], edges[good])
    right, down = (np.average(np.linalg.norm(per_step[:, k], axis=1), weights=area[good]) for k in (0, 1))
    return 1e3 * float(right), 1e3 * float(down)


def _blurred(veins: Singles, deviation_mm: float, mm_per_texel: tuple[float, float]) -> Singles:
    """The map as a lobe sees it: where its light was half-way is spread by sigma / sqrt(2) about where it comes out."""
    right, down = (max(deviation_mm / size, 1e-3) for size in mm_per_texel)
    return np.asarray(cv2.GaussianBlur(veins, (0, 0), right, sigmaY=down, borderType=cv2.BORDER_REPLICATE), np.float32)


def _lookup(picture: Singles, uv: Doubles) -> Doubles:
    """Values (P,) between the texels of a picture (h, w)."""
    height, width = picture.shape
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip(uv[:, 1] * height - 0.5, 0, height - 1)
    left, top = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    a, b = x - left, y - top
    upper = (1 - a) * picture[top, left] + a * picture[top, right]
    return np.asarray((1 - b) * upper + b * ((1 - a) * picture[bottom, left] + a * picture[bottom, right]), np.float64)
