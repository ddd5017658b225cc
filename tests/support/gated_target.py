"""A camera that takes gated pictures of a flat target with a hidden timing, rendered by the program's own exposure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from slopegate.core.calibration.edges import edges_in, profiles
from slopegate.core.calibration.informative import FIRST, GOAL, TargetSight, enough, next_gates, nominal_of, sight_of
from slopegate.core.calibration.law import Direction, Nominal, Shot
from slopegate.core.calibration.target import FlatTarget, target_rows
from slopegate.core.calibration.timing import GateTiming, fit_timing
from slopegate.core.exposure.blur import BlurredDirect, blurred
from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import SensorModel, expose
from slopegate.core.gating.gate import RowWindows, row_windows
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, ShutterLimits, Steps, gate

SENSOR = SensorModel()
NOISE = 30.0
"""Counts of a lit pixel: shot noise of some 1500 counts at two electrons each."""
FOG_ROWS = 0.7
"""Share of the projector's rows over which the light of fog in front of the target fades: about as many as there are
between the target and the rig, for a row's share of it hardly depends on its distance."""


@dataclass(frozen=True)
class HiddenTiming:
    """What the rig file does not tell: the delay's offset, a factor on line times, directions, the trigger's faults."""

    offset_us: float
    stretch: float = 1.0
    projector: Direction = "down"
    camera: Direction = "down"
    jitter_us: float = 0.0
    missed: float = 0.0
    fog: float = 0.0


def small_rig(active_fraction: float = 0.92, scale: float = 1.0, ladder: tuple[float, ...] = ()) -> Rig:
    """A rig of 160 x 200 camera and 220 x 180 projector pixels, times `scale`."""
    width, height = round(160 * scale), round(200 * scale)
    projector = RigProjector(
        Lens(round(220 * scale), round(180 * scale), 240 * scale, 240 * scale, 110 * scale, 60 * scale),
        16666.7,
        active_fraction,
    )
    line = PixelClocks(78 * 68.0 / scale, ladder or (50.0, 60.0, 70.0, 78.0, 88.0, 100.0, 108.0))
    shutter = ShutterLimits(line, Steps(-30000, 30000, 1), Steps(50, 16600, 1))
    return ideal_rig(
        RigCamera(Lens(width, height, 300 * scale, 300 * scale, width / 2, height / 2), shutter), projector, 0.1
    )


def drawn_rig(random: np.random.Generator, scale: float = 1.0) -> Rig:
    """The small rig with another active fraction, and lenses that blur by up to a pixel."""
    rig = small_rig(float(random.uniform(0.85, 0.97)), scale)
    blur = random.choice([0.0, 0.8], 2)
    return replace(
        rig,
        camera=replace(rig.camera, blur_px=float(blur[0])),
        projector=replace(rig.projector, blur_px=float(blur[1])),
    )


def drawn_target(random: np.random.Generator) -> FlatTarget:
    """A plane 0.6 to 1.2 m away, tilted by up to 17 degrees each way."""
    x, y = random.uniform(-0.3, 0.3, 2)
    return FlatTarget(tuple((np.array([-x, -y, 1.0]) / random.uniform(0.6, 1.2)).tolist()))


def drawn_timing(random: np.random.Generator, jitter_us: float, missed: float = 0.0, fog: float = 0.0) -> HiddenTiming:
    """Any offset within half a period, line times off by up to 3 %, all directions."""
    projector, camera = random.choice(["down", "up"], 2)
    stretch, offset = random.uniform(0.97, 1.03), random.uniform(-8000, 8000)
    return HiddenTiming(float(offset), float(stretch), str(projector), str(camera), jitter_us, missed, fog)  # type: ignore[arg-type]


