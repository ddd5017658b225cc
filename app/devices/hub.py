"""Finds, tests, connects and remembers the devices of a window. Every call to a device is in another thread."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field
from PySide6.QtCore import QObject, Signal

from slopegate.app.session import preferences
from slopegate.app.session.letting_go import LettingGo
from slopegate.app.session.loading import Loader
from slopegate.core.rig.checks import InputError
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.families import Address, Family, Found
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.devices.survey import Survey, Surveyor, try_device
from slopegate.drivers.sync.board import Board, BoardStatus
from slopegate.drivers.sync.board_delay import BoardDelay
from slopegate.drivers.sync.boards import BoardChoice, dialect_of

FILE_NAME = "devices.json"
CLOSE_S = 1.0
"""How long the end of the program waits for a board."""

DelayOwner = Literal["camera", "board"]


class CameraMode(BaseModel):
    """The pixel format and rate chosen for a camera; None where nothing was chosen."""

    model_config = ConfigDict(extra="ignore", frozen=True, ser_json_inf_nan="constants")

    pixel_format: str | None = None
    rate_hz: float | None = Field(default=None, gt=0)
    """Infinite: as fast as the camera can."""


class DeviceChoices(BaseModel):
    """What is remembered of devices."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    camera: tuple[str, str] | None = None
    """Family and where."""
    camera_runs: bool = False
    """Whether the window was streaming from it when it was closed."""
    triggered: bool = True
    """Whether the projector's sync signal triggers the camera; else it runs by itself."""
    modes: dict[str, CameraMode] = Field(default_factory=dict)
    """The mode of every camera, by its address."""
    board: BoardChoice | None = None
    """None where no board is connected."""
    delay_by: DelayOwner = "camera"


class DeviceHub(QObject):
    """The devices of a window. Nothing here waits for one; `changed` tells of another choice or connection."""

    changed = Signal()
    surveyed = Signal(object)
    """A Survey."""
    tested = Signal(str, bool)
    """What a test found, and whether the device works."""

    def __init__(self, path: Path, known: Sequence[Family] | None = None, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._path, self._known = path, known
        self.choices, self.notice = preferences.load(path, DeviceChoices, "devices")
        self._surveyor = Surveyor(known)
        self._looker: Loader[Survey] = Loader(lambda _: None, self)
        self._tester: Loader[str] = Loader(lambda _: None, self)
        self._board: Board | None = None
        self._closing = LettingGo()
        self.running: Address | None = None
        """The camera that the window streams from."""
        self._looker.finished.connect(self.surveyed)
        self._tester.finished.connect(lambda sentence: self.tested.emit(sentence, True))
        self._tester.failed.connect(lambda sentence: self.tested.emit(sentence, False))
        if self.choices.board is not None:
            try:
                self._open(self.choices.board)
            except InputError as error:
                self.notice = f"The remembered board cannot be used: {error}."

    @property
    def looking(self) -> bool:
        """Whether a survey is under way."""
        return self._looker.busy

    @property
    def testing(self) -> bool:
        """Whether a test is under way."""
        return self._tester.busy

    @property
    def board_status(self) -> BoardStatus | None:
        """The state of the connected board; None without one."""
        return None if self._board is None else self._board.status

    @property
    def delay_owner(self) -> DelayOwner:
        """What makes the gate's delay: the board where it was chosen and can, else the camera."""
        choice = self.choices.board
        able = choice is not None and dialect_of(choice.dialect).limits is not None
        return self.choices.delay_by if able else "camera"

    def look(self) -> None:
        """Look what is plugged in; `surveyed` follows. Nothing happens while a look is under way."""
        if not self._looker.busy:
            surveyor = self._surveyor
            self._looker.start(lambda _: surveyor.look())

    def test(self, device: Found) -> None:
        """Open a device and see whether it works; `tested` follows."""
        known = self._known
        self._tester.start(lambda _: try_device(device, known))

    def stop_test(self) -> None:
        """Stop waiting for a test."""
        self._tester.cancel()

    def connect_board(self, choice: BoardChoice) -> None:
        """Use this board from now on and remember it. Raises InputError for an output or pulses that it has not."""
        choice.check()
        self._open(choice)
        self._keep(self.choices.model_copy(update={"board": choice}))

    def disconnect_board(self) -> None:
        """Close the board and forget it."""
        self._let_go()
        self._keep(self.choices.model_copy(update={"board": None, "delay_by": "camera"}))

    def set_delay_owner(self, owner: DelayOwner) -> None:
        """Choose what makes the gate's delay, from the next camera that is opened on."""
        self._keep(self.choices.model_copy(update={"delay_by": owner}))

    @property
    def remembered_camera(self) -> Address | None:
        """The camera that the window was streaming from when it was closed; None where it was a scene."""
        choices = self.choices
        return None if choices.camera is None or not choices.camera_runs else Address(*choices.camera)

    @property
    def last_camera(self) -> Address | None:
        """The camera that was connected last."""
        return None if self.choices.camera is None else Address(*self.choices.camera)

    def set_running(self, address: Address | None, forget: bool = True) -> None:
        """Say which camera the window streams from, None for none. `forget`: start without one the next time."""
        update: dict[str, object] = {}
        if address is not None:
            update = {"camera": (address.family, address.where), "camera_runs": True}
        elif forget:
            update = {"camera_runs": False}
        self.running = address
        self._keep(self.choices.model_copy(update=update))

    def way_to_open(self, address: Address) -> OpenOptions:
        """The options to open this camera with: the pixel format and the rate that were chosen for it."""
        mode = self.choices.modes.get(str(address), CameraMode())
        return OpenOptions(self.choices.triggered, mode.pixel_format, mode.rate_hz)

    def keep_mode(self, address: Address, opened: OpenOptions) -> None:
        """Remember the options that this camera was opened with."""
        mode = CameraMode(pixel_format=opened.pixel_format, rate_hz=opened.rate_hz)
        if mode != self.choices.modes.get(str(address), CameraMode()):
            self._save(self.choices.model_copy(update={"modes": {**self.choices.modes, str(address): mode}}))

    def set_triggered(self, wanted: bool) -> None:
        """Choose whether the projector triggers the camera."""
        self._keep(self.choices.model_copy(update={"triggered": wanted}))

    def way(self) -> tuple[bool, Board | None]:
        """Whether a camera that is opened now is triggered, and the board that makes its delay."""
        return self.choices.triggered, self._board if self.delay_owner == "board" else None

    def with_delay(self, camera: Camera, period_us: float) -> Camera:
        """The camera to stream from: the same, or one whose delay the board makes."""
        choice = self.choices.board
        if self.delay_owner == "camera" or self._board is None or choice is None or camera.info.limits is None:
            return camera
        return BoardDelay(camera, self._board, period_us, choice.pulse())

    def close(self) -> None:
        """Close everything. What hangs is left behind."""
        self._looker.close(0.0)
        self._tester.close(0.0)
        self._let_go()
        self._closing.wait(CLOSE_S)

    def _open(self, choice: BoardChoice) -> None:
        self._let_go()
        board = choice.board()
        if board.dialect.limits is not None and self.choices.delay_by == "camera":
            board.submit(choice.pulse())
        self._board = board
        board.start()

    def _let_go(self) -> None:
        board, self._board = self._board, None
        if board is not None:
            self._closing.begin(board.close, "the board")

    def _keep(self, choices: DeviceChoices) -> None:
        if choices != self.choices:
            self._save(choices)
        self.changed.emit()

    def _save(self, choices: DeviceChoices) -> None:
        self.choices = choices
        self.notice = preferences.save(self._path, choices)
