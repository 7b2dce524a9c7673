"""Random diagrams against an independent reference, bounded; ``python -m tests.fuzz differential`` goes on."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks.blocks as B
from tests.fuzz.differential import campaign as campaigns
from tests.fuzz.differential.agreement import Disagreement, check
from tests.fuzz.differential.campaign import campaign
from tests.fuzz.differential.diagrams import Drawn, drawn, nested
from tests.fuzz.differential.equations import LAWS, Equations
from tests.fuzz.differential.methods import reference_run
from tsmblocks.model.block import REGISTRY
from tsmblocks.model.diagram import Diagram

SEED, DIAGRAMS = 1, 24
WITHOUT = {"Random", "SensorNoise", "Enable", "Trigger", "Divide", "Delay", "DeadTime"}
"""Blocks without equations of the reference: noise of a generator, what switches diagrams, and what is delayed."""


def test_random_diagrams_agree_with_the_reference_and_between_ways():
    count = campaign(SEED, diagrams=DIAGRAMS)
    assert count.faults == {}
    assert count.inputs == DIAGRAMS
    assert count.refused < DIAGRAMS / 3


def test_the_reference_knows_nearly_all_blocks():
    ours = {name for name, cls in REGISTRY.items() if cls.__module__.startswith("tsmblocks.")}
    assert ours - set(LAWS) <= WITHOUT
    seen = {type(block).__name__ for seed in range(300) for block in drawn(seed).blocks.values()}
    assert len(seen) > 90


def test_the_same_seed_gives_the_same_diagram_and_nesting_keeps_its_blocks():
    for seed in range(20):
        one, other = drawn(seed), drawn(seed)
        assert one.blocks == other.blocks
        assert one.driver == other.driver
    assert any(isinstance(block, Diagram) for seed in range(5) for block in nested(drawn(seed)).blocks.values())


def lag():
    """A sine through a lag."""
    blocks = {"s": B.Sine(amplitude=1.0, frequency=1.0), "l": B.FirstOrderLag(time_constant=0.1)}
    return Drawn(0, blocks, {("l", "u"): ("s", "y")}, {}, "rk4", True)


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("heun", 2), ("rk4", 4), ("sdirk2", 2), ("sdirk4", 4)])
def test_the_reference_converges_to_the_solution(method, order):
    exact = solve_ivp(lambda t, x: (np.sin(2 * np.pi * t) - x) / 0.1, (0, 0.5), [0.0], rtol=1e-12, atol=1e-13).y[0, -1]
    errors = [
        abs(reference_run(lag().flat(), h, n, {}, method)["l", "y"][-1] - exact) for h, n in ((0.05, 10), (0.025, 20))
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.35)


def test_a_wrong_equation_is_found_and_shrunk(monkeypatch):
    right = LAWS["FirstOrderLag"](B.FirstOrderLag())
    wrong = Equations(right.outputs, {"value": lambda b, t, x, u: 1.0001 * right.rates["value"](b, t, x, u)})
    monkeypatch.setitem(LAWS, "FirstOrderLag", lambda block: wrong)
    made = lag()
    made.blocks["more"], made.driver["more", "u"] = B.Gain(gain=2.0), ("l", "y")
    with pytest.raises(Disagreement, match=r"run against reference: l\.y differs by"):
        check(made, ())
    monkeypatch.setattr(campaigns, "drawn", lambda seed: made)
    count = campaign(SEED, diagrams=1)
    ((fault, text),) = count.faults.items()
    assert fault.startswith("run against reference: l.y differs by")
    assert "more" not in text
    assert "seed 0, rk4" in text
