"""`slopegate render`: one gated image of a scene, into files."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from slopegate.app.commands.geometry import asked_gate, clock_mhz, hardware_warnings, slab_values
from slopegate.app.commands.report import (
    CommandError,
    finite,
    print_json,
    print_table,
    print_warnings,
    say_share_done,
    share_line_done,
)
from slopegate.app.commands.scene import opened
from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import SensorModel, auto_gain, expose, mono
from slopegate.core.gating.gate import complement, row_windows, slab, weights
from slopegate.core.render.integrate import integrate
from slopegate.core.render.render import Buffers, render
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import depth_m
from slopegate.core.scene.scene import Scene
from slopegate.drivers.files.durable import check_destination
from slopegate.drivers.files.images import save_image
from slopegate.drivers.files.rig_files import rig_to_toml

LINEAR_SUFFIXES = (".npy", ".exr")
COUNT_SUFFIXES = (".tif", ".tiff", ".png")


def run_render(options: Namespace) -> int:
    """Render, gate, and write what was asked for; nothing is written unless all of it could be computed."""
    files = _destinations(options)
    rig, scene = opened(options)
    asked = asked_gate(options, rig)
    applied = complement(asked, rig.projector.period_us) if options.complement else asked
    windows = row_windows(rig, applied)
    buffers = render(rig, scene, options.time_s, skip=options.skip)
    recorded = weights(windows, buffers.projector_row) > 0
    found = slab(rig, asked)
    warnings = [*hardware_warnings(rig, asked), *found.warnings]
    report = _report(options, rig, scene, asked, applied) | {
        "slab": slab_values(found),
        "lit_fraction": float(recorded.mean()),
        "warnings": warnings,
    }
    if options.samples == 1:
        periods = applied.exposure_us / rig.projector.period_us
        radiance = gated(buffers.projector_row, buffers.direct, buffers.ambient, windows, periods, options.skip)
    else:
        try:
            radiance = integrate(rig, scene, applied, options.samples, options.time_s, say_share_done, options.skip)
        finally:
            share_line_done()
    image, sensor = _image(options, radiance, buffers)
    if sensor is not None:
        report["sensor"] = asdict(sensor)
    save_image(files["image"], image, finite(report | {"rig_toml": rig_to_toml(rig)}))
    if "mask" in files:
        save_image(files["mask"], np.where(recorded, 255, 0).astype(np.uint8))
    if "depth" in files:
        save_image(files["depth"], depth_m(buffers.inverse_depth))
    report["files"] = {kind: str(path) for kind, path in files.items()}
    if options.json:
        print_json(report)
        return 0
    _print_report(report, image.shape, rig)
    print_warnings(warnings)
    return 0


def _destinations(options: Namespace) -> dict[str, Path]:
    """What goes where, refused before any work if it could not be written."""
    wanted = (
        ("image", options.out, (*LINEAR_SUFFIXES, *COUNT_SUFFIXES)),
        ("mask", options.mask_out, (".png",)),
        ("depth", options.depth_out, (".npy",)),
    )
    files: dict[str, Path] = {}
    for kind, path, suffixes in wanted:
        if path is None:
            continue
        check_destination(path, suffixes)
        if path.resolve() in [other.resolve() for other in files.values()]:
            raise CommandError(f"{path} is named twice: each output needs a file of its own")
        files[kind] = path
    return files


def _image(options: Namespace, radiance: Singles, buffers: Buffers) -> tuple[Singles | Counts, SensorModel | None]:
    """The pixels as the file is to hold them, and the sensor that counted them, if any."""
    linear = options.out.suffix.lower() in LINEAR_SUFFIXES
    signal = radiance if options.colour else mono(radiance)
    if linear and not options.noise:
        return signal.astype(np.float32), None
    floodlit = buffers.direct + buffers.ambient
    sensor = auto_gain(floodlit if options.colour else mono(floodlit), SensorModel())
    if options.noise:
        counts = expose(signal, sensor, np.random.default_rng(options.seed))
    else:
        exact = signal.astype(np.float64) * sensor.counts_per_unit + sensor.black_count
        counts = np.clip(np.floor(exact + 0.5), 0, sensor.max_count).astype(np.uint16)
    return (counts.astype(np.float32) if linear else counts), sensor


def _report(options: Namespace, rig: Rig, scene: Scene, asked: GateSettings, applied: GateSettings) -> dict[str, Any]:
    counted = options.noise or options.out.suffix.lower() in COUNT_SUFFIXES
    return {
        "program": f"slopegate {version('slopegate')}",
        "scene": scene.name,
        "rig": rig.name,
        "settings": {
            "clock_mhz": clock_mhz(rig, asked.line_time_us),
            "line_time_us": asked.line_time_us,
            "delay_us": asked.delay_us,
            "exposure_us": asked.exposure_us,
            "complement": options.complement,
        },
        "rendered": {
            "line_time_us": applied.line_time_us,
            "delay_us": applied.delay_us,
            "exposure_us": applied.exposure_us,
        },
        "unit": "counts" if counted else "linear, E = 1",
        "noise": options.noise,
        "seed": options.seed,
        "samples": options.samples,
        "colour": options.colour,
        "time_s": options.time_s,
    }


def _print_report(report: dict[str, Any], shape: tuple[int, ...], rig: Rig) -> None:
    read = report["slab"]
    print(f"{report['scene']} on {rig.name or 'this rig'}, {shape[1]} x {shape[0]} pixels")
    print_table(
        [
            ("tilt", read["tilt_deg"], "deg", "positive: the top leans away from the rig"),
            ("distance", read["distance_m"], "m", "to the centre plane, on the axis"),
            ("thickness", read["thickness_m"], "m", ""),
            ("lit", 100 * report["lit_fraction"], "%", "of the pixels receive light through the gate"),
        ]
    )
    for kind, path in report["files"].items():
        print(f"  {kind}: {path}")
