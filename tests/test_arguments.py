"""When a run begins and ends, and what is kept of it."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsmblocks.blocks import FirstOrderLag, Gain, Sine, StateSpace
from tsmblocks.common.errors import DataError, RunError
from tsmblocks.data import Record
from tsmblocks.model.block import Samples
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.simulation.arguments import TimeGrid, end_time, run_times, step_count
from tsmblocks.simulation.sensitivities import sensitivities
from tsmblocks.simulation.simulate import simulate

SINE = Diagram(blocks=dict(ref=Sine(), k=Gain()), wires=["ref -> k"], outputs={"y": "k"})


@pytest.mark.parametrize(
    ("start", "stop", "h", "steps"),
    [
        (0.0, 1.0, 1e-3, 1000),
        (0.0, 20.0, 1e-3, 20000),
        (0.0, 0.3, 0.1, 3),  # 0.3 / 0.1 is a hair below 3
        (0.0, 1.0, 0.3, 3),
        (0.0, 1.0, 0.6, 1),
        (-1.0, 1.0, 0.25, 8),
        (5.0, 5.0009999, 1e-4, 9),
    ],
)
def test_whole_steps(start, stop, h, steps):
    assert step_count(start, stop, h) == steps


@given(st.integers(1, 10_000_000), st.sampled_from([1e-5, 1e-4, 1e-3, 0.01, 1 / 3, 1 / 7]))
def test_whole_steps_of_a_multiple_are_that_multiple(n, h):
    assert step_count(0.0, n * h, h) == n


def test_a_run_never_goes_beyond_its_end():
    run = simulate(SINE, stop=1.0, step=0.3)
    assert run.t == pytest.approx([0.0, 0.3, 0.6, 0.9])


@pytest.mark.parametrize(
    ("inputs", "stop"),
    [
        ({}, 20.0),
        ({"u": 1.0}, 20.0),
        ({"u": np.sin}, 20.0),
        ({"u": np.zeros(101)}, 1.0),
        ({"u": [0.0] * 51}, 0.5),
        ({"u": ([0.0, 0.7], [0.0, 1.0])}, 0.7),
        ({"u": Samples(np.array([0.0, 0.3]), np.zeros(2))}, 0.3),
        ({"u": ([0.0, 0.705], [0.0, 1.0])}, 0.7),  # on a step
        ({"u": ([0.0, 0.7], [0.0, 1.0]), "v": np.zeros(31), "w": 2.0}, 0.3),
    ],
    ids=str,
)
def test_without_an_end_a_run_lasts_as_long_as_its_inputs(inputs, stop):
    assert end_time(inputs, 0.0, 0.01) == pytest.approx(stop)


def test_times():
    times = run_times({}, 1, 2, 0.25, 2)
    assert times == TimeGrid(1.0, 0.25, 4, 2)
    assert times.grid.tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert times.kept == 3


@pytest.mark.parametrize("every", [1, 2, 3, 7, 1000])
def test_what_is_kept_stands_on_the_grid(every):
    run, whole = simulate(SINE, stop=0.1, every=every), simulate(SINE, stop=0.1)
    assert (run.t == whole.t[::every]).all()
    assert (run["y"] == whole["y"][::every]).all()


# ---- what inputs may be


def lag(unit="rad", **numbers):
    return Diagram(
        title="lag", blocks=dict(g=FirstOrderLag(**numbers)), inputs={"u": Inlet("g", unit)}, outputs={"y": "g"}
    )


T = 0.01 * np.arange(101)
WAVE = np.sin(7.0 * T)


def answer(given, **how):
    return simulate(lag(), inputs={"u": given}, step=0.01, **how)["y"]


def test_a_recording_stands_for_its_signal_of_that_name_in_the_inputs_unit():
    wanted = answer((T, WAVE))
    recording = Record("wave", T, {"u": np.rad2deg(WAVE), "other": T}, {"u": "deg", "other": "s"})
    assert answer(recording) == pytest.approx(wanted, abs=1e-12)
    assert answer(simulate(lag(), inputs={"u": (T, WAVE)}, step=0.01)) == pytest.approx(wanted, abs=1e-12)
    with pytest.raises(DataError, match="there is no signal 'u'"):
        answer(Record("others", T, {"other": T}, {"other": "s"}, "others.csv"))


def test_a_column_of_pandas_brings_its_times():
    slow = answer((2.0 * T, WAVE), stop=1.0)
    assert answer(pd.Series(WAVE, index=2.0 * T), stop=1.0) == pytest.approx(slow, abs=1e-15)
    assert answer(pd.Series(WAVE)) == pytest.approx(answer(WAVE), abs=0)  # rows that are only counted
    ramp = answer((np.array([0.0, 2.0]), np.array([0.0, 1.0])), stop=1.0)
    assert answer(pd.Series([0.0, 1.0], index=[0, 2]), stop=1.0) == pytest.approx(ramp, abs=0)


def test_numbers_of_numpy_are_numbers():
    two = np.float32(2.0)
    for number in (two, np.int64(2), np.array(2), np.array(2.0), 2):
        assert lag(gain=number) == lag(gain=2.0)
        tied = Diagram(blocks=dict(k=Gain(gain="$k")), inputs={"u": "k"}, values={"k": number})
        assert tied.parameters == {"k": 2.0}
        assert tied.with_parameters({"k": number}).parameters == {"k": 2.0}
    with pytest.warns(PendingDeprecationWarning):
        A = np.matrix([[-1.0]])
    assert StateSpace(A=A, B=np.ones((1, 1)), C=[[1]]) == StateSpace(A=((-1.0,),), B=((1.0,),), C=((1.0,),))
    assert simulate(lag(), inputs={"u": two}, stop=np.float32(0.25), step=np.float64(0.125)).t.tolist() == [
        0.0,
        0.125,
        0.25,
    ]


def test_as_many_instants_as_there_are_are_left_out():
    assert run_times({}, 0.0, 1.0, 0.1, 10**30).kept == 1
    assert simulate(SINE, stop=0.01, every=10**30).t.tolist() == [0.0]


def test_one_name_need_not_be_a_list(tmp_path):
    run = simulate(SINE, stop=0.01)
    assert list(run.to_pandas("ref.y")) == ["ref.y"]
    assert run.save(tmp_path / "one.csv", "ref.y").read_text().splitlines()[0] == "t [s],ref.y"
    found = sensitivities(SINE, "k.gain", outputs="y", stop=0.01)
    assert found.jacobian[:, 0, 0] == pytest.approx(run["ref.y"])


def test_a_method_that_is_no_text():
    d = Diagram(title="lag", blocks=dict(s=Sine(), lag=FirstOrderLag()), wires=["s -> lag"])
    with pytest.raises(RunError, match=r"there is no method '\['rk4'\]'"):
        simulate(d, stop=0.1, method=["rk4"])
