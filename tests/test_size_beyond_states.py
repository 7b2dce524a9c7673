"""What the size of a memory gains beyond the states that it may begin from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsmblocks.diagnosis.size_beyond_states import size_beyond_states
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space
from tsmblocks.fitting.jacobian import Jacobian

OWNER = np.repeat([0, 1], [1200, 800])
T = np.r_[np.arange(1200.0), np.arange(800.0)] / 100
FADES = np.exp(-T / 2.0)[:, None]
FOLLOWS = (np.sin(2 * np.pi * 0.3 * T) + 0.2 * T)[:, None]
CONSTANT = np.ones((2000, 1))


def found(r, noise=None, draws=99):
    base = column_space(Jacobian.of(CONSTANT), SQUARED_EFFECT_TOLERANCE)
    noise = np.random.default_rng(7).standard_normal((2000, draws)) if noise is None else noise
    return size_beyond_states(FOLLOWS, FADES, OWNER, base, r, base.project_out(noise))


def plain(r):
    """The same by least squares."""

    def rest(*columns):
        A = np.column_stack([CONSTANT, FADES * (OWNER[:, None] == [0, 1]), *columns])
        return float(np.sum((r - A @ np.linalg.lstsq(A, r, rcond=None)[0]) ** 2))

    return rest() - rest(FOLLOWS)


@given(st.integers(0, 10_000), st.floats(-2, 2), st.floats(-5, 5))
def test_the_gain_is_that_of_least_squares(seed, size, start):
    r = np.random.default_rng(seed).standard_normal(2000) + size * FOLLOWS[:, 0] + start * FADES[:, 0]
    assert found(r, draws=2).gain == pytest.approx(plain(r), rel=1e-3, abs=0.02)


def test_gains_in_noise_are_those_of_one_size():
    every = found(np.zeros(2000), draws=4000).noise_gains
    assert np.mean(every) == pytest.approx(1.0, abs=0.1)  # chi-squared with one degree of freedom
    assert np.quantile(every, 0.95) == pytest.approx(3.84, rel=0.1)


def test_what_fades_from_the_start_of_each_experiment_tells_nothing_of_the_size():
    noise = np.random.default_rng(3).standard_normal(2000)
    apart = np.where(OWNER == 0, 30.0, -20.0) * FADES[:, 0]
    assert found(noise + apart).gain == pytest.approx(found(noise).gain, abs=1e-3)
    assert found(apart).is_noise


def test_what_follows_the_motion_does():
    noise = np.random.default_rng(3).standard_normal(2000)
    assert not found(noise + 0.5 * FOLLOWS[:, 0]).is_noise
