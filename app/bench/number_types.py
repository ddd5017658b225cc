"""The cached map of projector rows in other number types, through the program's own kernel.

Numba compiles `core.exposure.kernels.expose` for whatever types it is given, so nothing but the number type differs.
A CPU cannot calculate with halves, but those that are not negative sort like their bits: they are compared as 16-bit
integers. Fixed point counts 65535 steps over the projector's rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopegate.app.bench.subject import Subject
from slopegate.app.bench.variant import Variant, array_bytes, fine_response, gate_response, read_fine
from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.sensor import Plates, noise_pool
from slopegate.core.gating.gate import RowWindows
from slopegate.core.rig.arrays import Bools, Counts, Doubles, Ints

Encode = Callable[[Doubles], NDArray[Any]]


@dataclass(frozen=True)
class NumberType:
    """How projector rows and window edges are stored, and where an edge then really lies (all of projector rows)."""

    name: str
    rows: Encode
    edges: Encode
    drawn: Callable[[Doubles], Doubles]


def number_types(projector_rows: int) -> tuple[NumberType, ...]:
    """float64, float32 (the program's), float16, and 16-bit fixed point for this many projector rows."""
    scale = 65535 / projector_rows

    def fixed_edges(edges: Doubles) -> Counts:
        return np.minimum(np.rint(edges * scale), 65535).astype(np.uint16)

    def half_edges(edges: Doubles) -> Counts:
        return round_up(edges, np.float16).view(np.uint16)

    return (
        NumberType("float64", lambda r: r, lambda e: e, lambda e: e),
        NumberType(
            "float32",
            lambda r: r.astype(np.float32),
            lambda e: round_up(e, np.float32),
            lambda e: between(e, np.float32),
        ),
        NumberType(
            "float16",
            lambda r: np.maximum(r, 0).astype(np.float16).view(np.uint16),
            half_edges,
            lambda e: between(e, np.float16),
        ),
        NumberType(
            "uint16 fixed point",
            lambda r: (np.maximum(r, 0) * scale).astype(np.uint16),
            fixed_edges,
            lambda e: np.rint(e * scale) / scale,
        ),
    )


def round_up(edges: Doubles, kind: type[np.floating[Any]]) -> NDArray[Any]:
    """The least number of this type that is not below each edge."""
    nearest = edges.astype(kind)
    return np.where(nearest < edges, np.nextafter(nearest, kind(np.inf)), nearest)


def between(edges: Doubles, kind: type[np.floating[Any]]) -> Doubles:
    """Where numbers rounded to this type change sides of an edge rounded up: midway between it and the one below."""
    above = round_up(edges, kind)
    below = np.nextafter(above, kind(-np.inf))
    return np.asarray((above.astype(np.float64) + below.astype(np.float64)) / 2, np.float64)


@dataclass(frozen=True, eq=False)
class FramePath:
    """What `core.exposure.kernels.expose` needs to make the frames of a subject's gates."""

    subject: Subject
    planes: kernels.Planes
    windows: tuple[kernels.Windows, ...]
    responses: tuple[kernels.Response, ...]
    noise: kernels.Noise
    out: Counts

    def run(self, index: int) -> None:
        """One noisy frame."""
        kernels.expose(self.planes, self.windows[index], self.responses[index], self.noise, self.out)

    def counts(self, index: int) -> Doubles:
        """The same without noise, before rounding."""
        silent = self.noise._replace(step=np.float32(0))
        kernels.expose(self.planes, self.windows[index], fine_response(self.responses[index]), silent, self.out)
        return read_fine(self.out, self.subject)

    def without_tiles(self) -> FramePath:
        """The same, every pixel compared and read."""
        low = np.zeros_like(self.planes.tile_low)
        high = np.full_like(low, np.finfo(low.dtype).max if low.dtype.kind == "f" else 65535)
        return replace(self, planes=self.planes._replace(tile_low=low, tile_high=high))

    def kept_bytes(self) -> int:
        """What stays in memory from frame to frame."""
        return array_bytes(self.planes, self.noise.pool, self.out)


def default_path(subject: Subject) -> FramePath:
    """The program's own way: float32 rows, light in eighths of a count, pooled noise."""
    return frame_path(subject, number_types(subject.rig.projector.lens.height)[1])


def frame_path(subject: Subject, kind: NumberType) -> FramePath:
    """The program's own way with rows of another type."""
    sight = subject.sight
    plates = Plates(sight.row.astype(np.float32), sight.direct, sight.ambient, subject.sensor)
    rows = kind.rows(sight.row)
    low, high = tile_table(rows, sight.row >= 0)
    planes = plates.planes._replace(projector_row=rows, tile_low=low, tile_high=high)
    windows = tuple(
        kernels.Windows(kind.edges(gate.windows.low), kind.edges(gate.windows.high), *_times(gate.windows))
        for gate in subject.gates
    )
    noise = noise_pool(np.random.default_rng(0), subject.shape[1]).frame(0, 0)
    responses = tuple(gate_response(plates, gate) for gate in subject.gates)
    return FramePath(subject, planes, windows, responses, noise, np.empty(subject.shape, np.uint16))


def light_as_float(subject: Subject) -> FramePath:
    """The program's own way with unrounded light: float32 in counts instead of uint16 in eighths of them."""
    path = default_path(subject)
    gain, sight = np.float32(subject.sensor.counts_per_unit), subject.sight
    planes = path.planes._replace(direct=sight.direct * gain, ambient=sight.ambient * gain)
    responses = tuple(
        item._replace(direct_step=np.float32(1), ambient_step=np.float32(gate.periods))
        for item, gate in zip(path.responses, subject.gates, strict=True)
    )
    return replace(path, planes=planes, responses=responses)


def tile_table(rows: NDArray[Any], lit: Bools) -> tuple[NDArray[Any], NDArray[Any]]:
    """Least and greatest lit value of every tile, in any number type; low > high where a tile has none."""
    height, width = rows.shape
    tiles = -(-width // kernels.TILE)
    top, bottom = (np.inf, -np.inf) if rows.dtype.kind == "f" else (65535, 0)
    room = ((0, 0), (0, tiles * kernels.TILE - width))
    cut = (height, tiles, kernels.TILE)
    low = np.pad(np.where(lit, rows, rows.dtype.type(top)), room, constant_values=top).reshape(cut).min(axis=2)
    high = np.pad(np.where(lit, rows, rows.dtype.type(bottom)), room, constant_values=bottom).reshape(cut).max(axis=2)
    return low, high


def edge_error(subject: Subject, drawn: Callable[[Doubles], Doubles]) -> tuple[float, float]:
    """How far edges of the gates lie from the exact ones, maximum and RMS, in camera rows of a frontal surface."""
    lens, projector = subject.rig.camera.lens, subject.rig.projector
    edges = np.concatenate([part for gate in subject.gates for part in (gate.windows.low, gate.windows.high)])
    edges = edges[edges < projector.lens.height]
    off = np.abs(drawn(edges) - edges) * lens.fy / projector.lens.fy
    return float(off.max(initial=0.0)), float(np.sqrt((off**2).mean())) if off.size else 0.0


def variants(subject: Subject, skip: bool = True) -> list[Variant]:
    """A variant per number type, and one with light as float32; without `skip` every pixel is compared and read."""
    kinds = number_types(subject.rig.projector.lens.height)
    found = [typed_variant(subject, kind, skip) for kind in kinds]
    light = light_as_float(subject)
    edge_rows = edge_error(subject, kinds[1].drawn)
    return [*found, _variant("light as float32", light if skip else light.without_tiles(), edge_rows, False)]


def default_variant(subject: Subject) -> Variant:
    """The program's own way."""
    return typed_variant(subject, number_types(subject.rig.projector.lens.height)[1], True)


def typed_variant(subject: Subject, kind: NumberType, skip: bool) -> Variant:
    """The program's own way with rows of this type."""
    path = frame_path(subject, kind)
    edge_rows = edge_error(subject, kind.drawn)
    name = f"rows as {kind.name}"
    return _variant(name, path if skip else path.without_tiles(), edge_rows, kind.name == "float32")


def _variant(name: str, path: FramePath, edge_rows: tuple[float, float], default: bool) -> Variant:
    group = "default" if default else "number type"
    label = "cached float32 rows, hard edges" if default else name
    return Variant(group, label, path.run, path.counts, None, edge_rows, path.kept_bytes(), default=default)


def _times(windows: RowWindows) -> tuple[Ints, Ints]:
    exact = kernel_windows(windows)
    return exact.inside, exact.outside
