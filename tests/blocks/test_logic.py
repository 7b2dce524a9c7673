"""Logic blocks against truth tables and closed forms; a ball and a thermostat made of blocks."""

import itertools
import math

import numpy as np
import pytest

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound, refuses, value
from tsmblocks.blocks import Comparison, Constant, Gain, Integrator, Logic, Ramp, Sine, StateMachine, TriggeredHold

THERMOSTAT = StateMachine(
    modes=("heat", "rest"), signals=("temp",), transitions=("heat -> rest: temp > 1", "rest -> heat: temp < 0.5")
)


@pytest.mark.parametrize(
    "block",
    [
        Comparison(),
        *(Comparison(sign=sign, level=0.3) for sign in (">=", "<", "<=")),
        *(Logic(operation=one, n=3) for one in ("and", "or", "xor", "nand", "nor")),
        Logic(operation="not", n=1),
        TriggeredHold(),
        StateMachine(),
        THERMOSTAT,
        Integrator(reset=True, target=True, enable=True),
    ],
    ids=lambda block: type(block).__name__,
)
def test_sound(block):
    assert_sound(block)


@pytest.mark.parametrize(
    ("sign", "expected"), [(">", [0, 0, 1]), (">=", [0, 1, 1]), ("<", [1, 0, 0]), ("<=", [1, 1, 0])]
)
def test_comparison(sign, expected):
    assert [value(Comparison(sign=sign, level=2.0), u=u)["y"] for u in (1.0, 2.0, 3.0)] == expected


@pytest.mark.parametrize(
    ("operation", "of"),
    [
        ("and", all),
        ("or", any),
        ("xor", lambda given: sum(given) % 2 == 1),
        ("nand", lambda given: not all(given)),
        ("nor", lambda given: not any(given)),
    ],
)
def test_truth_tables(operation, of):
    for given in itertools.product([0.0, 1.0], repeat=3):
        inputs = dict(zip(("u1", "u2", "u3"), given, strict=True))
        assert value(Logic(operation=operation, n=3), **inputs)["y"] == float(of([v > 0.5 for v in given]))


def test_a_value_is_taken_as_the_trigger_rises():
    blocks = {"r": Ramp(slope=1.0), "s": Sine(frequency=0.5), "hold": TriggeredHold(initial=-1.0)}
    d = tsm.Diagram(title="hold", blocks=blocks, wires=["r -> hold.u", "s -> hold.trigger"], outputs={"y": "hold"})
    run = tsm.simulate(d.with_parameters({"s.amplitude": 1.0}), stop=5.0, step=0.01, locate=True)
    rises = [math.asin(0.5) / math.pi + 2.0 * k for k in range(3)]
    expected = np.select([run.t <= rises[0], run.t <= rises[1], run.t <= rises[2]], [-1.0, *rises[:2]], rises[2])
    assert np.abs(run["y"] - expected).max() < 1e-9


def ball():
    """A bouncing ball of elementary blocks: both integrators are set back as it goes through the ground."""
    blocks = {
        "g": Constant(value=-9.81),
        "v": Integrator(reset=True, target=True),
        "h": Integrator(integral=1.0, reset=True, target=True),
        "low": Comparison(sign="<="),
        "down": Comparison(sign="<"),
        "hit": Logic(operation="and"),
        "back": Gain(gain=-0.9),
        "ground": Constant(value=0.0),
    }
    wires = ["g -> v.u", "v -> h.u, down, back", "h -> low", "low -> hit.u1", "down -> hit.u2"]
    wires += ["hit -> v.reset, h.reset", "back -> v.to", "ground -> h.to"]
    return tsm.Diagram(title="ball", blocks=blocks, wires=wires, outputs={"y": "h"})


