"""A capture opened in the window: the live path, the pictures, one pixel in every slice, and export."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from scripted_camera import USERS, Scripted
from slopegate.app.panels import capture_view as pictures
from slopegate.app.panels.capture_view import FILM, CaptureView
from slopegate.app.session.loading import Progress
from slopegate.app.session.session import Session
from slopegate.app.session.source import Options, open_source
from slopegate.app.window.window import Window
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import occupied_times, tile_times
from slopegate.core.measure.stack import StackSummary
from slopegate.drivers.captures.film import create_film, make_film_manifest
from slopegate.drivers.captures.film_recorder import FilmLimits, FilmRecorder
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.captures.storage import create_capture, make_manifest, open_capture
from slopegate.drivers.stream.stream import Stream
from small_capture import RIG
from small_window import make_desk, make_source, small_rig

COUNT = 8
QUICK = Options(noise=False, rate_hz=200.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture of the small scene: a card at 1 m before a wall at 2 m."""
    rig = small_rig()
    source = make_source(rig)
    times = occupied_times(rig, upright_line_time(rig), source.buffers.projector_row)
    assert times is not None
    slices = tile_times(rig, upright_line_time(rig), *times, COUNT)
    path = tmp_path_factory.mktemp("view") / "capture"
    folder = create_capture(path, make_manifest("Small", rig, source.camera.info, slices, 1, False, False))
    stream = Stream(source.camera)
    recorder = Recorder(stream, folder)
    recorder.start()
    with stream:
        assert recorder.wait(60)
    return path


@pytest.fixture
def session(recorded: Path) -> Iterator[Session]:
    made = Session()
    made.adopt(open_source(recorded, small_rig(), QUICK, Progress(lambda share, text: None)))
    yield made
    made.close()


@pytest.fixture
def view(qtbot: QtBot, session: Session) -> Iterator[CaptureView]:
    made = CaptureView(make_desk(session))
    qtbot.addWidget(made)
    made.resize(540, 270)
    with qtbot.waitExposed(made):
        made.show()
    yield made
    made.close()


def test_a_capture_has_the_format_it_was_taken_with_and_the_scene_after_it_the_one_that_was_chosen(
    recorded: Path,
) -> None:
    chosen = replace(QUICK, pixel_format="bayer_rg12")
    source = open_source(recorded, small_rig(), chosen, Progress(lambda share, text: None))
    modes, can = source.camera.info.modes, source.camera.info.can
    assert (modes.format, bool(can.choose_format), modes.rate_hz) == ("mono12", False, 200.0)
    assert "taken with" in can.choose_format.missing
    assert source.options == chosen
    source.close()


def test_a_capture_that_was_cut_short_says_so_when_it_is_opened(recorded: Path, tmp_path: Path) -> None:
    whole = open_source(recorded, small_rig(), QUICK, Progress(lambda share, text: None))
    cut = shutil.copytree(recorded, tmp_path / "cut")
    (cut / "slice_0001.tif").unlink()
    source = open_source(cut, small_rig(), QUICK, Progress(lambda share, text: None))
    assert (whole.remark, source.remark) == ("", f"cut is unfinished: 1 of {COUNT} slices are missing")
    whole.close()
    source.close()


def camera_of(session: Session) -> PlaybackCamera:
    source = session.source
    assert source is not None
    assert isinstance(source.camera, PlaybackCamera)
    return source.camera


def test_the_slider_goes_through_the_slices_and_the_live_image_follows(
    qtbot: QtBot, view: CaptureView, session: Session
) -> None:
    camera = camera_of(session)
    view.slider.setFocus()
    qtbot.keyClick(view.slider, Qt.Key.Key_Home)
    assert view.place == COUNT - 1
    for step in range(COUNT):
        if step:
            qtbot.keyClick(view.slider, Qt.Key.Key_Right)
        place = COUNT - 1 - step
        assert view.place == place
        record = camera.records[place]
        assert record.index == step, "nearest first"

        def arrived(wanted: int = place) -> bool:
            frame = session.newest()
            if frame is None or frame.stamp.applied != camera.settings[wanted]:
                return False
            np.testing.assert_array_equal(frame.image, camera.folder.total(camera.records[wanted].index or 0))
            return True

        qtbot.waitUntil(arrived)
        qtbot.waitUntil(lambda shown=step: view.text.text().startswith(f"Slice {shown + 1} of {COUNT} at"))


