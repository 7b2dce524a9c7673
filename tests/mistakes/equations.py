"""Mistakes in the equations of users' own blocks."""

import math

import casadi as ca
import numpy as np

from tests.mistakes.table import mistake
from tsmblocks.block import Block, Input, Output, Past, State, block, option, parameter, state
from tsmblocks.blocks import function_block, Sine
from tsmblocks.compile import compile_diagram
from tsmblocks.diagram import Diagram
from tsmblocks.errors import BlockError, DiagramError, EquationError


def compiled(cls, **parameters):
    """A diagram with one sine into the block, compiled."""
    made = cls(**parameters)
    compile_diagram(Diagram(title="own", blocks=dict(ref=Sine(unit="1"), mine=made), wires=[f"ref -> mine.{k}" for k in made.inports]))


@mistake(EquationError, "?")
def an_output_is_left_out():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")
        z = Output("other")

        def outputs(self, t, x, u):
            return dict(y=u.u)

    compiled(Mine)


@mistake(EquationError, "?")
def an_output_by_another_name():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(Y=u.u)

    compiled(Mine)


@mistake(EquationError, "?")
def no_outputs_method():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

    compiled(Mine)


@mistake(EquationError, "?")
def a_number_instead_of_a_dict():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return u.u

    compiled(Mine)


@mistake(EquationError, "?")
def nothing_is_returned():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            dict(y=u.u)

    compiled(Mine)


@mistake(EquationError, "?")
def a_misspelt_input_in_an_equation():
    @block(register=False)
    class Mine(Block):
        speed = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.sped)

    compiled(Mine)


@mistake(EquationError, "?")
def a_misspelt_parameter_in_an_equation():
    @block(register=False)
    class Mine(Block):
        gain: float = parameter(default=2.0, about="gain")
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=self.gian * u.u)

    compiled(Mine)


@mistake(EquationError, "?")
def a_python_if_on_a_signal():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            if u.u > 0:
                return dict(y=u.u)
            return dict(y=0.0)

    compiled(Mine)


@mistake(EquationError, "?")
def a_python_max_of_a_signal():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=max(u.u, 0.0))

    compiled(Mine)


@mistake(EquationError, "?")
def tanh_of_math():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=math.tanh(u.u))

    compiled(Mine)


@mistake(EquationError, "?")
def float_of_a_signal():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=2 * float(u.u))

    compiled(Mine)


@mistake(EquationError, "?")
def a_vector_where_a_number_belongs():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=ca.vertcat(u.u, u.u))

    compiled(Mine)


@mistake(EquationError, "?")
def text_where_a_signal_belongs():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y="u")

    compiled(Mine)


@mistake(EquationError, "?")
def a_state_without_a_rate():
    @block(register=False)
    class Mine(Block):
        z: float = state(default=0.0, about="memory")
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=x.z)

    compiled(Mine)


@mistake(EquationError, "?")
def a_rate_of_no_state():
    @block(register=False)
    class Mine(Block):
        z: float = state(default=0.0, about="memory")
        u = Input("in")
        y = Output("out")

        def derivatives(self, t, x, u):
            return dict(zeta=u.u, z=u.u)

        def outputs(self, t, x, u):
            return dict(y=x.z)

    compiled(Mine)


@mistake(EquationError, "?")
def a_sampled_block_with_rates():
    @block(register=False)
    class Mine(Block):
        sampled = True
        period: float = option(default=0.01, about="period", unit="s")
        z: float = state(default=0.0, about="memory")
        u = Input("in")
        y = Output("out")

        def derivatives(self, t, x, u):
            return dict(z=u.u)

        def outputs(self, t, x, u):
            return dict(y=x.z)

    compiled(Mine)


@mistake(EquationError, "?")
def a_sampled_block_without_a_period():
    @block(register=False)
    class Mine(Block):
        sampled = True
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.u)

    compiled(Mine)


@mistake(EquationError, "?", cause=True)
def a_block_that_fails_inside():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.u * {}["gain"])

    compiled(Mine)