def test_a_ball_of_blocks_bounces_in_closed_form():
    run = tsm.simulate(ball(), stop=3.0, step=0.01, locate=True)
    speed, g = math.sqrt(2 * 9.81), 9.81
    impacts, speeds = [speed / g], [0.9 * speed]
    while impacts[-1] < 3.0:
        impacts.append(impacts[-1] + 2 * speeds[-1] / g)
        speeds.append(0.9 * speeds[-1])
    k = np.searchsorted(impacts, run.t, side="right") - 1
    since, v = run.t - np.array(impacts)[k], np.array(speeds)[k]
    exact = np.where(k < 0, 1 - g * run.t**2 / 2, v * since - g * since**2 / 2)
    assert np.abs(run["y"] - exact).max() < 1e-9


def test_an_integrator_is_held_while_off():
    blocks = {"one": Constant(value=1.0), "w": Sine(amplitude=1.0, frequency=0.5), "i": Integrator(enable=True)}
    d = tsm.Diagram(title="held", blocks=blocks, wires=["one -> i.u", "w -> i.enable"], outputs={"y": "i"})
    run = tsm.simulate(d, stop=2.0, step=0.01, locate=True)
    assert run["y"][-1] == pytest.approx(2.0 / 3.0, abs=1e-9)  # a sine is above a half for a third of its period


def test_a_thermostat_cycles_at_the_analytic_instants():
    """Heated towards 2 at rate 1/s, cooled towards 0: from 0.5 to 1 takes ln 1.5, back ln 2."""
    blocks = {"lag": tsm.blocks.FirstOrderLag(time_constant=1.0, value=0.5), "m": THERMOSTAT, "power": Gain(gain=2.0)}
    wires = ["lag -> m.temp", "m.heat -> power -> lag"]
    d = tsm.Diagram(title="thermostat", blocks=blocks, wires=wires, outputs={"mode": "m.mode", "since": "m.since"})
    run = tsm.simulate(d, stop=5.0, step=0.01, locate=True)
    period = math.log(1.5) + math.log(2.0)
    place = run.t % period
    clear = (np.abs(place - math.log(1.5)) > 1e-6) & (place > 1e-6)
    assert np.array_equal(run["mode"][clear], (place > math.log(1.5))[clear].astype(float))
    since = np.where(place > math.log(1.5), place - math.log(1.5), place)
    assert np.abs(run["since"] - since)[clear].max() < 1e-8


def test_a_mode_is_left_after_a_time_and_the_first_transition_counts():
    machine = StateMachine(
        modes=("a", "b", "c"),
        signals=(),
        transitions=("a -> b: since > 0.5", "a -> c: since > 0.1", "b -> a: since > 1"),
    )
    d = tsm.Diagram(title="timed", blocks={"m": machine}, wires=[], outputs={"mode": "m.mode", "c": "m.c"})
    run = tsm.simulate(d, stop=2.0, step=0.01, locate=True)
    assert run["mode"][5] == 0.0
    assert run["mode"][-1] == 2.0
    assert run["c"][-1] == 1.0


@pytest.mark.parametrize(
    ("message", "values"),
    [
        ("StateMachine: 'on' is no transition. Write 'off -> on: u > 1'.", dict(transitions=("on",))),
        (
            "StateMachine: transition 'off -> onn: u > 1': there is no mode 'onn'. Did you mean 'on'?",
            dict(transitions=("off -> onn: u > 1",)),
        ),
        ("StateMachine: the name 'off' is taken already. Choose another.", dict(modes=("off", "off"))),
        ("StateMachine: the name 'since' is taken already. Choose another.", dict(signals=("since",))),
        ("StateMachine.active is the number of a mode, 0 to 1, got 2.", dict(active=2.0)),
        ("StateMachine needs at least one mode.", dict(modes=(), transitions=())),
    ],
)
def test_machines_that_are_refused(message, values):
    refuses(message, StateMachine, **values)


def test_what_else_is_refused():
    refuses("Logic: 'not' takes one input, so n=1, got n=2.", Logic, operation="not")
    refuses("Integrator: target=True gives the value of a reset, so it needs reset=True.", Integrator, target=True)
