"""Webcams, video files and folders of images through OpenCV, as plain cameras without a gate."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Final, Protocol

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.device_camera import Arrival, Device, DeviceCamera
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, Modes, OpenOptions, PixelFormat

PICTURES: Final = {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".tif", ".tiff", ".webp"}
FILMS: Final = {".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".webm", ".wmv"}
USUAL_RATE_HZ: Final = 25.0
RECORDING: Final = "recording.json"
"""What tells a recording at one gate (`captures.film`), whose files are stacks of many frames."""
RAW_GREY: Final = {int.from_bytes(code, "little") for code in (b"Y800", b"Y1\x00\x10")}
"""FFmpeg's codes of 8-bit and 16-bit grey, which OpenCV would otherwise turn into 8-bit colour."""

Image = Bytes | Counts
NO_GATE: Final = Ability("A video source has no shutter that could be timed: there is no gate.")
PLAIN: Final = Abilities(NO_GATE, NO_GATE, NO_GATE, NO_GATE, Ability("A video source always gives whole pictures."))


class Pictures(Protocol):
    """A source of images (H, W) uint8 or uint16, one after another."""

    rate_hz: float | None
    """None: live, it comes at its own pace."""

    def next(self) -> Image | None:
        """The next image; None at the end."""
        ...

    def rewind(self) -> None:
        """Back to the first image."""
        ...

    def close(self) -> None:
        """Release the file or camera."""
        ...


class Folder:
    """The pictures of a folder in the order of their names, with numbers in them counted as numbers."""

    def __init__(self, path: Path) -> None:
        """Raises CameraError for a folder without pictures."""
        if (path / RECORDING).exists():
            raise CameraError(f"{path} is a recording at one gate, not a folder of pictures: open it as a scene")
        found = [child for child in path.iterdir() if child.suffix.lower() in PICTURES and child.is_file()]
        if not found:
            raise CameraError(f"{path} holds no pictures ({' '.join(sorted(PICTURES))})")
        self._paths = sorted(found, key=lambda child: _natural(child.name))
        self._index = 0
        self.rate_hz: float | None = USUAL_RATE_HZ

    def next(self) -> Image | None:
        """The next picture; raises CameraError naming the file that cannot be read."""
        if self._index == len(self._paths):
            return None
        path = self._paths[self._index]
        self._index += 1
        try:
            data = np.fromfile(path, np.uint8)
        except OSError as error:
            raise CameraError(f"{path} cannot be read ({error.strerror or error})") from None
        image = cv2.imdecode(data, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE) if data.size else None
        if image is None or image.dtype not in (np.uint8, np.uint16):
            raise CameraError(f"{path} is no picture of 8 or 16 bits a pixel")
        return image  # type: ignore[return-value]

    def rewind(self) -> None:
        """Back to the first picture."""
        self._index = 0

    def close(self) -> None:
        """Nothing to do: no file is held open."""


class VideoSource:
    """A video file, network stream or webcam."""

    def __init__(self, source: str | int, name: str, live: bool) -> None:
        """Raises CameraError when OpenCV cannot open it."""
        self._capture = cv2.VideoCapture(source) if isinstance(source, int) else _open_file(source)
        self._name = name
        if not self._capture.isOpened():
            kind = "camera, or it is in use by another program" if live else "video that OpenCV can play"
            raise CameraError(f"{name} is no {kind}")
        if int(self._capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) in RAW_GREY:
            self._capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        rate_hz = self._capture.get(cv2.CAP_PROP_FPS)
        self.rate_hz = None if live else rate_hz if 0 < rate_hz <= 1000 else USUAL_RATE_HZ

    def next(self) -> Image | None:
        """The next image, colours as luminance; None at the end of a file, CameraGoneError for a lost camera."""
        good, image = self._capture.read()
        if not good or image is None:
            if self.rate_hz is None:
                raise CameraGoneError(f"{self._name} sends no pictures any more")
            return None
        if image.ndim == 3:
            code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
            image = image[:, :, 0] if image.shape[2] == 1 else cv2.cvtColor(image, code)
        return image  # type: ignore[return-value]

    def rewind(self) -> None:
        """Back to the first image."""
        self._capture.set(cv2.CAP_PROP_POS_FRAMES, 0)

    def close(self) -> None:
        """Let the file or the camera go."""
        self._capture.release()


