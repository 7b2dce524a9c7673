"""Wrong readings, slow noise and motion at rest, which are no model errors."""

from __future__ import annotations

from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

import tsmblocks as tsm
from tests.test_evidence import DEG, SIGMA, STEP, motion
from tsmblocks.blocks import Bias, Gain, SecondOrderLag
from tsmblocks.diagnosis.outliers import isolated_outliers, outlier_notes, share_of_outliers, without_outliers
from tsmblocks.model.diagram import Diagram

SLOW_NEEDS = ["diagnosis", "data"]
GAIN = Diagram(
    title="gain and zero",
    blocks={"gain": Gain(gain=0.9), "zero": Bias(bias=0.0)},
    wires=["gain -> zero"],
    inputs={"x_in": "gain"},
    outputs={"x_out": "zero"},
)


def records(seed, slow=0.0, share=0.0):
    """Recordings of a gain with slow noise (5 s) beside white noise, and a share of wrong readings."""
    draw, result, a = np.random.default_rng(seed), [], np.exp(-STEP / 5.0)
    for k in range(4):
        t, x = motion(100 * seed + k)
        y = 0.9 * x + SIGMA * draw.standard_normal(len(t))
        y += slow * SIGMA * lfilter([np.sqrt(1 - a * a)], [1, -a], draw.standard_normal(len(t) + 2000))[2000:]
        y += 30 * SIGMA * draw.standard_normal(len(t)) * (draw.random(len(t)) < share)
        result.append(tsm.Record(f"run {k}", t, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"}))
    return result


# ---- outliers of a residual


@given(st.integers(0, 10_000), st.integers(50, 500))
def test_normal_noise_has_next_to_no_outliers(seed, n):
    r = np.random.default_rng(seed).standard_normal(n)
    assert (without_outliers(r) != r).mean() < 0.03
    assert share_of_outliers([r]) < 0.45  # one sample of five standard deviations among fifty


def test_single_wrong_readings_are_isolated_and_bursts_are_not():
    r = np.random.default_rng(1).standard_normal(1000)
    r[[100, 300, 301, 302, 700]] = 40.0
    assert np.flatnonzero(isolated_outliers(r) & (np.abs(r) > 10)).tolist() == [100, 700]
    assert share_of_outliers([r, r]) == pytest.approx(share_of_outliers([r]))


def test_a_constant_has_no_outliers():
    assert share_of_outliers([np.ones(50)]) == 0.0
    assert share_of_outliers([np.zeros(50)]) == 0.0


def test_readings_a_quantum_apart_are_no_outliers():
    """Of noise that is half a quantum most readings are the same: those beside them were called wrong."""
    draw, quantum = np.random.default_rng(2), 0.1
    small = 0.05 * quantum * np.sin(0.1 * np.arange(4000))
    r = quantum * np.round(0.5 * draw.standard_normal(4000)) - small
    assert isolated_outliers(r).mean() > 0.05
    assert not isolated_outliers(r, 3 * quantum).any()
    y = r + small + quantum * (np.arange(4000) // 200)
    run = SimpleNamespace(measured=y[:, None], t=0.01 * np.arange(4000), name="run")
    problem = SimpleNamespace(segments=[slice(0, 4000)], weights=[10.0])
    model = SimpleNamespace(setup=SimpleNamespace(outputs=["y"], experiments=[run]), problem=problem, r=10.0 * r)
    assert outlier_notes(model) == []
    run.measured = run.measured + 1e-3 * draw.standard_normal((4000, 1))  # read in finer steps, it has outliers
    (note,) = outlier_notes(model)
    assert "of y" in note


def test_wrong_readings_are_no_model_error():
    """They make the residual three times the noise floor, and a note counts them."""
    found = tsm.diagnose(GAIN, records(1, share=0.008), effects=["jump", "offset", "odd_nonlinearity"])
    assert found.verdict == "none"
    notes = [text for text in found.notes if "wrong readings" in text]
    assert [text.endswith("without weight.") for text in notes] == [True, False]
    assert all("of x_out" in text and "s of run " in text for text in notes)


@pytest.mark.slow
def test_slow_noise_is_no_effect_of_time():
    """Noise whose correlation time is a fifth of a recording wanders; one set in twelve may pass for an effect."""
    effects = ["jump", "drift", "offset", "parameter_change"]
    verdicts = [tsm.diagnose(GAIN, records(seed, slow=1.0), effects=effects).verdict for seed in range(12)]
    assert verdicts.count("none") >= 11


@pytest.mark.slow
def test_a_jump_that_is_larger_than_slow_noise_is_named():
    given = records(3, slow=0.4)
    late = given[0]["x_out"] + 0.6 * DEG * (given[0].t > 9.0)
    worn = [attrs.evolve(given[0], signals={**given[0].signals, "x_out": late}), *given[1:]]
    found = tsm.diagnose(GAIN, worn, effects=["jump", "drift", "offset", "parameter_change"])
    assert [e.name for e in found.effects] == ["jump"]


# ---- noise at rest


def ringing(seed):
    """A stage that rings after steps, with long rests: by its closed form, half a period of the noise apart."""
    draw, t = np.random.default_rng(seed), np.arange(0.0, 6.0, 0.004)
    omega, zeta, u, y = 60.0, 0.02, np.zeros(len(t)), np.zeros(len(t))
    damped = omega * np.sqrt(1 - zeta**2)
    for start, size in zip((0.5, 2.5, 4.5), draw.uniform(0.5, 1.5, 3) * draw.choice([-1, 1], 3), strict=True):
        at = np.maximum(t - start, 0.0)
        u += size * (t >= start - 1e-9)
        swing = np.cos(damped * at) + zeta * omega / damped * np.sin(damped * at)
        y += size * (1 - np.exp(-zeta * omega * at) * swing)
    y += 0.004 * draw.standard_normal(len(t))
    return tsm.Record(f"run{seed}", t, {"u": u, "y": y}, {"u": "V", "y": "V"})


def test_what_rings_at_rest_is_no_noise():
    stage = Diagram(
        title="stage",
        blocks={"stage": SecondOrderLag(omega=55.0, zeta=0.03)},
        inputs={"u": "stage"},
        outputs={"y": "stage"},
    )
    found = tsm.diagnose(stage, [ringing(1), ringing(2)], effects=["backlash", "dead_time"])
    (gap,) = found.segments[0].gaps
    assert gap.noise_floor == pytest.approx(0.004, rel=0.2)
    assert found.verdict == "none"
