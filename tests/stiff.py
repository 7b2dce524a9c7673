"""Stiff problems as blocks, for tests and benchmarks."""

import casadi as ca
from tsmblocks.block import Block, Input, Output, block, parameter, state


@block(register=False)
class VanDerPol(Block):
    """x'' = mu (1 - x^2) x' - x."""

    mu: float = parameter(default=1000.0, about="damping")
    x: float = state(default=2.0, about="position")
    v: float = state(default=0.0, about="velocity")
    y = Output("position")

    def outputs(self, t, x, u):
        return dict(y=x.x)

    def derivatives(self, t, x, u):
        return dict(x=x.v, v=self.mu * (1 - x.x**2) * x.v - x.x)


@block(register=False)
class Robertson(Block):
    """Three reactions with rates from 0.04 to 3e7 (Robertson 1966)."""

    a: float = state(default=1.0, about="first substance")
    b: float = state(default=0.0, about="second substance")
    c: float = state(default=0.0, about="third substance")
    y = Output("first substance")

    def outputs(self, t, x, u):
        return dict(y=x.a)

    def derivatives(self, t, x, u):
        slow, back, fast = 0.04 * x.a, 1e4 * x.b * x.c, 3e7 * x.b**2
        return dict(a=back - slow, b=slow - back - fast, c=fast)


@block(register=False)
class Contact(Block):
    """A mass under a force on a wall of stiffness k, with the damping of Hunt and Crossley (1975)."""

    k: float = parameter(default=1e7, about="stiffness")
    d: float = parameter(default=1.0, about="damping")
    x: float = state(default=0.1, about="position")
    v: float = state(default=0.0, about="velocity")
    u = Input("force")
    y = Output("position")

    def outputs(self, t, x, u):
        return dict(y=x.x)

    def derivatives(self, t, x, u):
        inside = ca.fmax(-x.x, 0.0)
        return dict(x=x.v, v=u.u + self.k * inside * ca.fmax(1.0 - self.d * x.v, 0.0))
