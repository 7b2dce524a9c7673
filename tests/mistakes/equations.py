"""Mistakes in the equations of users' own blocks."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import math

import casadi as ca
import numpy as np

from tests.mistakes.table import mistake
from tsmblocks.blocks import Sine, function_block
from tsmblocks.common.errors import BlockError, DiagramError, EquationError
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.model.block import Block, Input, Output, Past, State, block, option, parameter, state
from tsmblocks.model.diagram import Diagram


def compiled(cls, **parameters):
    """A diagram with one sine into the block, compiled."""
    made = cls(**parameters)
    compile_diagram(
        Diagram(
            title="own", blocks=dict(ref=Sine(unit="1"), mine=made), wires=[f"ref -> mine.{k}" for k in made.inports]
        )
    )


@mistake(BlockError, "Mine is not a block yet: write @block above class Mine(Block).")
def a_class_that_was_not_made_a_block():
    class Mine(Block):
        gain: float = parameter(default=2.0, about="gain")
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=self.gain * u.u)

    compiled(Mine, gain=3.0)


@mistake(EquationError, "mine: Mine.outputs leaves out z. Declared: y, z.")
def an_output_is_left_out():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")
        z = Output("other")

        def outputs(self, t, x, u):
            return dict(y=u.u)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs leaves out y and returns Y, which is not declared. Declared: y.")
def an_output_by_another_name():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(Y=u.u)

    compiled(Mine)


@mistake(EquationError, "mine: Mine has no method outputs(self, t, x, u), which should give y.")
def no_outputs_method():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs must return values by name, such as dict(y=…), got one expression.")
def a_number_instead_of_a_dict():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return u.u

    compiled(Mine)


@mistake(
    EquationError, "mine: Mine.outputs must return values by name, such as dict(y=…), got nothing (is there a return?)."
)
def nothing_is_returned():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            dict(y=u.u)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs reads 'sped', which is no input. Did you mean 'speed'? See HERE.")
def a_misspelt_input_in_an_equation():
    @block(register=False)
    class Mine(Block):
        speed = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.sped)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs reads self.gian, which is not declared. Did you mean 'gain'? See HERE.")
def a_misspelt_parameter_in_an_equation():
    @block(register=False)
    class Mine(Block):
        gain: float = parameter(default=2.0, about="gain")
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=self.gian * u.u)

    compiled(Mine)


@mistake(
    EquationError,
    "mine: Mine.outputs branches on a signal, which has no value yet. Use ca.if_else, ca.fmin, ca.fmax or ca.logic_and instead of Python's if, min, max or and. See HERE.",
)
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


@mistake(
    EquationError,
    "mine: Mine.outputs branches on a signal, which has no value yet. Use ca.if_else, ca.fmin, ca.fmax or ca.logic_and instead of Python's if, min, max or and. See HERE.",
)
def a_python_max_of_a_signal():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=max(u.u, 0.0))

    compiled(Mine)


@mistake(
    EquationError,
    "mine: Mine.outputs makes y not a number. Inside equations use casadi's functions (ca.tanh, ca.fabs), not math's or float().",
)
def tanh_of_math():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=math.tanh(u.u))

    compiled(Mine)


@mistake(
    EquationError,
    "mine: Mine.outputs makes y not a number. Inside equations use casadi's functions (ca.tanh, ca.fabs), not math's or float().",
)
def float_of_a_signal():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=2 * float(u.u))

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs gives y with shape (2, 1); every signal is a scalar.")
def a_vector_where_a_number_belongs():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=ca.vertcat(u.u, u.u))

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs gives y = 'u', which is not a number.")
def text_where_a_signal_belongs():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y="u")

    compiled(Mine)


@mistake(
    EquationError, "mine: Mine leaves state z without a rate or an update. Give it one in derivatives or in updates."
)
def a_state_without_a_rate():
    @block(register=False)
    class Mine(Block):
        z: float = state(default=0.0, about="memory")
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=x.z)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.derivatives returns zeta, which is not a state. Declared: z.")
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


@mistake(EquationError, "mine: Mine is sampled, so it has no rates; z should be in updates.")
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


@mistake(EquationError, "mine: Mine is sampled and needs an option 'period' in s.")
def a_sampled_block_without_a_period():
    @block(register=False)
    class Mine(Block):
        sampled = True
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.u)

    compiled(Mine)


@mistake(
    EquationError,
    "mine: Mine.outputs calls the CasADi function 'cube' for y, whose operations cannot be seen. Make it without the option never_inline.",
)
def a_function_of_casadi_that_stays_a_call():
    z = ca.SX.sym("z")
    cube = ca.Function("cube", [z], [z**3], {"never_inline": True})

    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=cube(u.u))

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs fails: KeyError: 'gain'. See HERE.", cause=True)
def a_block_that_fails_inside():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.u * {}["gain"])

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs fails: ZeroDivisionError: division by zero. See HERE.", cause=True)
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


@mistake(EquationError, "mine: Mine.v is the rate of 'x', which is no input. Known here: u.")
def the_rate_of_a_port_that_is_not_there():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        v = Input("rate", rate_of="x")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.v)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.v is its own rate: v of w of v.")
def a_rate_of_itself():
    @block(register=False)
    class Mine(Block):
        v = Input("rate", rate_of="w")
        w = Input("rate of the rate", rate_of="v")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.v)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.past is the past of 'x', which is no input. Known here: u.")
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


@mistake(EquationError, "mine: Mine.past needs the parameter 'tau', which is not declared. There are none.")
def the_past_by_a_parameter_that_is_not_there():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        past = Past("old", of="u", by="tau", initial="z0")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.past)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.outputs gives y with shape (2, 1); every signal is a scalar.")
def a_numpy_array_where_a_number_belongs():
    @block(register=False)
    class Mine(Block):
        u = Input("in")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=np.array([1.0, 2.0]) * u.u)

    compiled(Mine)


@mistake(EquationError, "mine: Mine.z must start at a number, got 'zero'.")
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


@mistake(EquationError, "mine: Mine.y is used twice (as a port and a state); give one of them another name.")
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


@mistake(
    DiagramError,
    """
