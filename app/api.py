"""Slopegate in Python: gates, gated images, masks, depth, searches, slices and light transport, without a window.

    from slopegate.app import api

    scene = api.open_scene("three_targets")              # or a scene file, a mesh, a folder with photo and depth
    gate = scene.plan(tilt_deg=15, distance_m=1.05, thickness_m=0.1).applied
    light = scene.light(gate)                            # (H, W) float32, linear
    counts = scene.frame(gate, seed=1)                   # (H, W) uint16, with the camera's noise

The command line is made of the same calls. The names in `__all__` and what their docstrings describe are public and
stay as they are, or CHANGELOG says what changed. Everything else in `slopegate` is internal and may change at any time.

Axes: x right, y down, z forward; row k of an image covers [k, k + 1). Metres, degrees, microseconds, MHz. Light is in
units in which a white frontal surface 1 m from the projector returns 1. What the caller can mend is raised as
`UserError`, one sentence; any other exception is a bug of the program.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from slopegate.app.rig_gates import OpenRig, open_rig
from slopegate.app.transports import KEEP_S, Composite, OpenTransport, open_transport, with_decoding
from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.patterned import patterned
from slopegate.core.exposure.sensor import SensorModel, auto_gain, expose, frames_of_light, mono
from slopegate.core.gating.gate import Plane, Slab, SlabOrWhy, complement, row_windows
from slopegate.core.gating.plan import Planned
from slopegate.core.gating.slab_errors import SlabErrors
from slopegate.core.gating.slices import Slices, occupied_times, once_around, tile_times
from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import BakeSettings, for_patterns
from slopegate.core.light.indirect import Indirect, more_places
from slopegate.core.light.lens import behind_lens, blurred_light, has_blur, integrate_blurred
from slopegate.core.light.lights import PLAIN, Lights, asked_parts, holds, total, within_order
from slopegate.core.light.part import PARTS, Filter, LightPart, PartName
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.measure.depth_errors import DepthErrors, depth_errors
from slopegate.core.measure.exposure_sweep import (
    Likeness,
    best_exposure_us,
    expected_likeness,
    fog_target,
    measured_likeness,
    sweep_gates,
)
from slopegate.core.measure.mask import MaskGate, best_gate, overlap, recorded, seen_in_frames
from slopegate.core.measure.stack import StackSummary
from slopegate.core.measure.sweep import DepthError, DepthMap, DepthSweep, SweepSettings, depth_error
from slopegate.core.render.integrate import integrate_parts
from slopegate.core.render.render import Buffers, Renderer
from slopegate.core.rig.arrays import Bools, Counts, Singles
from slopegate.core.rig.blocks import on_raster, parse_grid
from slopegate.core.rig.checks import InputError, UserError, require, require_rectangle
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import depth_m
from slopegate.core.scene.scene import Scene
from slopegate.core.search.keypoints import Rectangle
from slopegate.core.search.search import begin
from slopegate.core.search.state import Method, Outcome, SearchStep
from slopegate.core.transport.plan import TransportPlan, plan_transport
from slopegate.core.transport.relight import SliceLight
from slopegate.core.transport.sliced import Entries, SliceTransport
from slopegate.core.transport.weights import Agreement
from slopegate.drivers.cameras.virtual import FILTERS, VirtualCamera
from slopegate.drivers.captures.capture_run import SceneClock, run_capture
from slopegate.drivers.captures.exported import is_recorded, open_any
from slopegate.drivers.captures.film import FilmFolder, check_new_film, create_film, is_film, make_film_manifest
from slopegate.drivers.captures.film import open_film as open_film_folder
from slopegate.drivers.captures.film_recorder import FilmLimits, FilmProgress, FilmRecorder
from slopegate.drivers.captures.film_run import run_film
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.captures.recorder import CaptureProgress, Recorder
from slopegate.drivers.captures.storage import (
    CaptureFolder,
    check_new_folder,
    create_capture,
    make_manifest,
)
from slopegate.drivers.captures.storage import open_capture as open_folder
from slopegate.drivers.captures.summary import by_delay, summarise
from slopegate.drivers.contract.frame import PixelFormat
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes import scene_files
from slopegate.drivers.scenes.bakes import USUAL_ERROR_PERCENT, BakeGoal, BakeReport, bake_to, begin_bake
from slopegate.drivers.scenes.scene_files import SceneEntry, scene_path
from slopegate.drivers.stream.depth_run import frames_of, run_sweep
from slopegate.drivers.stream.search_run import run_on_camera
from slopegate.drivers.stream.stream import Stream
from slopegate.drivers.transports.bench import SceneBench
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import Attendance
from slopegate.drivers.transports.storage import (
    TransportFolder,
    check_new_transport,
    is_transport,
)
from slopegate.drivers.transports.storage import open_transport as open_transport_folder

__all__ = [
    "Agreement",
    "BakeReport",
    "Buffers",
    "Composite",
    "DepthError",
    "DepthErrors",
    "DepthMap",
    "Entries",
    "ExposureSweep",
    "FilmProgress",
    "GateSettings",
    "Likeness",
    "MaskGate",
    "MaskResult",
    "MeasuredDepth",
    "OpenCapture",
    "OpenFilm",
    "OpenRig",
    "OpenScene",
    "OpenTransport",
    "Outcome",
    "PartName",
    "Plane",
    "Planned",
    "Recording",
    "SceneEntry",
    "SearchResult",
    "SearchStep",
    "SensorModel",
    "Slab",
    "SlabErrors",
    "SlabOrWhy",
    "SliceLight",
    "SliceTransport",
    "StackSummary",
    "TransportPlan",
    "UserError",
    "list_scenes",
    "open_capture",
    "open_film",
    "open_rig",
    "open_scene",
    "open_transport",
]

RATE_HZ = 20.0
"""Frames a second of scene time while slices are recorded."""

Share = Callable[[float], None]
"""Told the share done, 0..1."""
Sentence = Callable[[str], None]
"""Told what is under way."""


@dataclass(frozen=True, eq=False)
class MeasuredDepth:
    """Depth as the camera measured it by moving the gate."""

    map: DepthMap
    """`depth_m` (H, W) float32, NaN where unknown; `projector_row`, `disparity_rows`; the number of `frames`."""
    error: DepthError | None
    """Against the scene's own depth; None where no lit pixel has a depth."""
    standard_errors: DepthErrors | None = None
    """How well each depth is known, `total_m` (H, W) float32: by the rig, `rig_m`, and by the sweep's steps, `sweep_m`;
    None where the rig file does not tell how well its numbers are known."""


