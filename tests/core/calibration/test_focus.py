"""The projector's blur, found from Gray code, against what it was rendered with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slopegate.core.calibration.chart_scene import held
from slopegate.core.calibration.focus import Focus, contrast, focus, typical
from slopegate.core.calibration.sight import look
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations import practice
from slopegate.drivers.calibrations.practice import PracticeRig, PracticeWorld
from slopegate.drivers.calibrations.taking import open_gate, take_pose
from small_practice import small_chart, small_rig


@pytest.mark.parametrize(("blur_px", "stripe_px"), [(0.0, 2.0), (0.4, 2.0), (1.0, 2.0), (1.0, 8.0), (3.0, 4.0)])
def test_what_is_left_of_stripes_is_that_of_a_blurred_square_wave(blur_px: float, stripe_px: float) -> None:
    fine = 200
    x = np.arange(int(2 * stripe_px * fine)) / fine
    wave = np.sign(np.sin(np.pi * x / stripe_px + 1e-12))
    spectrum = np.fft.rfft(wave) * np.exp(-2 * (np.pi * blur_px * np.fft.rfftfreq(x.size, 1 / fine)) ** 2)
    left = np.abs(np.fft.irfft(spectrum, x.size)).mean()
    assert float(contrast(np.array(blur_px), np.array(stripe_px))) == pytest.approx(left, abs=5e-3)


def focus_of(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> Focus:
    """What a pose of the small chart tells of a rig."""
    monkeypatch.setattr(practice, "hidden_rig", lambda *_: rig)
    made = PracticeRig(rig, small_chart(), 1, PracticeWorld())
    made.move(held(small_chart(), (0.0, 0.02, 0.9), 15.0, -10.0))
    made.camera.start()
    pose = take_pose("pose_01", made.projector, made.shots(), open_gate(rig, made.camera.info))
    assert pose is not None
    sight = look("pose_01", small_chart(), pose.order, pose.frames, pose.full_scale)
    found = focus(pose.order, pose.frames, sight.decoded, sight.blur_px)
    assert found is not None
    return found


def blurred(camera_px: float, projector_px: float) -> Rig:
    rig = small_rig()
    return replace(
        rig,
        camera=replace(rig.camera, blur_px=camera_px),
        projector=replace(rig.projector, blur_px=projector_px),
    )


@pytest.mark.parametrize(
    ("camera_px", "projector_px"), [(0.0, 0.5), (0.0, 1.0), (0.0, 2.0), (0.5, 0.5), (0.5, 0.8), (1.0, 1.0), (0.8, 1.6)]
)
def test_the_blur_of_the_projector_is_found(
    camera_px: float, projector_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = focus_of(blurred(camera_px, projector_px), monkeypatch)
    assert found.blur_px == pytest.approx((projector_px, projector_px), abs=0.1)
    assert found.mean_px == pytest.approx(projector_px, abs=0.1)
    told = found.blur_map[np.isfinite(found.blur_map)]
    assert told.size > 10
    np.testing.assert_allclose(told, projector_px, atol=0.25)


def test_a_sharp_projector_is_sharp_and_a_larger_blur_of_the_camera_makes_it_uncertain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert focus_of(blurred(0.0, 0.0), monkeypatch).mean_px < 0.3
    veiled = focus_of(blurred(1.5, 0.6), monkeypatch)
    assert abs(veiled.mean_px - 0.6) < 3 * veiled.standard_error
    assert veiled.standard_error > 0.05


def test_several_views_are_one_figure_and_its_spread() -> None:
    views = [Focus((blur, blur), (0.01, 0.01), (0.2, 0.2), np.full((2, 6, 8), 0.8)) for blur in (0.78, 0.8, 0.82, 3.0)]
    views[1].blur_map[:, 0] = np.nan
    for view in views:
        view.blur_map[:, 5, 7] = np.nan
    found = typical(views)
    assert found.blur_px == pytest.approx(0.81)
    assert 0.007 < found.standard_error < 0.1
    assert np.isnan(found.blur_map[5, 7])
    np.testing.assert_allclose(found.blur_map[:5], 0.8)
    assert found.sharpest_px == found.softest_px == pytest.approx(0.8)
