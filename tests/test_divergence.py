"""The block that a run names as the one that diverges: by construction the cause is known."""

import casadi as ca
import pytest
from tsmblocks.block import Block, Input, Output, block, parameter, state

import tsmblocks as tsm
from tsmblocks.blocks import Constant, DiscreteTransferFunction, FirstOrderLag, Integrator, Sum, Tanh
from tsmblocks.common.errors import NotFinite
from tsmblocks.simulation.stability import StepWarning


@block(register=False)
class Doubling(Block):
    """Memory that grows without bound behind an output that stays bounded."""

    u = Input("input")
    y = Output("output")
    m: float = state(default=1.0, about="memory")

    def updates(self, t, x, u):
        return dict(m=2.0 * x.m * x.m + u.u)

    def outputs(self, t, x, u):
        return dict(y=ca.tanh(x.m))


@block(register=False)
class Lost(Block):
    """A state that is reset to the root of a negative number at some time."""

    at: float = parameter(default=0.0, about="time of the reset")
    y = Output("output")
    level: float = state(default=2.0, about="level")

    def derivatives(self, t, x, u):
        return dict(level=0.0)

    def updates(self, t, x, u):
        return dict(level=ca.if_else(t >= self.at, ca.sqrt(-x.level), x.level))

    def outputs(self, t, x, u):
        return dict(y=x.level)


@block(register=False)
class Escape(Block):
    """x' = x^2 + u."""

    u = Input("input")
    y = Output("output")
    x: float = state(default=1.0, about="state")

    def derivatives(self, t, x, u):
        return dict(x=x.x**2 + u.u)

    def outputs(self, t, x, u):
        return dict(y=x.x)


def failure(blocks, wires, **options):
    d = tsm.Diagram(title="d", blocks=blocks, wires=wires)
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(d, **{"stop": 2.0, "step": 0.01} | options)
    return caught.value


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("locate", [False, True])
def test_memory_that_grows_without_bound_is_named(backend, locate):
    error = failure(dict(c=Constant(), m=Doubling(), i=Integrator()), ["c -> m -> i"], backend=backend, locate=locate)
    assert error.block == "m"
    # 1, 3, 19, ...: the value doubles its digits at each step, and overflows at the tenth
    assert str(error) == (
        "m.m = inf at t = 0.09 s: a state of m (Doubling) diverges. One step before: m.m = 8.90746e+201. "
        "The loop may be unstable, or the step too long for it; try a smaller step."
    )


def test_a_sampled_filter_that_is_unstable_is_named():
    error = failure(
        dict(c=Constant(), z=DiscreteTransferFunction(num=[1.0], den=[1.0, -3.0], period=0.01), s=Tanh()),
        ["c -> z -> s"],
        stop=10.0,
    )
    assert error.block == "z"
    assert "a state of z (DiscreteTransferFunction) diverges" in str(error)


@pytest.mark.parametrize("at", [0.0, 0.05])
def test_a_reset_that_is_undefined_is_named(at):
    error = failure(dict(c=Constant(), b=Lost(at=at), i=Integrator()), ["b -> i"])
    assert (error.block, error.time) == ("b", pytest.approx(at))
    assert "One step before: b.level = 2. Within the step its equations are undefined" in str(error)


def test_of_states_that_overflow_in_one_step_the_first_cause_is_named():
    """What reads the state is defined first, and overflows in the same step; a loop around it names the largest."""
    blocks = dict(late=FirstOrderLag(time_constant=0.01), x=Escape(), c=Constant())
    assert failure(blocks, ["c -> x -> late"]).block == "x"
    blocks = dict(late=FirstOrderLag(time_constant=1.0), s=Sum(signs="++"), c=Constant(), x=Escape())
    assert failure(blocks, ["c -> s.plus1", "s -> x -> late -> s.plus2"]).block == "x"


def test_a_pole_that_is_too_fast_for_the_method_leads_to_an_implicit_one():
    blocks = dict(c=Constant(), lag=FirstOrderLag(time_constant=1e-4))
    with pytest.warns(StepWarning, match="an implicit method"):
        error = failure(blocks, ["c -> lag"])
    assert str(error).endswith("try a smaller step or an implicit method (method='sdirk2').")
    d = tsm.Diagram(title="d", blocks=blocks, wires=["c -> lag"])
    assert tsm.simulate(d, stop=2.0, step=0.01, method="sdirk2")["lag.y"][-1] == pytest.approx(1.0)
