"""Blocks that switch the diagram that contains them: on and off, or on at instants."""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter

TRUE = 0.5
"""Value above which a signal counts as true."""
INITIAL = "outputs of the diagram before it was first on, one for each; an empty list means zeros"


@block
class Enable(Block):
    r"""Enable: switches the diagram that contains it on and off.

    .. math:: \dot x = f(t, x, u) \text{ while } u_{on} > \tfrac12, \qquad \dot x = 0 \text{ otherwise}

    While it is off all states in its diagram are held, those of nested diagrams too, sampled blocks do not sample, and
    outputs of the diagram hold the value at which it was switched off; with ``while_off="reset"`` they are ``initial``.
    When it is switched on again the states continue from their values; with ``restart="reset"`` they restart from their
    initial values, and a port ``begins`` is 1 then. A signal inside the diagram that drives the port is held too.
    Sampled blocks act at their next instant after it is switched on. With ``locate=True`` it switches at the located
    instant.
    """

    source = "definition; as the enabled subsystem of Simulink"
    symbol = "enable"
    switches = "enable"

    restart: str = option(
        default="hold", about="states when switched on again: held or reset", choices=("hold", "reset")
    )
    while_off: str = option(default="hold", about="outputs while off: held or reset", choices=("hold", "reset"))
    initial: tuple[float, ...] = parameter(default=(), about=INITIAL, known=True)
    u = Input("above 0.5 the diagram is on")
    on = Output("1 while it is on, else 0", unit="1")

    @property
    def outports(self) -> dict[str, Output]:
        begins = Output("1 as it is switched on, for blocks that act at instants", "1")
        return {**super().outports, **({"begins": begins} if self.restart == "reset" else {})}

    @property
    def states(self) -> dict[str, State]:
        return {"was": State(0.0, "1 where it was on as the step began", "1")} if self.restart == "reset" else {}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(was=_number(u.u > TRUE)) if self.restart == "reset" else {}

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        on = _number(u.u > TRUE)
        return dict(on=on, begins=on * (1.0 - x.was)) if self.restart == "reset" else dict(on=on)


@block
class Trigger(Block):
    r"""Trigger: executes the diagram that contains it each time a signal becomes true.

    .. math:: x_{k+1} = g(t_k, x_k, u(t_k)), \quad y = h(t_k, x_k, u(t_k)), \qquad
        t_k \text{ the instants at which } u \text{ rises above } \tfrac12

    Between them all memory in its diagram and all outputs of the diagram are held. Sampled blocks inside act at these
    instants instead of at multiples of their period, which their equations still use as the time since the last one.
    Blocks with continuous states are not allowed there. It acts as a step begins, and with ``locate=True`` at the
    located instant.
    """

    source = "definition; as the triggered subsystem of Simulink"
    symbol = "trigger"
    switches = "trigger"

    initial: tuple[float, ...] = parameter(default=(), about=INITIAL, known=True)
    u = Input("acts as it rises above 0.5")
    on = Output("1 at the instant at which it acts, for blocks that act at instants", unit="1")

    @property
    def states(self) -> dict[str, State]:
        return {"was": State(0.0, "1 where the signal was above 0.5 as the step began", "1")}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(was=_number(u.u > TRUE))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(on=_number(u.u > TRUE) * (1.0 - x.was))


def _number(true: Any) -> Any:
    return ca.if_else(true, 1.0, 0.0)
