"""A sync board or delay generator: a thread owns its port, sets what is asked, reads it back, and reconnects."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal

from slopegate.core.rig.checks import InputError
from slopegate.drivers.files.library_words import fault_inside
from slopegate.drivers.files.workers import Worker
from slopegate.drivers.sync.dialect import (
    PULSE_FIELDS,
    BoardError,
    Dialect,
    Pulse,
    RefusedError,
    ReplyError,
    Values,
    differing,
)
from slopegate.drivers.sync.serial_port import Port, PortError
from slopegate.drivers.sync.talk import Conversation

RETRY_S: Final = (0.1, 0.2, 0.5, 1.0)
"""Pauses after one, two, ... failures in a row; the last one is kept up for ever."""

GREETINGS: Final = 4
"""On one open port: opening it resets some boards, which then say nothing for two seconds."""

LISTEN_S: Final = 0.05
"""How soon a pulled cable is noticed."""

State = Literal["connecting", "ready", "lost", "closed"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BoardStatus:
    """What is known of a board at one moment."""

    state: State = "closed"
    sentence: str = ""
    """What is wrong; empty when all is well."""
    identity: str = ""
    """Who answered last."""
    asked: Pulse | None = None
    """On the instrument's steps."""
    applied: Pulse | None = None
    """Read back from the instrument; None while that is not known in full."""
    settable: tuple[str, ...] = ()
    """Fields of a Pulse that this model sets and tells."""
    agreed_s: float | None = None
    """Monotonic clock when the read-back first agreed with `asked`; None while it does not."""
    connections: int = 0
    """Times that the instrument was greeted with success."""
    errors: int = 0
    """Failures of the port, the line or the instrument."""