@dataclass(frozen=True)
class MaskResult:
    """The gate that keeps or hides a region, and how well two frames say it does."""

    best: MaskGate
    """`sent` is the gate to use, `iou` the overlap that it should reach, `good` whether that is enough."""
    achieved_iou: float
    """Overlap (intersection over union) counted in a frame of the gate and one of its complement."""
    told_share: float
    """Of the lit pixels, those bright enough in these frames to be counted."""


@dataclass(frozen=True)
class SearchResult:
    """How a search ended, and the frames it took."""

    outcome: Outcome
    """`settings` is the gate found, None when none was; `reason` says why, in a sentence."""
    history: tuple[SearchStep, ...]
    target: Rectangle
    """x0, y0, x1, y1 in pixels, without x1 and y1 themselves."""
    max_frames: int


@dataclass(frozen=True)
class ExposureSweep:
    """How like the same scene without fog a gate's image is, at every exposure."""

    exposures_us: tuple[float, ...]
    """Rising."""
    measured: tuple[Likeness, ...]
    """What noisy frames of each exposure say."""
    expected: tuple[Likeness, ...]
    """What the light of each exposure let expect before a frame was taken."""
    regular: Likeness
    """What frames of the fully lit image say."""
    best_us: float
    """The measured exposure of the greatest NCC."""
    predicted_us: float
    """The expected one."""


@dataclass(frozen=True, eq=False, repr=False)
class OpenCapture(OpenRig):
    """A recorded capture: the rig it was made with, and its slices by rising delay, farthest first."""

    folder: Capture
    """The program's own view of the folder, which may change."""

    @property
    def scene_name(self) -> str:
        """What was recorded."""
        return self.folder.manifest.scene

    @property
    def _title(self) -> str:
        return self.scene_name

    @property
    def missing(self) -> int:
        """How many of the planned slices have not been taken."""
        return len(self.folder.missing())

    @property
    def gates(self) -> Slices:
        """The gates that the camera applied."""
        return tuple(record.applied.settings() for record in by_delay(self.folder))

    def light(self, place: int) -> Singles:
        """Counts above the dark (H, W) float32, the mean over a slice's frames; `place` as in `gates`."""
        records = by_delay(self.folder)
        require(0 <= place < len(records), "place", place, f"a whole number from 0 to {len(records) - 1}")
        index = records[place].index
        assert index is not None
        return self.folder.mean(index) - self.folder.dark_mean()

    @cached_property
    def stack(self) -> StackSummary:
        """All slices together: `total` light, coloured `overlay`, `projector_row` and `inverse_depth` (1/m)."""
        return summarise(self.folder)

    @property
    def depth_m(self) -> Singles:
        """Metres along the camera's axis (H, W) float32, NaN where no slice shows light."""
        return depth_m(self.stack.inverse_depth)


@dataclass(frozen=True, eq=False, repr=False)
class OpenFilm(OpenRig):
    """A recording at one gate: the rig it was made with, and its frames in the order in which they came."""

    folder: FilmFolder
    """The program's own view of the folder, which may change."""

    @property
    def scene_name(self) -> str:
        """What was recorded."""
        return self.folder.manifest.scene

    @property
    def _title(self) -> str:
        return self.scene_name

    @property
    def applied(self) -> GateSettings | None:
        """The gate as the camera made it; None without frames, and for a camera without a gate."""
        found = self.folder.record(0).applied if self.frames else None
        return None if found is None else found.settings()

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(self.folder)

    @property
    def lost(self) -> int:
        """Frames that should be there and are not: the camera lost them, or the disk was too slow."""
        return self.folder.counted().lost

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return self.folder.counted().seconds

    @property
    def bytes(self) -> int:
        """Of all frames on the disk."""
        return self.folder.counted().bytes

    @property
    def ended(self) -> str:
        """Why it ended, in a sentence."""
        return self.folder.counted().ended

    def frame(self, number: int) -> Counts:
        """Raw counts (H, W) uint16 of a frame, from 0."""
        return self.folder.frame(number)

    def time_s(self, number: int) -> float:
        """When the exposure of a frame's row 0 began, in seconds since that of the first frame."""
        return self.folder.record(number).time_s - self.folder.record(0).time_s


