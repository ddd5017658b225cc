"""`slopegate capture --board`: a sync board or delay generator makes the gate's delay in place of the camera."""

from __future__ import annotations

from argparse import Namespace
from contextlib import ExitStack

from pydantic import ValidationError
from slopegate.app.commands.report import CommandError
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.files.errors import first_fault
from slopegate.drivers.sync.board_choice import BoardChoice
from slopegate.drivers.sync.board_delay import BoardDelay
from slopegate.drivers.sync.boards import dialect_of, who_answers
from slopegate.drivers.sync.dialect import BoardError
from slopegate.drivers.sync.serial_port import PortError

FAMILY = "serial:"


def with_board(camera: Camera, options: Namespace, period_us: float, wait_s: float, held: ExitStack) -> Camera:
    """The camera with its delay made by the board named, which has answered; `held` lets the board go.

    Raises InputError and CommandError for a board that does not answer or cannot do this.
    """
    choice = _choice(options)
    choice.check()
    board = choice.board()
    delayed = BoardDelay(camera, board, period_us, choice.pulse())
    board.start()
    held.callback(board.close)
    if not board.wait_ready(wait_s):
        raise CommandError(board.status.sentence or f"the board at {choice.where} has not answered for {wait_s:g} s")
    return delayed


def _choice(options: Namespace) -> BoardChoice:
    """The board by its port and the numbers given; its kind and speed by asking, where they are not given."""
    where, given = options.board.removeprefix(FAMILY), dict(options.board_settings or {})
    if "dialect" not in given:
        try:
            _, dialect, baud = who_answers(where)
        except (BoardError, PortError) as error:
            raise CommandError(f"{options.board} did not open: {error}") from None
        given = {"dialect": dialect.key, "baud": str(baud)} | given
    elif "baud" not in given:
        given["baud"] = str(dialect_of(given["dialect"]).bauds[0])
    try:
        return BoardChoice.model_validate({"where": where} | given)
    except ValidationError as error:
        fault = first_fault(error)
        name, rule = ".".join(map(str, fault["loc"])), fault["msg"].replace("Input should", "it should")
        raise CommandError(f"--board-settings: {name} is {fault['input']!r}: {rule}") from None
