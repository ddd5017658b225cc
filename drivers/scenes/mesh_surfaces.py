"""What the parts of a mesh file look like: their colours and textures as the renderer knows them.

It knows one albedo a mesh, or one texture that is looked up within 0..1. Whatever else a file asks for (a texture that
repeats, colours that vary over a face, colours that multiply a texture) becomes a texture like that.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.scene.materials import Material
from slopegate.core.scene.shapes import Finish
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_checks import MAX_PIXELS
from slopegate.drivers.files.picture_decoding import linear_rgb
from slopegate.drivers.scenes.mesh_parts import MeshPart, Wrap

MAX_TEXELS = 60_000_000
"""Of all parts of a file together."""
BAKED_TEXELS = 2_000_000
"""How many texels colours are spread over where they vary within a part; at least one a face."""
SMOOTH_SIDE = 32
"""Texels along an edge of a face over which its colours vary, where there are faces few enough."""
_SAME_COLOUR = 1 / 255
_MARGIN = 1e-6
_CUT_OFF = "it has colours outside 0..1, which are cut off there"


def linear_colours(codes: Doubles, full: float | None, remarks: list[str]) -> Singles:
    """Linear colours (n, 3) from sRGB codes of which `full` is 1; NaN is white.

    Of floats (None) 1 is full, or 255 where they are whole numbers up to that. What is outside is cut off and remarked.
    """
    codes = np.nan_to_num(codes, nan=np.inf)
    finite = codes[np.isfinite(codes)]
    if full is None:
        full = 255.0 if finite.size and 1 < finite.max() <= 255 and (finite % 1 == 0).all() else 1.0
    if finite.size and (finite.min() < 0 or finite.max() > full):
        remarks.append(_CUT_OFF)
    return linear_rgb("colours", (np.clip(codes / full, 0, 1) * 65535).round().astype(np.uint16))


class PartSurfaces:
    """Turns parts of one file into a finish and texture coordinates; parts with the same texture share its memory."""

    def __init__(self, path: Path) -> None:
        self.remarks: list[str] = []
        self._path = path
        self._tinted: dict[tuple[int, tuple[float, ...]], tuple[Singles, Singles]] = {}
        self._texels = 0

    def surface(self, part: MeshPart, material: Material | None) -> tuple[Finish, Doubles | None]:
        """The part's finish, and texture coordinates (F, 3, 2) within the finish's texture.

        Raises SceneError for textures that are too large, and InputError for colours that cannot be joined with veins.
        """
        factor, colours = self._within(part.factor), part.colours
        if colours is not None and not len(colours):
            colours = None
        if colours is not None and (colours == colours[0, 0]).all():
            factor, colours = self._product(factor, colours[0, 0]), None
        elif colours is not None:
            self._note_range(colours)
            colours = np.clip(np.nan_to_num(colours), 0, 1)
        texture = part.texture if part.uv is not None else None
        if texture is None and colours is None:
            return Finish(factor or Finish.albedo, None, material), part.uv
        if texture is not None and factor is not None:
            texture = self._times(texture, factor)
        if colours is None:
            assert texture is not None
            assert part.uv is not None
            uv, spread = tiled(self._path, part.uv, texture, part.wrap)
            self._count(0 if spread is texture else spread.shape[0] * spread.shape[1])
            return Finish(Finish.albedo, spread, material), uv
        if Finish(material=material).patterned:
            raise InputError("it has colours that vary from corner to corner: an object with veins must have an albedo")
        if texture is None and factor is not None:
            colours = colours * np.array(factor, np.float32)
        baked, uv = self._baked(part, colours, texture)
        self._count(baked.shape[0] * baked.shape[1])
        return Finish(Finish.albedo, baked, material), uv

    def _within(self, factor: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if factor is None:
            return None
        self._note_range(np.array(factor))
        red, green, blue = (min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0 for value in factor)
        return red, green, blue

    def _product(self, factor: tuple[float, float, float] | None, colour: Singles) -> tuple[float, float, float]:
        self._note_range(colour)
        red, green, blue = (np.clip(np.nan_to_num(colour), 0, 1) * (factor or (1.0, 1.0, 1.0))).tolist()
        return red, green, blue

    def _note_range(self, colours: Singles | Doubles) -> None:
        if not ((colours >= -_MARGIN) & (colours <= 1 + 1e-3)).all():
            self.remarks.append(_CUT_OFF)

    def _times(self, texture: Singles, factor: tuple[float, float, float]) -> Singles:
        if min(factor) == 1:
            return texture
        key = (id(texture), factor)
        if key not in self._tinted:
            self._count(texture.shape[0] * texture.shape[1])
            self._tinted[key] = texture * np.array(factor, np.float32), texture  # kept, so that its id stays its own
        return self._tinted[key][0]

    def _count(self, made: int) -> None:
        self._texels += made
        if self._texels > MAX_TEXELS:
            raise SceneError(
                f"{self._path} needs textures of more than {MAX_TEXELS / 1e6:.0f} megapixels together, with those that "
                "repeat spread out: that is too much"
            )

    def _baked(self, part: MeshPart, colours: Singles, texture: Singles | None) -> tuple[Singles, Doubles]:
        """A texture (h, w, 3) with a square of texels for each face, and uv (F, 3, 2) in it."""
        count = len(colours)
        most = max(math.isqrt(BAKED_TEXELS // count), 1)
        side = SMOOTH_SIDE if np.ptp(colours, axis=1).max() > _SAME_COLOUR else 1
        if texture is not None:
            assert part.uv is not None
            _check_finite(self._path, part.uv)
            height, width = texture.shape[:2]
            wanted = math.ceil(min(float((np.ptp(part.uv, axis=1) * (width, height)).max()), 1e6))
            side = max(side, wanted)
            if wanted > most:
                self.remarks.append(
                    f"its texture, which colours multiply, is shown with {most} texels along the edge of a face "
                    f"instead of {wanted}"
                )
        side = min(side, most)
        weights = _weights(side)
        texels = np.einsum("tc,fck->ftk", weights.astype(np.float32), colours)
        if texture is not None and part.uv is not None:
            texels *= _looked_up(texture, np.einsum("tc,fck->ftk", weights, part.uv), part.wrap)
        across = math.ceil(math.sqrt(count))
        down = math.ceil(count / across)
        sheet = np.zeros((down * across, side * side, 3), np.float32)
        sheet[:count] = texels
        picture = sheet.reshape(down, across, side, side, 3).swapaxes(1, 2).reshape(down * side, across * side, 3)
        index = np.arange(count)
        cells = np.stack([index % across, index // across], axis=-1)[:, None, :]
        corners = np.full((3, 2), 0.5) if side == 1 else np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) * 0.9998 + 1e-4
        return np.ascontiguousarray(picture), (cells + corners) / (across, down)


def _weights(side: int) -> Doubles:
    """Shares of the three corners at each texel of a face's square (side * side, 3), row by row.

    The corners lie at the square's top left, top right and bottom left, so half of it lies beyond the face.
    """
    if side == 1:
        return np.full((1, 3), 1 / 3)
    down, right = (np.indices((side, side)).reshape(2, -1) + 0.5) / side
    beyond = np.maximum((right + down - 1) / 2, 0)
    right, down = right - beyond, down - beyond
    return np.stack([1 - right - down, right, down], axis=-1)


def _looked_up(texture: Singles, uv: Doubles, wrap: tuple[Wrap, Wrap]) -> Singles:
    """The texels at uv (..., 2), also beyond 0..1."""
    height, width = texture.shape[:2]
    column, row = (_wrapped(uv[..., k], size, wrap[k]) for k, size in ((0, width), (1, height)))
    return np.asarray(texture[row, column])


def _wrapped(place: Doubles, size: int, wrap: Wrap) -> Indices:
    if wrap == "repeat":
        place = place - np.floor(place)
    elif wrap == "mirror":
        place = 1 - np.abs(1 - (place - 2 * np.floor(place / 2)))
    return np.clip(np.floor(np.clip(place, 0, 1) * size), 0, size - 1).astype(np.int64)


def _check_finite(path: Path, uv: Doubles) -> None:
    if not np.isfinite(uv).all():
        raise SceneError(f"{path} has a texture coordinate that is not finite: every one must be a finite number")


def tiled(
    path: Path, uv: Doubles, texture: Singles, wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
) -> tuple[Doubles, Singles]:
    """The texture repeated as often as one face needs, and uv (F, 3, 2) that stay within it: 0..1.

    Along an axis that `wrap` clamps uv stay as they are: the renderer clamps. Raises SceneError for texture
    coordinates that are not finite and for too large a picture.
    """
    _check_finite(path, uv)
    beyond = [
        wrap[k] != "clamp" and bool(uv[..., k].min() < -_MARGIN or uv[..., k].max() > 1 + _MARGIN) for k in (0, 1)
    ]
    if not any(beyond):
        return uv, texture
    period = np.array([2.0 if beyond[k] and wrap[k] == "mirror" else 1.0 for k in (0, 1)])
    shifted = uv / period
    whole = np.floor(shifted.min(axis=1, keepdims=True))
    shifted = shifted - np.where(beyond, whole, 0.0)
    across, down = (max(math.ceil(float(shifted[..., k].max()) - _MARGIN), 1) if beyond[k] else 1 for k in (0, 1))
    height, width = texture.shape[:2]
    if across * down * height * width * period.prod() > MAX_PIXELS:
        raise SceneError(f"{path} repeats its texture {across} x {down} times on one face: that is too large a picture")
    if period[0] == 2:
        texture = np.concatenate([texture, texture[:, ::-1]], axis=1)
    if period[1] == 2:
        texture = np.concatenate([texture, texture[::-1]], axis=0)
    return shifted / (across, down), np.tile(texture, (down, across, 1))
