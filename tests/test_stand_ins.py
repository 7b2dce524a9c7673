"""Errors that no name fits: a factor that varies, and effects that explain a part of something else."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import tsmblocks as tsm
from tests.test_evidence import DEG, SIGMA, STEP, fitted, motion, noise
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.varying_factor import varying_factor

UNITS = {"x_in": "rad", "x_out": "rad"}


def recordings(seed, what, kind="white", count=4):
    """A gain of 0.9 with ``what(t, x, draw)`` added, and noise; each recording begins at zero."""
    draw, result = np.random.default_rng(seed), {}
    for k in range(count):
        t, x = motion(100 * seed + k)
        y = 0.9 * x + what(t, x, draw) + SIGMA * noise(kind, len(t), draw)
        result[f"run {k}"] = tsm.Record(f"run {k}", t, {"x_in": x, "x_out": y}, UNITS)
    return result


def wandering(t, x, draw):
    """A gain that wanders by 1 %, without return: low-pass noise of 3 s."""
    a = np.exp(-STEP / 3.0)
    slow = lfilter([np.sqrt(1 - a * a)], [1, -a], draw.standard_normal(len(t) + 2000))[2000:]
    return 0.01 * slow * x


def jitter(t, x, draw):
    """A clock that jitters by 3 ms from sample to sample: large where the motion is fast."""
    return 0.003 * draw.standard_normal(len(t)) * np.gradient(0.9 * x, t)


def product(t, x, draw):
    """The product of the position and the speed behind a filter of 0.1 s, which no block has."""
    a = np.exp(-STEP / 0.1)
    return 0.01 * x * lfilter([1 - a], [1, -a], np.gradient(x, t)) / (10 * DEG)


def test_a_gain_that_wanders_is_proportional_to_the_position_by_a_factor_that_varies():
    found = varying_factor(fitted(recordings(1, wandering)), 0)
    assert found.material
    assert found.coordinate == "position"
    records = recordings(1, lambda *_: 0.0), recordings(1, wandering)
    error = np.mean([np.mean((b["x_out"] - a["x_out"]) ** 2) for a, b in zip(*map(dict.values, records), strict=True)])
    assert 0.3 < found.share * (1 + error / SIGMA**2) / (error / SIGMA**2) < 1.1
    assert f"varies within about {found.window:.2g} s" in found.words


def test_what_a_curve_tells_as_well_does_not_vary():
    """The magnitude of the position is proportional to it by a factor that changes with its sign, and not with time."""
    assert not varying_factor(fitted(recordings(1, lambda t, x, draw: 0.01 * np.abs(x))), 0).material
    assert not varying_factor(fitted(recordings(1, lambda t, x, draw: 0.02 * x**3 / (20 * DEG) ** 2)), 0).material


def test_a_gain_that_changes_once_varies_over_long_windows():
    """Short windows tell no more of it than those of a part of the recording."""
    found = varying_factor(fitted(recordings(1, lambda t, x, draw: 0.01 * x * (t > 10.0))), 0)
    assert found.material
    assert found.window >= 24.0 / 6


@pytest.mark.parametrize("kind", ["white", "heavy", "slow", "very slow"])
def test_noise_of_any_spectrum_is_proportional_to_nothing(kind):
    assert not any(varying_factor(fitted(recordings(seed, lambda *_: 0.0, kind)), 0).material for seed in (2, 3, 4))


def test_noise_that_is_large_where_the_motion_is_fast_is_proportional_to_nothing():
    assert not any(varying_factor(fitted(recordings(seed, jitter)), 0).significant for seed in (2, 3, 4))


def test_a_constant_factor_too_small_to_be_seen_does_not_vary():
    """A lag of 0.1 ms."""
    late = varying_factor(fitted(recordings(5, lambda t, x, draw: -1e-4 * np.gradient(x, t))), 0)
    assert not late.material


def test_a_gain_that_wanders_is_unknown_and_the_verdict_says_to_what_it_is_proportional():
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), recordings(1, wandering), effects=["backlash", "drift"])
    assert found.verdict == "unknown"
    assert found.worst.irregular
    assert max(r.share for r in found.worst.ranking if r.fitted) < 0.9
    assert found.worst.excess > 0.1
    assert (
        "has a part in proportion to the position of x_in (input), by a factor that varies within about"
        in found.sentence
    )
    assert "temperature" in str(found)
    assert found.to_dict()["segments"][0]["varies_with"] == found.worst.varies_with


def test_an_effect_that_explains_a_part_of_a_predictable_error_is_not_named():
    records = recordings(1, product)
    found = tsm.diagnose(tsm.load("tendon_sheath_linear"), records, effects=["position_dependent_friction"])
    best = max(r.share for r in found.worst.ranking if r.fitted)
    assert 0.5 < best < 0.8  # it would be named if the rest were noise
    assert found.verdict == "unknown"
    assert found.worst.predictable[0] > 0.1


@pytest.mark.parametrize(
    ("loss", "from_inputs", "share", "varies"),
    [(2.0, False, 0.9, False), (2.5, False, 0.3, True), (2.5, True, 0.3, False), (2.5, True, 0.6, True)],
)
def test_a_factor_varies_only_in_more_than_noise(loss, from_inputs, share, varies):
    """A noise floor of 2: a residual up to a fifth above it may be input noise that was filtered.

    Where noise of the inputs would explain the residual, only a factor that predicts half of it or more is reported.
    """
    part = SimpleNamespace(
        losses=[5.0, loss],
        search=SimpleNamespace(noise=SimpleNamespace(low=2.0)),
        varying=SimpleNamespace(material=True, share=share),
        is_noise_of_inputs=from_inputs,
    )
    assert DiagnosedPart.varies.fget(part) is varies
