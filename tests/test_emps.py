"""EMPS, a measured ball-screw axis: the published figures to their last digit, and the same found in other ways."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

import tsmblocks as tsm
from tsmblocks.blocks import Gain, ZeroOrderHold
from tsmblocks.fitting.experiments import grid_step

EXAMPLE = Path(__file__).parents[1] / "examples" / "20_emps.py"
PUBLISHED = {"mass": 95.1089, "viscous": 203.5034, "dry": 20.3935, "offset": -3.1648}
SPREAD = {"mass": 0.5, "viscous": 3.0, "dry": 0.4, "offset": 0.1}
"""What is allowed between one procedure and another: of the mass half a percent, of friction two."""


@pytest.fixture(scope="module")
def example(measured):
    """Everything the example computes, by name."""
    return runpy.run_path(str(EXAMPLE))


def values(fit, names):
    return dict(zip(PUBLISHED, (fit[name].value for name in names), strict=True))


def test_the_published_procedure_gives_the_published_digits(example):
    one, two, thin = (example[k] for k in ("one_level", "two_levels", "decimated"))
    assert [len(record) for record in thin] == [2480, 2480]
    found = values(one, ("mass.gain", "forwards.gain", "dry.gain", "offset.bias"))
    assert found == pytest.approx(PUBLISHED, abs=6e-5)
    fitted, pulses = (100 * d.relative for d in tsm.score(one.diagram, thin))
    assert (fitted, pulses) == pytest.approx((4.083, 5.982), abs=6e-4)
    assert two["forwards.gain"].value == pytest.approx(166.71, abs=0.006)
    assert two["backwards.gain"].value == pytest.approx(240.42, abs=0.006)
    assert 100 * two.differences["force"].relative == pytest.approx(3.112, abs=6e-4)


def test_the_fit_is_the_least_squares_solution(example):
    """An independent one: a matrix of columns, solved by NumPy."""
    record = example["decimated"][0]
    columns = [record["acceleration"], record["v_forwards"] + record["v_backwards"], record["direction"]]
    exact = np.linalg.lstsq(np.column_stack([*columns, np.ones(len(record))]), record["force"], rcond=None)[0]
    found = values(example["one_level"], ("mass.gain", "forwards.gain", "dry.gain", "offset.bias"))
    assert list(found.values()) == pytest.approx(list(exact), rel=1e-8)


def test_intervals_hold_what_other_ways_find(example):
    """Residuals are coloured: the textbook's intervals would be many times narrower than the spread between ways."""
    names = {"mass.gain": "mass.value", "forwards.gain": "viscous.coefficient", "dry.gain": "dry.level"}
    for summed, looped in names.items():
        estimate = example["one_level"][summed]
        assert estimate.low < example["simulated"][looped].value < estimate.high


def test_the_loop_simulated_beside_the_raw_force(example):
    fit = example["simulated"]
    found = values(fit, ("mass.value", "viscous.coefficient", "dry.level", "offset.value"))
    assert fit.status == "converged"
    assert found == pytest.approx({"mass": 95.18, "viscous": 205.64, "dry": 20.29, "offset": -3.167}, rel=1e-3)
    for name, value in PUBLISHED.items():
        assert abs(found[name] - value) < SPREAD[name]
    fitted, pulses = (100 * d.relative for d in tsm.score(fit.diagram, example["raw"], **example["sampled"]))
    assert (fitted, pulses) == pytest.approx((4.28, 5.05), abs=0.01)


def test_the_tools_of_a_record_give_the_same_axis(example):
    """Differentiated by splines, ends cut, thinned with our own low-pass: another way to the same numbers."""
    thin = []
    for record in example["raw"]:
        own = record.differentiated("qm", cutoff=100.0, name="v")
        own = own.differentiated("qm", 2, cutoff=100.0, name="acceleration")
        own = own.with_signal("v_forwards", np.maximum(own["v"], 0)).with_signal("direction", np.sign(own["v"]))
        own = own.with_signal("v_backwards", np.minimum(own["v"], 0))
        thin.append(own.part(0.2, own.t[-1] - 0.2).resampled(0.01))
    fit = tsm.fit(example["terms"], thin[0], ties={"backwards.gain": "forwards.gain"})
    found = values(fit, ("mass.gain", "forwards.gain", "dry.gain", "offset.bias"))
    for name, value in PUBLISHED.items():
        assert abs(found[name] - value) < SPREAD[name]
    fitted, pulses = (100 * d.relative for d in tsm.score(fit.diagram, thin))
    assert 3.7 < fitted < 4.09  # a little less of the noise passes 35 Hz than the published 40 Hz
    assert 5.3 < pulses < 5.99


def test_the_ends_of_the_record_are_not_what_decides(example):
    """The published filters with 0.2 s cut at both ends, where filters ring."""
    found, errors = [], []
    for record in example["raw"]:
        q = signal.filtfilt(*signal.butter(4, 100.0, fs=1000.0), record["qm"])
        v = np.gradient(q, 1e-3)
        x = np.column_stack([np.gradient(v, 1e-3), v, np.sign(v), np.ones_like(v), record["force"]])
        x = signal.filtfilt(*signal.cheby1(8, 0.05, 0.08), x[200:-200], axis=0)[::10]
        found.append(found[0] if found else np.linalg.lstsq(x[:, :4], x[:, 4], rcond=None)[0])
        errors.append(100 * np.linalg.norm(x[:, 4] - x[:, :4] @ found[-1]) / np.linalg.norm(x[:, 4]))
    assert found[0] == pytest.approx([95.117, 203.8, 20.36, -3.18], rel=2e-3)
    assert errors == pytest.approx([4.03, 5.95], abs=0.02)


@pytest.mark.parametrize("step", [1e-3, None])
@pytest.mark.parametrize("samples", [400, 5000, 14000])
def test_times_kept_in_single_precision_do_not_delay_a_held_input(step, samples):
    """As in these files: instants some millionths of a step early or late must not fetch the sample before."""
    t = np.float32(1e-3 * np.arange(samples))
    assert np.abs(t - 1e-3 * np.arange(samples)).max() > 1e-9
    u = np.random.default_rng(0).normal(size=samples)
    held = tsm.Diagram(
        title="held",
        blocks={"hold": ZeroOrderHold(period=1e-3), "gain": Gain(gain=2.0)},
        wires=["hold -> gain"],
        inputs={"u": "hold.u"},
        outputs={"y": "gain"},
    )
    record = tsm.Record("single precision", t.astype(float), {"u": u, "y": 2.0 * u}, {})
    assert tsm.score(held, record, hold="zero", step=step).rms < 1e-12


@given(st.floats(1e-6, 1e3), st.integers(4, 3000), st.floats(-10, 10))
def test_the_step_of_an_even_record_is_as_close_as_its_instants_tell(step, samples, start):
    """Rounding the step to few digits must not move the instants further than their own rounding did."""
    t = start + step * np.arange(samples)
    found = grid_step(t)
    assert np.abs(t - t[0] - found * np.arange(samples)).max() <= 1e-14 * np.abs(t).max() + 1e-15 * step


def test_a_step_of_many_digits_is_kept():
    assert grid_step(0.0123456789012 * np.arange(900)) == pytest.approx(0.0123456789012, rel=1e-15)
    assert grid_step(np.arange(900) / 3.0) == pytest.approx(1 / 3, rel=1e-15)
