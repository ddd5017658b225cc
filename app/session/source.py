"""A source is what the window looks at: a scene, the rig that sees it, and the camera that makes its frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from slopegate.app.session.loading import CancelledError, Progress
from slopegate.app.widgets.paint import warm_up
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.gating.epipolar import epipolar_gate
from slopegate.core.gating.gate import Reach, lit_rows, row_windows, seen_reach, upright_line_time, whole_reach
from slopegate.core.gating.plan import plan_on_hardware, whole_period
from slopegate.core.light.lights import asked_parts
from slopegate.core.render.render import Buffers, Cancelled
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Preset, Scene
from slopegate.drivers.cameras.faults import Faults, FaultyCamera
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.exported import is_recorded, open_any
from slopegate.drivers.captures.film_camera import FilmCamera
from slopegate.drivers.captures.model import SliceRecord
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.device_rig import fixed_gate, no_gate, no_timing
from slopegate.drivers.contract.families import Address
from slopegate.drivers.contract.frame import OpenOptions, PixelFormat
from slopegate.drivers.scenes.scene_files import open_scene


@dataclass(frozen=True)
class Options:
    """How the virtual camera is built."""

    pixel_format: PixelFormat = "mono12"
    noise: bool = True
    rate_hz: float = 20.0
    """Frames a second; infinite: as fast as it can."""
    lit_rows: bool = False
    """Read only the camera rows that the gate can light."""
    skip: bool = True
    """False: render and gate every pixel of every frame."""
    faults: Faults | None = None
    """Faults of a real rig that it imitates."""


@dataclass(frozen=True, eq=False)
class Source:
    """A scene or device that is ready to stream: everything slow has been done."""

    where: Path | Address
    rig: Rig
    scene: Scene
    options: Options
    camera: Camera
    buffers: Buffers | None
    """What was known of the scene when it was opened; None for a device, of whose scene nothing is known."""
    presets: tuple[Preset, ...]
    remark: str = ""
    """What the user must know of it, in one sentence."""
    measured: Buffers | None = None
    """What a depth sweep measured of a device's scene; its light is black."""
    opened: OpenOptions | None = None
    """How a device of the list was opened."""
    rendered: VirtualCamera | None = None
    """The camera, where it is a virtual one."""
    played: PlaybackCamera | None = None
    """The camera, where it plays a capture."""
    film: FilmCamera | None = None
    """The camera, where it plays a recording at one gate."""

    @cached_property
    def streamed(self) -> Camera:
        """The camera that a stream reads: with the faults that it imitates."""
        faults = self.options.faults
        if faults is None:
            return self.camera
        if self.rendered is None:
            return FaultyCamera(self.camera, faults)
        return FaultyCamera(self.camera, faults, trigger_late=self.rendered.trigger_late)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of its images, also before the first one has come."""
        return self.camera.info.height, self.camera.info.width

    @property
    def is_device(self) -> bool:
        """Whether the frames come from a device or a video, whose camera may block for seconds."""
        return self.buffers is None

    @property
    def triggered(self) -> bool:
        """Whether a frame that is missing tells of a missed trigger: a virtual camera only imitates them.

        A computer that is too busy to draw in time is no fault of a trigger line.
        """
        return bool(self.camera.info.can.trigger) if self.is_device else self.options.faults is not None

    @property
    def replayed(self) -> bool:
        """Whether frames were taken before: what is lost or late now tells nothing of the camera that took them."""
        return self.camera.info.modes.replayed and self.options.faults is None

    @property
    def lost_before(self) -> int | None:
        """Frames that were lost while what is replayed was recorded; None where nobody knows."""
        ended = None if self.film is None else self.film.ended
        return None if ended is None else ended.lost

    @property
    def own_rig(self) -> str:
        """Why it is looked at with its own rig and no other, in one sentence; empty when any can be chosen."""
        kind = "capture" if self.played is not None else "recording" if self.film is not None else ""
        return f"A {kind} has the rig that it was recorded with" if kind else ""

    @property
    def fixed_gate(self) -> str:
        """Why the gate that is there is the only one, in one sentence; empty where there is none or another one."""
        return fixed_gate(self.camera.info)

    @property
    def no_gate(self) -> str:
        """Why the camera cannot be told what its gate is to be, in one sentence; empty when it can."""
        return no_gate(self.camera.info)

    @property
    def no_timing(self) -> str:
        """Why it is not known when rows are exposed; empty when it is."""
        return no_timing(self.camera.info)

    @property
    def no_plane(self) -> str:
        """Why no gate can be set by the plane or the distance of its slab; empty when it can."""
        return self.no_gate or no_slabs(self.rig)

    @property
    def place(self) -> str:
        """The file's name, or the device's address."""
        return self.where.name if isinstance(self.where, Path) else str(self.where)

    def shows_the_same(self, other: Source) -> bool:
        """Whether it is the other's scene or camera, opened anew with as many pixels: places in the image hold on."""
        here, there = self.camera.info, other.camera.info
        known = _same_things(self.scene, other.scene) or self.is_device
        return known and self.where == other.where and (here.width, here.height) == (there.width, there.height)

    def rows(self, settings: GateSettings) -> tuple[int, int] | None:
        """The camera rows worth reading with this gate, first and one past the last; None for all of them."""
        return lit_rows(row_windows(self.rig, settings), self._reach) if self.options.lit_rows else None

    @cached_property
    def _reach(self) -> Reach:
        # What moves may be anywhere, so only how far the projector reaches is known.
        known = None if self.scene.moving else self.buffers
        return whole_reach(self.rig) if known is None else seen_reach(known.projector_row)

    def close(self) -> None:
        """Let the camera go."""
        self.camera.close()


