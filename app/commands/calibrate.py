"""`slopegate calibrate`: lenses and pose of a rig from pictures of a chart under Gray code."""

from __future__ import annotations

import math
import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.capture import add_wait_and_board
from slopegate.app.commands.options import add_overwrite, add_rig, add_screen, describe, flag, given, number, whole
from slopegate.app.commands.report import (
    CommandError,
    ShareLine,
    old_rig_values,
    print_json,
    print_old_rig,
    print_warnings,
    say_line,
)
from slopegate.app.session.aligned import aligned
from slopegate.core.calibration.chart import ALLOWED, CHART_ERROR_PERCENT, USUAL_CHART, chart_from
from slopegate.core.rig.calibration import GEOMETRY
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.files.durable import check_destination, write_durably
from slopegate.drivers.files.rig_files import MAX_PIXELS_A_SIDE, calibrated_rig_file, load_rig

if TYPE_CHECKING:
    from slopegate.core.calibration.chart import Chart
    from slopegate.core.calibration.compared import Compared
    from slopegate.core.calibration.distortion import CornerDistortion
    from slopegate.core.calibration.geometry import ViewError
    from slopegate.core.calibration.response import LevelResponse
    from slopegate.core.rig.rig import Rig
    from slopegate.drivers.calibrations.geometry_run import CalibratedGeometry, GeometryRun, LookedView
    from slopegate.drivers.calibrations.published import PublishedCheck

