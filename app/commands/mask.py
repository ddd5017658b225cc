"""`slopegate mask`: the gate that keeps or hides a region of the image."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
from slopegate.app.commands.depth import sweep_of
from slopegate.app.commands.geometry import clock_mhz, slab_values
from slopegate.app.commands.report import CommandError, print_json, print_table, print_warnings
from slopegate.app.commands.scene import opened
from slopegate.core.gating.gate import complement, slab
from slopegate.core.measure.mask import GOOD_IOU, MaskGate, best_gate, overlap, recorded, seen_in_frames
from slopegate.core.measure.sweep import SweepSettings
from slopegate.core.rig.arrays import Bools
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.files.durable import check_destination
from slopegate.drivers.files.images import save_image
from slopegate.drivers.files.picture_files import read_region
from slopegate.drivers.stream.depth_run import frames_of

NO_GOOD_GATE = 1


def run_mask(options: Namespace) -> int:
    """Find the gate, count in frames what it does, and say both; 1 when no gate does it well."""
    if options.mask_out is not None:
        check_destination(options.mask_out, (".png",))
    rig, scene = opened(options)
    region = _region(options, (rig.camera.lens.height, rig.camera.lens.width))
    camera = VirtualCamera(rig, scene, rate_hz=None, seed=options.seed, noise=options.noise)
    camera.prepare(lambda share: True)
    camera.start()
    try:
        buffers = camera.buffers
        assert buffers is not None
        rows, swept = buffers.projector_row.copy(), 0
        if options.measured:
            found = sweep_of(camera, rig, SweepSettings())
            rows, swept = found.projector_row, found.frames
        best = best_gate(rig, rows, region, options.hide)
        achieved, told = _achieved(camera, rig, best.sent, region, options.hide, rows >= 0)
        if options.mask_out is not None:
            seen = recorded(rig, best.sent, buffers.projector_row)
            save_image(options.mask_out, np.where(seen, 255, 0).astype(np.uint8))
    finally:
        camera.close()
    values = {"scene": scene.name, "rig": rig.name, "hide": options.hide, "sweep_frames": swept}
    values |= mask_values(rig, best) | {"achieved_iou": achieved, "told_share": told}
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0 if best.good else NO_GOOD_GATE


def _region(options: Namespace, shape: tuple[int, int]) -> Bools:
    if options.region_png is not None:
        return _painted(options.region_png, shape)
    x0, y0, x1, y1 = options.region
    if not (x0 < x1 <= shape[1] and y0 < y1 <= shape[0]):
        raise CommandError(
            f"--region {x0} {y0} {x1} {y1} must have X0 below X1 and Y0 below Y1, inside the image of "
            f"{shape[1]} x {shape[0]} pixels"
        )
    region = np.zeros(shape, bool)
    region[y0:y1, x0:x1] = True
    return region


def _painted(path: Path, shape: tuple[int, int]) -> Bools:
    painted = read_region(path)
    if painted.shape != shape:
        raise CommandError(
            f"{path} is {painted.shape[1]} x {painted.shape[0]} pixels: it must be of the image's size, "
            f"{shape[1]} x {shape[0]}"
        )
    return painted


def _achieved(
    camera: VirtualCamera, rig: Rig, sent: GateSettings, region: Bools, hide: bool, lit: Bools
) -> tuple[float, float]:
    """Overlap counted in a frame of the gate and one of its complement, and the share of lit pixels that tell."""
    take, frames = frames_of(camera), []
    for settings in (sent, complement(sent, rig.projector.period_us)):
        got = take(settings)
        assert got is not None
        frames.append(got[0].copy())
    seen, told = seen_in_frames(frames[0], frames[1], camera.info.black_count)
    told &= lit
    share = int(np.count_nonzero(told)) / max(int(np.count_nonzero(lit)), 1)
    return overlap(~seen if hide else seen, region, told), share


def mask_values(rig: Rig, best: MaskGate) -> dict[str, Any]:
    """A mask's gate as plain values."""
    found = slab(rig, best.gate)

    def plain(settings: GateSettings) -> dict[str, float | None]:
        return {
            "clock_mhz": clock_mhz(rig, settings.line_time_us),
            "line_time_us": settings.line_time_us,
            "delay_us": float(settings.delay_us),
            "exposure_us": settings.exposure_us,
        }

    return {
        "good": best.good,
        "iou": best.iou,
        "hit_pixels": best.hit_pixels,
        "missed_pixels": best.missed_pixels,
        "extra_pixels": best.extra_pixels,
        "settings": plain(best.gate) | {"complement": best.complement},
        "sent": plain(best.sent),
        "slab": slab_values(found),
        "clocks_tried": best.line_times,
        "warnings": list(found.warnings),
    }


def _print(values: dict[str, Any]) -> None:
    verb = "hides" if values["hide"] else "keeps"
    word = "the best gate" if values["good"] else "no gate does it well; the nearest one"
    print(f"{values['scene']}: {word} {verb} the region with an overlap of {values['iou']:.3f}")
    settings, read = values["settings"], values["slab"]
    rows: list[tuple[str, float | str | None, str, str]] = []
    if settings["clock_mhz"] is not None:
        rows.append(("pixel clock", settings["clock_mhz"], "MHz", f"best of {values['clocks_tried']}"))
    what = "everything but this gate is recorded" if settings["complement"] else ""
    rows += [
        ("delay", settings["delay_us"], "us", ""),
        ("exposure", settings["exposure_us"], "us", what),
        ("tilt", read["tilt_deg"], "deg", "positive: the top leans away from the rig"),
        ("distance", read["distance_m"], "m", "to the centre plane, on the axis"),
        ("thickness", read["thickness_m"], "m", ""),
        ("predicted", values["iou"], "", f"overlap (intersection over union; good from {GOOD_IOU:g})"),
        ("achieved", values["achieved_iou"], "", f"in frames, over {values['told_share']:.0%} of the lit pixels"),
    ]
    print_table(rows)
    print_warnings(values["warnings"])
