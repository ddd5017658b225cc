"""The projector of a virtual camera's rig: what it shows lights the camera's scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.patterns import LIT
from slopegate.core.rig.rig import Rig
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.contract.projector import ProjectorError, ProjectorInfo, Showing, check_picture


class LitCamera(Protocol):
    """A camera whose scene a projector lights."""

    @property
    def info(self) -> CameraInfo:
        """Fixed facts."""
        ...

    @property
    def rig(self) -> Rig:
        """The rig that it is the camera of, as far as it is known."""
        ...

    def light_with(self, pattern: Singles | None) -> None:
        """Let the projector show this picture from the next frame on; None: everything lit."""
        ...


class VirtualProjector:
    """`drivers.contract.projector.Projector` for a scene: a picture's value v is v / 255 of the light, linear.

    What it shows is on the wall at once, and so certain as soon as it is shown: a frame that begins after that sees
    nothing else. After `stop` the scene is fully lit again, as it is without this projector. Methods may be called from
    any thread.
    """

    def __init__(self, camera: LitCamera, clock: Callable[[], float] = time.monotonic, turned: bool = False) -> None:
        """`clock`: the camera's own, by which it stamps its frames.

        turned: it shows every pattern turned by half a turn, so that rows of patterns count against its scan.
        """
        self._camera, self._clock, self._turned = camera, clock, turned
        projector = camera.rig.projector
        self._info = ProjectorInfo(f"The projector of {camera.info.name}", projector.raster, projector.period_us)
        self._patterns: tuple[Bytes, ...] = ()
        self._stopped = False

    @property
    def info(self) -> ProjectorInfo:
        """Fixed facts."""
        return self._info

    def load(self, patterns: Sequence[Bytes]) -> None:
        """Keep these pictures, not copies of them. Raises ProjectorError for another size, and for colours."""
        for number, picture in enumerate(patterns):
            check_picture(picture, self._info.raster, f"Pattern {number}")
        self._patterns = tuple(_grey(picture, f"Pattern {number}") for number, picture in enumerate(patterns))

    def show(self, index: int) -> Showing:
        """Light the scene with a loaded pattern."""
        if not 0 <= index < len(self._patterns):
            raise IndexError(f"pattern {index} was not loaded: there are {len(self._patterns)}")
        return self._light(index, np.asarray(self._patterns[index] / np.float32(LIT), np.float32))

    def black(self) -> Showing:
        """Everything off; ambient light stays."""
        raster = self._info.raster
        return self._light(-1, np.zeros((raster.height, raster.width), np.float32))

    def white(self) -> Showing:
        """Everything on."""
        return self._light(-1, None)

    def stop(self) -> None:
        """Show no pattern from now on."""
        self._stopped = True
        self._camera.light_with(None)

    def _light(self, index: int, picture: Singles | None) -> Showing:
        if self._stopped:
            raise ProjectorError(f"{self._info.name} was stopped: nothing can be shown on it any more")
        if picture is not None and self._turned:
            picture = np.ascontiguousarray(picture[::-1, ::-1])
        self._camera.light_with(picture)
        now_s = self._clock()
        return Showing(index, now_s, now_s)


def _grey(picture: Bytes, name: str) -> Bytes:
    """A picture as one plane. Raises ProjectorError when its channels differ."""
    if picture.ndim == 2:
        return picture
    if (picture != picture[:, :, :1]).any():
        raise ProjectorError(f"{name} has colours: the projector of a scene shows grey pictures alone")
    return np.ascontiguousarray(picture[:, :, 0])
