"""Every command: a name, and the line that says what it does. A new one is a file beside this one and a line here."""

from __future__ import annotations

from argparse import Action, ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from slopegate.app.commands import window
from slopegate.app.commands.report import CommandError

COMMANDS = {
    "slab": "where the slab of given settings lies",
    "plan": "the settings that give a wanted slab",
    "render": "one gated image of a scene, into files",
    "bake": "prepare the indirect light of a scene for all gates",
    "capture": "record a scene, or what a camera sees, slice by slice into a folder",
    "record": "frames at one gate, a video or a time lapse, into a folder",
    "export": "a capture, or light transport, in the formats of other programs",
    "transport": "light transport slice by slice: plan it, acquire it, show what a folder holds",
    "relight": "acquired light transport under other light, slice by slice",
    "composite": "the foreground of acquired light transport before a new background",
    "search": "the gate that shows a target, found from images alone",
    "mask": "the gate that keeps or hides a region of the image",
    "depth": "depth of every pixel, measured by moving the gate",
    "fog": "how like the fog-free scene a gate's image is, at every exposure",
    "calibrate": "lenses and pose of a rig from pictures of a chart under Gray code",
    "calibrate-timing": "when projector and camera scan, from gated pictures of a plane",
    "chart": "a chart to calibrate with, for a printer",
    "mtf": "sharpness of an imaging system from a picture of a slanted edge",
    "bench": "run time against error of every way to make a gated frame",
    "scenes": "list the scenes that ship with the program",
    "demo": "a tour of the window that leaves pictures",
    "devices": "what is plugged in, and what could be",
    "doctor": "check this computer and say what to do",
}
"""Each is the module of this name, _ for -, with `arguments(parser)` and `run(options) -> exit code`."""

_ABOUT = """\
Slope disparity gating: a projector that scans its rows and a rolling-shutter camera below it record only light from a
slab of space. Three numbers set the slab: the pixel clock its tilt, the delay its distance, the exposure its thickness.

Without a command the window opens.
"""

_EXAMPLES = """\
examples:
  slopegate                                      open the window
  slopegate --camera video:0 --free-running      open it on the first webcam
  slopegate plan --tilt-deg 15 --distance-m 1.05 --thickness-m 0.1
                                                 which settings light a slab leaning back by 15 degrees, 10 cm thick?
  slopegate slab --clock-mhz 78 --delay-us 2028 --exposure-us 400
                                                 where is the slab of these settings?
  slopegate scenes                               what is there to look at?

'slopegate COMMAND --help' explains every number. Errors are one sentence on standard error, with exit code 2.
A bug of the program is one sentence with exit code 1; the log, which 'slopegate doctor' names, has the details.
"""


class SentenceParser(ArgumentParser):
    """Options are never abbreviated, and refusals are one sentence."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=RawDescriptionHelpFormatter, **keywords)

    def error(self, message: str) -> NoReturn:
        raise CommandError(f"{message} (see '{self.prog} --help')")


class _ShowVersion(Action):
    """`--version`; looking the number up takes long, so only who asks for it waits."""

    def __call__(self, parser: ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        print(f"slopegate {version('slopegate')}")
        parser.exit()


class _CommandParser(SentenceParser):
    """A command's parser, which imports the command when it is asked to parse: the others are not waited for."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self._module = self.prog.rsplit(" ", 1)[-1].replace("-", "_")

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Namespace | None = None
    ) -> tuple[Namespace, list[str]]:
        command = import_module(f"slopegate.app.commands.{self._module}")
        command.arguments(self)
        self.set_defaults(run=command.run)
        options, rest = super().parse_known_args(args, namespace)
        if rest:  # told here, so that the sentence names this command's help
            self.error(f"unrecognized arguments: {' '.join(rest)}")
        return options, rest


def command_parser() -> ArgumentParser:
    """The parser of `slopegate`; it raises CommandError and sets `run`, a function from options to exit code."""
    parser = SentenceParser(prog="slopegate", description=_ABOUT, epilog=_EXAMPLES)
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the program's version number and exit")
    parser.add_argument(
        "--debug", action="store_true", help="show the details of a bug, and what else is logged, on standard error"
    )
    window.arguments(parser)
    parser.set_defaults(run=window.run)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", parser_class=_CommandParser)
    for name, what in COMMANDS.items():
        commands.add_parser(name, help=what)
    return parser
