"""`slopegate devices`: what is plugged in, and what could be."""

from __future__ import annotations

import shlex
from argparse import ArgumentParser, Namespace
from dataclasses import asdict

from slopegate.app.commands.options import add_json, describe
from slopegate.app.commands.report import print_json
from slopegate.app.session.log import sentence_of
from slopegate.drivers.contract.families import Found
from slopegate.drivers.devices.catalog import VIRTUAL
from slopegate.drivers.devices.survey import Survey, families, survey, try_device

_TITLES = {"camera": "Cameras", "board": "Serial ports", "usb": "USB"}


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
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
    add_json(parser)


def run(options: Namespace) -> int:
    """List what is plugged in, and what could be."""
    seen = survey()
    answers = _answers(seen) if options.test else {}
    if options.json:
        found = [asdict(device) | ({"answer": answers.get(device)} if options.test else {}) for device in seen.found]
        print_json({"found": found, "missing": [asdict(missing) for missing in seen.missing]})
        return 0
    for kind, title in _TITLES.items():
        print(title)
        devices = [device for device in seen.found if device.kind == kind]
        for device in devices:
            print(f"  {device.name}" + (f" ({device.detail})" if device.detail else ""))
            if device.kind == "camera" and device.family != VIRTUAL.key:
                print(f"    slopegate --camera {shlex.quote(str(device.address))}")
            for remark in (device.problem, answers.get(device, "")):
                if remark:
                    print(f"    {remark}")
        if not devices:
            print("  none")
    if seen.missing:
        print("Not looked at")
        for missing in seen.missing:
            print(f"  {missing.title}: {missing.sentence.removeprefix(missing.title + ': ')}")
    return 0


def _answers(seen: Survey) -> dict[Found, str]:
    testable = {family.key for family in families() if family.test is not None}
    return {device: _answer(device) for device in seen.found if device.family in testable}


def _answer(device: Found) -> str:
    try:
        return try_device(device)
    except Exception as error:  # the others are to answer
        return sentence_of(error, f"Testing {device.name}")
