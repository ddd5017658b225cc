"""`slopegate chart`: a chart to calibrate with, for a printer."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from slopegate.app.commands.options import add_json, add_overwrite, describe, number
from slopegate.app.commands.report import print_json
from slopegate.core.calibration.chart import ALLOWED, USUAL_CHART, chart_from
from slopegate.drivers.files.durable import check_destination, write_durably

SUFFIXES = (".pdf", ".png")


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="A checkerboard or ChArUco board to calibrate with, true to scale, with a ruler to check the\n"
        "print by. Print it at 100 %, glue it onto something flat, measure the ruler and some squares, and give\n"
        "the size that you measured to 'slopegate calibrate'. A ChArUco board may be seen in part.",
        epilog="examples:\n  slopegate chart --out chart.pdf\n"
        "  slopegate chart charuco:11x7:30 --paper a3 --out board.pdf",
    )
    parser.add_argument("chart", metavar="CHART", nargs="?", default=USUAL_CHART, help=f"{ALLOWED} ({USUAL_CHART})")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the .pdf, or a .png")
    parser.add_argument(
        "--paper", default="a4", metavar="P", help="a5 to a0, letter, legal, tabloid, or WIDTHxHEIGHT in mm (a4)"
    )
    parser.add_argument(
        "--dpi",
        type=number(50.0, 2400.0, "a number from 50 to 2400"),
        default=600.0,
        metavar="N",
        help="dots per inch of a .png (600); a .pdf has none",
    )
    add_overwrite(parser)
    add_json(parser)


def run(options: Namespace) -> int:
    """Draw one chart."""
    chart = chart_from(options.chart)
    check_destination(options.out, SUFFIXES, overwrite=options.overwrite)
    from slopegate.app.widgets.chart_page import as_image, as_pdf, lay_out, png_bytes

    page = lay_out(chart, options.paper)
    _with_fonts()
    pdf = options.out.suffix.lower() == ".pdf"
    write_durably(options.out, as_pdf(page) if pdf else png_bytes(as_image(page, options.dpi)))
    told = {
        "file": str(options.out),
        "chart": str(chart),
        "inner_corners": [chart.columns, chart.rows],
        "square_mm": 1000 * chart.square_m,
        "paper_mm": [page.width_mm, page.height_mm],
        "dpi": None if pdf else options.dpi,
    }
    if options.json:
        print_json(told)
        return 0
    print(f"Chart {chart} on {page.width_mm:g} x {page.height_mm:g} mm is in {options.out}")
    print("  print it at 100 %, measure the ruler, and calibrate with the size that you measure:")
    print(f"  slopegate calibrate FOLDER --chart {chart} --out RIG.toml")
    return 0


def _with_fonts() -> None:
    """Text needs an application; without a display it draws all the same."""
    from PySide6.QtGui import QGuiApplication

    from slopegate.app.commands.window import has_display

    if QGuiApplication.instance() is None:
        _kept.append(QGuiApplication([sys.argv[0], *([] if has_display() else ["-platform", "offscreen"])]))


_kept: list[object] = []
"""Qt's application, which would end with its last reference."""
