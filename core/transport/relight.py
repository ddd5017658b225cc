"""Relighting by slices: every slice lit in its own colour and by its own picture (equation 14 of the paper).

i = sum over slices of weight gain T_i p_i. The sparse products T_i p_i change only with a slice's picture; colours,
gains and visibility only mix them anew. With a colour mosaic everything is mixed behind the filters, each pixel with
the share of its own colour, and the colours between the filters are made at the end, since that is linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.shown import srgb_curve
from slopegate.core.rig.arrays import Bytes, Doubles, Ints, Singles
from slopegate.core.rig.checks import require, require_finite, require_positive
from slopegate.core.transport.mosaic import colour_row, demosaic, filter_table, filtered
from slopegate.core.transport.sliced import SliceTransport, relit

Colour = tuple[float, float, float]

LEVELS: Final = 4096
"""Steps of linear light, from 0 to what is shown white, that a shown picture tells apart."""


@dataclass(frozen=True, eq=False)
class SliceLight:
    """How one slice is lit."""

    colour: Colour = (1.0, 1.0, 1.0)
    """Linear red, green and blue of the projector's light, at least 0."""
    picture: Singles | None = None
    """What the projector shows, linear 0..1, (raster height, raster width) or (..., 3) float32; None: all on."""
    gain: float = 1.0
    visible: bool = True

    def __post_init__(self) -> None:
        for part in self.colour:
            require(np.isfinite(part) and part >= 0, "colour", self.colour, "three finite numbers of at least 0")
        require_finite("gain", self.gain)

    @property
    def strength(self) -> Colour:
        """What the light of the slice is multiplied with; zeros where it is hidden."""
        red, green, blue = (self.gain * part if self.visible else 0.0 for part in self.colour)
        return red, green, blue


WHITE: Final = SliceLight()


def relight(
    slices: Sequence[SliceTransport],
    lights: Sequence[SliceLight],
    weights: Sequence[float] | None = None,
    mosaic: str = "",
) -> Singles:
    """The scene as these lights show it, (H, W, 3) float32, linear, in the unit of the slices.

    weights: a factor for each slice (`weights.slice_weights`); None: all 1. mosaic: the filters of the camera's first
    two rows and columns, such as RGGB; empty for a monochrome camera, whose picture takes the lights' colours. Raises
    InputError where slices, lights and weights are not as many.
    """
    live = LiveRelight(slices, weights, mosaic)
    _require_as_many("lights", lights, slices)
    for index, light in enumerate(lights):
        live.light(index, light)
    return live.linear()


class LiveRelight:
    """Slices that are relit again and again: keeps each one's light, and computes only what a change asks for."""

    def __init__(
        self, slices: Sequence[SliceTransport], weights: Sequence[float] | None = None, mosaic: str = ""
    ) -> None:
        """All slices are white at first. Arguments as for `relight`."""
        require(len(slices) > 0, "slices", "empty", "at least one slice")
        self._shape = slices[0].total.shape
        require(all(one.total.shape == self._shape for one in slices), "slices", "mixed", "of one camera's size")
        self._slices, self._mosaic = tuple(slices), mosaic
        self._table = filter_table(mosaic) if mosaic else np.zeros((2, 2), np.int32)
        self._weights = [1.0] * len(slices)
        self.weigh(self._weights if weights is None else weights)
        self._lights = [WHITE] * len(slices)
        self._planes = np.stack([one.total for one in slices])
        """(planes, H, W): one a slice, or three that lie together where a picture in colour meets no filters."""
        self._raw = np.empty(self._shape if mosaic else (0, 0), np.float32)
        self._line = np.empty((3, self._shape[1]), np.float32)

    @property
    def lights(self) -> tuple[SliceLight, ...]:
        """How the slices are lit now."""
        return tuple(self._lights)

    def weigh(self, weights: Sequence[float]) -> None:
        """Give each slice another weight."""
        _require_as_many("weights", weights, self._slices)
        self._weights = [float(weight) for weight in weights]

    def light(self, index: int, light: SliceLight) -> None:
        """Light one slice otherwise. Only another picture (another array) needs its sparse product."""
        old, self._lights[index] = self._lights[index], light
        if light.picture is old.picture:
            return
        first = sum(self._count(one) for one in self._lights[:index])
        last, count = first + self._count(old), self._count(light)
        if last - first != count:
            room = np.empty((count, *self._shape), np.float32)
            self._planes = np.concatenate([self._planes[:first], room, self._planes[last:]])
        self._fill(self._slices[index], light.picture, self._planes[first : first + count])

    def linear(self) -> Singles:
        """The relit scene (H, W, 3) float32, linear."""
        if self._mosaic:
            _mix_filtered(self._planes, self._strengths(1.0), self._table, self._raw)
            return demosaic(self._raw, self._mosaic)
        out = np.empty((*self._shape, 3), np.float32)
        strengths = self._strengths(1.0)
        for row in range(self._shape[0]):
            mix_row(self._planes, strengths, row, self._line)
            out[row] = self._line.T
        return out

    def paint(self, white: float, out: Bytes) -> None:
        """Set out (H, W, 3) uint8 to the relit scene by the sRGB curve; light `white` and more is shown as white.

        Within 1 of the exact curve's 0..255: light is told apart in `LEVELS` steps.
        """
        require_positive("white", white)
        strengths = self._strengths((LEVELS - 1) / white)
        if self._mosaic:
            _mix_filtered(self._planes, strengths, self._table, self._raw)
            _show_filtered(self._raw, self._table, _CURVE, self._line, out)
        else:
            _show(self._planes, strengths, _CURVE, self._line, out)

    def _count(self, light: SliceLight) -> int:
        """Planes of a slice that is lit so."""
        return 3 if light.picture is not None and light.picture.ndim == 3 and not self._mosaic else 1

    def _fill(self, transport: SliceTransport, picture: Singles | None, planes: Singles) -> None:
        if picture is None:
            planes[0] = transport.total
        elif picture.ndim == 2:
            planes[0] = relit(transport, picture)
        elif self._mosaic:
            planes[0] = filtered(relit(transport, picture), self._mosaic)
        else:
            planes[:] = relit(transport, picture).transpose(2, 0, 1)

    def _strengths(self, scale: float) -> Singles:
        """What each plane adds to red, green and blue, (planes, 3)."""
        rows: list[Doubles] = []
        for light, weight in zip(self._lights, self._weights, strict=True):
            strength = scale * weight * np.array(light.strength)
            rows.append(np.diag(strength) if self._count(light) == 3 else strength[None])
        return np.concatenate(rows).astype(np.float32)