@dataclass(eq=False)
class GatedTarget:
    """The camera in front of the target. `rig` is the true one but for the timing that is hidden.

    `rows` (H, W): the projector rows that are believed to light the target, of the picture as it is; the real ones
    unless told otherwise.
    """

    rig: Rig
    target: FlatTarget
    hidden: HiddenTiming
    random: np.random.Generator
    believed: Rig | None = None
    believed_target: FlatTarget | None = None
    _before: Singles | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.true_rows = target_rows(self.rig, self.target)
        self.rows = target_rows(self.believed or self.rig, self.believed_target or self.target)
        self.known = (self.rows >= 0) & (self.true_rows >= 0)
        height, width = self.rows.shape
        stripes = 1 + 0.3 * np.sin(np.arange(width) / 5)
        self.direct = np.where(self.true_rows >= 0, 0.4 * stripes, 0).astype(np.float32) * np.ones(
            (height, 1), np.float32
        )
        whole = RowWindows(np.zeros(height), np.zeros(height), np.zeros(height, np.int32), np.ones(height, np.int32))
        self.full = np.mean([self._counts(self._light(whole)) for _ in range(8)], axis=0, dtype=np.float32)

    @property
    def sight(self) -> TargetSight:
        return sight_of(self.rows, self.known)

    def shot(self, settings: GateSettings) -> Shot:
        """The edges of one picture."""
        image = self.picture(settings)
        found = profiles(image, self.full, self.rows, self.known, NOISE)
        return Shot(settings, tuple(edge for profile in found for edge in edges_in(profile)))

    def picture(self, settings: GateSettings) -> Singles:
        """Counts above the dark; of the gate before, or black, where the trigger was missed."""
        hidden = self.hidden
        light = self._light(self._windows(settings))
        if self.random.random() < hidden.missed:
            black = self._before is None or self.random.random() < 0.5
            light = np.zeros_like(light) if black else self._before
        self._before = light
        return self._counts(light)

    def _windows(self, settings: GateSettings) -> RowWindows:
        hidden = self.hidden
        late = hidden.offset_us + self.random.normal(0.0, hidden.jitter_us)
        real = gate(hidden.stretch * settings.line_time_us, settings.delay_us + late, settings.exposure_us)
        return row_windows(self.rig, real)

    def _counts(self, light: Singles) -> Singles:
        return expose(light, SENSOR, self.random).astype(np.float32) - np.float32(SENSOR.black_count)

    def _flip(self, image: Singles) -> Singles:
        return image[::-1].copy() if self.hidden.camera == "up" else image

    def _in_scan_order(self, rows: Singles) -> tuple[Singles, Bools]:
        """Rows as the scan counts them, row by row as the camera reads."""
        lit = rows >= 0
        if self.hidden.projector == "up":
            rows = np.where(lit, np.nextafter(np.float32(self.rig.projector.lens.height), np.float32(0)) - rows, -1)
        return self._flip(rows.astype(np.float32)), self._flip(lit)

    def _light(self, windows: RowWindows) -> Singles:
        """What these windows, of camera rows in the order that they are read, record; as the picture shows it."""
        rows, _ = self._in_scan_order(self.true_rows)
        direct = self._flip(self.direct)
        if self.rig.camera.blur_px or self.rig.projector.blur_px:
            light = np.zeros_like(direct)
            BlurredDirect(self.rig, rows, direct).add(windows, light)
        else:
            light = gated(rows, direct, np.zeros_like(direct), windows, 0.0)
        light = light * np.float32(1 - 0.5 * self.hidden.fog) + np.float32(self.hidden.fog) * self._veil(windows, rows)
        return self._flip(np.asarray(light, np.float32))

    def _veil(self, windows: RowWindows, rows: Singles) -> Singles:
        """Light of fog in front of the target: of the rows that pass there on their way, fading with them."""
        count = float(self.rig.projector.lens.height)
        sign = -1.0 if self.hidden.projector == "up" else 1.0
        fade = FOG_ROWS * count

        def until(row: Doubles) -> Doubles:
            """Of the fog's light, what comes from rows before this one."""
            inside = np.clip(sign * (row - rows), 0, None) / fade
            return sign * (1 - np.exp(-inside))

        low, high = (np.minimum(edge[:, None], count) for edge in (windows.low, windows.high))
        part = until(high) - until(low)
        whole = until(np.array([[count]])) - until(np.array([[0.0]]))
        times = windows.outside[:, None] * whole + (windows.inside - windows.outside)[:, None] * part
        return blurred(np.where(rows >= 0, 0.4 * times, 0).astype(np.float32), self.rig.camera.blur_px)


def measured(camera: GatedTarget, most: int = 400, every: int = 8, goal=GOAL) -> tuple[GateTiming | None, list[Shot]]:
    """Propose, take, fit, until it is enough or at most so many."""
    nominal = nominal_of(camera.believed or camera.rig, 0.05)
    shots: list[Shot] = []
    timing = None
    sight = camera.sight
    while len(shots) < most and not enough(timing, goal).enough:
        count = every if shots else FIRST
        for settings in next_gates(camera.believed or camera.rig, sight, shots, timing, count, goal):
            shots.append(camera.shot(settings))
        timing = fitted(shots, nominal)
    return timing, shots


def fitted(shots: list[Shot], nominal: Nominal) -> GateTiming | None:
    """The timing that the shots tell, None where they do not yet."""
    try:
        return fit_timing(shots, nominal)
    except InputError:
        return None


def off_us(timing: GateTiming, hidden: HiddenTiming) -> float:
    """How far the offset is off, whole periods aside."""
    period = timing.period_us
    return float((timing.offset_us - hidden.offset_us + period / 2) % period - period / 2)
