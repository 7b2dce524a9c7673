"""The slow part of a residual: white noise loses its square there, steps and slopes keep it."""

from types import SimpleNamespace

import numpy as np
import pytest

from tsmblocks.diagnosis import slow_sums as slow


@pytest.fixture(autouse=True)
def rows(monkeypatch):
    """One output in two experiments, of 3000 and 2000 samples."""
    monkeypatch.setattr(slow, "rows_of_experiments", lambda *_: {"a": slice(0, 3000), "b": slice(3000, 5000)})


MODEL = SimpleNamespace(setup=SimpleNamespace(outputs=["y"]))
T = np.r_[np.arange(3000.0), np.arange(2000.0)]


def test_white_noise_keeps_the_share_of_its_averages():
    noise = np.random.default_rng(0).standard_normal((5000, 200))
    assert np.mean(slow.slow_sums(MODEL, noise)) == pytest.approx(2 * slow.BLOCKS, rel=0.02)


@pytest.mark.parametrize("change", [np.where(T > 1234, 1.0, -0.5), T - 900.0, np.exp(-T / 400)])
def test_steps_slopes_and_decays_are_slow(change):
    assert slow.is_slow(MODEL, change)
    assert slow.slow_sums(MODEL, change[:, None])[0] == pytest.approx(float(change @ change), rel=0.02)


@pytest.mark.parametrize("change", [np.sin(T), (T > 1234) * np.sin(T / 2), np.zeros(5000)])
def test_what_follows_a_fast_motion_is_not(change):
    assert not slow.is_slow(MODEL, change)


def test_recordings_of_few_samples_count_whole(monkeypatch):
    monkeypatch.setattr(slow, "rows_of_experiments", lambda *_: {"a": slice(0, 150)})
    r = np.random.default_rng(1).standard_normal((150, 1))
    assert slow.slow_sums(MODEL, r)[0] == pytest.approx(float(np.sum(r**2)))


@pytest.mark.parametrize(("wander", "enough"), [(0.5, True), (2.0, False)])
def test_a_jump_explains_the_slowest_part_unless_what_it_leaves_wanders_more(wander, enough):
    jump, noise = np.where(T > 1234, 1.0, -0.5), np.random.default_rng(2).standard_normal(5000)
    left = noise + wander * np.sin(2 * np.pi * T / 2500)
    base, fitted = (SimpleNamespace(setup=MODEL.setup, r=r) for r in (left + jump, left))
    assert slow.explains_slowest(fitted, base) is enough


def test_slow_noise_that_is_shorter_than_a_tenth_does_not_count():
    jump, noise = np.where(T > 1234, 1.0, -0.5), 5 * np.sin(2 * np.pi * T / 100)
    base, fitted = (SimpleNamespace(setup=MODEL.setup, r=r) for r in (noise + jump, noise))
    assert slow.explains_slowest(fitted, base)
