"""Metrics by name against closed forms, for one run and for many side by side; and what is no metric."""

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.common.errors import DataError, ParameterError, RunError
from tsmblocks.common.units import UnitError
from tsmblocks.metrics.metrics import Metric, measure, metric, metrics
from tsmblocks.metrics.reductions import REDUCTIONS

T = np.linspace(0.0, 10.0, 100_001)
SIGNALS = {
    "sine": 3.0 * np.sin(2 * np.pi * 0.5 * T),
    "step": 1.0 - np.exp(-T / 0.4),
    "ringing": 1.0 - np.exp(-0.5 * T) * (np.cos(4 * T) + 0.125 * np.sin(4 * T)),
    "ramp": 2.0 * T,
}
UNITS = {
    "x_ref": "rad",
    "x_out": "rad",
    "u": "V",
    "speed": "rad/s",
    "share": "1",
    "odd": "",
    "angle": "deg",
    "motor.i": "A",
}
TOP = math.exp(-0.5 * math.pi / 4)
"""Overshoot of the second-order step response: exp(-decay pi / frequency)."""
CASES = {
    "peak_to_peak(sine)": 6.0,
    "rms(sine)": 3.0 / math.sqrt(2),
    "largest(2 * sine - 1)": 7.0,
    "highest(sine)": 3.0,
    "lowest(sine)": -3.0,
    "mean(sine + 4)": 4.0,
    "final(ramp)": 20.0,
    "integral(ramp)": 100.0,
    "integral(sine**2)": 45.0,
    "variation(sine)": 5 * 12.0,
    "share(abs(sine) > 1.5)": 2 / 3,
    "share(0 < sine <= 1.5)": 1 / 6,
    "share(sine > 5)": 0.0,
    "share(ramp - ramp >= 0)": 1.0,
    "share(ramp - ramp > 0)": 0.0,
    "share(2 <= ramp - ramp + 2 < 3)": 1.0,
    "settling_time(step - 1, 0.02)": 0.4 * math.log(50),
    "settling_time(step - 1, 2)": 0.0,
    "settling_time(ramp, 0.1)": math.inf,
    "rise_time(step, 1)": 0.4 * math.log(9),
    "rise_time(step, 3)": math.inf,
    "rise_time(-step, -1)": 0.4 * math.log(9),
    "overshoot(ringing, 1)": TOP,
    "overshoot(step, 1)": 0.0,
    "overshoot(-ringing, -1)": TOP,
    "overshoot(ringing, target=1)": TOP,
    "overshoot(ringing, after=0, target=1)": TOP,
    "mean(ramp, after=5)": 15.0,
    "mean(ramp, after=2, before=4)": 6.0,
    "rms(sine) / highest(sine)": math.sqrt(0.5),
    "180 / pi * final(ramp, before=1) + max(1, 2)": 360 / math.pi + 2,
}


@pytest.mark.parametrize("text", CASES)
def test_against_the_closed_form(text):
    one = metric(text, dict.fromkeys(SIGNALS, ""))
    assert one(T, SIGNALS) == pytest.approx(CASES[text], rel=2e-4, abs=1e-9)
    assert one.name == one.text == text


def test_every_reduction_has_a_closed_form_here():
    assert {name for name in REDUCTIONS if any(f"{name}(" in text for text in CASES)} == set(REDUCTIONS)


@given(st.sampled_from(list(CASES)), st.integers(1, 5))
def test_many_runs_side_by_side_are_each_as_alone(text, runs):
    one, some = metric(text, dict.fromkeys(SIGNALS, "")), slice(None, None, 200)
    factor = 1.0 + 0.1 * np.arange(runs)
    wide = {k: v[some, None] * factor for k, v in SIGNALS.items()}
    alone = [one(T[some], {k: v[:, j] for k, v in wide.items()}) for j in range(runs)]
    assert one(T[some], wide) == pytest.approx(alone, rel=1e-12)


def test_a_run_that_is_not_finite_has_no_number_and_leaves_the_others_theirs():
    wide = np.stack([SIGNALS["sine"], np.where(T > 5, np.inf, 0.0)], axis=1)
    found = metric("rms(y)", {"y": ""})(T, {"y": wide})
    assert found[0] == pytest.approx(3.0 / math.sqrt(2), rel=1e-4)
    assert np.isnan(found[1])


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("rms(x_ref - x_out)", "rad"),
        ("peak_to_peak(-x_ref)", "rad"),
        ("rms(x_ref) / rms(x_out)", "1"),
        ("rms(x_ref) + 2", "rad"),
        ("2 * rms(x_ref)", ""),
        ("rms(x_ref) * rms(share)", "rad"),
        ("rms(share * x_ref)", "rad"),
        ("rms(x_ref / share)", "rad"),
        ("integral(speed)", "rad"),
        ("integral(x_ref)", "rad*s"),
        ("integral(x_ref**2)", ""),
        ("rms(odd)", ""),
        ("rms(odd - x_ref)", ""),
        ("share(odd > 2)", "1"),
        ("settling_time(odd, 2)", "s"),
        ("overshoot(x_out, 1)", "1"),
        ("max(abs(mean(x_ref)), rms(x_out))", "rad"),
        ("mean(sin(share))", "1"),
        ("mean(sin(odd))", ""),
        ("rms(i)", "A"),
    ],
)
def test_the_unit_of_a_metric(text, unit):
    assert metric(text, UNITS).unit == unit


