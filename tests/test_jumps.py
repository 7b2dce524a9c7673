"""Jumps of a signal are distinguished from its motion and its noise, and are kept where noise is filtered out of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.common.interpolation import is_held
from tsmblocks.data.jumps import jumps

T = np.arange(0.0, 20.0, 0.01)
LEVELS = np.array([20.0, 80.0, 35.0, 140.0, 60.0, 10.0, 95.0, 50.0])
STAIRS = np.repeat(LEVELS, len(T) // len(LEVELS))
SWEEP = np.sin(2 * np.pi * (0.1 + 0.05 * T) * T)


def noise(size, seed=0, count=None):
    return size * np.random.default_rng(seed).standard_normal(len(T) if count is None else count)


@pytest.mark.parametrize("size", [0.0, 0.02, 1.0, 2.0])
def test_every_jump_of_a_staircase_is_found_where_it_is(size):
    found = jumps(STAIRS + noise(size))
    assert found[0] == 0
    assert np.flatnonzero(np.abs(np.diff(found)) > 1e-9).tolist() == np.flatnonzero(np.diff(STAIRS)).tolist()
    assert np.abs(found + STAIRS[0] - STAIRS).max() <= 2.5 * size + 1e-9


def test_a_jump_that_is_sampled_halfway_keeps_that_sample():
    x = np.where(np.arange(100) > 50, 1.0, 0.0)
    x[51] = 0.4
    assert jumps(x)[49:54].tolist() == [0.0, 0.0, 0.4, 1.0, 1.0]


@pytest.mark.parametrize(
    "x",
    [
        SWEEP,
        SWEEP + noise(0.03),
        np.round(20 * SWEEP) / 20,
        np.round(200 * np.sin(0.2 * T)) / 10,
        T / 3,
        np.tanh((T - 10) / 0.04),
        np.random.default_rng(0).standard_t(3, 50_000),
        1 - np.exp(-np.maximum(T - 5, 0) / 0.05),
    ],
    ids=["sweep", "noisy sweep", "rounded sweep", "rounded sine", "ramp", "fast rise", "heavy tails", "lagging rise"],
)
def test_neither_a_motion_nor_noise_has_jumps(x):
    assert not jumps(x).any()


@given(st.integers(0, 10_000), st.integers(16, 400))
def test_noise_alone_has_no_jumps(seed, count):
    assert not jumps(noise(1.0, seed, count)).any()


def test_a_staircase_is_filtered_between_its_jumps():
    """The filter smeared them over 60 samples, so that a plant began to answer before its input moved."""
    record = tsm.Record("rig", T, {"P": STAIRS + noise(2.0)}, {"P": "W"})
    error = record.filtered("P")["P"] - STAIRS
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert np.abs(error).max() < 3.0


def test_a_noisy_staircase_is_held_after_it_was_conditioned():
    record = tsm.Record("rig", T, {"P": STAIRS + noise(1.0)}, {"P": "W"})
    made = record.conditioned(["P"])
    assert is_held(made["P"])
    assert np.flatnonzero(np.diff(made["P"])).tolist() == np.flatnonzero(np.diff(STAIRS)).tolist()
    assert np.abs(made["P"] - STAIRS).max() < 0.4


def test_a_cut_off_that_is_given_filters_jumps_as_well():
    record = tsm.Record("rig", T, {"P": STAIRS}, {"P": "W"})
    assert np.abs(record.filtered("P", cutoff=5.0)["P"] - STAIRS).max() > 30