def _same_things(one: Scene, other: Scene) -> bool:
    """Whether it is the same scene, if perhaps in another fog."""
    kept = one.objects if one.capture is None else one.capture
    return one is other or (bool(kept) and kept is (other.objects if other.capture is None else other.capture))


def known_buffers(source: Source) -> Buffers | None:
    """The depth and light that a virtual camera or a capture knows now; for other cameras what a sweep measured."""
    knowing = source.rendered or source.played
    return (knowing.buffers if knowing else None) or source.measured


def open_source(where: Path, rig: Rig, options: Options, progress: Progress) -> Source:
    """Read a scene file or folder and render it once. Raises UserError, OSError or CancelledError."""
    progress.step(0.0, f"Reading {where.name} ...")
    if is_recorded(where):
        return open_recorded(where, options, progress)
    scene_rig, scene = open_scene(where, rig)
    return build_source(where, scene_rig, scene, options, progress)


def build_source(
    where: Path, rig: Rig, scene: Scene, options: Options, progress: Progress, sensor: SensorModel | None = None
) -> Source:
    """The camera for a scene that is already in memory, rendered once. `sensor` None: one that suits the scene."""
    if is_recorded(where):
        return open_recorded(where, options, progress)
    progress.step(0.1, f"Preparing {scene.name} ...")
    warm_up()
    camera = VirtualCamera(
        rig,
        scene,
        sensor,
        pixel_format=options.pixel_format,
        rate_hz=options.rate_hz,
        noise=options.noise,
        skip=options.skip,
        bake=True,
    )
    try:
        camera.prepare(lambda share: progress.report(0.1 + 0.9 * share, f"Rendering {scene.name} ..."))
    except Cancelled:
        raise CancelledError from None
    buffers = camera.buffers
    assert buffers is not None
    remark = "; ".join(scene.remarks)
    named = presets(rig, scene, buffers)
    return Source(where, rig, scene, options, camera, buffers, named, remark, rendered=camera)


