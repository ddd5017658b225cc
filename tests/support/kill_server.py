"""Processes that are killed in the middle of writing into a folder, forked one after the other by a server."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from queue import Queue


class Server:
    """The process that forks the children to be killed: a script of this folder that calls `serve`."""

    def __init__(self, script: str) -> None:
        command = [sys.executable, str(Path(__file__).with_name(script))]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._lines: Queue[str] = Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        assert self.line() == "ready"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())

    def line(self) -> str:
        return self._lines.get(timeout=200)

    def begin(self, folder: Path) -> int:
        """Let a child record into the folder; its process number."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{folder}\n")
        self._process.stdin.flush()
        # the child may speak before its parent
        said: list[str] = []
        while not said or not said[-1].startswith("pid "):
            said.append(self.line())
        self.early = said[:-1]
        return int(said[-1].split()[1])

    def until_ended(self) -> list[str]:
        """All that the child said."""
        said = self.early
        while (line := self.line()) != "ended":
            said.append(line)
        return said

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(100)
        self._reader.join(100)
        assert self._process.stdout is not None
        self._process.stdout.close()


def serve(child: Callable[[Path], object]) -> None:
    """For every folder named on standard input fork a child, print its number, and let it work into that folder."""
    print("ready", flush=True)
    for line in sys.stdin:
        forked = os.fork()
        if forked == 0:
            child(Path(line.strip()))
            os._exit(0)
        print(f"pid {forked}", flush=True)
        os.waitpid(forked, 0)
        print("ended", flush=True)


def say(line: str) -> None:
    """In one piece, so that being killed leaves no half of a line."""
    os.write(1, f"{line}\n".encode())
