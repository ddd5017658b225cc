"""The trigger's pulse of hidden rigs, from gates by both of its edges."""

from __future__ import annotations

from dataclasses import replace

import pytest

from slopegate.core.rig.checks import InputError
from slopegate.drivers.calibrations.both_edges import pulse_by_edges, require_edges
from slopegate.drivers.calibrations.timing_bench import TimingBench
from slopegate.drivers.calibrations.timing_run import TimingAttendance, TimingPlan, run_timing
from slopegate.drivers.cameras.faults import Faults, FaultyCamera
from slopegate.drivers.cameras.virtual import VirtualCamera
from timed_scenes import JITTER, HiddenPlane, hidden_plane


def bench_of(hidden: HiddenPlane, pulse_us: float, faults: Faults | None = JITTER) -> TimingBench:
    return TimingBench(
        hidden.scene, hidden.true, hidden.believed, faults=faults,
        camera_up=hidden.camera_up, projector_up=hidden.projector_up, pulse_us=pulse_us,
    )  # fmt: skip


@pytest.mark.parametrize(("seed", "pulse_us"), [(1, 730.0), (4, -2000.0)])
def test_the_pulse_is_found_and_the_rising_edge_set_again(seed: int, pulse_us: float) -> None:
    """A negative one: the signal is low in its pulse, so its falling edge comes first."""
    hidden = hidden_plane(seed)
    bench = bench_of(hidden, pulse_us)
    plan = TimingPlan(hidden.target, frames=60)
    first = run_timing(bench.shots, hidden.believed, plan, None, bench.projector)
    assert first is not None
    found = pulse_by_edges(bench.camera, bench.shots, hidden.believed, plan, first.timing, None, bench.projector)
    assert found.width is not None
    assert found.width.second == ("falling" if pulse_us > 0 else "rising")
    assert found.width.error_us < 2.5
    assert abs(found.width.width_us - abs(pulse_us)) < 3 * found.width.error_us
    again = run_timing(bench.shots, hidden.believed, plan, None, bench.projector)
    bench.close()
    assert again is not None
    assert again.timing.offset_us == pytest.approx(first.timing.offset_us, abs=8.0)


def test_given_up_it_says_so_and_the_first_timing_stands() -> None:
    hidden = hidden_plane(1)
    bench = bench_of(hidden, 100.0, None)
    plan = TimingPlan(hidden.target, frames=30)
    first = run_timing(bench.shots, hidden.believed, plan, None, bench.projector)
    assert first is not None
    attendance = TimingAttendance(given_up=lambda: True)
    found = pulse_by_edges(bench.camera, bench.shots, hidden.believed, plan, first.timing, attendance, bench.projector)
    bench.close()
    assert found.width is None
    assert "given up" in found.why_not


def test_a_camera_of_one_edge_is_refused() -> None:
    hidden = hidden_plane(1)
    camera = FaultyCamera(VirtualCamera(hidden.true, replace(hidden.scene, fog=None)), JITTER)
    with pytest.raises(InputError, match="which edge of the trigger"):
        require_edges(camera)
    camera.close()
