"""What a model before its fit shows of recordings: another unit, times in another unit, growth; and few samples."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain, Integrator, Sum
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


# ---- growth, and few samples


def inverted(stiffness):
    """An axis with a spring that pushes outward; its poles are the roots of the stiffness."""
    return tsm.Diagram(
        title="inverted",
        blocks={"sum": Sum(signs="++"), "speed": Integrator(), "way": Integrator(), "spring": Gain(gain=stiffness)},
        wires=["sum -> speed -> way -> spring -> sum.plus2"],
        inputs={"u": tsm.Inlet("sum.plus1", unit="m/s^2")},
        outputs={"q": "way"},
        output_units={"q": "m"},
    )


GROWS = "run: with its parameters before the fit the model diverges: "


def swing():
    return tsm.Record("run", T, {"u": U, "q": 0.3 * np.sin(3 * T)}, {"u": "m/s^2", "q": "m"})


def test_a_model_that_grows_beyond_what_was_measured_is_named_with_its_state_and_the_time():
    (note,) = notes(swing(), inverted(1600.0))
    assert note.startswith(f"{GROWS}from t = 0.")
    assert "q is beyond 1000 times its measured range, since speed.integral grows by a pole of 40 1/s. Correct" in note
    assert note in tsm.fit(inverted(1600.0), swing(), free=["spring.gain"], bounds={"spring.gain": (900, None)}).notes


def test_a_model_that_overflows_is_named_with_its_block():
    (note,) = notes(swing(), inverted(4e4))
    assert note.startswith(GROWS)
    assert " = inf at t = " in note or "diverges. One step before" in note


@pytest.mark.parametrize("stiffness", [-1600.0, 0.0, 0.01, 1.0])
def test_a_model_that_stays_near_what_was_measured_is_not_said_to_diverge(stiffness):
    assert notes(swing(), inverted(stiffness)) == []


def test_a_good_fit_says_nothing_of_where_it_began():
    record = tsm.simulate(inverted(-1600.0), stop=4.0, step=0.01, inputs={"u": np.append(U, 0.0)})
    record = tsm.Record("run", T, {"u": U, "q": record["q"][:-1]}, {"u": "m/s^2", "q": "m"})
    fitted = tsm.fit(inverted(1600.0), record, free=["spring.gain"], bounds={"spring.gain": (-2000, 2000)})
    assert fitted["spring.gain"].value == pytest.approx(-1600, rel=1e-2)
    assert not [text for text in fitted.notes if text.startswith(GROWS)]


@pytest.mark.parametrize(("samples", "noted"), [(5, True), (20, False)])
def test_few_samples_for_the_parameters_are_noted(samples, noted):
    few = slice(samples)
    record = recorded(v=0)
    record = tsm.Record("run", T[few], {k: record[k][few] for k in record.names}, {})
    found = tsm.fit(drive(), record, free=["lag.gain", "lag.time_constant"], starts=1).notes
    assert noted == any(text.startswith("5 samples are few for 2 parameters: ") for text in found)