class Board:
    """A sync board or delay generator, kept connected and as asked for by a thread of its own.

    Every method may be called from any thread. Only `apply`, `wait_ready` and `close` wait.
    """

    def __init__(
        self,
        open_port: Callable[[], Port],
        dialect: Dialect,
        output: int = 1,
        *,
        reply_timeout_s: float = 1.0,
        poll_s: float = 0.5,
        retry_s: tuple[float, ...] = RETRY_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if dialect.outputs and not 1 <= output <= dialect.outputs:
            raise InputError(f"output is {output}: {dialect.title} has outputs 1 to {dialect.outputs}")
        self.dialect, self.output = dialect, output
        self._open_port, self._clock = open_port, clock
        self._reply_timeout_s, self._poll_s, self._retry_s = reply_timeout_s, poll_s, retry_s
        self._changed = threading.Condition()
        self._status = BoardStatus()
        self._pending = False
        self._known: Values = {}
        self._poll_due_s = 0.0
        self._wake, self._ending = threading.Event(), threading.Event()
        self._worker: Worker | None = None

    @property
    def status(self) -> BoardStatus:
        """A consistent snapshot; never waits for the instrument."""
        with self._changed:
            return self._status

    def start(self) -> None:
        """Connect, and stay connected until closed."""
        if self._worker is None:
            self._tell(state="connecting", sentence="")
            self._worker = Worker(self._run, "slopegate-board")
            self._worker.start()

    def submit(self, pulse: Pulse) -> Pulse:
        """Ask for this pulse, also after a reconnection; the latest wins. Returns it rounded to the instrument's steps.

        Raises InputError for what this kind of instrument cannot do.
        """
        if self.dialect.limits is None:
            raise InputError(f"{self.dialect.title}: there is no pulse to set")
        rounded = self.dialect.limits.round(pulse)
        with self._changed:
            if rounded != self._status.asked or self._status.agreed_s is None:
                self._pending = True
                self._status = replace(self._status, asked=rounded, agreed_s=None)
        self._wake.set()
        return rounded

    def apply(self, pulse: Pulse, timeout_s: float = 5.0) -> Pulse:
        """Submit and wait for the read-back: what the instrument really has. Raises BoardError when that fails."""
        asked = self.submit(pulse)
        with self._changed:
            self._changed.wait_for(lambda: self._status.asked != asked or not self._pending, timeout_s)
            status, done = self._status, not self._pending
        if status.asked == asked and status.agreed_s is not None and status.applied is not None:
            return status.applied
        if done and status.state == "ready":
            raise BoardError(status.sentence or "Something else was asked of the board meanwhile.")
        raise BoardError(f"The board has not confirmed the pulse within {timeout_s:g} s. {status.sentence}".strip())

    def wait_ready(self, timeout_s: float) -> bool:
        """Wait until the instrument answers; False after the time-out."""
        with self._changed:
            return self._changed.wait_for(lambda: self._status.state == "ready", timeout_s)

    def close(self, timeout_s: float = 5.0) -> None:
        """Let the port go and wait for the thread; one that hangs in the system's driver is left behind."""
        self._ending.set()
        self._wake.set()
        if self._worker is not None:
            self._worker.finish(timeout_s)
            self._worker = None
        self._tell(state="closed", sentence="", applied=None, agreed_s=None)

    def _tell(self, **news: object) -> None:
        with self._changed:
            self._status = replace(self._status, **news)  # type: ignore[arg-type]
            self._changed.notify_all()

    def _run(self) -> None:
        failures = 0
        while not self._ending.is_set():
            before = self.status.connections
            try:
                port = self._open_port()
                try:
                    self._serve(port)
                finally:
                    port.close()
            except (PortError, BoardError) as error:
                self._lose(str(error))
            except Exception as error:  # whatever a port's driver raises must not end the reconnecting
                _log.exception("The board's port failed")
                self._lose(f"The board's port {fault_inside(error)}")
            failures = 0 if self.status.connections > before else failures + 1
            self._ending.wait(self._retry_s[min(failures, len(self._retry_s) - 1)])

    def _lose(self, sentence: str) -> None:
        self._known = {}
        with self._changed:
            self._pending = self._pending or self._status.asked is not None
            errors = self._status.errors + 1
            self._status = replace(
                self._status, state="lost", sentence=sentence, applied=None, agreed_s=None, errors=errors
            )
            self._changed.notify_all()

    def _serve(self, port: Port) -> None:
        """Talk until the port goes, or until nobody answers any more."""
        talk = Conversation(port, self.dialect, self.output, self._reply_timeout_s, self._clock, self._ending.wait)
        silent = 0
        while not self._ending.is_set():
            try:
                self._meet(talk)
                silent = 0
                while not self._ending.is_set():
                    self._step(talk)
            except BoardError as error:
                silent += 1
                if silent >= GREETINGS:
                    raise
                self._lose(str(error))
                self._ending.wait(self._retry_s[0])

    def _meet(self, talk: Conversation) -> None:
        identity = talk.greet()
        self._known = talk.read_all()
        connections = self.status.connections + 1
        self._tell(state="ready", sentence="", identity=identity, settable=talk.settable, connections=connections)
        self._judge(talk.settable)

    def _step(self, talk: Conversation) -> None:
        with self._changed:
            pending, asked = self._pending, self._status.asked
        if pending and asked is not None:
            self._write(talk, asked)
        elif self._wake.wait(min(LISTEN_S, self._poll_s)):
            self._wake.clear()
        elif self._clock() >= self._poll_due_s:
            self._poll(talk)
            self._poll_due_s = self._clock() + self._poll_s
        else:
            talk.listen()

    def _write(self, talk: Conversation, asked: Pulse) -> None:
        refusal = ""
        try:
            self._known = talk.write(asked, self._known)
        except RefusedError as error:
            refusal = str(error)
            self._known = talk.read_all()
        with self._changed:
            if self._status.asked == asked:
                self._pending = False
        self._judge(talk.settable, refusal)

    def _poll(self, talk: Conversation) -> None:
        """Read back one value: somebody may have turned a knob at the instrument, or pulled its cable."""
        try:
            fields, told = talk.read_next()
        except RefusedError as error:
            raise ReplyError(str(error)) from None
        self._known = {name: value for name, value in self._known.items() if name not in fields} | told
        self._judge(talk.settable)

    def _judge(self, settable: tuple[str, ...], refusal: str = "") -> None:
        """Compare what was read back with what was asked."""
        with self._changed:
            was, known = self._status, self._known
            complete = bool(settable) and "delay_us" in known and all(name in known for name in settable)
            applied = Pulse(**known) if complete else None  # type: ignore[arg-type]
            off = () if was.asked is None or self._pending else differing(was.asked, known, settable)
            agreed_s, sentence, errors = was.agreed_s, refusal, was.errors
            if was.asked is None or self._pending or off:
                agreed_s = None
            elif agreed_s is None:
                agreed_s = self._clock()
            unable = () if was.asked is None or self._pending else _beyond(was.asked, settable)
            if unable:
                agreed_s, sentence = None, sentence or f"The instrument cannot be told {', '.join(unable)}."
            elif off:
                has = ", ".join(f"{name} {known.get(name, 'unknown')}" for name in off)
                wanted = ", ".join(f"{name} {getattr(was.asked, name)}" for name in off)
                sentence = sentence or f"The instrument has {has}; asked was {wanted}."
                errors += was.agreed_s is not None or bool(refusal) or not was.sentence
            self._status = replace(was, applied=applied, agreed_s=agreed_s, sentence=sentence, errors=errors)
            self._changed.notify_all()


def _beyond(asked: Pulse, settable: tuple[str, ...]) -> tuple[str, ...]:
    """Fields that this model cannot set although something unusual is asked of them."""
    usual = Pulse(0.0)
    return tuple(name for name in PULSE_FIELDS if name not in settable and getattr(asked, name) != getattr(usual, name))
