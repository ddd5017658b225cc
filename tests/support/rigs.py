"""Rigs of the tests: few pixels, which are quick to render, and poses and lenses that no closed form covers."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from slopegate.core.rig.calibration import NUMBERS, Calibration, as_rows
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import LineTimes, PixelClocks, ShutterLimits, Steps
from slopegate.core.rig.uncertainty import numbers_of

LADDER = (*map(float, range(10, 50)), *map(float, range(50, 100, 2)), *map(float, range(100, 129, 4)))
"""Pixel clocks of the check rig's camera, in MHz."""

DELAYS, EXPOSURES = Steps(-16667.0, 33334.0, 1.0), Steps(100.0, 50000.0, 1.0)
FINE_LINES = LineTimes(1.0, 500.0, 0.25)
WIDE_LIMITS = ShutterLimits(LineTimes(1.0, 2000.0, 0.01), Steps(-40000.0, 40000.0, 1.0), Steps(1.0, 60000.0, 1.0))
"""A shutter that refuses nothing a test asks for."""

PROJECTOR = RigProjector(Lens(1280, 720, 1000.0, 1000.0, 640.0, 360.0), 16666.7)
"""A projector whose sweep fills its period."""

CAMERA_BARREL = (-0.21, 0.09, 0.001, -0.002, 0.01)
PROJECTOR_BARREL = (-0.08, 0.05, 0.0005, 0.001)


def shutter(
    line: PixelClocks | LineTimes, *, delay: Steps = DELAYS, exposure: Steps = EXPOSURES, offset_us: float = 0.0
) -> ShutterLimits:
    """What a camera accepts: these line times, and the check rig's delays and exposures unless told otherwise."""
    return ShutterLimits(line, delay, exposure, offset_us)


def plain_rig(width: int, height: int, focal_px: float, limits: ShutterLimits) -> Rig:
    """A camera with its axis in the middle of the picture, 10 cm straight below `PROJECTOR`."""
    lens = Lens(width, height, focal_px, focal_px, width / 2, height / 2)
    return ideal_rig(RigCamera(lens, limits), PROJECTOR, 0.1)


def check_rig(
    width: int,
    line: PixelClocks | LineTimes | None = None,
    *,
    height: int | None = None,
    ladder: tuple[float, ...] = LADDER,
    delay: Steps = DELAYS,
    exposure: Steps = EXPOSURES,
) -> Rig:
    """The check rig with fewer pixels (3/4 as high as wide), its slabs upright at 78 MHz unless told other lines."""
    projector = RigProjector(PROJECTOR.lens, 1e6 / 60, 0.92)
    focal = width * 25 / 24
    clocks = PixelClocks(78 / (projector.rows_per_us * focal / 1000.0), ladder)
    height = height or width * 3 // 4
    lens = Lens(width, height, focal, focal, width / 2, height / 2)
    return ideal_rig(RigCamera(lens, shutter(line or clocks, delay=delay, exposure=exposure)), projector, 0.1, "small")


def turned(
    rig: Rig,
    degrees: tuple[float, float, float] = (4.0, -3.0, 2.0),
    offset_m: tuple[float, float, float] = (0.02, -0.11, 0.015),
) -> Rig:
    """The rig with its projector turned about x, y and z (a rotation vector) and moved."""
    matrix = np.asarray(cv2.Rodrigues(np.radians(degrees))[0], np.float64)
    rotation = tuple(tuple(map(float, row)) for row in matrix)
    return replace(rig, projector_offset_m=offset_m, projector_rotation=rotation)  # type: ignore[arg-type]


def bent(rig: Rig, camera: tuple[float, ...] = CAMERA_BARREL, projector: tuple[float, ...] = PROJECTOR_BARREL) -> Rig:
    """The rig with both lenses distorted."""
    return replace(
        rig,
        camera=replace(rig.camera, lens=replace(rig.camera.lens, distortion=camera)),
        projector=replace(rig.projector, lens=replace(rig.projector.lens, distortion=projector)),
    )


LENS_ERRORS = (0.3, 0.3, 0.5, 0.5, 1e-3, 2e-3, 1e-4, 1e-4, 2e-3)
"""Standard errors of a good calibration of a lens, in pixels of a picture 1600 wide and as coefficients."""
ERRORS = (*LENS_ERRORS, *LENS_ERRORS, *(1e-4, 1e-4, 5e-5), *(1e-4, 1e-4, 2e-4), 0.02, 2e-4, 0.1, 2.0)
"""Standard errors of a good calibration, in the order of `NUMBERS`."""


def calibrated(rig: Rig, errors: tuple[float, ...] = ERRORS, seed: int = 1) -> Rig:
    """The rig with a calibration that tells every number, all of them tied to each other."""
    clocks = isinstance(rig.camera.shutter.line, PixelClocks)
    told = [place for place, name in enumerate(NUMBERS) if clocks or name != "clocks_per_line"]
    wide = np.array(errors)
    wide[:4] *= rig.camera.lens.width / 1600
    factor = np.random.default_rng(seed).normal(size=(len(told), 40)) * wide[told, None]
    facts = (("chart", "a board"), ("views", "12"))
    known = Calibration(tuple(NUMBERS[place] for place in told), as_rows(factor @ factor.T / 40), facts)
    return replace(rig, calibration=known)


def drawn(rig: Rig, count: int, seed: int = 2) -> np.ndarray:
    """What the rig's numbers may really be, by its calibration, (count, 28)."""
    assert rig.calibration is not None
    places = [NUMBERS.index(name) for name in rig.calibration.names]
    found = np.tile(numbers_of(rig), (count, 1))
    values, axes = np.linalg.eigh(rig.calibration.array)
    scatter = np.random.default_rng(seed).normal(size=(count, len(places)))
    found[:, places] += scatter * np.sqrt(np.maximum(values, 0)) @ axes.T
    return found