@mistake(EquationError, "?", cause=True)
def a_rate_that_fails_inside():
    @block(register=False)
    class Mine(Block):
        z: float = state(default=0.0, about="memory")
        u = Input("in")
        y = Output("out")

        def derivatives(self, t, x, u):
            return dict(z=u.u / 0)

        def outputs(self, t, x, u):
            return dict(y=x.z + (1 / 0))

    compiled(Mine)


@mistake(EquationError, "?")
def the_rate_of_a_port_that_is_not_there():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        v = Input("rate", rate_of="x")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.v)

    compiled(Mine)


@mistake(EquationError, "?")
def the_past_of_a_port_that_is_not_there():
    @block(register=False)
    class Mine(Block):
        tau: float = parameter(default=0.1, about="delay", unit="s")
        z0: float = parameter(default=0.0, about="before")
        u = Input("in")
        past = Past("old", of="x", by="tau", initial="z0")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.past)

    compiled(Mine)


@mistake(EquationError, "?")
def the_past_by_a_parameter_that_is_not_there():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        past = Past("old", of="u", by="tau", initial="z0")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.past)

    compiled(Mine)


@mistake(EquationError, "?")
def a_numpy_array_where_a_number_belongs():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=np.array([1.0, 2.0]) * u.u)

    compiled(Mine)


@mistake(EquationError, "?")
def a_state_that_starts_with_text():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        @property
        def states(self):
            return {"z": State("zero", "memory")}

        def derivatives(self, t, x, u):
            return dict(z=u.u)

        def outputs(self, t, x, u):
            return dict(y=x.z)

    compiled(Mine)


@mistake(EquationError, "?")
def a_state_named_like_an_input():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        @property
        def states(self):
            return {"y": State(0.0, "memory")}

        def derivatives(self, t, x, u):
            return dict(y=u.u)

        def outputs(self, t, x, u):
            return dict(y=2 * x.y)

    compiled(Mine)


@mistake(DiagramError, "?")
def a_unit_that_is_none():
    @block(register=False)
    class Mine(Block):
        u = Input("in", unit="radd")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.u)

    compiled(Mine)


@mistake(DiagramError, "?")
def two_ports_whose_units_cannot_agree():
    @block(register=False)
    class Mine(Block):
        u = Input("in", unit="?u")
        y = Output("out", unit="?u")
        z = Output("out", unit="?u/s*s*s")

        def outputs(self, t, x, u):
            return dict(y=u.u, z=u.u)

    compiled(Mine)


# ---- plain functions


@mistake(EquationError, "?")
def a_function_that_branches():
    @function_block(register=False)
    def mine(u, k=0.3):
        return k * u if u > 0 else 0.0

    compiled(mine)


@mistake(EquationError, "?")
def a_function_that_returns_nothing():
    @function_block(register=False)
    def mine(u, k=0.3):
        k * u

    compiled(mine)


@mistake(EquationError, "?")
def a_function_that_returns_two():
    @function_block(register=False)
    def mine(u, k=0.3):
        return u, k * u

    compiled(mine)


@mistake(EquationError, "?")
def a_function_of_math():
    @function_block(register=False)
    def mine(u, k=0.3):
        return math.sin(k * u)

    compiled(mine)


@mistake(BlockError, "?")
def a_function_of_any_number_of_things():
    @function_block(register=False)
    def mine(*u):
        return u[0]


@mistake(BlockError, "?")
def a_function_with_a_default_of_text():
    @function_block(register=False)
    def mine(u, mode="fast"):
        return u


@mistake(BlockError, "?")
def a_function_without_a_name():
    function_block(lambda u: u)


@mistake(BlockError, "?")
def a_function_with_a_misspelt_unit():
    @function_block(register=False, units={"U": "rad"})
    def mine(u):
        return u


@mistake(BlockError, "?")
def a_function_in_an_unknown_unit():
    @function_block(register=False, units={"u": "radd"})
    def mine(u):
        return u
