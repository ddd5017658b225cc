"""The search: both methods find a card that they know nothing of, end whatever they see, and say why."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import check_rig
from search_card import SearchCard, finish, search_card, speckle
from slopegate.core.gating.gate import phase_us, row_windows, slab, upright_line_time, weights
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.shapes import turn
from slopegate.core.search.fast import STALLED
from slopegate.core.search.paper import FIRST_DELAY_US, PATIENCE, line_times
from slopegate.core.search.search import ask, begin, cancelled, tell
from slopegate.core.search.state import DEFAULT_FRAMES, FOUND_SHARE, METHODS, MIN_KEYPOINTS, Method, Phase


@pytest.fixture(scope="module")
def leaning() -> SearchCard:
    return search_card(35.0, 0.9, ambient=0.05)


@pytest.mark.parametrize(("tilt_deg", "distance_m"), [(0.0, 1.0), (-40.0, 0.7), (60.0, 1.1)])
def test_fast_finds_a_card_by_itself(tilt_deg: float, distance_m: float) -> None:
    card = search_card(tilt_deg, distance_m, ambient=0.02)
    state = finish(begin(card.rig, card.target, black_count=40.0), card.camera())
    outcome = state.outcome
    assert outcome is not None
    assert (outcome.cause, outcome.found) == ("found", True)
    assert outcome.settings is not None
    assert outcome.slab == slab(card.rig, outcome.settings)
    assert card.overlap(outcome.settings) > 0.9
    assert outcome.kept > 0.7 * outcome.keypoints
    assert outcome.frames == state.frames == len(state.history) <= 32
    assert outcome.target is not None
    assert outcome.target.tilt_deg == pytest.approx(tilt_deg, abs=3)
    assert outcome.target.distance_m == pytest.approx(card_on_axis(tilt_deg, distance_m), rel=0.03)
    # the clock's steps leave the gate's own tilt to within a few degrees, and another clock may isolate better
    assert outcome.slab.tilt_deg == pytest.approx(tilt_deg, abs=20)


@pytest.mark.parametrize("tilt_deg", [0.0, 60.0])
def test_the_gate_of_a_flat_target_is_hardly_thicker_than_the_target(tilt_deg: float) -> None:
    card = search_card(tilt_deg, 1.0)
    outcome = finish(begin(card.rig, card.target, black_count=40.0), card.camera()).outcome
    assert outcome is not None
    found = outcome.settings
    assert found is not None
    assert (found.exposure_us - np.ptp(phases_of(card, found.line_time_us))) * card.rig.projector.rows_per_us < 3


@pytest.mark.parametrize("yaw_deg", [-40.0, 40.0])
def test_the_gate_reaches_to_the_sides_of_a_target_that_have_no_keypoints(yaw_deg: float) -> None:
    """A card turned to the side is plain, as the wall is, but in its middle: its sides are nearer and farther."""
    card = search_card(0.0, 0.9, yaw_deg=yaw_deg, roll_deg=0.0)
    x0, _, x1, _ = card.target
    direct, side = card.buffers.direct.copy(), (x1 - x0) // 7
    direct[:, : x0 + side] = direct[:, x1 - side :] = np.median(direct[card.truth], axis=0)
    plain = replace(card, buffers=replace(card.buffers, direct=direct))
    outcome = finish(begin(card.rig, card.target, black_count=40.0), plain.camera()).outcome
    assert outcome is not None
    exact = outcome.target
    assert exact is not None
    phases = phases_of(card, exact.line_time_us)
    ((start, end),) = exact.windows_us
    narrower = np.array([start - phases.min(), phases.max() - end]) * card.rig.projector.rows_per_us
    assert narrower.max() < 1.5


def phases_of(card: SearchCard, line_time_us: float) -> np.ndarray:
    """Phases of what the projector lights of the card, microseconds."""
    lit = card.truth & (card.buffers.projector_row >= 0)
    return phase_us(card.rig, line_time_us, np.nonzero(lit)[0] + 0.5, card.buffers.projector_row[lit].astype(float))


def test_a_plane_that_cuts_make_no_surer_is_tried(leaning: SearchCard) -> None:
    """A cut that does not help is counted, one that helps clears the count, and at the limit the plane is tried."""
    frame = leaning.camera()
    state = after = begin(leaning.rig, leaning.target, "fast", 40.0)
    while not (state.phase.doing == after.phase.doing == "locating" and after.phase.plane.sharpest < STALLED[0]):
        state, wish = after, ask(after)
        assert wish is not None
        image = frame(wish, state.frames)
        after = tell(state, image, wish)

    def told(idle: int, sharpest: float) -> Phase:
        plane = replace(state.phase.plane, idle=idle, sharpest=sharpest)
        return tell(replace(state, phase=replace(state.phase, plane=plane)), image, wish).phase

    unsure = after.phase.plane.sharpest
    for idle in range(STALLED[2] - 1):
        assert told(idle, unsure).plane.idle == idle + 1
        assert told(idle, 2 * unsure).plane.idle == 0
    assert told(STALLED[2] - 1, unsure).doing == "trying the plane"
    assert told(STALLED[2] - 1, 2 * unsure).doing == "locating"


def test_ambient_light_is_looked_for_where_nothing_in_front_of_the_rig_is_recorded(leaning: SearchCard) -> None:
    state = finish(begin(leaning.rig, leaning.target, black_count=40.0), leaning.camera())
    (settings,) = (step.settings for step in state.history if step.doing == "ambient light only")
    rig = leaning.rig
    camera, windows = rig.camera.lens, row_windows(rig, settings)
    rays = rig.camera_rays(np.full(camera.height, camera.cx), np.arange(camera.height) + 0.5)
    for depth_m in (0.3, 1.0, 10.0, 1e6):
        rows = rig.to_projector(rig.camera_centre_m + depth_m * rays)[1]
        lit = np.where((rows >= 0) & (rows < rig.projector.lens.height), rows, -1)
        assert (lit >= 0).sum() > camera.height / 3
        assert not weights(windows, lit).any()


def test_fast_finds_a_card_with_a_turned_projector_and_bent_lenses() -> None:
    ideal = check_rig(800)
    rotation = turn(2.0, 1.5, 1.0).tolist()
    camera = replace(ideal.camera.lens, distortion=(-0.12, 0.05, 0.001, -0.001))
    projector = replace(ideal.projector.lens, distortion=(0.08, -0.03, 0.0, 0.0))
    rig = replace(
        ideal,
        camera=replace(ideal.camera, lens=camera),
        projector=replace(ideal.projector, lens=projector),
        projector_offset_m=(0.004, -0.1, 0.006),
        projector_rotation=tuple(map(tuple, rotation)),
    )
    card = search_card(40.0, 0.8, 0.03, rig)
    outcome = finish(begin(rig, card.target, black_count=40.0), card.camera()).outcome
    assert outcome is not None
    assert outcome.settings is not None
    assert card.overlap(outcome.settings) > 0.9
    assert outcome.target is not None
    assert outcome.target.tilt_deg == pytest.approx(40.0, abs=5)


def card_on_axis(tilt_deg: float, distance_m: float) -> float:
    """Where the plane of the card of `search_card` (8 degrees of yaw, 3 of roll) meets the axis."""
    normal = turn(tilt_deg, 8.0, 3.0) @ (0.0, 0.0, 1.0)
    centre = np.array([0.02, -0.06 * distance_m, distance_m])
    return float(normal @ centre / normal[2])


def test_paper_finds_a_leaning_card_with_more_frames(leaning: SearchCard) -> None:
    paper, fast = (
        finish(begin(leaning.rig, leaning.target, method, 40.0), leaning.camera()).outcome
        for method in ("paper", "fast")
    )
    assert paper is not None
    assert fast is not None
    assert paper.found
    assert fast.found
    assert paper.kept > 0.7 * paper.keypoints
    assert fast.frames * 3 <= paper.frames


def test_paper_goes_up_the_clocks_from_the_shortest_exposure(leaning: SearchCard) -> None:
    state = finish(begin(leaning.rig, leaning.target, "paper", 40.0), leaning.camera())
    line = leaning.rig.camera.shutter.line
    clocks = [step.settings.line_time_us for step in state.history if step.doing == "raising the clock"]
    assert clocks == list(line_times(state.task))[: len(clocks)]
    assert clocks[0] == line.line_time_us(10.0)  # type: ignore[union-attr]
    raised = [step for step in state.history if step.doing == "raising the clock"]
    assert {(step.settings.delay_us, step.settings.exposure_us) for step in raised} == {(1.0, 100.0)}
    assert [step.seen > 0 for step in raised] == [False] * (len(raised) - 1) + [True]
    # whatever came later, the answer is the frame that showed the most
    assert state.outcome is not None
    assert state.outcome.kept == max(
        step.seen for step in state.history if step.doing.startswith(("moving", "raising"))
    )


def test_paper_moves_the_delay_up_while_that_gains_and_then_once_down_from_the_best(leaning: SearchCard) -> None:
    state = finish(begin(leaning.rig, leaning.target, "paper", 40.0), leaning.camera())
    moves = [step.settings.delay_us for step in state.history if step.doing == "moving the delay"]
    ways = np.sign(np.diff([FIRST_DELAY_US, *moves]))
    turn_at = int(np.argmax(ways < 0))
    assert turn_at >= PATIENCE
    assert (ways[:turn_at] > 0).all()
    assert (ways[turn_at:] < 0).all()
    assert len(ways) - turn_at >= PATIENCE


@pytest.mark.parametrize("method", METHODS)
def test_equal_frames_make_equal_searches_and_no_state_changes(leaning: SearchCard, method: Method) -> None:
    frame = leaning.camera()
    state = begin(leaning.rig, leaning.target, method, 40.0, seed=5)
    for _ in range(8):
        wish = ask(state)
        assert wish is not None
        image = frame(wish, state.frames)
        one, two = tell(state, image, wish), tell(state, image, wish)
        assert ask(one) == ask(two)
        assert ask(state) == wish
        state = one


@pytest.mark.parametrize("method", METHODS)
def test_a_plain_target_has_too_few_keypoints(method: Method) -> None:
    rig = check_rig(640)
    plain = np.full((480, 640), 900, np.uint16)
    state = finish(begin(rig, None, method, 40.0), lambda *_: plain)
    assert state.outcome is not None
    assert state.outcome.cause == "too few keypoints"
    assert "only 0 keypoints" in state.outcome.reason
    assert str(MIN_KEYPOINTS) in state.outcome.reason
    assert (state.outcome.settings, state.outcome.slab, state.outcome.found) == (None, None, False)
    assert state.frames == 1


def test_a_small_photo_ends_with_its_number_of_keypoints() -> None:
    rig = check_rig(116, height=115)
    photo = (40 + 2000 * cv2.GaussianBlur(speckle(3)[:115, :116, 0], (0, 0), 3.5)).astype(np.uint16)
    state = finish(begin(rig, None, "fast", 40.0), lambda *_: photo)
    assert state.outcome is not None
    assert state.outcome.cause == "too few keypoints"
    assert 0 < state.outcome.keypoints < MIN_KEYPOINTS
    assert f"only {state.outcome.keypoints} keypoints" in state.outcome.reason


def test_noise_alone_has_no_keypoints_that_repeat() -> None:
    rng = np.random.default_rng(0)
    state = finish(begin(check_rig(640)), lambda *_: rng.normal(400, 60, (480, 640)).astype(np.uint16))
    assert state.outcome is not None
    assert state.outcome.cause == "too few keypoints"
    assert state.frames == 2


@pytest.mark.parametrize("method", METHODS)
def test_a_target_in_the_room_light_only_is_not_lit(method: Method) -> None:
    rig = check_rig(640)
    wall = 1500 * tiled(speckle(3)[:, :, 0])

    def frame(asked: GateSettings, number: int) -> np.ndarray:
        return (40 + wall * asked.exposure_us / rig.projector.period_us).astype(np.uint16)

    state = finish(begin(rig, None, method, 40.0), frame)
    assert state.outcome is not None
    assert state.outcome.cause == "not lit"
    assert state.frames == 3


def tiled(tile: np.ndarray) -> np.ndarray:
    """The tile over the whole image."""
    return np.tile(tile, (2, 3))[:480, :640].astype(np.float64)


@settings(max_examples=6)
@given(seed=st.integers(0, 2**32 - 1), method=st.sampled_from(METHODS), frames=st.integers(1, 60))
def test_whatever_the_camera_shows_the_search_ends(leaning: SearchCard, seed: int, method: Method, frames: int) -> None:
    rng = np.random.default_rng(seed)
    honest = leaning.camera(seed)

    def frame(asked: GateSettings, number: int) -> np.ndarray:
        image = honest(asked, number)
        if number >= 3:  # lies: parts lit that are not, parts dark that are lit, everything bright
            full = honest(begin(leaning.rig).wish or asked, 0)
            lies = rng.random((12, 16)) < 0.5
            image = np.where(np.kron(lies, np.ones((40, 40), bool)), full, rng.integers(30, 60, full.shape))
        return image.astype(np.uint16)

    state = finish(begin(leaning.rig, leaning.target, method, 40.0, frames, seed), frame)
    assert state.outcome is not None
    assert state.outcome.reason
    assert state.outcome.frames <= frames
    assert (state.outcome.settings is not None) == (state.outcome.cause in {"found", "part"})
    if state.outcome.settings is not None:
        assert state.outcome.kept >= FOUND_SHARE * state.outcome.keypoints


def test_a_gate_that_shows_most_is_the_target_and_half_a_part_of_it(leaning: SearchCard) -> None:
    """Less is not the target: it names the gate that shows the most, and leaves the settings as they were."""
    state = finish(begin(leaning.rig, leaning.target, "fast", 40.0), leaning.camera())
    assert state.outcome is not None
    assert state.outcome.settings is not None
    total = state.outcome.keypoints
    half, most = -(-total // 2), -(-4 * total // 5)
    for kept, cause in ((most, "found"), (most - 1, "part"), (half, "part"), (half - 1, "not seen")):
        outcome = state.judged(state.outcome.settings, kept).outcome
        assert outcome is not None
        assert (outcome.cause, outcome.found) == (cause, cause == "found")
        assert (outcome.settings is None) == (cause == "not seen")
        assert f"{kept} of {total} keypoints" in outcome.reason
        assert (f"delay {state.outcome.settings.delay_us:.0f} and exposure" in outcome.reason) == (cause == "not seen")


def test_a_search_out_of_frames_says_so(leaning: SearchCard) -> None:
    state = finish(begin(leaning.rig, leaning.target, "paper", 40.0, max_frames=7), leaning.camera())
    assert state.outcome is not None
    assert state.outcome.cause == "frames used up"
    assert "7 frames" in state.outcome.reason
    assert state.frames == 7


def test_cancelling_ends_a_search_and_leaves_an_ended_one(leaning: SearchCard) -> None:
    state = cancelled(begin(leaning.rig))
    assert ask(state) is None
    assert state.outcome is not None
    assert (state.outcome.cause, state.outcome.settings) == ("cancelled", None)
    assert cancelled(state) is state


def test_only_images_of_the_camera_and_searches_under_way_are_taken(leaning: SearchCard) -> None:
    state = begin(leaning.rig)
    wish = ask(state)
    assert wish is not None
    with pytest.raises(ValueError, match=r"image is .* of 480 x 640 pixels"):
        tell(state, np.zeros((480, 641), np.uint16), wish)
    with pytest.raises(RuntimeError, match="search has ended"):
        tell(cancelled(state), np.zeros((480, 640), np.uint16), wish)


@pytest.mark.parametrize("target", [(0, 0, 641, 480), (-1, 0, 100, 100), (50, 50, 60, 200), (200, 100, 100, 200)])
def test_a_target_outside_the_image_or_tiny_is_refused(target: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match=r"target is .* 640 x 480 pixels"):
        begin(check_rig(640), target)


def test_limits_are_what_they_are_said_to_be() -> None:
    rig = check_rig(640)
    assert {method: begin(rig, None, method).task.max_frames for method in METHODS} == DEFAULT_FRAMES
    assert upright_line_time(rig) == rig.camera.shutter.line.line_time_us(78.0)  # type: ignore[union-attr]
    with pytest.raises(ValueError, match="max_frames"):
        begin(rig, max_frames=0)
