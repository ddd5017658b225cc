"""`slopegate devices`."""

from __future__ import annotations

import shlex
from argparse import Namespace
from dataclasses import asdict

from slopegate.app.commands.report import print_json
from slopegate.drivers.contract.families import Found
from slopegate.drivers.devices.catalog import VIRTUAL
from slopegate.drivers.devices.survey import Survey, families, survey, try_device

_TITLES = {"camera": "Cameras", "board": "Serial ports", "usb": "USB"}


def run_devices(options: Namespace) -> int:
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
    except Exception as error:  # a vendor's library may raise anything
        return str(error) or type(error).__name__
