"""Diagrams that are switched on and off: the effect of an ``Enable`` or a ``Trigger`` on the blocks beside it.

While the diagram is off, its states and memory are held. Each of its outputs passes an added block, which holds the
last value, or gives another one.
"""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter

ON, BEGINS = "on", "begins"
"""Outputs of a block that switches its diagram, 1 or 0: while it is on; at an instant at which it is switched on."""
HOLD, RESET = "hold", "reset"
"""What outputs do while off, and states when switched on: keep their value; take their initial one."""


@attrs.frozen
class Switch:
    """A block that switches the diagram that contains it: its path, and the block itself, as given."""

    path: str
    block: Any

    @property
    def on(self) -> tuple[str, ...]:
        """The node that is 1 while the diagram is on."""
        return ("y", self.path, ON)

    @property
    def begins(self) -> tuple[str, ...]:
        """The node that is 1 as it is switched on."""
        return ("y", self.path, BEGINS)

    @property
    def triggers(self) -> bool:
        """Whether it acts only at instants."""
        return self.block.switches == "trigger"

    @property
    def resets(self) -> bool:
        """Whether states take their initial values as it switches on."""
        return not self.triggers and self.block.restart == RESET


@block(register=False)
class SwitchedOutput(Block):
    r"""An output of a diagram that is switched on and off.

    .. math:: y = u \text{ while on}, \quad \text{else its last value (or the initial one)}
    """

    source = "definition"
    symbol = "hold"

    while_off: str = option(default=HOLD, about="value while off", choices=(HOLD, RESET))
    instants: bool = option(default=False, about="whether it is on only at instants")
    initial: float = parameter(default=0.0, about="value before it was first on", unit="?u")
    u = Input("the signal inside", unit="?u")
    on = Input("1 while on")
    y = Output("the signal outside", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        held, was = State(self.initial, "last value", "?u"), State(0.0, "1 where it was on at the last instant", "1")
        return {} if self.while_off == RESET else {"held": held} if self.instants else {"held": held, "was": was}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        if not self.states:
            return {}
        if self.instants:
            return dict(held=ca.if_else(u.on, u.u, x.held))
        return dict(held=ca.if_else(x.was, u.u, x.held), was=u.on)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        if self.while_off == RESET:
            return dict(y=ca.if_else(u.on, u.u, self.initial))
        if self.instants:
            return dict(y=x.held)
        # It ends where a step begins: the states are held from within a step, and their last value is kept there.
        return dict(y=ca.if_else(ca.logic_or(u.on, x.was), u.u, x.held))


def switched_output(switch: Switch, made: Any, number: int) -> tuple[Block, Any]:
    """An output of a switched diagram, as given and with symbols; ``made`` is the block that switches, with symbols."""
    initial, number_given = ((b.initial[number] if b.initial else 0.0) for b in (made, switch.block))
    while_off = HOLD if switch.triggers else switch.block.while_off
    given = SwitchedOutput(initial=number_given, while_off=while_off, instants=switch.triggers)
    return given, given.with_symbols(lambda *_: initial)


def faults(switches: tuple[Switch, ...], path: str, block: Block, continuous: tuple[str, ...]) -> list[str]:
    """The message for a block that cannot be switched on and off by these."""
    found = []
    if block.past_ports and switches:
        found.append(
            f"{path} ({type(block).__name__}) reads past values, which continue while {switches[-1].path} is off. Put "
            "it outside of this diagram."
        )
    trigger = next((one.path for one in switches if one.triggers), "")
    if trigger and continuous:
        found.append(
            f"{path} ({type(block).__name__}) has a continuous state ({', '.join(continuous)}), which cannot change "
            f"only at the instants of {trigger}. Use a sampled block, or an Enable instead of the Trigger."
        )
    return found
