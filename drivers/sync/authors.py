"""The sync board of the paper's authors: one character a command, 57 600 baud, and no delay of its own.

It passes the projector's trigger on; the camera's own trigger delay sets the gate. `o` asks how it is, `y` is the
answer. Its other commands work the projector's power and mode and are not used here.
"""

from __future__ import annotations

from typing import Final

from slopegate.drivers.sync.dialect import Dialect, ReplyError


def _identity(reply: str) -> str:
    if reply != "y":
        raise ReplyError(f"The board answered {reply!r} when asked how it is: y was expected.")
    return "Authors' sync board"


AUTHORS: Final = Dialect(
    key="authors",
    title="The paper's sync board (passes the trigger on, sets no delay)",
    bauds=(57600,),
    hello="o",
    identity=_identity,
    items=lambda output: (),
    ending=b"",
    reply_ending=b"",
)