diagram 'own' (HERE) has 1 problem:
  1. mine.u: 'radd' is not a unit known here. Did you mean 'rad'?
""",
)
def a_unit_that_is_none():
    @block(register=False)
    class Mine(Block):
        u = Input("in", unit="radd")
        y = Output("out")

        def outputs(self, t, x, u):
            return dict(y=u.u)

    compiled(Mine)


# ---- plain functions


@mistake(
    EquationError,
    "mine: mine.outputs branches on a signal, which has no value yet. Use ca.if_else, ca.fmin, ca.fmax or ca.logic_and instead of Python's if, min, max or and. See HERE.",
)
def a_function_that_branches():
    @function_block(register=False)
    def mine(u, k=0.3):
        return k * u if u > 0 else 0.0

    compiled(mine)


@mistake(EquationError, "mine: mine must return y, got nothing.")
def a_function_that_returns_nothing():
    @function_block(register=False)
    def mine(u, k=0.3):
        k * u

    compiled(mine)


@mistake(EquationError, "mine: mine must return y, got 2 values.")
def a_function_that_returns_two():
    @function_block(register=False)
    def mine(u, k=0.3):
        return u, k * u

    compiled(mine)


@mistake(
    EquationError,
    "mine: mine.outputs makes y not a number. Inside equations use casadi's functions (ca.tanh, ca.fabs), not math's or float().",
)
def a_function_of_math():
    @function_block(register=False)
    def mine(u, k=0.3):
        return math.sin(k * u)

    compiled(mine)


@mistake(BlockError, "mine(*u) cannot be a block: name each input and each parameter.")
def a_function_of_any_number_of_things():
    @function_block(register=False)
    def mine(*u):
        return u[0]


@mistake(
    BlockError,
    "mine: the default of 'mode' must be a number or a tuple of numbers, got 'fast'. Without a default it would be an input.",
)
def a_function_with_a_default_of_text():
    @function_block(register=False)
    def mine(u, mode="fast"):
        return u


@mistake(
    BlockError,
    "function_block needs a function made by def, with a name, got <function a_function_without_a_name.<locals>.<lambda> at 0x….",
)
def a_function_without_a_name():
    function_block(lambda u: u)


@mistake(BlockError, "mine: units names 'U', which it does not have. Did you mean 'u'?")
def a_function_with_a_misspelt_unit():
    @function_block(register=False, units={"U": "rad"})
    def mine(u):
        return u


@mistake(BlockError, "mine: unit of 'u': 'radd' is not a unit known here. Did you mean 'rad'?")
def a_function_in_an_unknown_unit():
    @function_block(register=False, units={"u": "radd"})
    def mine(u):
        return u
