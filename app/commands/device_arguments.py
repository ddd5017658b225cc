"""The options of `slopegate devices` and `slopegate doctor`."""

from __future__ import annotations

from typing import Any


def add_devices(commands: Any) -> None:
    """`slopegate devices`."""
    parser = commands.add_parser(
        "devices",
        help="what is plugged in, and what could be",
        description="Lists cameras, serial ports and what is on the USB; then what could be there if its driver or\n"
        "package were installed. Below each camera stands how the window is started on it. Nothing is opened or\n"
        "changed, unless --test is given.",
        epilog="examples:\n  slopegate devices\n  slopegate devices --test",
    )
    parser.add_argument(
        "--test",
        action="store_true",
        help="also open every device that can be tested and ask who is there; on serial ports by the greetings of the "
        "instruments that the program knows, which change nothing on them",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.devices", "run_devices"))


def add_doctor(commands: Any) -> None:
    """`slopegate doctor`."""
    parser = commands.add_parser(
        "doctor",
        help="check this computer and say what to do",
        description="Checks display, OpenGL, screens, serial ports, USB, camera drivers and folders, and says what to\n"
        "do where something is missing. The exit code is 1 when something is broken that the program needs; what is\n"
        "optional and missing is 0.",
        epilog="example:\n  slopegate doctor",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.doctor", "run_doctor"))
