"""Exports a capture in a worker thread."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Signal
from slopegate.app.session.loading import CancelledError, Loader, Progress
from slopegate.core.render.render import Cancelled
from slopegate.drivers.captures.export import export_capture
from slopegate.drivers.captures.limits import Format
from slopegate.drivers.captures.storage import CaptureFolder


class Exporter(QObject):
    """One export at a time; `said` tells how far it is, and how it ended."""

    said = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._loader: Loader[str] = Loader(lambda _: None, self)
        self._loader.progressed.connect(lambda share, text: self.said.emit(f"{text} {100 * share:.0f} %"))
        self._loader.finished.connect(self._on_finished)
        self._loader.failed.connect(self.said)

    @property
    def busy(self) -> bool:
        """Whether an export is under way."""
        return self._loader.busy

    def export(self, folder: CaptureFolder, kind: Format, out: Path) -> None:
        """Write this format."""

        def job(progress: Progress) -> str:
            try:
                count = export_capture(
                    folder, kind, out, progress=lambda share: progress.report(share, f"Exporting to {out.name}:")
                )
            except Cancelled:
                raise CancelledError from None
            return f"{count} slices are in {out}"

        self._loader.start(job)

    def _on_finished(self, sentence: str) -> None:
        # a Loader's results are objects, and those do not go straight into a signal of text
        self.said.emit(sentence)

    def close(self) -> None:
        """Stop and wait."""
        self._loader.close()
