"""Ways to acquire light transport: one acquisition of a scene by each, and what it says of random patterns."""

from __future__ import annotations

import tempfile
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slopegate.app.bench.measure import core_clock
from slopegate.app.bench.transport_truth import Shown, TransportCase, case_camera
from slopegate.core.measure.quality import psnr_db
from slopegate.core.transport.sliced import relit
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import run_acquisition
from slopegate.drivers.transports.shots import CameraShots
from slopegate.drivers.transports.storage import TransportFolder, create_transport, make_transport


@dataclass(frozen=True)
class Acquired:
    """What one acquisition took and kept. wall_s and core_s: with decoding; relit_db: of every random pattern."""

    frames: int
    wall_s: float
    core_s: float
    peak_mb: float
    kept_mb: float
    left_out: float
    relit_db: tuple[float, ...]


def acquire(case: TransportCase, codes: CodeName, truth: Shown, seed: int | None) -> Acquired:
    """One acquisition, with noise where there is a seed, compared with what the camera saw of the random patterns."""
    with tempfile.TemporaryDirectory() as place, case_camera(case, seed is not None, seed or 0) as pair:
        camera, projector = pair
        assert camera.sensor is not None
        manifest = make_transport(
            case.name, case.rig, camera.info, case.grid, codes, case.slices,
            counts_per_unit=camera.sensor.counts_per_unit, seed=seed,
        )  # fmt: skip
        folder = create_transport(Path(place) / "transport", manifest)
        shots = CameraShots(camera, number_frames_from=camera.number_frames_from)
        tracemalloc.start()
        wall_s, core_s = time.perf_counter(), core_clock()
        progress = run_acquisition(projector, shots, folder)
        wall_s, core_s = time.perf_counter() - wall_s, core_clock() - core_s
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        records, kept = folder.records().values(), sum(folder.slice(k).bytes for k in range(len(case.slices)))
        left = max((record.left_out for record in records), default=0.0)
        db = _relit_db(case, folder, truth, camera.sensor.counts_per_unit)
        return Acquired(progress.frames, wall_s, core_s, peak / 1e6, kept / 1e6, left, db)


def _relit_db(case: TransportCase, folder: TransportFolder, truth: Shown, counts_per_unit: float) -> tuple[float, ...]:
    """PSNR of the sum of all slices under every random pattern, against the brightest pixel with all on."""
    slices = [folder.slice(index) for index in range(len(case.slices))]
    peak, exact = float(truth.lit.sum(axis=0).max()), truth.pictures.sum(axis=0)
    found = []
    for pattern, image in zip(case.patterns, exact, strict=True):
        picture = case.grid.spread(pattern.astype(np.float32))
        light = np.sum([relit(one, picture) for one in slices], axis=0) * np.float32(counts_per_unit)
        found.append(psnr_db(light, image, peak))
    return tuple(found)
