"""Simulated sync boards and delay generators on real pseudo-terminals: strict about syntax, and bad on command.

Written from the manuals' words, apart from the drivers, so that a misunderstanding shows. As a program, it is an
instrument that can be killed: `python sync_instruments.py KIND LINK`.
"""

# ruff: noqa: PLR0911 (a parser refuses in many places)
from __future__ import annotations

import os
import re
import select
import sys
import threading
import time
import tty
from pathlib import Path

UNITS = {"": 1e-9, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "s": 1.0}


class Instrument:
    """A pseudo-terminal with somebody behind it. `link` is a path that stays the same over disconnections."""

    reply_ending = "\r\n"
    gap_s = 0.0
    """Lines that come sooner after the last reply are violations."""
    sleep = staticmethod(time.sleep)

    def __init__(self, link: Path) -> None:
        self.link = link
        self.fault = ""
        """silent, late, truncated, garbage, wrong, flood: how the next `faults_left` replies go."""
        self.faults_left = 0
        self.late_s = 0.3
        self.lines: list[str] = []
        self.violations: list[str] = []
        self._replied_s = 0.0
        self._buffer = b""
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._plug()
        self._thread = threading.Thread(target=self._run, name="instrument", daemon=True)
        self._thread.start()

    def misbehave(self, fault: str, times: int = 1, late_s: float = 0.3) -> None:
        with self._lock:
            self.fault, self.faults_left, self.late_s = fault, times, late_s

    def unplug(self) -> None:
        """The cable is pulled: the port vanishes in the middle of whatever it was doing."""
        with self._lock:
            self.link.unlink(missing_ok=True)
            for fd in (self._slave, self._master):
                if fd >= 0:
                    os.close(fd)
            self._master = self._slave = -1

    def plug(self) -> None:
        with self._lock:
            self._plug()

    def close(self) -> None:
        self._ending.set()
        self._thread.join(5)
        self.unplug()

    def received(self, line: str) -> str | None:
        """The strict part: a complete line -> what is answered, None for nothing."""
        raise NotImplementedError

    def frames(self, data: bytes) -> list[str]:
        """Complete lines out of what came; the rest is kept."""
        raise NotImplementedError

    def _plug(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        tty.setraw(self._master)
        self._buffer = b""
        part = self.link.with_name(self.link.name + ".part")
        part.unlink(missing_ok=True)
        part.symlink_to(os.ttyname(self._slave))
        part.replace(self.link)

    def _run(self) -> None:
        while not self._ending.is_set():
            with self._lock:
                master = self._master
            if master < 0:
                time.sleep(0.005)
                continue
            try:
                ready, _, _ = select.select([master], [], [], 0.02)
                data = os.read(master, 4096) if ready else b""
            except (OSError, ValueError):
                continue
            for line in self.frames(data) if data else []:
                if time.monotonic() - self._replied_s < self.gap_s:
                    self.violations.append(f"{line!r} came too soon")
                self.lines.append(line)
                self._reply(self.received(line))

    def _reply(self, text: str | None) -> None:
        if text is None:
            return
        with self._lock:
            fault = self.fault if self.faults_left > 0 else ""
            self.faults_left -= bool(fault)
        data = (text + self.reply_ending).encode()
        if fault == "silent":
            return
        if fault == "late":
            time.sleep(self.late_s)
        if fault == "truncated":
            data = data[: len(data.strip()) // 2]
        if fault == "garbage":
            data = b"\xff\x00\xfe\x81" + self.reply_ending.encode()
        if fault == "wrong":
            data = ("42.5" + self.reply_ending if self.reply_ending else "n").encode()
        if fault == "flood":
            data = b"x" * 3000
        if fault == "gone":
            self.unplug()
            return
        self._replied_s = time.monotonic()  # before whoever waits for it can answer
        with self._lock:
            if self._master >= 0:
                os.write(self._master, data)


class PulseInstrument(Instrument):
    """Quantum Composers 9530 manual: keywords in their short or long form, seconds, ok or ?n."""

    gap_s = 0.045
    edge_words = ("EDGE",)
    whole = "PULSE0"

    def __init__(self, link: Path) -> None:
        self.channels = {
            n: {"DELAY": 0.0, "WIDTH": 1e-6, "POL": "NORM", "STATE": "0", "SYNC": "CHA"} for n in range(1, 9)
        }
        self.running, self.mode, self.edge, self.level = "0", "DIS", "RIS", 2.5
        super().__init__(link)

    def frames(self, data: bytes) -> list[str]:
        self._buffer += data
        found = []
        while b"\n" in self._buffer:
            line, _, self._buffer = self._buffer.partition(b"\n")
            if not line.endswith(b"\r"):
                self.violations.append(f"{line!r} does not end in CR LF")
            found.append(line.rstrip(b"\r").decode("ascii"))
        return found

    def received(self, line: str) -> str:
        if line == "*IDN?":
            return "QC,9530,12345,1.2.3-4.5.6"
        if not line.startswith(":"):
            return "?1"
        match = re.fullmatch(r":([A-Z]+)(\d?):([A-Z:]+)(\?| (\S+))?", line)
        if match is None:
            return "?3"
        head, digit, key, rest, value = match.groups()
        if rest is None:
            return "?4"
        return (
            self._whole(key, value)
            if head + digit == self.whole or digit == "0"
            else self._channel(head, digit, key, value)
        )

    def _whole(self, key: str, value: str | None) -> str:
        if key in ("STATE", "STAT"):
            return self._keep("running", value, {"ON": "1", "OFF": "0", "1": "1", "0": "0"})
        if key in ("TRIG:MODE", "TRIGGER:MODE", "TRIG:MOD"):
            return self._keep("mode", value, {"TRIG": "TRIG", "DIS": "DIS"})
        if key in tuple(f"TRIG:{word}" for word in self.edge_words):
            return self._keep("edge", value, {"RIS": "RIS", "FALL": "FALL"})
        if key in ("TRIG:LEV", "TRIG:LEVEL"):
            if value is None:
                return f"{self.level:.2f}"
            if not re.fullmatch(r"\d+\.\d+", value) or not 0.2 <= float(value) <= 15:
                return "?5"
            self.level = float(value)
            return "ok"
        return "?3"

    def _keep(self, name: str, value: str | None, allowed: dict[str, str]) -> str:
        if value is None:
            return str(getattr(self, name))
        if value not in allowed:
            return "?5"
        setattr(self, name, allowed[value])
        return "ok"

    def _channel(self, head: str, digit: str, key: str, value: str | None) -> str:
        if head != "PULSE" or not digit or int(digit) not in self.channels:
            return "?3"
        channel = self.channels[int(digit)]
        full = {"DEL": "DELAY", "WIDT": "WIDTH", "STAT": "STATE"}.get(key, key)
        if full not in channel:
            return "?3"
        if full in ("DELAY", "WIDTH"):
            if value is None:
                return f"{channel[full]:.9f}"
            if not re.fullmatch(r"-?\d+(\.\d{1,11})?", value) or not -99.9 <= float(value) <= 999.9:
                return "?5"
            channel[full] = round(float(value) / 1e-8) * 1e-8
            return "ok"
        if value is None:
            return str(channel[full])
        allowed = {
            "POL": {"NORM": "NORM", "INV": "INV", "COMP": "COMP"},
            "STATE": {"ON": "1", "OFF": "0", "1": "1", "0": "0"},
            "SYNC": {"T0": "T0", "CHA": "CHA"},
        }[full]
        if value not in allowed:
            return "?5"
        channel[full] = allowed[value]
        return "ok"

    def pulse(self) -> tuple[float, float, bool, bool]:
        """Output 1 as it really is: delay and width in us, inverted, on."""
        one = self.channels[1]
        on = one["STATE"] == "1" and self.running == "1" and self.mode == "TRIG" and one["SYNC"] == "T0"
        return float(one["DELAY"]) * 1e6, float(one["WIDTH"]) * 1e6, one["POL"] != "NORM", on


class OlderPulseInstrument(PulseInstrument):
    """Another spelling of the trigger's edge and of the whole instrument."""

    edge_words = ("LOG", "LOGIC")
    whole = "SPULSE"

    def received(self, line: str) -> str:
        return "?3" if line.startswith(":PULSE0:STATE") else super().received(line)


class EdgelessPulseInstrument(PulseInstrument):
    """A small board without a choice of edge."""

    edge_words = ()


class OwnBoard(PulseInstrument):
    """The least that resources/boards.md asks of a board of one's own."""

    gap_s = 0.0
    edge_words = ()

    def received(self, line: str) -> str:
        return "?3" if ":POL" in line or ":TRIG:LEV" in line else super().received(line)


class DelayGenerator645(Instrument):
    """DG645 manual: settings silent, an error queue, queries as `DLAY?2`."""

    def __init__(self, link: Path) -> None:
        self.delays = {channel: (0, 0.0) for channel in range(2, 10)}
        self.polarity = dict.fromkeys(range(5), 1)
        self.source, self.level = 5, 1.0
        self.errors: list[int] = [10]  # left by somebody before us
        super().__init__(link)

    def frames(self, data: bytes) -> list[str]:
        self._buffer += data
        found = []
        while b"\n" in self._buffer:
            line, _, self._buffer = self._buffer.partition(b"\n")
            found.append(line.rstrip(b"\r").decode("ascii"))
        return found

    def received(self, line: str) -> str | None:
        match = re.fullmatch(r"(\*?[A-Z]{3,4})(\?)?\s*(.*)", line)
        if match is None:
            return self._error(110)
        name, query, rest = match.groups()
        words = [word for word in rest.split(",") if word]
        if name + (query or "") == "*IDN?":
            return "Stanford Research Systems,DG645,s/n001776,ver1.14.10E"
        if name == "*CLS":
            self.errors.clear()
            return None
        if name + (query or "") == "LERR?":
            return str(self.errors.pop() if self.errors else 0)
        handler = {"DLAY": self._delay, "LPOL": self._polar, "TSRC": self._source, "TLVL": self._level}.get(name)
        if handler is None:
            return self._error(111)
        try:
            return handler(bool(query), words)
        except (ValueError, IndexError, KeyError):
            return self._error(10)

    def _error(self, code: int) -> None:
        self.errors.append(code)

    def _delay(self, query: bool, words: list[str]) -> str | None:
        channel = int(words[0])
        if query:
            start, seconds = self.delays[channel]
            return f"{start},{seconds:+.12f}"
        start, seconds = int(words[1]), float(words[2])
        if len(words) != 3 or channel not in self.delays or channel == start:
            return self._error(13)
        if not 0 <= seconds <= 2000:
            return self._error(12)
        self.delays[channel] = start, round(seconds / 5e-12) * 5e-12
        return None

    def _polar(self, query: bool, words: list[str]) -> str | None:
        output = int(words[0])
        if query:
            return str(self.polarity[output])
        if words[1] not in ("0", "1"):
            return self._error(10)
        self.polarity[output] = int(words[1])
        return None

    def _source(self, query: bool, words: list[str]) -> str | None:
        if query:
            return str(self.source)
        if int(words[0]) not in range(7):
            return self._error(10)
        self.source = int(words[0])
        return None

    def _level(self, query: bool, words: list[str]) -> str | None:
        if query:
            return f"{self.level:+.2f}"
        self.level = float(words[0])
        return None

    def pulse(self) -> tuple[float, float, bool, bool]:
        good = self.delays[2][0] == 0 and self.delays[3][0] == 2 and self.source in (1, 2)
        return self.delays[2][1] * 1e6, self.delays[3][1] * 1e6, self.polarity[1] == 0, good


class Highland560(Instrument):
    """T560 manual: CR ends a line, times without unit are nanoseconds, changes wait for INSTALL."""

    def __init__(self, link: Path) -> None:
        self.set = {letter: {"D": 0.0, "W": 2e-6, "P": "POS", "S": "OFF"} for letter in "ABCD"}
        self.installed = {letter: dict(values) for letter, values in self.set.items()}
        self.trigger, self.level = "REM", 1.25
        self.changed_with_trigger_on = 0
        super().__init__(link)

    def frames(self, data: bytes) -> list[str]:
        self._buffer += data.replace(b"\n", b"")
        found = []
        while b"\r" in self._buffer:
            line, _, self._buffer = self._buffer.partition(b"\r")
            if len(line) > 256:
                self.violations.append("a line of more than 256 bytes")
            found.append(line.decode("ascii"))
        return found

    def received(self, line: str) -> str:
        replies = []
        for command in line.split(";"):
            replies.append(self._one(command.strip()))
            if replies[-1] == "??":
                break
        return ";".join(replies)

    def _one(self, command: str) -> str:
        word, _, argument = command.partition(" ")
        argument = argument.strip()
        if word in ("TR", "TRIGGER"):
            if not argument:
                return f"Trig {self.trigger} HIZ Level {self.level:.3f} Div 00 SYN 00010000.00"
            if argument not in ("POS", "NEG", "OFF", "REM", "SYN"):
                return "??"
            self.trigger = argument
            return "OK"
        if word in ("TL", "TLEVEL"):
            if not re.fullmatch(r"\d\.\d+", argument) or not 0.25 <= float(argument) <= 3.3:
                return "??"
            self.level = float(argument)
            return "OK"
        if word in ("WA", "WAIT"):
            if not argument.isdigit():
                return "??"
            self.sleep(int(argument) * 1e-6)
            return "OK"
        if word in ("IN", "INSTALL"):
            self.changed_with_trigger_on += self.trigger != "OFF"
            self.installed = {letter: dict(values) for letter, values in self.set.items()}
            return "OK"
        return self._channel(word, argument)

    def _channel(self, word: str, argument: str) -> str:
        if not re.fullmatch("[A-D][DWS]", word):
            return "??"
        letter, what = word
        if what == "S":
            if not argument:
                now = self.installed[letter]
                delay, width = (f"{now[key]:015.12f}" for key in "DW")
                grouped = [re.sub(r"(\d{3})(?=\d)", r"\1,", text.partition(".")[2]) for text in (delay, width)]
                whole = [text.partition(".")[0] for text in (delay, width)]
                return (
                    f"Ch {letter}  {now['P']}  {now['S']:<3}    Dly  {whole[0]}.{grouped[0]}  "
                    f"Wid  {whole[1]}.{grouped[1]}"
                )
            if argument not in ("POS", "NEG", "ON", "OFF"):
                return "??"
            self.set[letter]["P" if argument in ("POS", "NEG") else "S"] = argument
            return "OK"
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([pnums]?)", argument)
        if match is None or float(match[1]) * UNITS[match[2]] > 10:
            return "??"
        self.set[letter][what] = round(float(match[1]) * UNITS[match[2]] / 1e-11) * 1e-11
        return "OK"

    def pulse(self) -> tuple[float, float, bool, bool]:
        now = self.installed["A"]
        on = now["S"] == "ON" and self.trigger in ("POS", "NEG")
        return float(now["D"]) * 1e6, float(now["W"]) * 1e6, now["P"] == "NEG", on


class AuthorsBoard(Instrument):
    """One character a command; anything else is a violation."""

    reply_ending = ""

    def __init__(self, link: Path) -> None:
        self.power_presses = 0
        self.mode_presses = 0
        super().__init__(link)

    def frames(self, data: bytes) -> list[str]:
        return list(data.decode("ascii", "replace"))

    def received(self, line: str) -> str | None:
        if line == "p":
            self.power_presses += 1
        elif line == "m":
            self.mode_presses += 1
        elif line == "o":
            return "y"
        else:
            self.violations.append(line)
        return None


KINDS = {
    "own": OwnBoard,
    "pulse": PulseInstrument,
    "dg645": DelayGenerator645,
    "t560": Highland560,
    "authors": AuthorsBoard,
}

if __name__ == "__main__":
    KINDS[sys.argv[1]](Path(sys.argv[2]))
    print("plugged", flush=True)
    threading.Event().wait()
