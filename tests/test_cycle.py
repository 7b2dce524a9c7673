"""One cycle at a time, on arrays that are made once: the same numbers as a run, without allocation, and quickly."""

import time
import tracemalloc

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Delay, DiscretePID, Divide, FirstOrderLag, Gain, Sum, UnitDelay
from tsmblocks.common.errors import NotFinite

H = 0.01
U = np.random.default_rng(3).normal(size=(300, 2))


def loop():
    """Continuous, sampled and delayed parts, two inputs, and two outputs that show one signal."""
    blocks = {
        "e": Sum(signs="+-"),
        "pid": DiscretePID(period=0.03, kp=2.0, ki=1.0, low=-3.0, high=3.0),
        "late": Delay(time=0.025),
        "plant": FirstOrderLag(gain=2.0, time_constant=0.3),
        "total": Sum(signs="++"),
        "hold": UnitDelay(period=0.02),
    }
    wires = ["e -> pid -> late -> total.plus1", "total -> plant -> e.minus, hold"]
    outputs = {"y": "plant", "held": "hold", "u": "pid", "again": "plant"}
    inputs = {"r": "e.plus", "load": "total.plus2"}
    return tsm.Diagram(title="loop", blocks=blocks, wires=wires, inputs=inputs, outputs=outputs)


def cycled(cycle, rows):
    made = []
    for row in rows:
        cycle.u[:] = row
        cycle()
        made.append(cycle.y.copy())
    return np.array(made)


@pytest.mark.parametrize("backend", ["", "casadi"])
@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_cycles_are_a_run_with_inputs_held(backend, method):
    stepper = tsm.Stepper(loop(), step=H, method=method, backend=backend)
    t = H * np.arange(len(U))
    inputs = {"r": (t, U[:, 0]), "load": (t, U[:, 1])}
    run = tsm.simulate(loop(), inputs=inputs, stop=t[-1], step=H, hold="zero", method=method, backend=backend)
    rows = cycled(stepper.cycle(), U)
    assert stepper.inputs == ("r", "load")
    assert stepper.outputs == ("y", "held", "u", "again")
    assert np.abs(rows - np.column_stack([run[name] for name in stepper.outputs])).max() < 1e-13
    assert stepper.t == pytest.approx(H * len(U))


def test_a_cycle_continues_from_a_restored_state():
    stepper = tsm.Stepper(loop(), step=H)
    cycle = stepper.cycle()
    cycled(cycle, U[:100])
    saved = stepper.save()
    first = cycled(cycle, U[100:200])
    stepper.restore(saved)
    assert np.array_equal(cycled(cycle, U[100:200]), first)


def test_a_cycle_allocates_nothing():
    cycle = tsm.Stepper(loop(), step=H).cycle()
    for _ in range(10):
        cycle()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        cycle()
    left, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert left - before < 2000  # a counter or two, no array for each cycle
    assert most - before < 5000


def test_a_cycle_takes_microseconds():
    cycle = tsm.Stepper(tsm.load("fig16_feedforward_feedback"), step=1e-3).cycle()
    took = []
    for _ in range(20):
        begin = time.perf_counter()
        for _ in range(500):
            cycle()
        took.append((time.perf_counter() - begin) / 500)
    assert min(took) < 10e-6  # 2 µs on a quiet machine; the step that returns a dict takes 60


def test_an_output_that_is_not_finite_is_refused_at_its_cycle():
    blocks = {"one": Gain(gain=1.0), "ratio": Divide()}
    d = tsm.Diagram(
        title="ratio",
        blocks=blocks,
        wires=["one -> ratio.num"],
        inputs={"a": "one", "b": "ratio.den"},
        outputs={"q": "ratio"},
    )
    cycle = tsm.Stepper(d, step=H).cycle()
    cycle.u[:] = 1.0, 2.0
    cycle()
    assert cycle.y[0] == 0.5
    cycle.u[1] = 0.0
    with pytest.raises(NotFinite, match=r"ratio\.y of 'ratio' is not finite at t = 0\.01 s"):
        cycle()


def test_a_repeated_run_computes_neither_structure_nor_poles_again(monkeypatch):
    """What a call costs besides its steps is paid once for a diagram."""
    from tsmblocks.simulation import compiled, stability

    diagram = tsm.load("fig16_feedforward_feedback")
    first = tsm.simulate(diagram, stop=0.01)

    def again(*_):
        pytest.fail("computed again")

    monkeypatch.setattr(compiled, "signature", again)
    monkeypatch.setattr(stability, "_jacobian_at", again)
    assert np.array_equal(tsm.simulate(diagram, stop=0.01).rows, first.rows)
