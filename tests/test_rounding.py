"""Estimates are rounded to their uncertainty, in one way everywhere, and never to nothing."""

import pytest

from tsmblocks.common.rounding import decimals, plus_minus


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [
        (0.157, 0.011, "0.157 ± 0.011"),
        (0.357767, 59.0, "0.4 ± 59"),
        (-0.0027, 0.0196, "-0.003 ± 0.020"),
        (0.0312, 5.0, "0.03 ± 5.0"),
        (0.991, 1.5, "1.0 ± 1.5"),
        (71531.7, 2.2e6, "(0.07 ± 2.2)e6"),
        (0.000505, 4.1e-6, "(5.050 ± 0.041)e-4"),
        (0.004, 3.6e-6, "(4.0000 ± 0.0036)e-3"),
        (0.0, 1e-8, "(0.0 ± 1.0)e-8"),
        (0.0, 0.0074, "0.0000 ± 0.0074"),
        (-1e-9, 0.02, "0.000 ± 0.020"),
        (2980.4, 340.0, "2980 ± 340"),
    ],
)
def test_an_estimate_and_its_uncertainty(value, half, shown):
    assert plus_minus(value, half) == shown


def test_angles_are_shown_in_degrees():
    assert plus_minus(0.00872665, 0.000225, "rad") == "0.500 ± 0.013 deg"


def test_decimals_are_those_of_the_uncertainty_unless_the_value_would_vanish():
    assert decimals(12.345, 0.23) == 2
    assert decimals(0.00123, 0.23) == 3
    assert decimals(1e-6, 0.23) == 2
