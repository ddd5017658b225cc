"""Between what the window remembers and what Qt and the session hold."""

from __future__ import annotations

import math

from PySide6.QtCore import QByteArray

from slopegate.app.session.preferences import Preferences, RememberedGate
from slopegate.app.session.session import Intent, PlaneWish, Session, asked_slab
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
    return intent_from(kept.gate, kept.slab, kept.complement)


def intent_from(
    held: RememberedGate | None, slab: tuple[float, float, float] | None, complement: bool
) -> Intent | None:
    """A gate that was kept, by its slab where it was asked for by that; None where none was."""
    if slab is not None:
        return Intent(PlaneWish(*slab), complement)
    return None if held is None else Intent(held.settings(), complement)


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
            "slab": asked_slab(intent),
            "complement": intent.complement,
            "noise": options.noise,
            "rate_hz": kept_rate(options.rate_hz),
            "lit_rows": options.lit_rows,
        }
    )
