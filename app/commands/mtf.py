"""`slopegate mtf`: sharpness of an imaging system from a picture of a slanted edge."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopegate.app.commands.options import add_json, add_rectangle, describe, positive
from slopegate.app.commands.report import Row, print_json, print_table, print_warnings
from slopegate.core.measure.slanted_edge import EdgeMtf, slanted_edge_mtf
from slopegate.core.rig.checks import require_rectangle
from slopegate.drivers.files.picture_files import read_luminance

_FULL_SCALES = (255, 1023, 4095, 16383, 65535)
"""Of sensors with 8 to 16 bits."""
_SHOWN = (0.1, 0.2, 0.3, 0.4, 0.5)


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="The modulation transfer function (MTF) of what made a picture, from one slanted straight edge in\n"
        "it (ISO 12233): the frequency at which contrast has fallen to a half, and the curve. The edge stands 1 to 30\n"
        "degrees off the picture's columns or rows. The file's numbers are taken as linear light, which those of\n"
        "'slopegate render' and of cameras are, and those of an edited photo are not.",
        epilog="example:\n  slopegate mtf edge.npy --region 700 500 780 620",
    )
    parser.add_argument("image", type=Path, metavar="IMAGE", help="a .png, .tif, .npy or .exr, grey or colour")
    add_rectangle(parser, "--region", "where the edge is, and nothing else: ", required=True)
    parser.add_argument(
        "--full-scale",
        type=positive(1e9),
        metavar="N",
        help="the sensor's greatest count: a saturated region is refused (without it: a warning where it may be)",
    )
    add_json(parser)


def run(options: Namespace) -> int:
    """Measure one edge."""
    image = read_luminance(options.image)
    region: tuple[int, int, int, int] = tuple(options.region)
    require_rectangle("region", region, image.shape[1], image.shape[0])
    x0, y0, x1, y1 = region
    cut = image[y0:y1, x0:x1]
    found = slanted_edge_mtf(cut, options.full_scale)
    warnings = [] if options.full_scale else _clipped(cut)
    if options.json:
        print_json({"image": str(options.image), "region": list(region)} | _values(found) | {"warnings": warnings})
        return 0
    print(f"A {found.near} edge in {options.image}, {found.edge_angle_deg:+.2f} degrees")
    print_table(_rows(found))
    print(f"  {found.method}")
    print_warnings(warnings)
    return 0


def _clipped(region: NDArray[Any]) -> list[str]:
    """A warning where many pixels stand at what is the full scale of some sensor; luminance of counts is rounded."""
    peak = round(float(region.max()))
    share = float(np.mean(region > peak - 1e-3))
    if peak not in _FULL_SCALES or share <= 0.01:
        return []
    return [
        f"{share:.0%} of the region's pixels are {peak}: if the sensor is saturated there, the edge looks too sharp"
    ]


def _values(found: EdgeMtf) -> dict[str, Any]:
    return {
        "mtf50_cy_per_px": found.mtf50_cy_per_px,
        "edge_angle_deg": found.edge_angle_deg,
        "edge": found.near,
        "curve": {
            "frequency_cy_per_px": found.frequencies_cy_per_px.tolist(),
            "mtf": found.mtf.tolist(),
        },
        "method": found.method,
    }


def _rows(found: EdgeMtf) -> list[Row]:
    at = [float(value) for value in np.interp(_SHOWN, found.frequencies_cy_per_px, found.mtf)]
    rows: list[Row] = [("MTF50", found.mtf50_cy_per_px, "cycles per pixel", "where contrast has fallen to a half")]
    return rows + [(f"at {where:g}", value, "", "") for where, value in zip(_SHOWN, at, strict=True)]