@dataclass(frozen=True, eq=False)
class Recording:
    """A finished recording, and the frames that it took."""

    capture: OpenCapture
    frames_used: int
    frames_lost: int
    frames_duplicated: int
    frames_discarded: int


@dataclass(frozen=True, eq=False, repr=False)
class OpenScene(OpenRig):
    """A scene before a rig with a virtual camera. It is rendered once, at the first call that needs it.

    Colour images are (H, W, 3) RGB, others (H, W) luminance, as a monochrome sensor sees it. Depth, search and slices
    go through frames of the virtual camera, as they would with a real one; its noise follows from `seed` alone.
    """

    scene: Scene
    """The program's own description of it, which may change."""
    time_s: float = 0.0
    skip: bool = True

    @property
    def scene_name(self) -> str:
        """The scene's title."""
        return self.scene.name

    @property
    def _title(self) -> str:
        return self.scene_name

    @property
    def remarks(self) -> tuple[str, ...]:
        """What of the scene file was left out or made otherwise for this rig."""
        return self.scene.remarks

    @property
    def moving(self) -> bool:
        """Whether anything moves, which misleads depth and search."""
        return self.scene.moving

    @cached_property
    def gates(self) -> dict[str, GateSettings]:
        """The scene's own gates by name."""
        return {
            gate.name: self.complement(gate.settings) if gate.complement else gate.settings for gate in self.scene.gates
        }

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(self.rig, self.scene, self.skip)

    @cached_property
    def buffers(self) -> Buffers:
        """What each pixel sees, whatever the gate: projector row, inverse depth, direct and ambient light."""
        return self._renderer.at(self.time_s)[0]

    @property
    def depth_m(self) -> Singles:
        """The scene's own depth: metres along the camera's axis (H, W) float32, NaN where no surface is known."""
        return depth_m(self.buffers.inverse_depth)

    def recorded(self, gate: GateSettings) -> Bools:
        """Where the gate records light of the projector, (H, W) bool."""
        return recorded(self.rig, gate, self.buffers.projector_row)

    @cached_property
    def parts(self) -> frozenset[PartName]:
        """The parts of the light that the scene asks for: direct, ambient, and what fog, skin and the file bring."""
        return asked_parts(self.scene)

    def light(
        self,
        gate: GateSettings,
        *,
        colour: bool = False,
        samples: int = 1,
        parts: Collection[PartName] | None = None,
        max_order: int | None = None,
        pattern: Singles | None = None,
        progress: Share | None = None,
    ) -> Singles:
        """The light that the gate records, float32, linear. `samples`: rays a pixel along each axis.

        `parts`, `max_order`, `pattern`: as for `light_by_part`, whose parts this is the sum of.
        """
        shown = self.shown_parts(parts, max_order, pattern)
        if samples == 1 and shown == PLAIN and pattern is None:
            buffers, periods = self.buffers, gate.exposure_us / self.period_us
            windows = row_windows(self.rig, gate)
            light = gated(buffers.projector_row, buffers.direct, buffers.ambient, windows, periods, self.skip)
            return light if colour else mono(light)
        found = self.light_by_part(
            gate,
            colour=colour,
            samples=samples,
            parts=shown,
            max_order=max_order,
            pattern=pattern,
            progress=progress,
        )
        return total(found, (*self.shape, 3) if colour else self.shape)

    def light_by_part(
        self,
        gate: GateSettings,
        *,
        colour: bool = False,
        samples: int = 1,
        parts: Collection[PartName] | None = None,
        max_order: int | None = None,
        pattern: Singles | None = None,
        progress: Share | None = None,
    ) -> dict[PartName, Singles]:
        """The light that the gate records, part by part, each float32 and linear; they add up to `light`.

        `parts`: which of direct, airlight, scatter, indirect, subsurface, ambient; None is what the scene asks for. A
        part that the scene has nothing of is black. `max_order`: only light that changed direction at most so often
        (1: direct and airlight); None is all that matters. Indirect light is baked first, see `bake`.

        `pattern`: what the projector shows, (rows, columns) of its own size or of any grid up to that, the share, 0 to
        1, of its light; None is all on. Ambient light is not the projector's: with a pattern it counts only where
        `parts` names it. Direct light under a pattern is exact.
        """
        shown, picture = self.shown_parts(parts, max_order, pattern), self._picture(pattern)
        windows, found = row_windows(self.rig, gate), self._plain(gate, colour, samples, picture, progress)
        light_filter: Filter = "rgb" if colour else "mono"
        lights = self._lights(shown, light_filter, samples, _bake_settings(max_order, pattern is not None), progress)
        lights.light_with(picture)
        for name in PARTS:
            if name in shown - PLAIN:
                found[name] = np.zeros((*self.shape, 3) if colour else self.shape, np.float32)
                lights.add(windows, (name,), found[name])
        return {name: found[name] for name in PARTS if name in shown}

    def shown_parts(
        self, parts: Collection[PartName] | None, max_order: int | None = None, pattern: Singles | None = None
    ) -> frozenset[PartName]:
        """The parts that `light` adds up when it is given these."""
        usual = self.parts if pattern is None else self.parts - {"ambient"}
        wanted = usual if parts is None else frozenset(parts)
        wrong = sorted(wanted - set(PARTS))
        require(not wrong, "parts", wrong, f"some of {', '.join(PARTS)}")
        require(max_order is None or max_order >= 1, "max_order", max_order, "None or a whole number of at least 1")
        return within_order(wanted, max_order)

    def needs_bake(self, parts: Collection[PartName] | None = None, max_order: int | None = None) -> bool:
        """Whether these parts hold indirect light that the scene has surfaces for."""
        return "indirect" in self.shown_parts(parts, max_order) and holds(self.scene, "indirect")

    def _picture(self, pattern: Singles | None) -> Singles | None:
        """A pattern on the projector's raster."""
        if pattern is None:
            return None
        values = np.asarray(pattern, np.float32)
        require(values.ndim == 2, "pattern", values.shape, "a picture of rows x columns")
        ok = bool(((values >= 0) & (values <= 1)).all())
        require(ok, "pattern", float(values.min()), "shares of the light from 0 to 1 in every pixel")
        return on_raster(values, self.rig.projector.raster)

    def _plain(
        self, gate: GateSettings, colour: bool, samples: int, picture: Singles | None, progress: Share | None
    ) -> dict[PartName, Singles]:
        """Direct and ambient light of a gate, while the projector shows this picture."""
        if has_blur(self.rig) and samples == 1:
            direct, ambient = blurred_light(self.rig, self.buffers, gate, picture)
        elif samples != 1 or has_blur(self.rig):
            integrated = integrate_blurred if has_blur(self.rig) else integrate_parts
            asked = self.rig, self.scene, gate, samples, self.time_s, _to_the_end(progress), self.skip
            direct, ambient = integrated(*asked, picture)
        else:
            buffers, windows = self.buffers, row_windows(self.rig, gate)
            dark = np.zeros_like(buffers.direct)
            lit = patterned(buffers.direct, buffers.projector_row, buffers.projector_column, picture)
            direct = gated(buffers.projector_row, lit, dark, windows, 0.0, self.skip)
            ambient = np.float32(gate.exposure_us / self.period_us) * buffers.ambient
        return {"direct": direct if colour else mono(direct), "ambient": ambient if colour else mono(ambient)}

    def bake(
        self,
        *,
        paths: int | None = None,
        error_percent: float | None = None,
        max_order: int | None = None,
        patterns: bool = False,
        progress: Share | None = None,
    ) -> BakeReport:
        """Prepare indirect light: until there are `paths` a cell, or its noise is at most error_percent (1).

        The noise is the root mean square over 4 x 4 pixels in a gate that records everything twice, as a share of the
        fully lit image's mean. What the disk has of such a bake is taken up, and the result is kept there, in the
        platform's cache folder. `patterns`: for light under patterns, which needs a table of its own.
        """
        require(paths is None or paths >= 1, "paths", paths, "None or a whole number of at least 1")
        noise = USUAL_ERROR_PERCENT if error_percent is None else error_percent
        require(noise > 0, "error_percent", error_percent, "None or a number above 0")
        told = _to_the_end(progress)
        settings = _bake_settings(max_order, patterns)
        bake = self._bakes.get(settings)
        if bake is None:
            bake = self._bakes[settings] = begin_bake(self.rig, self.scene, settings, told)
        report = bake_to(bake, BakeGoal(paths, noise), told)
        for (_, _, shown_with), lights in self._prepared.items():
            if shown_with == settings and not report.cached:
                lights.drop("indirect")
        return report

    @cached_property
    def _bakes(self) -> dict[BakeSettings, Bake]:
        return {}

    def _lights(
        self,
        shown: Collection[PartName],
        light_filter: Filter,
        samples: int,
        settings: BakeSettings,
        progress: Share | None,
    ) -> Lights:
        """The parts among these, each prepared once; indirect light as far as it is baked, or to the usual noise."""
        lights = self._prepared.setdefault((light_filter, samples, settings), Lights())
        missing = frozenset(shown) - PLAIN - set(lights.names)
        max_order = settings.max_order
        view = SeenScene(self.rig, self.scene, self.buffers, light_filter, self.time_s, samples, max_order)
        for part in prepare_parts(view, missing, _to_the_end(progress)):
            lights.put(part)
        if self.needs_bake(missing):
            if settings not in self._bakes:
                self.bake(max_order=max_order, patterns=settings.columns > 1, progress=progress)
            bake = self._bakes[settings]
            finer = more_places(self.rig, bake.surfaces, bake.picture, samples)
            indirect = Indirect(self.rig, bake.picture, light_filter, finer=finer)
            indirect.show(bake.snapshot())
            lights.put(behind_lens(self.rig, indirect))
        return lights

    @cached_property
    def _prepared(self) -> dict[tuple[Filter, int, BakeSettings], Lights]:
        return {}

    def sensor(self, *, colour: bool = False) -> SensorModel:
        """The 12-bit sensor of `frame`; the fully lit image fills 80 % of its range."""
        return auto_gain(self.light(self.everything_lit, colour=colour), SensorModel())

    def frame(
        self,
        gate: GateSettings,
        *,
        noise: bool = True,
        seed: int = 0,
        colour: bool = False,
        samples: int = 1,
        parts: Collection[PartName] | None = None,
        max_order: int | None = None,
        pattern: Singles | None = None,
        progress: Share | None = None,
    ) -> Counts:
        """The camera's image: counts, uint16, with shot and read noise unless `noise` is False. The rest as `light`."""
        light = self.light(
            gate,
            colour=colour,
            samples=samples,
            parts=parts,
            max_order=max_order,
            pattern=pattern,
            progress=progress,
        )
        return self.expose(light, noise=noise, seed=seed, colour=colour)

    def expose(self, light: Singles, *, noise: bool = True, seed: int = 0, colour: bool = False) -> Counts:
        """Counts of the scene's sensor, uint16, from linear light as `light` gives it."""
        rng = np.random.default_rng(_checked(seed)) if noise else None
        return expose(light, self.sensor(colour=colour), rng)

    def measure_depth(
        self,
        *,
        nearest_m: float = 0.3,
        finest_rows: float = 1.0,
        average: int = 1,
        noise: bool = True,
        seed: int = 0,
        progress: Share | None = None,
    ) -> MeasuredDepth:
        """Depth of every pixel by a coarse-to-fine sweep of the gate.

        Nothing nearer than `nearest_m` is looked for; `finest_rows` projector rows are told apart; `average` frames are
        taken of each gate.
        """
        sweep = DepthSweep(self.rig, SensorModel().black_count, SweepSettings(nearest_m, finest_rows, repeats=average))
        told = progress or (lambda share: None)
        with self._camera(noise, seed) as camera:
            found = run_sweep(frames_of(camera), sweep, lambda now: told(now.share_done))
            assert found is not None
            assert camera.buffers is not None
            error = depth_error(found, camera.buffers.projector_row, camera.buffers.inverse_depth)
        return MeasuredDepth(found, error, depth_errors(self.rig, found))

    def mask(
        self,
        region: Bools | Rectangle,
        *,
        hide: bool = False,
        depth: DepthMap | None = None,
        noise: bool = True,
        seed: int = 0,
    ) -> MaskResult:
        """The gate, or complement of one, that keeps (or hides) a region of the image best.

        `region`: (H, W) bool, or x0, y0, x1, y1 in pixels without x1 and y1 themselves. `depth`: a measured map to go
        by, in place of the scene's own depth.
        """
        wanted = region if isinstance(region, np.ndarray) else self._rectangle(region)
        rows = (self.buffers if depth is None else depth).projector_row
        best = best_gate(self.rig, rows, wanted, hide)
        lit, frames = rows >= 0, []
        with self._camera(noise, seed) as camera:
            take = frames_of(camera)
            for settings in (best.sent, complement(best.sent, self.period_us)):
                got = take(settings)
                assert got is not None
                frames.append(got[0].copy())
            seen, told = seen_in_frames(frames[0], frames[1], camera.info.black_count)
        told &= lit
        share = int(np.count_nonzero(told)) / max(int(np.count_nonzero(lit)), 1)
        return MaskResult(best, overlap(~seen if hide else seen, wanted, told), share)

    def search(
        self,
        target: Rectangle | None = None,
        *,
        method: Method = "fast",
        max_frames: int | None = None,
        noise: bool = True,
        seed: int = 0,
        watch: Callable[[tuple[SearchStep, ...]], None] | None = None,
    ) -> SearchResult:
        """The gate that shows a target, found from images alone.

        `target`: x0, y0, x1, y1 in pixels without x1 and y1 themselves; None is the whole image. `watch` is told the
        history so far after every frame.
        """
        told = watch or (lambda history: None)
        state = begin(self.rig, target, method, SensorModel().black_count, max_frames, seed)
        with self._camera(noise, seed) as camera:
            state = run_on_camera(camera, state, lambda now: told(now.history))
        assert state.outcome is not None
        return SearchResult(state.outcome, state.history, state.task.target, state.task.max_frames)

    def sweep_exposure(
        self,
        *,
        delay_us: float,
        clock_mhz: float | None = None,
        line_time_us: float | None = None,
        region: Rectangle | None = None,
        count: int = 40,
        frames: int = 5,
        seed: int = 0,
        parts: Collection[PartName] | None = None,
        max_order: int | None = None,
        progress: Share | None = None,
    ) -> ExposureSweep:
        """NCC, contrast and contrast-to-noise of a gate's image against the fully lit scene without fog.

        At up to `count` exposures at equal ratios, from the camera's least to one period. `region`: x0, y0, x1, y1 in
        pixels without x1 and y1 themselves, None for the whole image; `frames`: how many of each exposure are taken,
        with the same noise at every exposure, so that what differs is the light; `parts`, `max_order`: of the light in
        fog, as for `light_by_part`.
        """
        require(frames >= 2, "frames", frames, "a whole number of at least 2, for noise shows in the difference of two")
        line = self._line_time_us(clock_mhz, line_time_us)
        gates = sweep_gates(self.rig.camera.shutter, self.period_us, line, delay_us, count)
        clear = OpenScene(self.rig, replace(self.scene, fog=None), self.time_s, self.skip)
        target = fog_target(clear.light(self.everything_lit, max_order=max_order), region)
        fully_lit = self.light(self.everything_lit, parts=parts, max_order=max_order)
        sensor, seed = auto_gain(fully_lit, SensorModel()), _checked(seed)

        def seen(gate: GateSettings) -> tuple[Likeness, Likeness]:
            light = np.ascontiguousarray(target.cut(self.light(gate, parts=parts, max_order=max_order)))
            taken = frames_of_light(light, sensor, seed, frames)
            return measured_likeness(taken, target, sensor.black_count), expected_likeness(light, target, sensor)

        measured, expected = [], []
        for place, gate in enumerate(gates):
            one, other = seen(gate)
            measured.append(one)
            expected.append(other)
            if progress is not None:
                progress((place + 1) / len(gates))
        exposures = tuple(gate.exposure_us for gate in gates)
        return ExposureSweep(
            exposures_us=exposures,
            measured=tuple(measured),
            expected=tuple(expected),
            regular=seen(self.everything_lit)[0],
            best_us=best_exposure_us(exposures, measured),
            predicted_us=best_exposure_us(exposures, expected),
        )

    def plan_lit_slices(
        self,
        count: int | None = None,
        *,
        clock_mhz: float | None = None,
        line_time_us: float | None = None,
        exposure_us: float | None = None,
        scattered: bool = False,
    ) -> Slices:
        """As `plan_slices`, over all that the projector lights.

        scattered: where fog, skin or surfaces scatter light, which then arrives from other distances too, the first and
        the last slice reach on until all of them record everything once.
        """
        line = self._settable_us(clock_mhz, line_time_us)
        lit = occupied_times(self.rig, line, self.buffers.projector_row)
        if lit is None:
            raise InputError(
                "the projector lights nothing that the camera sees: give the nearest and farthest distance"
            )
        if count is None:
            count = self._count(*lit, exposure_us)
        slices = tile_times(self.rig, line, *lit, count)
        return once_around(self.rig, slices) if scattered and self.parts - PLAIN else slices

    def record(
        self,
        folder: str | Path,
        slices: Sequence[GateSettings],
        *,
        frames: int = 1,
        dark: bool = False,
        skip_empty: bool = False,
        noise: bool = True,
        seed: int = 0,
        say: Sentence | None = None,
    ) -> Recording:
        """Record these slices into a new folder. Each is on the disk before the next begins.

        `frames` are averaged for each slice; `dark`: with a dark frame; `skip_empty`: slices without light are noted
        instead of taken. `say` is told a few times a second how far it is.
        """
        path = Path(folder)
        check_new_folder(path)
        clock = SceneClock()
        camera = self._recording_camera(clock, noise, seed)
        plan = slices, frames, dark, skip_empty
        manifest = make_manifest(self.scene_name, self.rig, camera.info, *plan, noise, seed)
        return self._run(create_capture(path, manifest), camera, clock, say)

    def resume(
        self,
        folder: str | Path,
        *,
        noise: bool | None = None,
        seed: int | None = None,
        say: Sentence | None = None,
    ) -> Recording:
        """Take what is missing or damaged in a capture of this scene that was begun before.

        `noise` and `seed` are those that it was begun with: None, or the same.
        """
        begun, clock = open_folder(Path(folder)), SceneClock()
        camera = self._recording_camera(clock, *begun.noise_to_go_on_with(noise, seed))
        begun.require_begun_with(self.rig, camera.info)
        return self._run(begun.set_damaged_aside(), camera, clock, say)

    def film(
        self,
        folder: str | Path,
        gate: GateSettings,
        *,
        frames: int | None = None,
        seconds: float | None = None,
        every_s: float | None = None,
        noise: bool = True,
        seed: int = 0,
        overwrite: bool = False,
        watch: Callable[[FilmProgress], object] | None = None,
    ) -> OpenFilm:
        """Record raw frames at one gate into a folder: so many `frames`, or so many `seconds` of the scene's time.

        Without either it goes on until it is interrupted, as by Ctrl-C; what has been recorded stays. 20 frames a
        second, or one `every_s`; a scene waits for the disk, so none is lost. `watch` is told a few times a second how
        far it is. `overwrite`: a recording that is there is replaced.
        """
        limits = FilmLimits(frames, seconds, every_s)
        path, clock = Path(folder), SceneClock()
        check_new_film(path, overwrite)
        rate_hz = RATE_HZ if limits.every_s is None else min(RATE_HZ, 1 / limits.every_s)
        camera = self._recording_camera(clock, noise, seed, rate_hz)
        manifest = make_film_manifest(self.scene_name, self.rig, camera.info, gate, limits.every_s)

        def attend(stream: Stream, recorder: FilmRecorder) -> Callable[[], object]:
            clock.watch(recorder)
            return lambda: None if watch is None else watch(recorder.progress)

        camera.prepare(lambda share: True)
        made = create_film(path, manifest, overwrite)
        return filmed(made, run_film(camera, made, limits, attend, lambda sentence: None))

    def plan_transport(
        self,
        slices: Sequence[GateSettings],
        *,
        grid: str = "32x32",
        codes: CodeName = "hadamard",
        frames: int = 1,
        pixel_format: PixelFormat = "mono12",
    ) -> TransportPlan:
        """What `acquire_transport` will take: frames, seconds, bytes and noise.

        The seconds are those of this computer with nothing else to do, from a few frames that are made for it after all
        is prepared, without the preparing.
        """
        blocks = parse_grid(grid, self.rig.projector.raster)
        bench = self._transport_bench(self._under_patterns(None), 0, pixel_format, None)
        frame_s = bench.seconds_a_frame() + KEEP_S * math.prod(self.shape)
        plan = plan_transport(codes, blocks, self.shape, len(slices), frames, frame_s, 0.0, bench.sensor)
        return with_decoding(plan, len(slices), self.shape)

    def acquire_transport(
        self,
        folder: str | Path,
        slices: Sequence[GateSettings],
        *,
        grid: str = "32x32",
        codes: CodeName = "hadamard",
        frames: int = 1,
        parts: Collection[PartName] | None = None,
        noise: bool = True,
        seed: int = 0,
        pixel_format: PixelFormat = "mono12",
        keep_raw: bool = False,
        say: Sentence | None = None,
    ) -> OpenTransport:
        """Acquire light transport through these gates into a new folder. Each slice is on the disk before the next.

        `grid`: columns x rows of blocks of the projector, from 4x2 to 512x512. `codes`: hadamard, s, impulse, gray or
        adaptive. `frames` are summed for each pattern. `parts`: as for `light_by_part`; None leaves ambient light out,
        which no pattern changes. `pixel_format`: mono12, or bayer_rg12 for a camera in colour. `keep_raw`: keep all
        frames. `say` is told how far it is.
        """
        path, seed = Path(folder), _checked(seed)
        check_new_transport(path)
        blocks, shown = parse_grid(grid, self.rig.projector.raster), self._under_patterns(parts)
        bench = self._transport_bench(shown, seed if noise else None, pixel_format, say)
        return _take_transport(bench, bench.begin(path, blocks, codes, slices, frames), keep_raw, say)

    def resume_transport(
        self, folder: str | Path, *, keep_raw: bool = False, say: Sentence | None = None
    ) -> OpenTransport:
        """Take what is missing in a folder of light transport of this scene that was begun before."""
        begun = open_transport_folder(Path(folder))
        manifest = begun.manifest
        kept, allowed = f"light transport of {manifest.scene}", f"of this scene, {self.scene_name}, as it was"
        require(manifest.scene == self.scene_name, "folder", kept, allowed)
        shown = frozenset(name for name in PARTS if name in manifest.parts)
        bench = self._transport_bench(shown, manifest.seed, manifest.camera.pixel_format, say)
        begun.require_begun_with(self.rig, bench.camera.info, self.rig.projector.raster)
        require(manifest.counts_per_unit == bench.sensor.counts_per_unit, "folder", kept, allowed)
        return _take_transport(bench, begun, keep_raw, say)

    def _under_patterns(self, parts: Collection[PartName] | None) -> frozenset[PartName]:
        """The parts that frames of light transport show."""
        return self.shown_parts(self.parts - {"ambient"} if parts is None else parts)

    def _transport_bench(
        self, shown: frozenset[PartName], seed: int | None, pixel_format: PixelFormat, say: Sentence | None
    ) -> SceneBench:
        """Ready, which fog and light between surfaces make slow: `say` is told how far it is."""
        require(pixel_format in FILTERS, "pixel_format", pixel_format, " or ".join(FILTERS))

        def told(share: float) -> None:
            if say is not None:
                say(f"Preparing the light: {share:.0%}")

        return SceneBench(
            self.rig,
            self.scene,
            shown,
            seed,
            pixel_format,
            progress=_to_the_end(told),
            renderer=self._shared_renderer,
            lights=self._parts_for(shown, FILTERS[pixel_format], for_patterns(), told),
            skip=self.skip,
        )

    def _run(
        self,
        folder: CaptureFolder,
        camera: VirtualCamera,
        clock: SceneClock,
        say: Sentence | None,
    ) -> Recording:
        def attend(stream: Stream, recorder: Recorder) -> Callable[[], object]:
            clock.watch(recorder)
            return lambda: None if say is None else say(recorder.progress.sentence)

        camera.prepare(lambda share: True)
        return finished(
            folder,
            run_capture(camera, folder, attend, lambda sentence: None, number_from=camera.number_frames_from),
        )

    def _recording_camera(self, clock: SceneClock, noise: bool, seed: int, rate_hz: float = RATE_HZ) -> VirtualCamera:
        return VirtualCamera(
            self.rig,
            self.scene,
            rate_hz=rate_hz,
            seed=_checked(seed),
            clock=clock.now,
            sleep=clock.sleep,
            noise=noise,
            renderer=self._shared_renderer,
            parts=self._parts_of_a_camera(),
        )

    @contextmanager
    def _camera(self, noise: bool, seed: int) -> Iterator[VirtualCamera]:
        """Ready to make frames, as fast as it can."""
        renderer = self._shared_renderer
        camera = VirtualCamera(
            self.rig,
            self.scene,
            rate_hz=math.inf,
            seed=_checked(seed),
            noise=noise,
            renderer=renderer,
            parts=self._parts_of_a_camera(),
        )
        camera.prepare(lambda share: True)
        camera.start()
        try:
            yield camera
        finally:
            camera.close()

    def _parts_of_a_camera(self) -> list[LightPart]:
        """What the scene asks for, baked to the usual noise; of its own where things move, as `_shared_renderer`."""
        return self._parts_for(self.parts, "mono", BakeSettings())

    def _parts_for(
        self, shown: frozenset[PartName], light_filter: Filter, settings: BakeSettings, progress: Share | None = None
    ) -> list[LightPart]:
        scene = OpenScene(self.rig, self.scene, skip=self.skip) if self.moving else self
        lights = scene._lights(shown, light_filter, 1, settings, progress)
        lights.light_with(None)
        return [lights.part(name) for name in lights.names if name in shown]

    @property
    def _shared_renderer(self) -> Renderer | None:
        """None where things move: a camera goes on with the time, and `buffers` stays where it is."""
        return None if self.moving else self._renderer

    def _rectangle(self, region: Rectangle) -> Bools:
        x0, y0, x1, y1 = region
        height, width = self.shape
        require_rectangle("region", region, width, height)
        found = np.zeros(self.shape, bool)
        found[y0:y1, x0:x1] = True
        return found


