"""The exposure sweep on a camera: each exposure's figures, the gate that was applied, giving up."""

from __future__ import annotations

import math

import numpy as np

from slopegate.core.exposure.sensor import mono
from slopegate.core.measure.exposure_sweep import fog_target, sweep_gates
from slopegate.core.render.render import render
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.stream.depth_run import frames_of
from slopegate.drivers.stream.exposure_run import run_exposures
from small_window import small_rig, small_scene

AROUND_THE_CARD = (80, 50, 240, 190)


def test_the_exposure_that_shows_the_card_but_not_the_wall_is_most_like_the_card_alone() -> None:
    rig = small_rig()
    scene = small_scene(rig)
    buffers = render(rig, scene)
    card = mono(buffers.direct) * (buffers.inverse_depth > 0.75)
    target = fog_target(card, AROUND_THE_CARD)
    line_time_us, delay_us = scene.gates[0].settings.line_time_us, scene.gates[0].settings.delay_us
    gates = sweep_gates(rig.camera.shutter, rig.projector.period_us, line_time_us, delay_us + 0.25, 12)
    camera = VirtualCamera(rig, scene, rate_hz=math.inf)
    camera.start()
    heard: list[float] = []
    found = run_exposures(frames_of(camera), gates, target, camera.info.black_count, 2, heard.append)
    assert found is not None
    assert [applied.exposure_us for applied, _ in found] == [gate.exposure_us for gate in gates]
    assert {applied.delay_us for applied, _ in found} == {round(delay_us)}
    likeness = [one.ncc for _, one in found]
    assert 0 < int(np.argmax(likeness)) < len(gates) - 1
    assert max(likeness) > 0.99
    assert likeness[-1] < max(likeness) - 0.005
    np.testing.assert_allclose(heard, np.arange(1, 13) / 12)
    camera.close()


def test_it_can_be_given_up() -> None:
    rig = small_rig()
    picture = np.arange(240 * 320, dtype=np.uint16).reshape(240, 320)
    left = [3]

    def take(asked: object) -> object:
        left[0] -= 1
        return (picture, asked) if left[0] > 0 else None

    gates = sweep_gates(rig.camera.shutter, rig.projector.period_us, 13.0, 2000.0, 5)
    assert run_exposures(take, gates, fog_target(picture), 0.0, 2) is None  # type: ignore[arg-type]
