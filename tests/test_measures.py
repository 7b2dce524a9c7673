"""Measures against values known in closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tolerances import EXACT
from tsmblocks.common.errors import DataError
from tsmblocks.common.units import UnitError
from tsmblocks.metrics.tracking import loop_area, peak_to_peak, rms, tracking_error

T = np.linspace(0.0, 10.0, 10001)


def test_a_sine_has_its_known_size():
    x = 3.0 * np.sin(2 * np.pi * T[:-1])
    assert peak_to_peak(x) == pytest.approx(6.0, abs=1e-9)
    assert rms(x) == pytest.approx(3.0 / np.sqrt(2), rel=EXACT)


def test_equation_10_is_the_mean_of_the_squares():
    error = np.array([1.0, 2.0, 3.0]) - [1.0, 4.0, 0.0]
    assert rms(error) ** 2 == pytest.approx((0 + 4 + 9) / 3, rel=EXACT)


@pytest.mark.parametrize("turns", [1, 3])
def test_an_ellipse_has_the_area_pi_a_b_for_each_turn(turns):
    phase = np.linspace(0.0, 2 * np.pi * turns, 4001)[:-1]
    x, y = 5.0 + 2.0 * np.cos(phase), -7.0 + 0.5 * np.sin(phase)
    assert loop_area(x, y) == pytest.approx(np.pi * turns, rel=1e-5)
    assert loop_area(x[::-1], y[::-1]) == pytest.approx(-np.pi * turns, rel=1e-5)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_the_area_of_a_square_does_not_depend_on_where_it_lies(a, b):
    assert loop_area([a, a + 1, a + 1, a], [b, b, b + 1, b + 1]) == pytest.approx(1.0, rel=1e-9)


def test_a_tracking_error_leaves_out_what_comes_before():
    x_out = np.where(T < 5, 2.0, 0.1 * np.sin(2 * np.pi * T))
    whole = tracking_error(np.zeros_like(T), x_out)
    late = tracking_error(np.zeros_like(T), x_out, t=T, after=5.0)
    assert whole.largest == pytest.approx(2.0)
    assert late.peak_to_peak == pytest.approx(0.2, rel=1e-6)
    assert (late.after, late.unit) == (5.0, "rad")
    assert late.to("deg").peak_to_peak == pytest.approx(np.degrees(late.peak_to_peak), rel=EXACT)
    assert late.to("deg").after == 5.0


def test_an_error_in_rad_does_not_become_volts():
    with pytest.raises(UnitError, match="'rad' does not convert to 'V'"):
        tracking_error([1.0], [0.5]).to("V")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: peak_to_peak([]), "x must be a list of at least one number"),
        (lambda: rms([[1.0, 2.0]]), "x must be a list of at least one number, got shape (1, 2)"),
        (lambda: loop_area([1.0, 2.0], [1.0]), "x and y must be of one length, got 2 and 1 samples"),
        (lambda: tracking_error([1.0], [1.0], after=1.0), "tracking_error needs t"),
        (lambda: tracking_error([1.0], [1.0], t=[0.0], after=1.0), "no instant remains after 1 s"),
    ],
)
def test_what_cannot_be_measured_is_refused(call, words):
    with pytest.raises(DataError) as refused:
        call()
    assert words in str(refused.value)
