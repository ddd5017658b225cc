"""A calibration put into a rig, and told beside the one before it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from slopegate.core.calibration.applied import differences
from slopegate.core.rig.calibration import Calibration
from slopegate.drivers.files.rig_files import load_rig


def test_a_difference_counts_in_the_standard_errors_of_both() -> None:
    rig = load_rig("check")
    old = replace(rig, calibration=Calibration(("camera.fx",), ((9.0,),)))
    moved = replace(rig, camera=replace(rig.camera, lens=replace(rig.camera.lens, fx=rig.camera.lens.fx + 10)))
    new = replace(moved, calibration=Calibration(("camera.fx",), ((16.0,),)))
    (found,) = differences(old, new)
    assert (found.name, found.standard_error) == ("camera.fx", 5.0)
    assert found.sigmas == pytest.approx(2.0)
    assert differences(rig, rig) == ()
