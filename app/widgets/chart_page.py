"""A calibration chart on a page, true to scale, for a printer: as a PDF, or as a picture that knows its resolution."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QMarginsF, QRectF, QSizeF, Qt
from PySide6.QtGui import QFont, QFontMetricsF, QImage, QImageWriter, QPageLayout, QPageSize, QPainter, QPdfWriter

from slopegate.core.calibration.chart import Chart, dark_parts
from slopegate.core.rig.checks import InputError, require

Millimetres = tuple[float, float]

PAPERS: Final[dict[str, Millimetres]] = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "a5": (148.0, 210.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
AMERICAN: Final = ("letter", "legal", "tabloid")
MARGIN_MM: Final = 8.0
"""White round the chart: printers leave so much free, and corners are found against it."""
FOOT_MM: Final = 12.0
"""For the line of text below it."""
BAR_MM: Final = 100.0
TICK_MM: Final = 10.0
TEXT_MM: Final = 2.6
MOST_PAPER_MM: Final = 20_000.0
MOST_PIXELS: Final = 30_000
MM_PER_INCH: Final = 25.4
_SIZE = re.compile(r"(\d{1,5}(?:\.\d{1,3})?)x(\d{1,5}(?:\.\d{1,3})?)")


@dataclass(frozen=True)
class ChartPage:
    """A chart on its page: width and height of the page in mm, and where the squares begin on it."""

    chart: Chart
    paper: str
    width_mm: float
    height_mm: float
    left_mm: float
    top_mm: float


def paper_size(paper: str) -> Millimetres:
    """Width and height of a paper of this name, or as "WIDTHxHEIGHT" in millimetres. Raises InputError."""
    if paper.lower() in PAPERS:
        return PAPERS[paper.lower()]
    found = _SIZE.fullmatch(paper.strip().lower())
    allowed = f"one of {', '.join(PAPERS)}, or WIDTHxHEIGHT in millimetres up to {MOST_PAPER_MM:g}"
    require(found is not None, "paper", paper, allowed)
    assert found is not None
    width, height = float(found[1]), float(found[2])
    require(0 < width <= MOST_PAPER_MM and 0 < height <= MOST_PAPER_MM, "paper", paper, allowed)
    return width, height


def lay_out(chart: Chart, paper: str) -> ChartPage:
    """The chart in the middle of a page of this paper, turned as it fits. Raises InputError with what would fit."""
    across, down = paper_size(paper)
    for width, height in ((across, down), (down, across)):
        left, top = _corner(chart, width, height)
        if min(left, top) >= MARGIN_MM:
            return ChartPage(chart, paper, width, height, left, top)
    raise InputError(_too_large(chart, paper, across, down))


def smallest_page(chart: Chart) -> ChartPage:
    """The chart on the smallest of papers A4 to A0 that holds it. Raises InputError where none does."""
    for paper in ("a4", "a3", "a2", "a1"):
        with suppress(InputError):
            return lay_out(chart, paper)
    return lay_out(chart, "a0")


def _corner(chart: Chart, width: float, height: float) -> Millimetres:
    """Where the squares begin on a page; less than the margin where they do not fit."""
    squares = [1000 * side for side in chart.size_m]
    return (width - squares[0]) / 2, (height - FOOT_MM - squares[1]) / 2


def _too_large(chart: Chart, paper: str, across: float, down: float) -> str:
    width, height = (1000 * side for side in chart.size_m)
    largest = max(_largest_square(chart, *sides) for sides in ((across, down), (down, across)))
    offers = []
    if largest >= 1:
        share = largest / (1000 * chart.square_m)
        smaller = replace(chart, square_m=largest / 1000, marker_m=chart.marker_m * share)
        offers.append(f"{smaller} would")
    american = paper.lower() in AMERICAN
    papers = [(name, sides) for name, sides in PAPERS.items() if (name in AMERICAN) == american]
    papers.sort(key=lambda item: item[1][0] * item[1][1])
    fitting = next((name for name, sides in papers if _fits(chart, sides)), None)
    if fitting is not None:
        offers.append(f"paper {fitting} would")
    else:
        offers.append(f"paper of {width + 2 * MARGIN_MM:.0f}x{height + 2 * MARGIN_MM + FOOT_MM:.0f} would")
    return (
        f"chart {chart} is {width:.6g} x {height:.6g} mm and does not fit {paper} ({across:g} x {down:g} mm) with its "
        f"border: {', and '.join(offers)}"
    )


def _fits(chart: Chart, sides: Millimetres) -> bool:
    return any(min(_corner(chart, *one)) >= MARGIN_MM for one in (sides, sides[::-1]))


def _largest_square(chart: Chart, width: float, height: float) -> int:
    """In whole millimetres; 0 where none fits."""
    room = (width - 2 * MARGIN_MM) / (chart.columns + 1), (height - 2 * MARGIN_MM - FOOT_MM) / (chart.rows + 1)
    return max(0, math.floor(min(room)))


def as_pdf(page: ChartPage) -> bytes:
    """The page as a PDF of one page, drawn with lines and areas: as sharp as the printer."""
    kept = QByteArray()
    buffer = QBuffer(kept)
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    writer = QPdfWriter(buffer)
    size = QPageSize(
        QSizeF(page.width_mm, page.height_mm), QPageSize.Unit.Millimeter, "", QPageSize.SizeMatchPolicy.ExactMatch
    )
    none = QMarginsF(0, 0, 0, 0)
    writer.setPageLayout(QPageLayout(size, QPageLayout.Orientation.Portrait, none, QPageLayout.Unit.Millimeter, none))
    writer.setTitle(f"Calibration chart {page.chart}")
    writer.setCreator("Slopegate")
    painter = QPainter(writer)
    _draw(painter, page, writer.resolution() / MM_PER_INCH)
    painter.end()
    buffer.close()
    return bytes(kept.data())


def as_image(page: ChartPage, dpi: float) -> QImage:
    """The page as a grey picture of this resolution, which it also names (PNG: pHYs). Raises InputError."""
    scale = dpi / MM_PER_INCH
    width, height = round(page.width_mm * scale), round(page.height_mm * scale)
    allowed = f"at most {MOST_PIXELS / max(page.width_mm, page.height_mm) * MM_PER_INCH:.0f} for this paper"
    require(max(width, height) <= MOST_PIXELS, "dpi", dpi, allowed)
    image = QImage(width, height, QImage.Format.Format_Grayscale8)
    image.fill(Qt.GlobalColor.white)
    for set_dots in (image.setDotsPerMeterX, image.setDotsPerMeterY):
        set_dots(round(1000 * scale))
    painter = QPainter(image)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    _draw(painter, page, scale)
    painter.end()
    return image


def png_bytes(image: QImage) -> bytes:
    """The picture as a PNG file."""
    kept = QByteArray()
    buffer = QBuffer(kept)
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    QImageWriter(buffer, QByteArray(b"png")).write(image)
    buffer.close()
    return bytes(kept.data())


def _draw(painter: QPainter, page: ChartPage, dots_per_mm: float) -> None:
    painter.scale(dots_per_mm, dots_per_mm)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(Qt.GlobalColor.black)
    for left, top, width, height in (1000 * dark_parts(page.chart)).tolist():
        painter.drawRect(QRectF(page.left_mm + left, page.top_mm + top, width, height))
    _draw_foot(painter, page)


def _draw_foot(painter: QPainter, page: ChartPage) -> None:
    """The ruler to check the scale by, and what the chart is, along the lower edge of the page."""
    bar = min(BAR_MM, TICK_MM * math.floor((page.width_mm - 2 * MARGIN_MM) / 2 / TICK_MM))
    base = page.height_mm - MARGIN_MM
    painter.drawRect(QRectF(MARGIN_MM, base - 0.3, bar, 0.3))
    for tick in range(round(bar / TICK_MM) + 1):
        long = tick in (0, round(bar / TICK_MM))
        # the outer edges of the end ticks are what is measured
        left = MARGIN_MM + tick * TICK_MM - (0.15 if 0 < tick * TICK_MM < bar else 0.3 * (tick > 0))
        painter.drawRect(QRectF(left, base - (3 if long else 1.5), 0.3, 3 if long else 1.5))
    room = QRectF(MARGIN_MM + bar + 4, base - 5, page.width_mm - 2 * MARGIN_MM - bar - 4, 5)
    text = (
        f"Slopegate chart {page.chart}. Print at 100 %, not fitted to the page: the bar is {bar:.0f} mm, "
        f"a square {1000 * page.chart.square_m:.6g} mm."
    )
    font = QFont("sans-serif")
    font.setPixelSize(100)
    drawn = QFontMetricsF(font)
    scale = min(TEXT_MM / drawn.height(), room.width() / drawn.horizontalAdvance(text))
    painter.save()
    painter.setFont(font)
    painter.setPen(Qt.GlobalColor.black)
    painter.translate(room.left(), room.bottom() - drawn.descent() * scale)
    painter.scale(scale, scale)
    painter.drawText(0, 0, text)
    painter.restore()
