"""A value and its standard error as people read them."""

import pytest

from slopegate.core.rig.calibration import told_number
from slopegate.core.rig.plus_minus import plus_minus


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.049712, 0.0061234, "1.0497 +- 0.0061"),
        (1666.66667, 0.3, "1666.67 +- 0.30"),
        (250.4, 1234.5, "250 +- 1234"),
        (15.2562, 12.0, "15 +- 12"),
        (15.2562, 9.96, "15.3 +- 10.0"),
        (0.0, 1e-5, "0.000000 +- 0.000010"),
        (-0.1, 1.234e-14, "-0.1 +- 1.2e-14"),
        (1.0497123, 0.0, "1.04971 +- 0"),
        (1.0497123, float("nan"), "1.04971 +- nan"),
    ],
)
def test_both_have_the_decimals_that_two_figures_of_the_error_have(value: float, error: float, text: str) -> None:
    assert plus_minus(value, error) == text
    assert plus_minus(value, error, "\u00b1") == text.replace("+-", "\u00b1")


def test_numbers_of_a_rig_have_their_units() -> None:
    assert told_number("camera.fx", 1666.6, 0.31) == "1666.60 +- 0.31 px"
    assert told_number("projector.k1", -0.1, 0.002) == "-0.1000 +- 0.0020"
    assert told_number("rotation_x_rad", 0.01, 0.0001) == "0.01000 +- 0.00010 rad"
    assert told_number("offset_y_m", -0.1, 0.0001) == "-0.10000 +- 0.00010 m"
    assert told_number("delay_offset_us", 12.0, 1.5) == "12.0 +- 1.5 us"
    assert told_number("active_fraction", 0.92, 0.001) == "0.9200 +- 0.0010"
