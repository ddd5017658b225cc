"""How much of each pixel some objects cover: the true matte of a scene, to hold others to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slopegate.core.render.integrate import pixel_positions, pixel_shifts
from slopegate.core.render.render import Cancelled, Progress, make_tracer
from slopegate.core.render.tracing import RAYS_PER_BAND
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

_SAME = 1e-9
"""Share of a depth by which two ways to the same surface may differ."""


def true_alpha(
    rig: Rig,
    scene: Scene,
    names: Sequence[str],
    samples: int,
    time_s: float = 0.0,
    progress: Progress | None = None,
) -> Singles:
    """Share (H, W) float32 of each pixel's samples x samples rays that meet one of the named objects first.

    Glass counts as what it is, not as what is seen through it. Rays as in `integrate`. `progress` is told the share
    done; Cancelled is raised when it returns False. Raises InputError for a name that no object has, for a capture,
    which has none, and when samples is below 1.
    """
    known = sorted({item.name for item in scene.objects})
    for name in names:
        require(name in known, "the object", name, f"one of {', '.join(known) or 'none: the scene has no objects'}")
    require(samples >= 1, "samples", samples, "a whole number of at least 1")
    solid = tuple(replace(item, material=None) for item in scene.objects)
    wanted = tuple(item for item in solid if item.name in names)
    tracers = [make_tracer(rig, Scene(scene.name, objects=items)) for items in (solid, wanted)]
    bodies = [tracer.still() + tracer.moving(time_s) for tracer in tracers]
    lens, positions = rig.camera.lens, pixel_positions(samples)
    hits = np.zeros(lens.height * lens.width, np.int64)
    for start in range(0, hits.size, RAYS_PER_BAND):
        if progress is not None and not progress(start / hits.size):
            raise Cancelled("Rendering was stopped")
        pixels = np.arange(start, min(start + RAYS_PER_BAND, hits.size))
        rows, columns = np.divmod(pixels, lens.width)
        aside, down = pixel_shifts(samples, columns, rows)
        for column, row in positions:
            places = columns + (column + aside) % 1, rows + (row + down) % 1
            first, own = (tracer.trace(*places, placed).depth for tracer, placed in zip(tracers, bodies, strict=True))
            hits[pixels] += np.isfinite(own) & (own <= first * (1 + _SAME))
    return (hits / len(positions)).astype(np.float32).reshape(lens.height, lens.width)