ALL_OUTLIERS = "outliers"
MOST_SEED = 2**31 - 1
MOST_POSES = 60
"""That are taken at most, good ones and others."""
_OF_CAMERA = ("screen", "settle_frames", "transfer_us", "pixel_format", "wait_s", "board", "board_settings")
_OF_LIVE = ("views", "keep")
_SIZE = re.compile(r"(\d{1,5})x(\d{1,5})")


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Focal lengths, principal points and distortion of camera and projector and the pose between\n"
        "them, each with its standard error, into a rig file. FOLDER holds a folder for every pose of the chart,\n"
        "with one picture for every pattern of a Gray code: pattern and inverse of every bit, the coarsest\n"
        "first, columns then rows, and all white and all black first or last. Pictures that others took do,\n"
        "too. A view that moved, is blurred, saturated or half out of the projector is named and left out.\n"
        "Ten to twenty poses, tilted by 20 to 45 degrees each another way, near and far, make a good rig.",
        epilog="examples:\n  slopegate calibrate poses --chart 9x7:22 --projector 1280x720 --out rig.toml\n"
        "  slopegate calibrate poses --chart charuco:11x7:30 --rig old.toml --out new.toml --leave-out pose_07\n"
        "  slopegate calibrate --camera ueye:4103123456 --screen HDMI-1 --rig lab.toml --chart 9x7:22 --out rig.toml\n"
        "  slopegate calibrate --practice 3 --chart 9x7:30 --out practice.toml",
    )
    parser.add_argument("folder", type=Path, nargs="?", metavar="FOLDER", help="a folder of pictures for every pose")
    _add_live(parser)
    parser.add_argument(
        "--chart", default=USUAL_CHART, metavar="CHART", help=f"the chart and its size: {ALLOWED} ({USUAL_CHART})"
    )
    parser.add_argument(
        "--projector",
        type=_raster,
        metavar="WxH",
        help="pixels of the projector, as the code was made for them (default: those of the rig)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="RIG.toml", help="the rig file to write")
    parser.add_argument(
        "--leave-out",
        nargs="+",
        default=[],
        metavar="NAME",
        help=f"views to leave out of the fit; {ALL_OUTLIERS}: all that do not fit the others, one after the other",
    )
    parser.add_argument(
        "--chart-error-percent",
        type=number(0.0, 10.0, "a number from 0 to 10"),
        default=CHART_ERROR_PERCENT,
        metavar="P",
        help="how well the chart's size is known, one standard error in percent: all lengths share it "
        f"({CHART_ERROR_PERCENT:g}: printed on paper and measured with a ruler)",
    )
    parser.add_argument(
        "--compare",
        type=Path,
        metavar="FILE",
        help="a rig file, or a calibration as OpenCV keeps it (.xml, .yml: cam_K, cam_kc, proj_K, proj_kc, R, T): by "
        "how many standard errors each number differs, and whether it can be true at all",
    )
    parser.add_argument(
        "--with-blur",
        action="store_true",
        help="write the blur of the projector that is found into the rig file, too",
    )
    add_overwrite(parser)
    add_rig(parser)


def _add_live(parser: ArgumentParser) -> None:
    live = parser.add_argument_group("instead of a FOLDER")
    live.add_argument(
        "--camera",
        metavar="FAMILY:WHERE",
        help="what this camera sees (see 'slopegate devices'), with patterns on --screen: the terminal says how to "
        "hold the chart, and Enter takes a pose",
    )
    live.add_argument(
        "--practice",
        type=whole(0, MOST_SEED),
        nargs="?",
        const=0,
        metavar="SEED",
        help="a virtual rig near that of --rig, drawn by this number (0), which holds the chart by itself; at the end "
        "its true numbers are told beside those that were found",
    )
    add_screen(live, "with --camera")
    live.add_argument(
        "--views",
        type=whole(3, MOST_POSES),
        metavar="N",
        help="end when so many views can be used (default: when three standard errors of distances are within 1 %%)",
    )
    live.add_argument(
        "--keep",
        type=Path,
        metavar="DIR",
        help="keep the pictures in this folder, which can be the FOLDER of another time; with --camera they always are "
        "(by OUT with _poses), and what is there counts",
    )
    live.add_argument("--pixel-format", metavar="F", help="of --camera, such as Mono12p (default: 12 bits or near)")
    add_wait_and_board(live)


def _raster(text: str) -> Raster:
    found = _SIZE.fullmatch(text.strip().lower())
    if found is None or not all(1 <= int(side) <= MAX_PIXELS_A_SIDE for side in found.groups()):
        raise ArgumentTypeError(f"{text!r} must be WIDTHxHEIGHT in pixels, as 1280x720")
    return Raster(int(found[1]), int(found[2]))


def run(options: Namespace) -> int:
    """Look at every view, fit, and write the rig."""
    chart = chart_from(options.chart)
    check_destination(options.out, (".toml",), overwrite=options.overwrite)
    _check_subject(options)
    if options.folder is None:
        from slopegate.app.commands.calibrate_live import calibrate_practice, calibrate_with_camera

        live = (calibrate_practice if options.camera is None else calibrate_with_camera)(options, chart)
        return finish(options, live.views, live.base, live.warnings, live.hidden, live.response)
    return _from_folder(options, chart)


def _check_subject(options: Namespace) -> None:
    """Refuse anything but one of a folder, a camera and practice, and what belongs to another of them."""
    named = {"a FOLDER": options.folder, "--camera": options.camera, "--practice": options.practice}
    ways = [name for name, value in named.items() if value is not None]
    if not ways:
        raise CommandError("give a FOLDER of pictures, --camera ('slopegate devices' lists some) or --practice")
    if len(ways) > 1:
        raise CommandError(f"{ways[0]} and {ways[1]} exclude each other: give one")
    for names, allowed in ((_OF_CAMERA, ("--camera",)), (_OF_LIVE, ("--camera", "--practice"))):
        if ways[0] not in allowed and (others := given(options, names)):
            raise CommandError(f"{flag(others[0])} goes with {' or '.join(allowed)}, not with {ways[0]}")
    if options.folder is None and options.projector is not None:
        raise CommandError(f"--projector goes with a FOLDER: the projector of {ways[0]} tells its pixels")


def _from_folder(options: Namespace, chart: Chart) -> int:
    base = load_rig(options.rig)
    from slopegate.drivers.calibrations.geometry_run import GeometryRun
    from slopegate.drivers.calibrations.pictures import pose_folders, read_pose
    from slopegate.drivers.calibrations.sizes import projector_of

    passed_over = [name for name in options.leave_out if name != ALL_OUTLIERS]
    poses = pose_folders(options.folder, passed_over)
    warnings: list[str] = []
    projector = options.projector or base.projector.raster
    if options.projector is None and options.rig is None:
        projector, warnings = projector_of(poses[0], projector)
    views = GeometryRun(chart, projector, passed_over)
    line = ShareLine("looking at the views")
    try:
        for place, pose in enumerate(poses):
            line(place / len(poses))
            views.add(read_pose(pose, projector))
    finally:
        say_line("")
    return finish(options, views, base, warnings)


def finish(
    options: Namespace,
    views: GeometryRun,
    base: Rig,
    warnings: Sequence[str] = (),
    hidden: Rig | None = None,
    response: LevelResponse | None = None,
) -> int:
    """Fit the views, however they came, write the rig file and tell of it; the exit code.

    hidden: the true rig, of practice. response: of the projector to grey levels.
    """
    from slopegate.core.calibration.picture import picture_advice
    from slopegate.drivers.calibrations.published import check_published, published_beside, read_published

    found = _fitted(options, views, base)
    given = [] if options.compare is None else [read_published(options.compare, found.rig)]
    beside = [] if options.folder is None else published_beside(options.folder, found.rig)
    given += [one for one in beside if one.path != options.compare]
    checks = [check_published(one, found) for one in given]
    told = [*warnings, *_warnings(options, base, found, checks), *picture_advice(found.focus, response)]
    if options.with_blur and found.focus is not None:
        blurred = replace(found.rig.projector, blur_px=round(found.focus.blur_px, 3))
        found = replace(found, rig=replace(found.rig, projector=blurred))
    write_durably(options.out, calibrated_rig_file(found.rig, options.out))
    if options.json:
        true = {} if hidden is None else {"hidden": _beside_truth(hidden, found)}
        values = _values(options, views, found, base, checks) | _picture_values(found, response)
        print_json(values | true | {"warnings": told})
        return 0
    _print(options, views, found, checks, response)
    if (against := _against(options, base, found)) is not None:
        print_old_rig(against.sentences)
    if hidden is not None:
        _print_truth(hidden, found)
    print_warnings(told)
    return 0


def _fitted(options: Namespace, views: GeometryRun, base: Rig) -> CalibratedGeometry:
    """With all outliers left out where that was asked for."""
    names: list[str] = []
    while True:
        found = views.finish(base, names, options.chart_error_percent)
        if ALL_OUTLIERS not in options.leave_out or not found.outliers:
            return found
        names += found.outliers


def _warnings(
    options: Namespace, base: Rig, found: CalibratedGeometry, checks: Sequence[PublishedCheck]
) -> Iterator[str]:
    if options.rig is None:
        yield f"shutter, period and blur are those of the default rig ({base.name}): give yours with --rig"
    for one in found.left_out:
        if not one.asked:
            yield f"left out: {one.why}"
    errors = {view.name: view.held_out_px for view in found.geometry.views}
    for name in found.outliers:
        yield (
            f"{name} does not fit the others, which expect its corners {errors[name]:.2f} pixels elsewhere: it is in "
            f"the fit; leave it out with --leave-out {name}"
        )
    for check in checks:
        if check.contradicts:
            yield check.sentence


def _values(
    options: Namespace,
    views: GeometryRun,
    found: CalibratedGeometry,
    base: Rig,
    checks: Sequence[PublishedCheck],
) -> dict[str, Any]:
    from slopegate.core.calibration.distortion import corner_distortions
    from slopegate.drivers.calibrations.geometry_run import sureness

    fitted, sure = found.geometry, sureness(views.chart, found)
    camera, projector = fitted.camera, fitted.projector
    against = _against(options, base, found)
    old = () if against is None or base.calibration is None else against.differences
    parameters = zip(GEOMETRY, fitted.values.tolist(), fitted.standard_errors.tolist(), strict=True)
    return {
        "file": str(options.out),
        "chart": str(views.chart),
        "chart_error_percent": options.chart_error_percent,
        "camera": [camera.width, camera.height],
        "projector": [projector.width, projector.height],
        "rms_px": fitted.rms_px,
        "camera_rms_px": fitted.camera_rms_px,
        "projector_rms_px": fitted.projector_rms_px,
        "views": [_view(view, fitted.views) for view in found.views],
        "left_out": [asdict(one) for one in found.left_out],
        "outliers": list(found.outliers),
        "parameters": {name: {"value": value, "standard_error": error} for name, value, error in parameters},
        "distortion": {one.lens: _distortion(one) for one in corner_distortions(fitted)},
        "remarks": _remarks(found),
        "judged": asdict(sure.judged),
        "distance_error_share": sure.distance_error,
        "coverage": {"camera": sure.camera.tolist(), "projector": sure.projector.tolist()},
        "differences": [asdict(one) for one in (checks[0].differences if options.compare else old)],
        "old_rig": None if against is None else old_rig_values(against),
        "compared": [
            {
                "file": str(check.published.path),
                "unit": check.published.unit or None,
                "consistent": not check.contradicts,
                "misfit": asdict(check.misfit),
                "fitted_misfit": asdict(check.fitted),
                "differences": [asdict(one) for one in check.differences],
            }
            for check in checks
        ],
        "facts": dict(found.rig.calibration.facts) if found.rig.calibration is not None else {},
    }


def _distortion(found: CornerDistortion) -> dict[str, Any]:
    """What a lens' distortion amounts to in the farthest corner of its picture, and which coefficients tell nothing."""
    return {
        "corner_px": found.corner_px,
        "standard_error_px": found.standard_error_px,
        "alone_px": found.alone_px,
        "undetermined": list(found.undetermined),
    }


def _remarks(found: CalibratedGeometry) -> list[str]:
    """What is to be known of the numbers themselves."""
    from slopegate.core.calibration.distortion import corner_distortions

    return [one.remark for one in corner_distortions(found.geometry) if one.remark]


def _against(options: Namespace, base: Rig, found: CalibratedGeometry) -> Compared | None:
    """The rig that was given, beside the one that was found; None where none was, or it is of other pictures."""
    from slopegate.core.calibration.compared import compared

    now = found.rig
    sizes = [((one.width, one.height)) for rig in (base, now) for one in (rig.camera.lens, rig.projector.lens)]
    return None if options.rig is None or sizes[:2] != sizes[2:] else compared(base, now)


def _view(view: LookedView, fitted: Sequence[ViewError]) -> dict[str, Any]:
    """What is known of a view; errors are null where it is no part of the fit."""
    error = next((one for one in fitted if one.name == view.name), None)
    return {
        "name": view.name,
        "used": error is not None,
        "corners": 0 if view.view is None else len(view.view.points_m),
        "rms_px": None if error is None else error.rms_px,
        "camera_rms_px": None if error is None else error.camera_px,
        "projector_rms_px": None if error is None else error.projector_px,
        "held_out_px": None if error is None else error.held_out_px,
        "distance_m": None if error is None else error.distance_m,
        "tilt_deg": None if error is None else error.tilt_deg,
        "lit_share": view.lit_share,
        "saturated_share": view.saturated_share,
        "shift_px": view.shift_px,
        "edge_px": view.edge_px,
        "projector_blur_px": None if view.focus is None else view.focus.mean_px,
        "pictures_sha256": view.digest,
        "faults": list(view.faults),
    }


def _picture_values(found: CalibratedGeometry, response: LevelResponse | None) -> dict[str, Any]:
    """How sharp the projector's picture is and how it answers grey levels; null where it is not known."""
    sharp = found.focus
    told = None
    if sharp is not None:
        fields = [[None if math.isnan(one) else one for one in row] for row in sharp.blur_map.tolist()]
        told = {"value": sharp.blur_px, "standard_error": sharp.standard_error, "map": fields}
    return {"projector_blur_px": told, "response": None if response is None else asdict(response)}


def _print(
    options: Namespace,
    views: GeometryRun,
    found: CalibratedGeometry,
    checks: Sequence[PublishedCheck],
    response: LevelResponse | None,
) -> None:
    from slopegate.core.calibration.picture import picture_told
    from slopegate.drivers.calibrations.geometry_run import sureness

    fitted = found.geometry
    print(
        f"Chart {views.chart} in {len(fitted.views)} views: rms {fitted.rms_px:.3f} px, camera "
        f"{fitted.camera_rms_px:.3f}, projector {fitted.projector_rms_px:.3f}"
    )
    _print_aligned(
        ("view", "corners", "camera px", "projector px", "held out px", "distance m", "tilt deg"),
        [
            (
                view.name, str(view.corners), f"{view.camera_px:.3f}", f"{view.projector_px:.3f}",
                "-" if math.isnan(view.held_out_px) else f"{view.held_out_px:.3f}", f"{view.distance_m:.3f}",
                f"{view.tilt_deg:.1f}",
            )
            for view in fitted.views
        ],
    )  # fmt: skip
    print("Numbers of the rig, with their standard errors")
    _print_aligned(
        ("", "value", "standard error"),
        [
            (name, f"{value:.6g}", f"{error:.2g}")
            for name, value, error in zip(GEOMETRY, fitted.values, fitted.standard_errors, strict=True)
        ],
    )
    for remark in _remarks(found):
        print(f"  {remark}")
    if picture := picture_told(found.focus, response, found.rig.projector.blur_px, "+-"):
        print(f"Projector's picture: {picture}")
    for check in checks:
        print(f"Against {check.published.path}{check.published.unit_told}")
        _print_aligned(
            ("", "there", "here", "standard errors apart"),
            [(one.name, f"{one.old:.6g}", f"{one.new:.6g}", f"{one.sigmas:.1f}") for one in check.differences],
        )
    print(f"  {sureness(views.chart, found).judged.text}")
    print(f"  {options.out} is written")


def _beside_truth(hidden: Rig, found: CalibratedGeometry) -> dict[str, Any]:
    """What a practice rig really has, and how many numbers lie within 1, 2 and 3 standard errors of it."""
    from slopegate.core.calibration.applied import differences

    apart = [one for one in differences(hidden, found.rig) if one.name in GEOMETRY]
    return {
        "numbers": len(apart),
        "within": {str(most): sum(one.sigmas <= most for one in apart) for most in (1, 2, 3)},
        "parameters": [asdict(one) for one in apart],
    }


def _print_truth(hidden: Rig, found: CalibratedGeometry) -> None:
    told = _beside_truth(hidden, found)
    print(f"Against the hidden truth of {hidden.name}")
    _print_aligned(
        ("", "true", "found", "standard errors apart"),
        [(one["name"], f"{one['old']:.6g}", f"{one['new']:.6g}", f"{one['sigmas']:.1f}") for one in told["parameters"]],
    )
    within = told["within"]
    print(
        f"  of {told['numbers']} numbers {within['1']} lie within 1 standard error, {within['2']} within 2 and "
        f"{within['3']} within 3"
    )


def _print_aligned(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    print(indent(aligned(headings, rows), "  "))
