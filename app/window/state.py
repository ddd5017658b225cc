"""Between what the window remembers and what Qt and the session hold."""

from __future__ import annotations

import math

from PySide6.QtCore import QByteArray

from slopegate.app.session.preferences import Preferences, RememberedGate
from slopegate.app.session.session import Intent, Session
from slopegate.app.session.source import Options
from slopegate.core.rig.settings import gate
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
    return Intent(gate(kept.gate.line_time_us, kept.gate.delay_us, kept.gate.exposure_us), kept.complement)


def kept_options(kept: Preferences, skip: bool = True, faults: Faults | None = None) -> Options:
    """The options of the virtual camera when the window was last closed."""
    rate_hz = math.inf if kept.rate_hz is None else kept.rate_hz
    return Options(kept.pixel_format, kept.noise, rate_hz, kept.lit_rows, skip, faults)


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
            "gate": RememberedGate(
                line_time_us=held.line_time_us, delay_us=float(held.delay_us), exposure_us=held.exposure_us
            ),
            "complement": intent.complement,
            "noise": options.noise,
            "rate_hz": options.rate_hz if math.isfinite(options.rate_hz) else None,
            "lit_rows": options.lit_rows,
        }
    )