def test_a_name_may_say_the_unit():
    one = metric("rms(x_ref - x_out)", UNITS, "error [deg]")
    assert (one.name, one.unit) == ("error", "deg")
    assert one(T, {"x_ref": SIGNALS["sine"], "x_out": 0 * T}) == pytest.approx(math.degrees(3 / math.sqrt(2)), rel=1e-4)


def test_metrics_have_the_names_they_are_given():
    assert [m.name for m in metrics({"error": "rms(x_ref - x_out)", "effort": "rms(u)"}, UNITS)] == ["error", "effort"]
    assert [m.name for m in metrics(["rms(u)"], UNITS)] == ["rms(u)"]
    assert metrics("rms(u)", UNITS)[0].signals == ("u",)
    assert [m.name for m in metrics(None, UNITS)] == ["peak-to-peak error", "rms error", "largest error", "effort"]
    assert [m.name for m in metrics(None, {"u": "V"})] == ["effort"]


def test_metrics_of_a_run():
    run = tsm.simulate(tsm.load("fig16_feedforward_feedback"), stop=10.0, step=1e-3)
    error = tsm.tracking_error(run, after=5.0)
    found = measure(
        run,
        {
            "p": "peak_to_peak(x_ref - x_out, after=5)",
            "r": "rms(x_ref - x_out, after=5)",
            "l [deg]": "largest(x_ref - x_out, after=5)",
        },
    )
    assert found == pytest.approx({"p": error.peak_to_peak, "r": error.rms, "l [deg]": math.degrees(error.largest)})
    assert list(measure(run)) == ["peak-to-peak error", "rms error", "largest error", "effort"]


def test_a_target_in_another_unit_is_seen():
    run = tsm.simulate(tsm.load("motor_linear"), stop=0.1, inputs={"u": 12.0})
    said = r"metric 'overshoot\(x, 60\)': the signal does 3\.\d% of the step from 0 to the target 60\. The target is"
    with pytest.warns(UserWarning, match=said):
        assert measure(run, "overshoot(x, 60)") == {"overshoot(x, 60)": 0.0}
    assert measure(run, "overshoot(x, 1)")["overshoot(x, 1)"] > 0.5


def test_a_run_without_the_usual_signals_is_told_how_others_are_named():
    run = tsm.simulate(tsm.load("motor_linear"), stop=0.1, inputs={"u": 12.0})
    with pytest.raises(RunError, match=r"has no signal 'x_ref'.* tracking_error\(run, reference='a', output='b'\)\."):
        tsm.tracking_error(run)


def test_what_others_call_total_variation_is_found():
    t = np.linspace(0.0, 2.0, 2001)
    assert metric("variation(u)", {"u": "V"})(t, {"u": np.sin(2 * np.pi * t)}) == pytest.approx(8.0)
    for word in ("travel", "total_variation"):
        with pytest.raises(ParameterError, match=f"the name '{word}' is not known. Did you mean 'variation'?"):
            metric(f"{word}(u)", {"u": "V"})


def test_no_instant_is_left():
    with pytest.raises(
        DataError,
        match=r"metric 'm': no instant of the run lies between 20 and inf s; it is from "
        r"0 to 10 s",
    ):
        metric("rms(y, after=20)", {"y": ""}, "m")(T, {"y": T})


