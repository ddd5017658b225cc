"""Gates on a chart that is not where the rig file has it tell no timing, and say so."""

from __future__ import annotations

import pytest

from slopegate.core.calibration.advice import candidates
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.chart_scene import held
from slopegate.drivers.calibrations.practice import PracticeRig
from slopegate.drivers.calibrations.timing_run import TimingPlan, run_timing
from small_window import small_rig


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_rig_that_is_far_off_is_no_bug() -> None:
    rig, chart = small_rig(), chart_from("6x5:40")
    practice = PracticeRig(rig, chart, 3)
    seen = candidates(rig, chart)
    x, y, z = seen[len(seen) // 2].placed(chart.points_m.mean(axis=0)).tolist()
    practice.move(held(chart, (x, y, z)))
    practice.camera.start()
    outcome = run_timing(practice.shots(), rig, TimingPlan(chart, frames=60), None, practice.projector)
    practice.camera.close()
    assert outcome is not None
    assert not outcome.verdict.enough
