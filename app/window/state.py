"""Between what the window remembers and what Qt and the session hold."""

from __future__ import annotations

import math

from PySide6.QtCore import QByteArray

from slopegate.app.session.preferences import Preferences, RememberedGate
from slopegate.app.session.session import Intent, Session
from slopegate.app.session.source import Options
from slopegate.drivers.cameras.faults import Faults
from slopegate.drivers.contract.families import Address


def pack(state: QByteArray) -> str:
    """Qt's bytes as text."""
    return bytes(state.toBase64().data()).decode("ascii")


def unpack(text: str) -> QByteArray:
    """Text as Qt's bytes; any other text gives bytes that Qt refuses."""
    return QByteArray.fromBase64(text.encode("ascii", "ignore"))


def kept_intent(kept: Preferences) -> Intent | None:
    """The gate that was set when the window was last closed."""
    if kept.gate is None:
        return None
    return Intent(kept.gate.settings(), kept.complement)


def kept_options(kept: Preferences, skip: bool = True, faults: Faults | None = None) -> Options:
    """The options of the virtual camera when the window was last closed."""
    return Options(kept.pixel_format, kept.noise, rate_of(kept.rate_hz), kept.lit_rows, skip, faults)


def kept_rate(rate_hz: float) -> float | None:
    """A frame rate as files keep it: None for as fast as it can, for JSON has no infinity."""
    return rate_hz if math.isfinite(rate_hz) else None


def rate_of(kept: float | None) -> float:
    """The frame rate that `kept_rate` has kept."""
    return math.inf if kept is None else kept


def with_session(kept: Preferences, session: Session) -> Preferences:
    """The preferences with what runs now; as they are when nothing runs."""
    source, resolved, intent = session.source, session.resolved, session.intent
    if source is None or resolved is None or intent is None:
        return kept
    held, options = resolved.gate, source.options
    file = {} if isinstance(source.where, Address) else {"scene": str(source.where.absolute())}
    seen = {} if source.is_device else {"pixel_format": options.pixel_format}
    return kept.model_copy(
        update={
            **file,
            **seen,
            "gate": RememberedGate.of(held),
            "complement": intent.complement,
            "noise": options.noise,
            "rate_hz": kept_rate(options.rate_hz),
            "lit_rows": options.lit_rows,
        }
    )
