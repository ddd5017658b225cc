"""What a bake of indirect light is asked for and gives, as plain data that can be kept on a disk."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Final

import numpy as np

from slopegate.core.light.surfaces import Surfaces
from slopegate.core.rig.arrays import Indices, Ints, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import KeyFrames, Scene

BAKE_VERSION: Final = 9
"""Rises when the same scene would give other tables, or these would have another form."""

MOST_CAUSTICS: Final = 1 << 20
"""Particles that a list of caustics takes: there are enough then."""

_CELLS_ACROSS: Final = 200
_CELLS_ACROSS_PATTERNS: Final = 64


@dataclass(frozen=True)
class BakeSettings:
    """How indirect light is baked.

    pitch_px: pixels across a cell, None for 3, or more where there would be over 200 cells across, or over 64 with
    columns. bands: parts that the projector's rows are kept in. columns: parts that its columns are kept in, for
    patterns; 1 takes a pattern's means over whole rows. max_order: how often light may change its direction (the
    surface that the camera sees counts), None for as often as matters. seed: of the random numbers. with_halo: keep
    what `scatter` draws (see `halo`), for tests of the bake alone.
    """

    pitch_px: int | None = None
    bands: int = 72
    columns: int = 1
    max_order: int | None = None
    seed: int = 1
    with_halo: bool = False

    def __post_init__(self) -> None:
        require(self.pitch_px is None or 1 <= self.pitch_px <= 64, "pitch_px", self.pitch_px, "from 1 to 64")
        require(1 <= self.bands <= 4096, "bands", self.bands, "from 1 to 4096")
        require(1 <= self.columns <= 1024, "columns", self.columns, "from 1 to 1024")
        ok = self.max_order is None or 1 <= self.max_order <= 1000
        require(ok, "max_order", self.max_order, "from 1 to 1000")

    def pitch_for(self, rig: Rig) -> int:
        """Pixels across a cell."""
        across = _CELLS_ACROSS if self.columns == 1 else _CELLS_ACROSS_PATTERNS
        return self.pitch_px or max(3, -(-rig.camera.lens.width // across))


def for_patterns(max_order: int | None = None) -> BakeSettings:
    """How light is baked that patterns shall be seen in: patterns of up to 32 x 32 blocks are whole parts of it.

    Root of the mean square, in percent of the fully lit mean, against paths that ask the pattern for their own pixel
    (the Cornell box, 400 x 300 pixels): 0.8 to 1.0 for random patterns of 4 x 4 to 128 x 128 blocks, of which 0.7 are
    the wider cells; behind gates 0.2 to 0.3. At 1600 x 1200 baking and showing take up to 176 MB, 252 MB with fog, and
    644 MB where a coloured scene has glass, whose list takes 75 MB of them.
    """
    return BakeSettings(bands=32, columns=32, max_order=max_order)


@dataclass(frozen=True, eq=False)
class Baked:
    """What the paths of a bake brought, by two halves that know nothing of each other.

    matt (2, R, B, K, C, W) float32: sums over the paths of each cell (row R, column W), band of projector rows B, part
    of its columns K, channel C (1 where nothing has a colour), to be multiplied by a pixel's albedo. plain: the same of
    light that is not (fog's, and of gloss), or (2, R, 0, K, C, W) where there is none. paths (2, R, W): how many paths
    began, and matt_paths (2, R, W): how many of them on a surface. nearness (2, R, W):
    their sum of 1 / distance to what they met next, 1/m. passes (2,) int64: in how many passes.

    Caustics are in matt, but for K > 1: no table of a few columns can hold what glass gathers. They are a list of both
    halves then, caustic_places (N, 3) int32: pixel, projector row and column; caustic_light (N, C) float32: what such a
    particle lays there, times the tangent area that it is spread over; caustic_count (2,) int64: how many were sent.
    """

    matt: Singles
    plain: Singles
    paths: Singles
    matt_paths: Singles
    nearness: Singles
    passes: Indices
    caustic_places: Ints
    caustic_light: Singles
    caustic_count: Indices

    @property
    def paths_per_cell(self) -> float:
        """Paths a cell of both halves together."""
        return float(self.paths.sum(axis=0).mean())

    def half(self, which: int) -> Baked:
        """One half alone, in both places; a list of caustics is that of both."""
        halves = {item.name: getattr(self, item.name) for item in fields(self) if "caustic" not in item.name}
        return replace(self, **{name: table[[which, which]] for name, table in halves.items()})

    def in_one_band(self) -> Baked:
        """The same without the projector's rows and columns: enough for what everything lit shows."""
        matt, plain = (table.sum(axis=(2, 3), keepdims=True) for table in (self.matt, self.plain))
        return replace(self, matt=matt, plain=plain if self.plain.size else self.plain)


def memory_bytes(rig: Rig, surfaces: Surfaces, settings: BakeSettings) -> int:
    """Memory that baking and showing take at most, beside the program and the planes of the camera's image."""
    lens, pitch = rig.camera.lens, settings.pitch_for(rig)
    pixels, cells = lens.width * lens.height, math.ceil(lens.width / pitch) * math.ceil(lens.height / pitch)
    channels = 1 if surfaces.grey else 3
    table = 4 * cells * settings.bands * settings.columns * channels * (2 if surfaces.has_plain else 1)
    # While a pass is traced: both halves, what it adds to them, the sums that are shown, and two batches; while it is
    # taken over: both halves, a copy, their mean and its sums. Per cell what it shows and 49 weights, per pixel what it
    # shows, its home, the weights of the cells about it and its colour.
    busiest = max(5 * table + _BATCHES_BYTES, 6 * table)
    listed = 3 * MOST_CAUSTICS * 4 * (3 + channels) if settings.columns > 1 and surfaces.has_glass else 0
    return busiest + listed + cells * 240 + pixels * (8 + 4 + 12 + 12 + 4 + 4 + 4 + 4 * channels)


_BATCHES_BYTES: Final = 10_000_000


def fingerprint(rig: Rig, scene: Scene, settings: BakeSettings) -> Iterator[bytes]:
    """Everything that a bake depends on, piece by piece: what gives equal bytes gives equal tables.

    That is the version, lenses and poses of the rig, what the objects are and where they are at time 0, the fog and
    the settings; no names, no gates, no shutter.
    """
    yield f"indirect {BAKE_VERSION}".encode()
    lit = rig.camera.lens, rig.projector.lens, rig.projector_offset_m, rig.projector_rotation
    for item in (*lit, settings, scene.fog, *scene.objects):
        yield from _bytes_of(item)


def _bytes_of(value: object) -> Iterator[bytes]:
    if isinstance(value, KeyFrames):
        value = value.pose(0.0)
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif is_dataclass(value):
        yield type(value).__name__.encode()
        for item in fields(value):
            if item.name != "name":
                yield item.name.encode()
                yield from _bytes_of(getattr(value, item.name))
    elif isinstance(value, tuple):
        yield f"({len(value)}".encode()
        for part in value:
            yield from _bytes_of(part)
    else:
        yield repr(value).encode()