def test_a_click_shows_the_pixels_light_in_every_slice(qtbot: QtBot, view: CaptureView, session: Session) -> None:
    camera = camera_of(session)
    for column, row, distance in ((160, 125, 1.0), (40, 60, 2.0)):
        where = view.picture.at(column + 0.5, row + 0.5).toPoint()
        qtbot.mouseClick(view.picture, Qt.MouseButton.LeftButton, pos=where)
        marked = view.picture.marked
        assert marked is not None
        assert abs(marked[0] - column) <= 2
        assert abs(marked[1] - row) <= 2
        black = camera.info.black_count
        expected = [
            float(camera.folder.total(item.index or 0)[marked[1], marked[0]]) - black for item in camera.records
        ]
        np.testing.assert_allclose(view.plot.light, expected)
        lit = [place for place, light in enumerate(expected) if light > 100]
        assert len(lit) == 1
        record = camera.records[lit[0]]
        assert record.slab.near_m is not None
        # depths are from the camera, slabs are read on the axis of an upright gate
        assert record.slab.near_m - 0.05 < distance
        assert f"column {marked[0]}, row {marked[1]}: " in view.text.text()
        shown = float(view.text.text().rsplit(": ", 1)[1].removesuffix(" m"))
        assert shown == pytest.approx(distance, rel=0.1)


def test_arrow_keys_move_the_mark(qtbot: QtBot, view: CaptureView) -> None:
    view.picture.setFocus()
    qtbot.keyClick(view.picture, Qt.Key.Key_Right)
    assert view.picture.marked == (161, 120)
    qtbot.keyClick(view.picture, Qt.Key.Key_Up, Qt.KeyboardModifier.ShiftModifier)
    assert view.picture.marked == (161, 110)
    for _ in range(20):
        qtbot.keyClick(view.picture, Qt.Key.Key_Up, Qt.KeyboardModifier.ShiftModifier)
    assert view.picture.marked == (161, 0)
    assert view.plot.light.size == COUNT


def test_sum_overlay_and_depth(qtbot: QtBot, view: CaptureView, session: Session) -> None:
    summary = camera_of(session).summary
    assert summary is not None
    seen = []
    for name in ("Sum of all", "Coloured overlay", "Depth"):
        view.mode.setFocus()
        qtbot.keyClick(view.mode, Qt.Key.Key_Down)
        assert view.mode.currentText() == name
        assert not view.slider.isEnabled()
        grabbed = view.picture.grab().toImage()
        at_card, at_wall = (view.picture.at(*where).toPoint() for where in ((160, 130), (40, 60)))
        seen.append((grabbed.pixelColor(at_card), grabbed.pixelColor(at_wall)))
    (card, wall), (card_colour, wall_colour), (near, far) = seen
    assert card.lightness() > wall.lightness() > 20, "light falls off with distance"
    assert card.red() == card.blue()
    assert card_colour.red() > card_colour.blue()
    assert wall_colour.blue() > wall_colour.red()
    assert near.red() > near.blue()
    assert far.blue() > far.red()
    assert view.text.text().startswith("Red 1.")


def test_the_plots_and_gates_of_a_capture(session: Session) -> None:
    source = session.source
    assert source is not None
    assert source.scene.name == "Small (captured)"
    assert [preset.name.split(" at ")[0] for preset in source.presets] == [f"Slice {n + 1}" for n in range(COUNT)]
    truth = make_source(small_rig()).buffers
    known = source.buffers.inverse_depth > 0
    lit = truth.projector_row >= 0
    assert (known == lit).mean() > 0.98
    assert np.abs(source.buffers.inverse_depth - truth.inverse_depth)[known & lit].max() < 0.15


