"""One question to a GigE Vision camera: is it there, and does anybody control it? (GigE Vision, GVCP READREG.)

Aravis asks the same, but waits five seconds for an answer.
"""

from __future__ import annotations

import socket
import struct
from typing import Final

PORT: Final = 3956
CONTROL_REGISTER: Final = 0x0A00
"""Control channel privilege; 0 while nobody controls the camera."""
KEY, ACKNOWLEDGE, READ, READ_ANSWER = 0x42, 0x01, 0x0080, 0x0081


def control_privilege(host: str, timeout_s: float = 0.25, tries: int = 3) -> int | None:
    """The register's value, -1 for an answer that refuses it, None when the camera at this address does not answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.settimeout(timeout_s)
        for number in range(1, tries + 1):
            question = struct.pack(">BBHHHI", KEY, ACKNOWLEDGE, READ, 4, number, CONTROL_REGISTER)
            try:
                asker.sendto(question, (host, PORT))
                answer = asker.recv(64)
            except OSError:  # no answer, or nobody at this port
                continue
            if len(answer) >= 8:
                status, command, length, _ = struct.unpack(">HHHH", answer[:8])
                whole = command == READ_ANSWER and status == 0 and length >= 4 and len(answer) >= 12
                return int(struct.unpack(">I", answer[8:12])[0]) if whole else -1
    return None
