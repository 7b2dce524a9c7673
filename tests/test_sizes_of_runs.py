"""What a run would take is measured before it is made; nothing is made that a run does not need."""

import tracemalloc

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import DeadTime
from tsmblocks.common import memory
from tsmblocks.common.errors import RunError
from tsmblocks.engine.inputs import EvenInstants
from tsmblocks.simulation.arguments import TimeGrid


@pytest.fixture
def little(monkeypatch):
    """A machine with 200 MB."""
    monkeypatch.setattr(memory, "free_memory", lambda: 2e8)


def motor(**options):
    return tsm.simulate(tsm.load("motor_linear"), **{"inputs": {"u": 1.0}, "step": 1e-3} | options)


def test_a_long_run_of_which_little_is_kept_takes_little():
    """Twenty million steps: 160 MB of times alone, which no part of this run needs; inputs are made by pieces."""
    motor(stop=0.01)
    tracemalloc.start()
    try:
        run = motor(stop=20_000.0, every=10_000_000, log="outputs")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert list(run.t) == [0.0, 10_000.0, 20_000.0]
    assert peak < 1e8


def test_a_run_is_refused_before_it_begins(little):
    with pytest.raises(
        RunError, match=r"logging 10,000,001 instants of \d signals would take .* MB of memory, and 200"
    ):
        motor(stop=10_000.0)
    with pytest.raises(RunError, match=r"the times of 20,000,001 steps would take 320 MB of memory, and 200 MB"):
        motor(stop=20_000.0, every=10_000_000, inputs={"u": np.broadcast_to(1.0, 20_000_001)})


def test_a_batch_is_refused_before_it_begins(little):
    motor = tsm.load("motor_linear")
    with pytest.raises(RunError, match="the results of 5,000 runs would take"):
        tsm.simulate_batch(motor, {"motor.K": np.linspace(1, 2, 5000)}, stop=2.0, inputs={"u": 1.0})
    with pytest.raises(RunError, match="the run of 20,000,000 steps would take"):
        tsm.simulate_batch(motor, {"motor.K": [1.0, 2.0]}, stop=20_000.0, every=1000, inputs={"u": 1.0})


def test_the_past_of_long_delays_is_measured(little):
    delays = {f"d{k}": DeadTime(time=50_000.0) for k in range(3)}
    diagram = tsm.Diagram(title="d", blocks=delays, wires=["d0 -> d1 -> d2"], inputs={"u": "d0"}, outputs={"y": "d2"})
    with pytest.raises(RunError, match=r"the past of 3 delayed signals would take .* GB of memory"):
        tsm.simulate(diagram, stop=1.0, step=1e-3, inputs={"u": 1.0})


@pytest.mark.parametrize("every", [1, 3, 7])
def test_instants_are_the_same_numbers_however_they_are_made(every):
    times = TimeGrid(0.7, 1e-3, 1000, every)
    assert np.array_equal(times.kept_instants, times.grid[::every])
    instants = EvenInstants(0.7, 1e-3, 1001)
    assert [instants[k] for k in (0, 1, 500, -1)] == [np.asarray(instants)[k] for k in (0, 1, 500, -1)]
    assert len(instants) == 1001