def test_other_sources_have_nothing_to_look_at(qtbot: QtBot, view: CaptureView, session: Session) -> None:
    assert view.picture.isVisible()
    session.adopt(make_source(small_rig()))
    assert not view.picture.isVisible()
    assert view.note.isVisible()
    assert "Open the folder of a capture" in view.note.text()


def test_export_by_mouse(
    qtbot: QtBot, view: CaptureView, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "slices.ome.tif"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(out), ""))
    qtbot.mouseClick(view.export, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: view.text.text() == f"{COUNT} slices are in {out}")
    planes = tifffile.imread(out)
    folder = camera_of(session).folder
    for index in range(COUNT):
        np.testing.assert_array_equal(planes[index], folder.total(index))
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(tmp_path / "slices.png"), ""))
    qtbot.mouseClick(view.export, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: "slices.png has the suffix '.png'" in view.text.text())


def test_a_damaged_slice_is_said(qtbot: QtBot, recorded: Path, tmp_path: Path) -> None:
    for path in recorded.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    session = Session()
    session.adopt(open_source(tmp_path, small_rig(), QUICK, Progress(lambda share, text: None)))
    view = CaptureView(make_desk(session))
    qtbot.addWidget(view)
    view.show()
    broken = tmp_path / "slice_0003.tif"
    data = bytearray(broken.read_bytes())
    data[-1] ^= 255
    broken.write_bytes(data)
    view.slider.setValue(3)
    qtbot.waitUntil(lambda: "slice_0003.tif is damaged" in view.text.text())
    view.close()
    session.close()


def test_it_opens_in_the_window(qtbot: QtBot, window: Window, recorded: Path) -> None:
    with qtbot.waitSignal(window.ready):
        window.open(recorded)
    source = window.session.source
    assert source is not None
    assert isinstance(source.camera, PlaybackCamera)
    assert window.windowTitle().startswith("Small (captured)")
    frame = window.live.frame
    assert frame is not None
    shown = open_capture(recorded).total(0)
    np.testing.assert_array_equal(frame.image, shown)
    window.session.use(source.presets[4])
    camera = camera_of(window.session)
    qtbot.waitUntil(
        lambda: window.live.frame is not None and window.live.frame.stamp.applied == source.presets[4].settings
    )
    assert camera.nearest(source.presets[4].settings) == COUNT - 1 - 4


def test_a_recording_leaves_the_viewer_to_the_capture_after_it(
    qtbot: QtBot, window: Window, recorded: Path, tmp_path: Path
) -> None:
    camera = Scripted()
    manifest = make_film_manifest("Small", RIG, camera.info, USERS)  # type: ignore[arg-type]
    with Stream(camera) as stream:
        recorder = FilmRecorder(stream, create_film(tmp_path / "film", manifest), FilmLimits(frames=3))
        recorder.start()
        assert recorder.wait(60)
    window.docks.bring("depth")
    viewer = window.docks.docks["capture"]
    with qtbot.waitSignal(window.ready):
        window.open(tmp_path / "film")
    qtbot.waitUntil(lambda: isinstance(viewer.panel, CaptureView) and viewer.panel.note.text() == FILM)
    with qtbot.waitSignal(window.ready):
        window.open(recorded)
    assert viewer.front
    assert isinstance(viewer.panel, CaptureView)
    assert viewer.panel.note.isHidden()


def test_pictures_of_little_and_nothing() -> None:
    dark = np.zeros((6, 8), np.float32)
    nothing = StackSummary(dark, np.zeros((6, 8, 3), np.float32), dark - 1, dark)
    assert pictures.depth_range(nothing) == (0.0, 0.0)
    assert (pictures.depth_picture(nothing, 800) == pictures.UNKNOWN).all()
    assert (pictures.overlay_picture(nothing, 1.0, 4) == 0).all()
    one = StackSummary(dark, np.zeros((6, 8, 3), np.float32), dark, dark + np.float32(0.5))
    assert pictures.depth_range(one) == (2.0, 2.0)
    assert pictures.depth_picture(one, 800).shape == (6, 8, 3)
