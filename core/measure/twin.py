"""A scene as a depth sweep saw it, in the form in which measured scenes are rendered: a photo with depth.

The fully lit image of a measured scene is photo / z_p^2, z_p the depth from the projector (`render.measured`). So the
photo is the light that the sweep saw, less ambient light, times z_p^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopegate.core.measure.sweep import DepthMap, points_m
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Twin:
    """What is rendered in a real scene's place."""

    photo: Singles
    """(H, W, 3) float32, linear, 0..1: albedo times shading, 0 where there is no depth."""
    inverse_depth: Singles
    """(H, W) float32, 1/m, 0 where nothing was measured."""
    ambient: float
    """The room's light as scenes have it: what a surface of photo 1 returns of it in one projector period."""
    counts_per_unit: float
    """Counts of the camera that a radiance of 1 made."""


def make_twin(rig: Rig, found: DepthMap, colour: Singles) -> Twin:
    """The twin of a swept scene.

    colour: `found.lit_counts`, (H, W), or (H, W, 3) where the caller has made colours of a mosaic. Values below 0,
    which noise makes, become 0. Raises InputError for a sweep that found no depth or no light.
    """
    shape = found.inverse_depth.shape
    require(colour.shape[:2] == shape, "colour", colour.shape, f"of the sweep's shape {shape}")
    known = found.known
    if not known.any():
        raise InputError("the sweep found no depth: there is nothing to make a scene of")
    squared = np.zeros(shape)
    squared[known] = rig.to_projector(points_m(rig, found))[2] ** 2
    light = np.maximum(colour if colour.ndim == 3 else np.repeat(colour[:, :, None], 3, axis=2), 0)
    photo = light * squared[:, :, None]
    brightest = float(photo.max())
    if brightest <= 0:
        raise InputError("the sweep saw no light where it found depth: there is nothing to make a scene of")
    grey = np.maximum(found.lit_counts, 0) * squared
    seen = known & (grey > 0.01 * brightest)
    ambient = float(np.median(found.ambient_counts[seen] / grey[seen])) if seen.any() else 0.0
    return Twin(
        (photo / brightest).astype(np.float32), found.inverse_depth.astype(np.float32), max(ambient, 0.0), brightest
    )