REFUSED = {
    "x_ref - x_out": "'x_ref' is a signal over time; reduce it to one number, for example by rms(x_ref).",
    "rms(x_rff)": "there is no signal 'x_rff'. Did you mean 'x_ref'?",
    "x_rff + 1": "there is no signal 'x_rff'. Did you mean 'x_ref'?",
    "rsm(x_ref)": "the name 'rsm' is not known. Did you mean 'rms'?",
    "1 + 2": "this does not reduce a signal to a number. Write for example 'rms(x_ref - x_out)'.",
    "rms(2)": "this contains no signal. Write for example 'rms(x_ref - x_out)'.",
    "rms()": "rms takes (signal, after=, before=), the last two being optional.",
    "rms(u, 2)": "rms takes (signal, after=, before=), the last two being optional.",
    "rms(u, after=1, after=2)": "rms takes (signal, after=, before=), the last two being optional.",
    "rms(u, from_=2)": "rms takes (signal, after=, before=), the last two being optional.",
    "overshoot(u)": "overshoot takes (signal, target, after=, before=), the last two being optional.",
    "overshoot(u, 1, target=1)": "overshoot takes (signal, target, after=, before=), the last two being optional.",
    "overshoot(u, band=1)": "overshoot takes (signal, target, after=, before=), the last two being optional.",
    "overshoot(target=1)": "overshoot takes (signal, target, after=, before=), the last two being optional.",
    "share(u)": "share takes a comparison, such as abs(u) > 23.9.",
    "rms(u > 2)": "rms takes a signal.",
    "rms(u) > 2": "this is a comparison, but a number is expected here. "
    "For the share of the time at which it holds, write share(…).",
    "share(u == 2)": "signals are compared by <, <=, > or >=.",
    "rms(rms(u))": "there is no function 'rms'. Known here: abs, cos, exp, log, max, min, sin, sqrt, tan, tanh.",
    "rms(x_ref - u)": "this mixes rad and V.",
    "rms(x_ref - angle)": "this mixes rad and deg.",
    "rms(x_ref) + rms(u)": "this mixes rad and V.",
    "share(x_ref > u)": "this mixes rad and V.",
    "rms(u, after=u)": "a plain number is expected here.",
    "settling_time(u, 1 / 0)": "this is a division by zero.",
    "rms(u) / 0": "this is a division by zero.",
    "ISE(x_ref)": "the name 'ISE' is not known. Write integral(e**2), e being the error, such as x_ref - x_out.",
    "overshoot(u, 5%)": "this cannot be read from here on. 5 % is written 0.05.",
    "rms(u, 2 x_ref)": "this cannot be read from here on.",
    **dict.fromkeys(
        ("settling_time(u, 1deg)", "settling_time(u, 1 deg)", "settling_time(u, 1°)"),
        "this cannot be read from here on. A number has no unit here; it is in that of the signal. "
        "1 deg in rad is pi / 180.",
    ),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_metric(text):
    with pytest.raises(ParameterError) as found:
        metric(text, UNITS)
    first, *shown = str(found.value).split("\n")
    assert first == f"metric: {REFUSED[text]}"
    assert shown[0].strip() == text
    assert set(shown[1].strip()) == {"^"}


def test_what_is_no_list_of_metrics():
    for given_, said in (
        (3, "metrics must be texts such as 'rms(x_ref - x_out)', a list or a mapping of them, got 3."),
        ([], "metrics must be texts such as 'rms(x_ref - x_out)', a list or a mapping of them, got []."),
        ({"a": "rms(u)", "a [V]": "mean(u)"}, "two metrics have the name 'a'."),
    ):
        with pytest.raises(ParameterError) as found:
            metrics(given_, UNITS)
        assert str(found.value) == said


def test_where_no_metric_is_usual_the_example_can_be_typed():
    with pytest.raises(ParameterError) as found:
        metrics(None, {"turn": "rad", "gain.y": "rad"})
    said = (
        "no metrics are given, and the diagram has no 'x_ref' with 'x_out', and no 'u'. Write for example 'rms(turn)'."
    )
    assert str(found.value) == said
    assert metrics("rms(turn)", {"turn": "rad"})


def test_a_unit_that_does_not_fit():
    with pytest.raises(UnitError, match=r"^metric '.*': 'rad' does not convert to 'V'\.$"):
        metric("rms(x_ref)", UNITS, "a [V]")
    with pytest.raises(UnitError, match=r"metric 'a': the unit of '2 \* rms\(x_ref\)' is not known, so it cannot be"):
        metric("2 * rms(x_ref)", UNITS, "a [deg]")


@given(st.text(alphabet="rms(xu_ef) -+*/<>=.,0123 after#", max_size=30))
def test_whatever_is_written_either_reads_or_is_refused(text):
    with contextlib.suppress(ParameterError):
        assert isinstance(metric(text, UNITS), Metric)


def test_time_in_a_metric():
    """The integral of time-weighted absolute error, in closed form for an exponential."""
    t = np.linspace(0.0, 20.0, 20_001)
    one = metric("integral(t * abs(e))", {"e": "rad"})
    assert one.signals == ("e",)
    assert one(t, {"e": -np.exp(-t)}) == pytest.approx(1.0, abs=1e-5)
    several = np.column_stack([np.exp(-t), 2 * np.exp(-t)])
    assert one(t, {"e": several}) == pytest.approx([1.0, 2.0], abs=1e-5)
    assert metric("integral(t * e)", {"e": "rad", "t": "K"}).signals == ("t", "e")  # a signal of that name comes first
    with pytest.raises(ParameterError, match="this contains no signal"):
        metric("integral(t)", {"e": "rad"})