def _checked(seed: int) -> int:
    require(0 <= seed < 2**63, "seed", seed, "a whole number from 0 to 2^63 - 1")
    return seed


def _bake_settings(max_order: int | None, patterns: bool) -> BakeSettings:
    return for_patterns(max_order) if patterns else BakeSettings(max_order=max_order)


def _to_the_end(progress: Share | None) -> Callable[[float], bool]:
    """The same for `core`, which stops when it is told False."""

    def told(share: float) -> bool:
        if progress is not None:
            progress(share)
        return True

    return told


def _take_transport(bench: SceneBench, folder: TransportFolder, keep_raw: bool, say: Sentence | None) -> OpenTransport:
    told = say or (lambda sentence: None)
    bench.acquire(folder, Attendance(lambda progress: told(progress.sentence)), keep_raw)
    return OpenTransport(folder.rig, folder)


def finished(folder: CaptureFolder, progress: CaptureProgress) -> Recording:
    """A recording that has ended. Raises StorageError where it failed."""
    if progress.state == "failed":
        raise StorageError(progress.doing)
    tally, opened = progress.tally, OpenCapture(folder.rig, folder)
    return Recording(opened, progress.frames, tally.lost, tally.duplicated, tally.discarded)


def filmed(folder: FilmFolder, progress: FilmProgress) -> OpenFilm:
    """A recording at one gate that has ended. Raises StorageError where it failed, and says what is kept."""
    if progress.state == "failed":
        raise StorageError(f"{progress.doing}; {progress.frames} frames are kept in {folder.path}")
    return OpenFilm(folder.rig, folder)


