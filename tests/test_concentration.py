"""A residual most of which lies in a short part of a recording."""

import attrs
import numpy as np
import pytest

from tests.test_report import UNKNOWN
from tsmblocks.diagnosis.concentration import concentrations
from tsmblocks.diagnosis.next_steps import next_steps
from tsmblocks.diagnosis.segment import Trace

RNG = np.random.default_rng(3)
T = np.linspace(0.0, 600.0, 3001)
MOTION = np.sin(2 * np.pi * T / 50)


def trace(error, measured=MOTION):
    noisy = measured + RNG.normal(0, 0.01, T.size)
    return Trace("run", "y", "K", T, noisy, noisy, measured + error, T * 0, "u", np.empty((0, 3)))


def during(start, stop, size=0.2):
    return np.where((start < T) & (stop > T), size, 0.0)


def test_a_short_part_with_most_of_the_error_is_found_with_its_instants():
    (found,) = concentrations([trace(during(310.0, 390.0))], {"y": 0.01})
    assert (found.experiment, found.output) == ("run", "y")
    assert 300 <= found.start <= 340
    assert 360 <= found.stop <= 400
    assert 0.7 <= found.share <= 1.0


@pytest.mark.parametrize(
    "error",
    [0.2 * np.cos(2 * np.pi * T / 50), during(100.0, 400.0), 0.0 * T, during(310.0, 390.0, 0.01)],
    ids=["everywhere", "long", "noise", "small"],
)
def test_a_residual_that_is_everywhere_or_small_is_in_no_part(error):
    assert not concentrations([trace(error)], {"y": 0.01})


def test_an_error_where_alone_the_mechanism_moves_is_none_of_a_time():
    burst = np.where((T > 300) & (T < 400), MOTION, 0.0)
    assert not concentrations([trace(0.3 * burst, burst)], {"y": 0.01})
    assert concentrations([trace(0.3 * burst)], {"y": 0.01})


def test_the_next_step_says_when():
    (gap,) = UNKNOWN.gaps[:1]
    one = attrs.evolve(trace(during(310.0, 390.0)), output=gap.output)
    said = attrs.evolve(UNKNOWN, traces=(one,), gaps=(attrs.evolve(gap, noise_floor=0.01, sensor_floor=0.0),))
    (step,) = (text for text in next_steps(said) if text.startswith("Examine run between 3"))
    assert f"of the variance of {gap.output} above the noise floor lies there" in step
    assert "(--window)" in step
