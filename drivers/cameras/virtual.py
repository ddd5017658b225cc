"""The virtual camera: renders a scene and makes frames of it as a real camera would."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Sequence
from typing import Final

import numpy as np

from slopegate.core.exposure.blur import blurred
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.patterned import patterned
from slopegate.core.exposure.sensor import (
    Plates,
    SensorModel,
    auto_gain,
    bayer_rg,
    expose_fast,
    mono,
    noise_pool,
    warm_up,
)
from slopegate.core.gating.gate import row_windows, upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.light.lens import behind_lens, has_blur
from slopegate.core.light.lights import PLAIN, asked_parts, holds
from slopegate.core.light.part import Filter, LightPart, PartName
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.render.render import NOWHERE, Buffers, Cancelled, Progress, Region, Renderer
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.projected import check_picture_of
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.live_bake import LiveBake
from slopegate.drivers.cameras.smooth_light import SmoothLight
from slopegate.drivers.contract.camera import Camera, check_buffer, check_rows
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, FrameStamp, Modes, PixelFormat, exposed_s


def frame_rate_hz(rig: Rig, settings: GateSettings, rows: int, rate_hz: float) -> float:
    """Frames a second that a camera whose whole frames come at `rate_hz` makes when it reads this many rows.

    The link to the computer carries as many rows a second as it does of whole frames. The projector triggers the camera
    once a period, when the last row of the frame before has been exposed and read: exposure + rows line times. Reading
    fewer rows never makes it slower.
    """
    height, period_us = rig.camera.lens.height, rig.projector.period_us
    if rows >= height:
        return rate_hz
    busy_us = settings.exposure_us + rows * settings.line_time_us
    triggered_hz = 1e6 / (period_us * math.ceil(busy_us / period_us - 1e-9))
    return max(rate_hz, min(rate_hz * height / max(rows, 1), triggered_hz))


class Beat:
    """Waits for a frame's turn. Scene time is frames made / rate, and the clock's when running free."""

    def __init__(self, rate_hz: float, clock: Callable[[], float], sleep: Callable[[float], object]) -> None:
        """`rate_hz` infinite: as fast as it can."""
        self._rate_hz, self._clock, self._sleep = rate_hz, clock, sleep
        self._due_s = 0.0
        self._since = (0, 0.0)
        self._first_s: float | None = None

    def start(self) -> None:
        """The next frame is due now."""
        self._due_s = self._clock()

    def set_rate(self, rate_hz: float, sequence: int) -> None:
        """Change the pace from frame number `sequence` on."""
        if rate_hz == self._rate_hz:
            return
        self._since = (sequence, self.scene_time_s(sequence))
        self._due_s += 1.0 / rate_hz - 1.0 / self._rate_hz
        self._rate_hz = rate_hz

    def wait(self, timeout_s: float) -> bool:
        """Sleep until the frame is due; False when that takes longer than the time-out."""
        if math.isinf(self._rate_hz):
            return True
        wait_s = self._due_s - self._clock()
        if wait_s > 0:
            self._sleep(min(wait_s, timeout_s))
        return wait_s <= timeout_s

    def advance(self) -> float:
        """Begin a frame and return the instant at which it was due; the next one is due a period later.

        A camera that fell behind by a frame or more has missed the triggers meanwhile, and does not rush to catch up.
        """
        now_s = self._clock()
        if math.isinf(self._rate_hz):
            return now_s
        late = math.floor((now_s - self._due_s) * self._rate_hz)
        due_s = self._due_s + max(late, 0) / self._rate_hz
        self._due_s = due_s + 1.0 / self._rate_hz
        return due_s

    def scene_time_s(self, sequence: int) -> float:
        """The instant of the scene that frame number `sequence`, the next one, shows."""
        if math.isfinite(self._rate_hz):
            first, since_s = self._since
            return since_s + (sequence - first) / self._rate_hz
        now_s = self._clock()
        if self._first_s is None:
            self._first_s = now_s
        return now_s - self._first_s


FILTERS: Final[dict[PixelFormat, Filter]] = {"mono12": "mono", "bayer_rg12": "bayer_rg"}
FORMATS: Final[tuple[PixelFormat, ...]] = tuple(FILTERS)
ROW_STEP: Final = 4
"""Rows are read in groups of this many, and at least one group."""


def _info(rig: Rig, scene: Scene, sensor: SensorModel, pixel_format: PixelFormat, rate_hz: float) -> CameraInfo:
    """What a virtual camera says of itself."""
    lens = rig.camera.lens
    return CameraInfo(
        scene.name,
        lens.width,
        lens.height,
        pixel_format,
        sensor.max_count,
        sensor.black_count,
        rig.camera.shutter,
        Abilities(rows=Ability(), cover=Ability(), choose_format=Ability(), choose_rate=Ability()),
        Modes(pixel_format, FORMATS, rate_hz, on_demand=math.isinf(rate_hz)),
    )


def _first_gate(rig: Rig) -> GateSettings:
    """The fully lit image, as nearly as the camera makes it."""
    return quantise(rig.camera.shutter, whole_period(rig, upright_line_time(rig)), rig.projector.period_us)


class Orders:
    """What is asked of the frames that come, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number: int | None = None
        self._pattern: Singles | None = None

    def light_with(self, pattern: Singles | None) -> None:
        """Show this pattern."""
        with self._lock:
            self._pattern = pattern

    def number_from(self, number: int) -> None:
        """Make the next frame the one of this number."""
        with self._lock:
            self._number = number

    def take(self, usual: int) -> tuple[int, Singles | None]:
        """The next frame's number, `usual` unless another was asked for meanwhile, and its pattern."""
        with self._lock:
            number, self._number = self._number, None
            return usual if number is None else number, self._pattern


