"""When a run begins and ends, and what is kept of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsmblocks.arguments import Times, resolve_stop, run_times, whole_steps
from tsmblocks.block import Samples
from tsmblocks.blocks import Gain, Sine
from tsmblocks.diagram import Diagram
from tsmblocks.simulate import simulate

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
    assert whole_steps(start, stop, h) == steps


@given(st.integers(1, 10_000_000), st.sampled_from([1e-5, 1e-4, 1e-3, 0.01, 1 / 3, 1 / 7]))
def test_whole_steps_of_a_multiple_are_that_multiple(n, h):
    assert whole_steps(0.0, n * h, h) == n


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
    assert resolve_stop(inputs, 0.0, 0.01) == pytest.approx(stop)


def test_times():
    times = run_times({}, 1, 2, 0.25, 2)
    assert times == Times(1.0, 0.25, 4, 2)
    assert times.grid.tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert times.kept == 3


@pytest.mark.parametrize("every", [1, 2, 3, 7, 1000])
def test_what_is_kept_stands_on_the_grid(every):
    run, whole = simulate(SINE, stop=0.1, every=every), simulate(SINE, stop=0.1)
    assert (run.t == whole.t[::every]).all()
    assert (run["y"] == whole["y"][::every]).all()
