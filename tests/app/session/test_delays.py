"""The delays that are of use for a scene."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.app.session.delays import lit_ends, useful_delays_us
from slopegate.app.session.source import Source, known_buffers
from slopegate.core.gating.slices import phase_range
from slopegate.core.rig.settings import GateSettings, gate


def records(source: Source, settings: GateSettings) -> bool:
    """Whether the gate records any lit pixel of the scene."""
    rows = known_buffers(source).projector_row
    times = rows / source.rig.projector.rows_per_us
    height = rows.shape[0]
    start = settings.delay_us - settings.exposure_us / 2 + (np.arange(height) + 0.5) * settings.line_time_us
    end = start + settings.exposure_us
    return bool(((rows >= 0) & (times >= start[:, None]) & (times <= end[:, None])).any())


@pytest.mark.parametrize("exposure_us", [200.0, 2000.0])
def test_within_them_the_gate_meets_the_scene_and_beyond_it_does_not(source: Source, exposure_us: float) -> None:
    rig = source.rig
    line = source.presets[0].settings.line_time_us
    low, high = useful_delays_us(rig, gate(line, 0.0, exposure_us), lit_ends(source))
    delays = np.linspace(low, high, 201)
    met = delays[[records(source, gate(line, delay, exposure_us)) for delay in delays]]
    assert met.min() - low < 0.05 * (high - low)
    assert high - met.max() < 0.05 * (high - low)
    for delay in (low - 5, high + 5):
        assert not records(source, gate(line, delay, exposure_us))


def test_of_an_unknown_scene_anything_before_the_rig_counts(source: Source) -> None:
    settings = source.presets[0].settings
    low, high = useful_delays_us(source.rig, settings, None)
    first, last = phase_range(source.rig, settings.line_time_us, 0.3)
    assert low < first
    assert last < high
