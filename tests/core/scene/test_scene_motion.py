import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from slopegate.core.scene.scene import KeyFrames, Scene, Sphere
from slopegate.core.scene.shapes import turn

SAMPLE = np.array([0.3, -0.2, 1.4])


def motion(loop: bool = True) -> KeyFrames:
    turns = [turn(), turn(yaw_deg=90), turn(yaw_deg=90, tilt_deg=30)]
    offsets = np.array([[0, 0, 0], [1.0, 0.5, 0], [0, 0, -1.0]])
    return KeyFrames(np.array([0.0, 2.0, 3.0]), offsets, np.stack(turns), (0.1, 0.2, 1.0), loop)


def moved(frames: KeyFrames, time_s: float) -> NDArray[np.float64]:
    rotation, shift = frames.pose(time_s)
    return rotation @ SAMPLE + shift


@pytest.mark.parametrize(("time_s", "key"), [(0.0, 0), (2.0, 1)])
def test_at_a_key_frame_the_object_is_where_the_key_says(time_s: float, key: int) -> None:
    frames = motion()
    pivot = np.array(frames.pivot_m)
    wanted = pivot + frames.rotations[key] @ (SAMPLE - pivot) + frames.positions_m[key]
    np.testing.assert_allclose(moved(frames, time_s), wanted, atol=1e-12)


@pytest.mark.parametrize("span_s", [0.01, 0.5, 1.0, 40.0])
def test_a_quarter_of_the_way_is_a_quarter_of_the_time_however_near_the_keys(span_s: float) -> None:
    turns, offsets = np.stack([turn(), turn(yaw_deg=80)]), np.array([[0, 0, 0], [0.4, 0, -0.8]])
    frames = KeyFrames(np.array([0.0, span_s]), offsets, turns, (0.0, 0.0, 0.0))
    rotation, shift = frames.pose(span_s / 4)
    np.testing.assert_allclose(rotation, turn(yaw_deg=20), atol=1e-12)
    np.testing.assert_allclose(shift, [0.1, 0, -0.2], atol=1e-12)


def test_between_keys_places_are_halved_and_turns_too() -> None:
    frames = motion()
    rotation, _ = frames.pose(1.0)
    assert np.allclose(cv2.Rodrigues(rotation)[0].ravel(), [0, -math.radians(45), 0], atol=1e-12)
    pivot = np.array(frames.pivot_m)
    np.testing.assert_allclose(frames.pose(1.0)[1] + rotation @ pivot - pivot, [0.5, 0.25, 0], atol=1e-12)


def test_a_loop_starts_again_and_a_single_pass_rests() -> None:
    np.testing.assert_allclose(moved(motion(), 4.0), moved(motion(), 1.0), atol=1e-12)
    np.testing.assert_allclose(moved(motion(loop=False), 99.0), moved(motion(loop=False), 3.0), atol=0)
    np.testing.assert_allclose(moved(motion(), -5.0), moved(motion(), 0.0), atol=0)


@given(st.floats(-1e6, 1e6))
def test_every_pose_is_a_rotation_and_a_shift(time_s: float) -> None:
    rotation, shift = motion().pose(time_s)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) > 0
    assert np.isfinite(shift).all()


def test_one_key_alone_holds_the_object() -> None:
    frames = KeyFrames(np.zeros(1), np.array([[0, 0, 2.0]]), turn()[None], (0, 0, 0))
    np.testing.assert_allclose(moved(frames, 12.3), SAMPLE + np.array([0, 0, 2.0]))


def test_a_scene_moves_when_one_object_does() -> None:
    still = Sphere("still", (0, 0, 1), 0.1)
    assert not Scene("a", objects=(still,)).moving
    assert Scene("b", objects=(still, Sphere("ball", (0, 0, 1), 0.1, motion=motion()))).moving