class VirtualCamera(Camera):
    """A camera that looks at a scene: it renders it once, then gates, exposes and quantises every frame.

    `rate_hz` paces it like a triggered camera; infinite lets it run free. A moving scene's time is frames made / rate,
    and the clock's time since the first frame when running free. Equal seeds and settings make equal frames. The
    rendering happens in the first `read`, or before that in `prepare`.
    """

    def __init__(
        self,
        rig: Rig,
        scene: Scene,
        sensor: SensorModel | None = None,
        *,
        pixel_format: PixelFormat = "mono12",
        rate_hz: float = 20.0,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
        noise: bool = True,
        skip: bool = True,
        renderer: Renderer | None = None,
        parts: Sequence[LightPart] | None = None,
        bake: bool = False,
        shown: Collection[PartName] | None = None,
    ) -> None:
        """`sensor` None: a typical one with `auto_gain`. `sleep` None: wait, or until `stop`.

        skip False: render and gate every pixel of every frame, whether it can have changed or be lit or not; the frames
        are the same. `renderer`: one of this rig and scene, made before, so that a scene at rest is rendered once.
        `parts`: fog, interreflection and skin made ready before, for this camera's filter; None: it prepares what the
        scene asks for, and indirect light only with `bake`: then it shows that after a first pass and, once started,
        refines it in a thread of its own. With a `sensor` nothing waits for that first pass, which is made there, too:
        only a gain that is to be chosen needs all the light there is. `shown`: the parts that frames show, see
        `SmoothLight.show`, and that are prepared; None: what the scene asks for.
        """
        require(rate_hz > 0, "rate_hz", rate_hz, "a number above 0")
        require(pixel_format in FORMATS, "pixel_format", pixel_format, " or ".join(FORMATS))
        self._rig, self._scene, self._sensor = rig, scene, sensor
        self._rate_hz, self._seed, self._noise, self._clock, self._skip = rate_hz, seed, noise, clock, skip
        self._stopped = threading.Event()
        self._stopped.set()
        self._beat = Beat(rate_hz, clock, self._stopped.wait if sleep is None else sleep)
        self._info = _info(rig, scene, sensor or SensorModel(), pixel_format, rate_hz)
        self._pool = noise_pool(np.random.default_rng(seed), rig.camera.lens.width)
        self._renderer, self._parts = renderer, parts
        self.smooth = SmoothLight(asked_parts(scene) if shown is None else shown)
        """Fog, interreflection and skin: what is ready, and what is shown."""
        self.baking: LiveBake | None = None
        """The bake of indirect light, where there is one."""
        if bake and parts is None and "indirect" in self.smooth.shown and holds(scene, "indirect"):
            self.baking = LiveBake(rig, scene, FILTERS[pixel_format], self._put_baked)
        self._buffers: Buffers | None = None
        self._plates: Plates | None = None
        self._sequence = self._number = 0
        self._orders = Orders()
        self._pattern: Singles | None = None
        # Direct light with all on, and whether the plates show it under the pattern.
        self._full, self._lit = np.zeros((0, 0), np.float32), True
        self._settled = True
        self._covered = False
        self._rows = (0, rig.camera.lens.height)
        # Counts whatever may change a frame without noise; which count the last frame and the kept one had.
        self._changes, self._made_at, self._kept_at = 0, -1, -1
        self._kept = np.zeros((0, 0), np.uint16)
        self._asked = self._applied = _first_gate(rig)
        self._late_us = 0.0
        self._aim()

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of the camera."""
        return self._info

    def _put_baked(self, part: LightPart) -> None:
        self.smooth.put(behind_lens(self._rig, part))

    @property
    def rig(self) -> Rig:
        """The rig that it is the camera of."""
        return self._rig

    @property
    def sensor(self) -> SensorModel | None:
        """The sensor model in use; None until `auto_gain` has chosen one."""
        return self._sensor

    @property
    def buffers(self) -> Buffers | None:
        """What the camera sees (depth read-outs), changed in place by motion; None before the first rendering."""
        return self._buffers

    def configure(self, settings: GateSettings) -> GateSettings:
        """Round to what the rig's camera accepts; the next frame is made with it and flagged as not settled."""
        period_us = self._rig.projector.period_us
        applied = quantise(self._rig.camera.shutter, settings, period_us)
        if applied != self._applied:
            self._change(applied, self._rows)
            self._aim()
        self._asked = settings
        return applied

    def trigger_late(self, late_us: float) -> None:
        """Let triggers come so much late (below 0: early) from the next frame on, and open the gates as late.

        What was set is told as it was set. For whoever reads the frames.
        """
        if late_us != self._late_us:
            self._late_us = late_us
            self._changes += 1
            self._aim()

    def _aim(self) -> None:
        """When the rows are exposed, with the trigger as late as it is."""
        real, late_us = self._applied, self._late_us
        if late_us:
            delay_us = math.remainder(real.delay_us + late_us, self._rig.projector.period_us)
            real = gate(real.line_time_us, delay_us, real.exposure_us)
        self._windows = row_windows(self._rig, real)
        self._edges = kernel_windows(self._windows)

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """Read only these rows, widened to whole groups of ROW_STEP."""
        check_rows(self._info, first, last)
        height = self._info.height
        first = max(min(first // ROW_STEP * ROW_STEP, height - ROW_STEP), 0)
        rows = first, min(max(-(-last // ROW_STEP) * ROW_STEP, first + ROW_STEP), height)
        if rows != self._rows:
            self._change(self._applied, rows)
        return rows

    def _change(self, applied: GateSettings, rows: tuple[int, int]) -> None:
        self._applied, self._rows = applied, rows
        self._settled = False
        self._changes += 1
        rate_hz = frame_rate_hz(self._rig, applied, rows[1] - rows[0], self._rate_hz)
        self._beat.set_rate(rate_hz, self._number)

    def cover(self, covered: bool) -> None:
        """Put the cap on the lens or take it off; the next frame is flagged as not settled."""
        if covered != self._covered:
            self._covered, self._settled = covered, False
            self._changes += 1

    def light_with(self, pattern: Singles | None) -> None:
        """Let the projector show this picture from the next frame on; None: everything lit, as at first.

        pattern (raster's height, width) float32: the share, 0..1, of its light that each projector pixel sends. It is
        kept, not copied, and must not change. Ambient light is not the projector's and stays. From any thread; the
        sensor's gain is chosen with everything lit.
        """
        if pattern is not None:
            check_picture_of(pattern, self._rig.projector.raster)
        self._orders.light_with(pattern)

    def number_frames_from(self, sequence: int) -> None:
        """Make the next frame the one of this number, and those after it the following ones; from any thread.

        The number fixes the frame's noise and, unless the camera runs free, the instant of a moving scene. Stamps go on
        counting the frames that come.
        """
        require(sequence >= 0, "sequence", sequence, "a whole number of at least 0")
        self._orders.number_from(sequence)

    def light_by_part(self, settings: GateSettings) -> dict[PartName, Singles]:
        """What each part that is ready brings to an image of this gate, shown or not: (H, W) float32, linear.

        Of the scene as the last frame saw it; from any thread, after `prepare`. The next frame waits for it. Nothing
        once the camera is closed.
        """
        seen = self._buffers
        if seen is None:
            return {}
        windows, periods = row_windows(self._rig, settings), settings.exposure_us / self._rig.projector.period_us
        places = seen.projector_row, seen.projector_column
        direct = patterned(self._plane(seen.direct), *places, self._pattern)
        return self.smooth.by_part(direct, seen.projector_row, windows, periods)

    def prepare(self, progress: Progress) -> None:
        """Render the scene now. `progress` is told the share done; Cancelled is raised when it returns False."""
        warm_up()
        renderer = self._renderer or Renderer(self._rig, self._scene, self._skip)
        rendered = 0.4 if self.smooth.shown - PLAIN else 0.8
        buffers, _ = renderer.at(0.0, lambda share: progress(rendered * share))
        if not progress(rendered):
            raise Cancelled("Rendering was stopped")
        self._prepare_parts(buffers, lambda share: progress(rendered + (0.8 - rendered) * share))
        plates = self._develop(buffers)
        self._renderer, self._buffers, self._plates = renderer, buffers, plates

    def _prepare_parts(self, buffers: Buffers, progress: Progress) -> None:
        waits = self.baking is not None and self._sensor is None
        baked = 0.5 if waits else 1.0
        parts = self._parts
        if parts is None:
            view = SeenScene(self._rig, self._scene, buffers, FILTERS[self._info.pixel_format])
            parts = prepare_parts(view, self.smooth.shown, lambda share: progress(baked * share))
        for part in parts:
            self.smooth.put(part)
        if self.baking and waits:
            self.baking.begin(lambda share: progress(baked + (1 - baked) * share))

    def start(self) -> None:
        """Begin to make frames."""
        if self.baking:
            self.baking.start()
        self._beat.start()
        self._stopped.clear()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """Wait for the next frame's turn and fill `buffer` (height, width) uint16; None after time-out or `stop`."""
        check_buffer(self._info, buffer)
        if self._stopped.is_set():
            return None
        if self._plates is None:
            try:
                self.prepare(lambda done: not self._stopped.is_set())
            except Cancelled:
                return None
        if not self._beat.wait(timeout_s) or self._stopped.is_set():
            return None
        time_s = self._beat.advance() - exposed_s(self._applied, self._rows[1])
        self._take_orders()
        cast = self._move(self._beat.scene_time_s(self._number))
        self._light()
        skipped = self._expose(buffer)
        rows = None if self._rows == (0, self._info.height) else self._rows
        made_with = (self._asked, self._applied, self._settled)
        stamp = FrameStamp(self._sequence, time_s, *made_with, skipped, rows=rows, cast_fraction=cast)
        self._sequence += 1
        self._number += 1
        self._settled = True
        return stamp

    def _take_orders(self) -> None:
        """Take over what `light_with` and `number_frames_from` asked for."""
        self._number, pattern = self._orders.take(self._number)
        if pattern is not self._pattern:
            self._pattern, self._lit = pattern, False
            self._changes += 1
            self.smooth.light_with(pattern)

    def _light(self) -> None:
        """Let the plates show the direct light of the pattern, unless they do."""
        # Where a lens is blurred, direct light is one of the parts and not the plates'.
        if not self._lit and not has_blur(self._rig):
            assert self._buffers is not None
            assert self._plates is not None
            self._plates.light_with(self._full, self._buffers.projector_column, self._pattern)
        self._lit = True

    def _expose(self, buffer: Counts) -> float:
        """Fill the buffer; returns the share of the pixels whose projector light was not looked at."""
        assert self._plates is not None
        quiet, changes = self._skip and not self._noise, self._changes + self.smooth.changes
        if quiet and self._kept_at == changes:
            np.copyto(buffer, self._kept)
            return 1.0
        periods = self._applied.exposure_us / self._rig.projector.period_us
        lit, times = self.smooth.pour(self._plates, self._windows, periods, self._changes)
        edges = self._edges
        if self._covered or not lit:
            edges = edges._replace(inside=0 * edges.inside, outside=0 * edges.outside)
        if self._covered:
            times = 0.0
        noise = self._pool.frame(self._seed, self._number, self._noise)
        skipped = expose_fast(self._plates, edges, times, noise, buffer, self._rows)
        # The second of equal frames is kept: a gate that goes on changing is spared the copy.
        if quiet and self._made_at == changes:
            self._kept, self._kept_at = buffer.copy(), changes
        self._made_at = changes
        return skipped

    def stop(self) -> None:
        """Make no more frames; wakes a waiting `read`. May come from any thread."""
        self._stopped.set()

    def close(self) -> None:
        """Stop and let the scene's buffers go."""
        self.stop()
        if self.baking:
            self.baking.close()
        self._renderer = self._buffers = self._plates = None

    def _move(self, time_s: float) -> float:
        """Move the scene to this instant; returns the share of the pixels that were rendered anew."""
        assert self._plates is not None
        assert self._renderer is not None
        if self._skip and not self._scene.moving:
            return 0.0
        self._buffers, region = self._renderer.at(time_s)
        if not self._skip:
            self._plates = self._develop(self._buffers)
            self.smooth.follow(self._buffers, region, time_s, self._room(self._buffers))
        elif region != NOWHERE:
            self._redevelop(self._plates, self._buffers, region, time_s)
        return self._renderer.recast_pixels / (self._info.height * self._info.width)

    def _develop(self, buffers: Buffers) -> Plates:
        direct, ambient = self._plane(buffers.direct), self._plane(buffers.ambient)
        self.smooth.take_ambient(self._room(buffers))
        if self._sensor is None:
            lit = row_windows(self._rig, whole_period(self._rig, upright_line_time(self._rig)))
            self._sensor = auto_gain(direct + self.smooth.whole(lit), SensorModel())
        self._full, self._lit = direct, self._pattern is None
        return Plates(buffers.projector_row, direct, ambient, self._sensor, self._skip)

    def _redevelop(self, plates: Plates, buffers: Buffers, region: Region, time_s: float) -> None:
        if has_blur(self._rig):
            # Blurred, light also changes beside the region.
            room = self._room(buffers)
            self.smooth.take_ambient(room)
            self.smooth.follow(buffers, region, time_s, room[region.rows, region.columns])
            return
        rows, columns = region
        direct = self._plane(buffers.direct[rows, columns], rows.start, columns.start)
        self._full[rows, columns] = direct
        places = buffers.projector_row[rows, columns], buffers.projector_column[rows, columns]
        direct = patterned(direct, *places, self._pattern)
        ambient = self._plane(buffers.ambient[rows, columns], rows.start, columns.start)
        self.smooth.follow(buffers, region, time_s, ambient)
        if not plates.refresh(rows, columns, direct, ambient):
            self._plates = self._develop(buffers)

    def _room(self, buffers: Buffers) -> Singles:
        """Ambient light (H, W) behind the lens."""
        return blurred(self._plane(buffers.ambient), self._rig.camera.blur_px)

    def _plane(self, rgb: Singles, first_row: int = 0, first_column: int = 0) -> Singles:
        if self._info.pixel_format == "mono12":
            return mono(rgb)
        return bayer_rg(rgb, first_row, first_column)
