"""Recordings in another unit than the model takes them to be in."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Integrator
from tsmblocks.fitting.scale_notes import scale_notes_before

T = 0.01 * np.arange(400)
U = np.sign(np.sin(4 * T)) + 0.5 * np.sin(1.3 * T)


def drive(v="m/s", q="m", u="V"):
    return tsm.Diagram(
        title="drive",
        blocks={"lag": FirstOrderLag(gain=2.0, time_constant=0.05), "way": Integrator()},
        wires=["lag -> way"],
        inputs={"u": tsm.Inlet("lag.u", unit=u)},
        outputs={"v": "lag", "q": "way"},
        output_units={"v": v, "q": q},
    )


def recorded(gain=2.2, **factors):
    """What the drive with other parameters does, some signals multiplied; one with a factor of 0 is not there."""
    true = drive().with_parameters({"lag.gain": gain, "lag.time_constant": 0.06})
    run = tsm.simulate(true, stop=T[-1], step=0.01, inputs={"u": U})
    signals = {"u": U, "v": run["v"], "q": run["q"]}
    factors = {k: factors.get(k, 1.0) for k in signals}
    return tsm.Record("run", T, {k: x * factors[k] for k, x in signals.items() if factors[k]}, {})


def at_other_times(factor):
    record = recorded()
    return tsm.Record("run", factor * T, record.signals, {})


def notes(record, diagram=None):
    return scale_notes_before(diagram or drive(), {"run": record})


LARGER = "times as large as the model gives before the fit, and of the same shape. If"


@pytest.mark.parametrize(
    ("factors", "units", "note"),
    [
        (
            dict(v=0, q=1000.0),
            {},
            f"q is about 1100 {LARGER} q was recorded in mm or u was recorded in kV, give the unit: "
            "map={'q [mm]': 'q'}, or --map 'q [mm]=q'.",
        ),
        (
            dict(q=1e6),
            {},
            f"q is about 1.1e+06 {LARGER} q was recorded in um, give the unit: map={{'q [um]': 'q'}}, or "
            "--map 'q [um]=q'.",
        ),
        (
            dict(u=1000.0),
            {},
            f"v and q are about 0.0011 {LARGER} u was recorded in mV, give the unit: map={{'u [mV]': 'u'}}, or "
            "--map 'u [mV]=u'.",
        ),
        (
            dict(gain=2.0, q=0.02 * 57.3, u=0.02, v=0),
            dict(v="rad/s", q="rad"),
            f"q is about 57 {LARGER} q was recorded in deg, give the unit: map={{'q [deg]': 'q'}}, or "
            "--map 'q [deg]=q'.",
        ),
        (
            dict(gain=2.0, v=9.55),
            dict(v="rad/s", q="rad"),
            f"v is about 9.4 {LARGER} v was recorded in rpm, give the unit: map={{'v [rpm]': 'v'}}, or "
            "--map 'v [rpm]=v'.",
        ),
    ],
)
def test_an_output_of_the_shape_of_the_model_and_another_size_may_be_in_another_unit(factors, units, note):
    assert notes(recorded(**factors), drive(**units)) == [f"run: {note}"]


@pytest.mark.parametrize(
    ("factors", "units"),
    [
        ({}, {}),
        (dict(q=-1000.0), {}),  # of another sign
        (dict(q=100.0), {}),  # no unit is
        (dict(q=57.3), {}),  # no angle
        (dict(q=1000.0), dict(q="", v="")),  # no unit is known
        (dict(gain=2.8, q=0.02 * 57.3, u=0.02, v=0), dict(v="rad/s", q="rad")),  # parameters may be as wrong
    ],
)
def test_no_other_unit_is_guessed_where_none_is_plain(factors, units):
    assert notes(recorded(**factors), drive(**units)) == []


def test_an_output_of_another_shape_has_no_other_unit():
    record = recorded(v=0)
    noise = 1000 * np.random.default_rng(0).standard_normal(len(T))
    assert notes(tsm.Record("run", T, {"u": U, "q": noise}, {})) == []
    few = slice(10)
    assert notes(tsm.Record("run", T[few], {"u": U[few], "q": 1000 * record["q"][few]}, {})) == []


def test_experiments_with_the_same_note_share_it():
    record = recorded(q=1000.0)
    (text,) = scale_notes_before(drive(), {"one": record, "two": record, "good": recorded()})
    assert text.startswith("one and two: q is about 1100 times")


@pytest.mark.parametrize(
    ("factor", "note"),
    [
        (
            1000.0,
            "the samples are 10 s apart, and the slowest time constant of the model is 0.05 s. If its times are in ms, "
            "give the unit: map={'t [ms]': 't'}, or --map 't [ms]=t'.",
        ),
        (
            1e-3,
            "the recording lasts 0.004 s, and the fastest time constant of the model is 0.05 s. If its times are in s, "
            "give the unit: map={'t [s]': 't'}, or --map 't [s]=t'.",
        ),
    ],
)
def test_times_that_hide_all_dynamics_may_be_in_another_unit(factor, note):
    assert f"run: {note}" in notes(at_other_times(factor))


@pytest.mark.parametrize("factor", [0.3, 3.0, 10.0])
def test_slow_and_fast_recordings_are_right(factor):
    assert notes(at_other_times(factor)) == []


def test_fits_comparisons_and_diagnoses_say_it():
    record, some = recorded(v=0, q=1000.0), dict(free=["lag.gain"])
    (note,) = notes(record)
    assert note in tsm.fit(drive(), record, **some).notes
    assert note in tsm.compare([drive()], record, starts=1).notes
    assert note in tsm.diagnose(drive(), record, effects=["backlash"], noise_floor=1e-3, **some).notes


@pytest.mark.filterwarnings("ignore::tsmblocks.simulation.stability.StepWarning")
def test_a_fit_that_cannot_begin_says_that_the_times_may_be_in_another_unit():
    record = recorded()
    long = tsm.Record("run", 1000 * np.arange(4000) * 0.01, {k: np.tile(x, 10) for k, x in record.signals.items()}, {})
    with pytest.raises(tsm.TsmError, match=r"In run the samples are 10 s apart.* If its times are in ms"):
        tsm.fit(drive(), long, step=10.0, starts=1)
