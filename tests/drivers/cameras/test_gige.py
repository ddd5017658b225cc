from __future__ import annotations

import os
import socket
import struct
import sys
import threading
from collections.abc import Iterator

import pytest

from slopegate.drivers.cameras.aravis import PORT, control_privilege

PROCESS = os.getpid()
HOST = f"127.{PROCESS >> 8 & 255}.{PROCESS & 255}.11"
"""This process's own, for a camera's port cannot be chosen."""


@pytest.fixture
def camera() -> Iterator[list[bytes]]:
    """Answers each question with the next of these; an empty one is no answer."""
    if sys.platform != "linux":
        pytest.skip("only Linux has more than one loopback address at once")
    answers: list[bytes] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind((HOST, PORT))
        server.settimeout(0.05)
        ending = threading.Event()

        def serve() -> None:
            while not ending.is_set():
                try:
                    question, asker = server.recvfrom(64)
                except TimeoutError:
                    continue
                assert question[:8] == bytes((0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, question[7]))
                assert question[8:] == bytes((0x00, 0x00, 0x0A, 0x00))
                if answers and (answer := answers.pop(0)):
                    server.sendto(answer, asker)

        thread = threading.Thread(target=serve)
        thread.start()
        yield answers
        ending.set()
        thread.join()


def answer(value: int, status: int = 0, command: int = 0x81) -> bytes:
    return struct.pack(">HHHHI", status, command, 4, 1, value)


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ([answer(2)], 2),
        ([answer(0)], 0),
        ([b"", answer(2)], 2),
        ([answer(0, status=0x8006)], -1),
        ([struct.pack(">HHHH", 0x8001, 0x81, 0, 1)], -1),
        ([answer(2, command=0x83)], -1),
        ([b"?", answer(2)], 2),
        ([b"", b"", b""], None),
        ([b"?", b"?", b"?"], None),
    ],
)
def test_what_a_camera_says_of_its_control(camera: list[bytes], answers: list[bytes], said: int | None) -> None:
    camera += answers
    assert control_privilege(HOST, 0.1 if said is None else 1.0) == said


def test_nobody_answers_where_nobody_is() -> None:
    assert control_privilege("127.0.0.12", 0.05) is None