class VideoDevice(Device):
    """Plays pictures one after another; those of files over and over."""

    def __init__(self, pictures: Pictures, name: str, rate_hz: float | None = None) -> None:
        """`rate_hz` overrides a file's own; raises CameraError when there is not a single picture."""
        self._pictures = pictures
        self._rate_hz = rate_hz if rate_hz is not None and pictures.rate_hz is not None else pictures.rate_hz
        first = pictures.next()
        if first is None:
            raise CameraError(f"{name} holds no picture that can be read")
        deep = first.dtype == np.uint16
        form: PixelFormat = "mono16" if deep else "mono8"
        size = (first.shape[1], first.shape[0])
        modes = Modes(replayed=self._rate_hz is not None)
        self._info = CameraInfo(name, *size, form, 65535 if deep else 255, 0.0, None, PLAIN, modes)
        self._waiting: Image | None = first
        self._number = 0
        self._due_s = 0.0

    @property
    def info(self) -> CameraInfo:
        """Fixed facts."""
        return self._info

    def start(self) -> None:
        """Begin to play, from where it was stopped."""
        self._due_s = time.monotonic()

    def stop(self) -> None:
        """Nothing to do: pictures come only when they are fetched."""

    def fetch(self, buffer: Counts, timeout_s: float) -> Arrival | None:
        """The next picture at its time; a webcam is waited for as long as it takes."""
        if self._rate_hz is not None and not self._await_turn(self._rate_hz, timeout_s):
            return None
        image = self._waiting if self._waiting is not None else self._next()
        self._waiting = None
        if image.shape != buffer.shape or (image.dtype == np.uint16) != (self.info.max_count > 255):
            kept = f"{self.info.width} x {self.info.height} {self.info.pixel_format}"
            raise CameraError(
                f"{self.info.name} changes from {kept} to {image.shape[1]} x {image.shape[0]} {image.dtype}"
            )
        buffer[:] = image
        self._number += 1
        return Arrival(self._number)

    def check(self) -> None:
        """Nothing to do: `fetch` raises for a lost camera."""

    def close(self) -> None:
        """Let the source go."""
        self._pictures.close()

    def _next(self) -> Image:
        image = self._pictures.next()
        if image is None:
            self._pictures.rewind()
            image = self._pictures.next()
        if image is None:
            raise CameraError(f"{self.info.name} cannot be read from its beginning again")
        return image

    def _await_turn(self, rate_hz: float, timeout_s: float) -> bool:
        wait_s = self._due_s - time.monotonic()
        if wait_s > 0:
            time.sleep(min(wait_s, timeout_s))
        if wait_s > timeout_s:
            return False
        # A player that fell behind starts a new beat instead of rushing to catch up.
        self._due_s = max(self._due_s + 1 / rate_hz, time.monotonic())
        return True


def open_video(where: str, rig: Rig, options: OpenOptions | None = None) -> DeviceCamera:
    """A webcam (its number or /dev/videoN), a video file, a folder of pictures or a stream's address (scheme://...).

    Raises CameraError when it cannot be opened. Of the options, `rate_hz` sets the pace of a file or folder.
    """
    chosen = options or OpenOptions()
    return DeviceCamera(lambda: _connect(where, chosen.rate_hz))


def is_pictures(path: Path) -> bool:
    """Whether it is a video file by its name, or a folder with pictures in it."""
    if path.is_dir():
        return any(child.suffix.lower() in PICTURES for child in path.iterdir())
    return path.suffix.lower() in FILMS and path.is_file()


def list_videos(folder: Path = Path("/sys/class/video4linux")) -> list[tuple[str, str]]:
    """Address and name of every webcam that Linux knows; elsewhere none, though they can be opened by number."""
    found = []
    nodes = folder.glob("video*") if folder.is_dir() else ()
    for node in sorted(nodes, key=lambda node: _natural(node.name)):
        # further nodes of one camera carry its metadata, not pictures
        if _line(node / "index") in ("", "0"):
            found.append((f"/dev/{node.name}", _line(node / "name") or node.name))
    return found


def _connect(source: str, rate_hz: float | None) -> VideoDevice:
    webcam = re.fullmatch(r"(?:/dev/video)?(\d+)", source)
    pictures: Pictures
    try:
        if webcam is not None:
            name = f"Camera {webcam[1]}"
            pictures = VideoSource(int(webcam[1]), name, live=True)
        elif "://" in source:
            name = source
            pictures = VideoSource(source, name, live=True)
        else:
            path = Path(source)
            name = path.name or source
            if not path.exists():
                raise CameraError(f"{source} does not exist")
            if not path.is_dir() and not path.is_file():  # a pipe would be waited for without end
                raise CameraError(f"{source} is not an ordinary file")
            pictures = Folder(path) if path.is_dir() else VideoSource(source, source, live=False)
    except OSError as error:
        raise CameraError(f"{source} cannot be read ({error.strerror or error})") from None
    try:
        return VideoDevice(pictures, name, rate_hz)
    except CameraError:
        pictures.close()
        raise


def _open_file(source: str) -> cv2.VideoCapture:
    return cv2.VideoCapture(source, cv2.CAP_FFMPEG)


def _natural(name: str) -> list[tuple[str, int]]:
    """A key that sorts frame2 before frame10."""
    return [(text.lower(), int(digits or 0)) for text, digits in re.findall(r"(\D*)(\d*)", name)]


def _line(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