def list_scenes() -> list[SceneEntry]:
    """The scenes that come with the program; `key` is what `open_scene` takes."""
    return scene_files.offered_scenes()


def open_scene(
    scene: str | Path, rig: str | Path | OpenRig | None = None, *, time_s: float = 0.0, skip: bool = True
) -> OpenScene:
    """A shipped scene by its key, a scene file (.toml), a mesh (.obj .ply .stl .glb .gltf) or an RGB-D folder.

    `rig`: a rig file, a shipped rig's key, an open rig, or None for the default; a folder with photo and depth brings
    its own camera.
    `time_s`: the instant of a moving scene that `light`, `frame` and `buffers` show. `skip` False: leave nothing out,
    cast every ray and look at every pixel; slower, and the same images.
    """
    path = scene_path(str(scene))
    if is_recorded(path):
        raise SceneError(f"{path} is a recorded capture of slices: it is no scene to render")
    if is_film(path):
        raise SceneError(f"{path} is a recording at one gate: it is no scene to render (the window plays it)")
    if is_transport(path):
        raise SceneError(f"{path} is acquired light transport: it is no scene to render (see 'slopegate relight')")
    given = rig if isinstance(rig, OpenRig) else open_rig(rig)
    seen_by, found = scene_files.open_scene(path, given.rig)
    return OpenScene(seen_by, found, time_s, skip)


def open_capture(folder: str | Path) -> OpenCapture:
    """A capture that `OpenScene.record`, the window or `slopegate capture` has recorded.

    Also what it was exported to: an OME-TIFF, or a folder in OME-Zarr.
    """
    found = open_any(Path(folder))
    return OpenCapture(found.rig, found)


def open_film(folder: str | Path) -> OpenFilm:
    """A recording at one gate that `OpenScene.film`, the window or `slopegate record` has made; also one cut short."""
    found = open_film_folder(Path(folder))
    return OpenFilm(found.rig, found)
