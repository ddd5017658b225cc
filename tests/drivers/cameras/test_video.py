from __future__ import annotations

import os
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slopegate.drivers.cameras.video import list_videos, open_video
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.files.rig_files import load_rig

RIG = load_rig(None)
FAST = OpenOptions(rate_hz=500.0)


def frames(camera: Camera, count: int) -> list[NDArray[np.uint16]]:
    camera.start()
    images = []
    end = time.monotonic() + 100.0
    while len(images) < count:
        image = np.zeros((camera.info.height, camera.info.width), np.uint16)
        if camera.read(image, 0.5) is not None:
            images.append(image)
        assert time.monotonic() < end
    camera.close()
    return images


def write_video(path: Path, codec: str, images: list[NDArray[np.generic]]) -> None:
    deep, colour = images[0].dtype == np.uint16, images[0].ndim == 3
    how = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U if deep else cv2.CV_8U, cv2.VIDEOWRITER_PROP_IS_COLOR, int(colour)]
    size = (images[0].shape[1], images[0].shape[0])
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), 20.0, size, how)
    assert writer.isOpened()
    for image in images:
        writer.write(image)
    writer.release()


def random_images(dtype: type, *shape: int) -> list[NDArray[np.generic]]:
    rng = np.random.default_rng(5)
    return [rng.integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype) for _ in range(3)]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("container", ["folder of png", "folder of tif", "ffv1 video"])
def test_every_grey_value_arrives_and_the_end_is_followed_by_the_beginning(
    tmp_path: Path, dtype: type, container: str
) -> None:
    images = random_images(dtype, 30, 40)
    where = tmp_path / "film.mkv"
    if container == "ffv1 video":
        write_video(where, "FFV1", images)
    else:
        where = tmp_path
        for k, image in enumerate(images):
            cv2.imwrite(str(tmp_path / f"{k}.{container[-3:]}"), image)
    camera = open_video(str(where), RIG, FAST)
    assert camera.info.pixel_format == ("mono16" if dtype is np.uint16 else "mono8")
    assert camera.info.limits is None
    for got, sent in zip(frames(camera, 5), [*images, *images[:2]], strict=True):
        np.testing.assert_array_equal(got, sent)


@pytest.mark.parametrize("name", ["c.png", "c.mkv"])
def test_colours_become_luminance(tmp_path: Path, name: str) -> None:
    image = np.zeros((30, 40, 3), np.uint8)
    image[:, :10], image[:, 10:20], image[:, 20:30] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    if name.endswith("png"):
        cv2.imwrite(str(tmp_path / name), image)
    else:
        write_video(tmp_path / name, "FFV1", [image])
    camera = open_video(str(tmp_path if name.endswith("png") else tmp_path / name), RIG, FAST)
    (got,) = frames(camera, 1)
    np.testing.assert_allclose(got[15, [5, 15, 25, 35]], [0.114 * 255, 0.587 * 255, 0.299 * 255, 0], atol=1)


def test_numbers_in_names_count_as_numbers(tmp_path: Path) -> None:
    for k in (10, 2, 1, 0):
        cv2.imwrite(str(tmp_path / f"frame{k}.png"), np.full((4, 6), k, np.uint8))
    (tmp_path / "frame3.txt").write_text("no picture")
    assert [image[0, 0] for image in frames(open_video(str(tmp_path), RIG, FAST), 4)] == [0, 1, 2, 10]


def test_a_film_keeps_its_own_pace(tmp_path: Path) -> None:
    write_video(tmp_path / "film.mkv", "FFV1", random_images(np.uint8, 30, 40))
    started = time.monotonic()
    frames(open_video(str(tmp_path / "film.mkv"), RIG), 9)
    assert time.monotonic() - started > 8 / 20.0 - 0.02


def test_a_picture_of_another_size_is_told(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((4, 6), np.uint8))
    cv2.imwrite(str(tmp_path / "2.png"), np.zeros((4, 7), np.uint8))
    cv2.imwrite(str(tmp_path / "3.png"), np.zeros((4, 6), np.uint16))
    for _ in range(2):
        with pytest.raises(CameraError, match="changes from 6 x 4 mono8"):
            frames(open_video(str(tmp_path), RIG, FAST), 3)
        (tmp_path / "2.png").unlink(missing_ok=True)


def test_a_damaged_picture_is_named(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((4, 6), np.uint8))
    (tmp_path / "2.png").write_bytes((tmp_path / "1.png").read_bytes()[:20])
    with pytest.raises(CameraError, match=r"2\.png is no picture"):
        frames(open_video(str(tmp_path), RIG, FAST), 2)


def test_a_film_cut_short_plays_what_there_is(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    noise = np.random.default_rng(1).integers(0, 60, (96, 128, 3), np.uint8)
    write_video(path, "MJPG", [noise + np.uint8(15 * k) for k in range(10)])
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    levels = [int(image.mean()) for image in frames(open_video(str(path), RIG, FAST), 15)]
    begins = [k for k in range(15) if abs(levels[k] - levels[0]) < 5]
    assert 4 <= begins[1] <= 8, "it began again after what there was"


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("missing.avi", "does not exist"),
        ("empty", "holds no pictures"),
        ("text.avi", "no video that OpenCV can play"),
        ("nothing.avi", "no video that OpenCV can play"),
        ("987", "Camera 987 is no camera"),
        ("/dev/video987", "Camera 987 is no camera"),
    ],
)
def test_what_cannot_be_opened_is_told(tmp_path: Path, source: str, complaint: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.avi").write_text("This is not a film. " * 100)
    (tmp_path / "nothing.avi").touch()
    with pytest.raises(CameraError, match=complaint):
        open_video(source if source.endswith("987") else str(tmp_path / source), RIG)


@pytest.mark.skipif(os.name == "nt", reason="there are no pipes in folders")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mp4")
    with pytest.raises(CameraError, match=r"pipe\.mp4 is not an ordinary file"):
        open_video(str(tmp_path / "pipe.mp4"), RIG)


def test_webcams_are_listed_by_name_without_their_metadata_nodes(tmp_path: Path) -> None:
    for number, name, index in ((10, "Late", 0), (0, "Integrated Camera", 0), (1, "Integrated Camera", 1)):
        node = tmp_path / f"video{number}"
        node.mkdir()
        (node / "name").write_text(name + "\n")
        (node / "index").write_text(f"{index}\n")
    assert list_videos(tmp_path) == [("/dev/video0", "Integrated Camera"), ("/dev/video10", "Late")]
    assert list_videos(tmp_path / "none") == []