def _require_as_many(name: str, values: Sequence[object], slices: Sequence[SliceTransport]) -> None:
    require(len(values) == len(slices), name, f"{len(values)} values", f"as many as there are slices ({len(slices)})")


_CURVE: Final[Bytes] = np.rint(255 * srgb_curve(np.arange(LEVELS) / (LEVELS - 1))).astype(np.uint8)
"""sRGB of each step of linear light, (LEVELS,)."""


@njit(cache=True, nogil=True)
def mix_row(planes: Singles, strengths: Singles, row: int, line: Singles) -> None:
    """Set line (3, W) to one row of the mixture of planes (n, H, W) by strengths (n, 3)."""
    line[:] = 0
    for plane in range(planes.shape[0]):
        for colour in range(3):
            strength = strengths[plane, colour]
            if strength != 0:
                for column in range(planes.shape[2]):
                    line[colour, column] += strength * planes[plane, row, column]


@njit(cache=True, nogil=True)
def _mix_filtered(planes: Singles, strengths: Singles, table: Ints, out: Singles) -> None:
    """Set out (H, W) to the mixture of planes (n, H, W), each pixel by the strength of its filter's colour."""
    width = out.shape[1]
    for row in range(out.shape[0]):
        out[row] = 0
        for plane in range(planes.shape[0]):
            even, odd = strengths[plane, table[row & 1, 0]], strengths[plane, table[row & 1, 1]]
            if even != 0 or odd != 0:
                for pair in range(width // 2):
                    out[row, 2 * pair] += even * planes[plane, row, 2 * pair]
                    out[row, 2 * pair + 1] += odd * planes[plane, row, 2 * pair + 1]
                if width & 1:
                    out[row, width - 1] += even * planes[plane, row, width - 1]


@njit(cache=True, nogil=True)
def _paint_row(line: Singles, curve: Bytes, row: int, out: Bytes) -> None:
    """Set one row of out (H, W, 3) to line (3, W), in steps of the curve."""
    top = np.float32(len(curve) - 1)
    for column in range(line.shape[1]):
        for colour in range(3):
            light = min(max(line[colour, column], np.float32(0)), top)
            out[row, column, colour] = curve[np.int32(light + np.float32(0.5))]


@njit(cache=True, nogil=True)
def _show(planes: Singles, strengths: Singles, curve: Bytes, line: Singles, out: Bytes) -> None:
    for row in range(out.shape[0]):
        mix_row(planes, strengths, row, line)
        _paint_row(line, curve, row, out)


@njit(cache=True, nogil=True)
def _show_filtered(raw: Singles, table: Ints, curve: Bytes, line: Singles, out: Bytes) -> None:
    for row in range(out.shape[0]):
        colour_row(raw, row, table, line)
        _paint_row(line, curve, row, out)