def in_fog(source: Source, fog: Fog | None, progress: Progress) -> Source:
    """The scene of a virtual camera in another fog, with its sensor as it is; what was switched off stays so."""
    old = source.rendered
    assert old is not None
    assert isinstance(source.where, Path)
    scene = replace(source.scene, fog=fog)
    made = build_source(source.where, source.rig, scene, source.options, progress, old.sensor)
    assert made.rendered is not None
    hidden = asked_parts(source.scene) - old.smooth.shown
    made.rendered.smooth.show(asked_parts(scene) - hidden)
    return made


def open_recorded(where: Path, options: Options, progress: Progress) -> Source:
    """Open a capture: every slice is read once and becomes a named gate. Raises StorageError or CancelledError."""
    folder = open_any(where)
    progress.step(0.0, f"Reading {folder.path.name} ...")
    camera = PlaybackCamera(folder, rate_hz=options.rate_hz)
    try:
        camera.prepare(lambda share: progress.report(share, f"Reading {folder.path.name} ..."))
    except Cancelled:
        raise CancelledError from None
    buffers, facts = camera.buffers, folder.manifest
    assert buffers is not None
    scene = Scene(f"{facts.scene} (captured)", f"Captured {facts.created} with {facts.software}.")
    gates = tuple(
        Preset(f"Slice {(record.index or 0) + 1}{at(record)}", record.applied.settings())
        for record in folder.records().values()
    )
    unfinished = folder.unfinished()
    return Source(folder.path, folder.rig, scene, options, camera, buffers, gates, unfinished, played=camera)


def at(record: SliceRecord) -> str:
    """Where a slice lies, for its name; nothing where it has no finite distance."""
    return "" if record.distance_m is None else f" at {record.distance_m:.3f} m"


def presets(rig: Rig, scene: Scene, buffers: Buffers) -> tuple[Preset, ...]:
    """The scene's own gates; without any, an upright slab about its middle. Then everything lit, for comparison.

    Where rows are epipolar, the gate of the direct light and its complement: first where gates are no slabs.
    """
    own = scene.gates or upright_gate(rig, buffers)
    named = (*epipolar_gates(rig), *own) if no_slabs(rig) else (*own, *epipolar_gates(rig))
    return (*named, everything_lit(rig, named[0].settings.line_time_us if named else upright_line_time(rig)))


def epipolar_gates(rig: Rig) -> tuple[Preset, ...]:
    """The gate that keeps direct light, whatever the distance, and its complement; none where rows are not epipolar."""
    found = epipolar_gate(rig)
    if found is None:
        return ()
    delay = "delay 0" if not found.delay_us else f"delay {found.delay_us:g} \u00b5s"
    return (
        Preset(f"Epipolar ({delay})", found),
        Preset("Everything but the epipolar light", found, complement=True),
    )


def everything_lit(rig: Rig, line_time_us: float) -> Preset:
    """A whole projector period, whatever the depth."""
    lit = quantise(rig.camera.shutter, whole_period(rig, line_time_us), rig.projector.period_us)
    return Preset("Everything lit", lit)


def upright_gate(rig: Rig, buffers: Buffers) -> tuple[Preset, ...]:
    """An upright slab about what the middle ninth of the image shows; none where nothing there is lit."""
    height, width = buffers.inverse_depth.shape
    middle = (slice(height // 3, 2 * height // 3, 4), slice(width // 3, 2 * width // 3, 4))
    sample = buffers.inverse_depth[middle][buffers.projector_row[middle] >= 0].astype(np.float64)
    if sample.size == 0:
        return ()
    far, near = 1.0 / np.percentile(sample, (10, 90))
    distance = float(near + far) / 2
    thickness = max(1.2 * float(far - near), 0.03 * distance)
    try:
        applied = plan_on_hardware(rig, 0.0, distance, thickness).applied
    except InputError:  # a rig that cannot do this has no such suggestion
        return ()
    return (Preset("Upright, middle of the image", applied),)
