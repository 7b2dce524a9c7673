"""The form in which the reference states a block's equations, and a table that they are entered in.

They are written from the reference pages of the blocks, with plain numbers, and share no code with the package.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs

Law = Callable[[Any, Any, Any, Any], Any]
"""A function of the block (its parameters), the time, its states and its inputs."""


def _own_states(block: Any) -> dict[str, float]:
    return {name: float(state.start) for name, state in block.states.items()}


@attrs.frozen
class Equations:
    """Outputs, rates of states, states after an instant (memory, or resets), and initial states.

    ``still``: an output that reads no continuous state does not move within a step, unless an input does.
    """

    outputs: dict[str, Law]
    rates: dict[str, Law] = attrs.field(factory=dict)
    updates: dict[str, Law] = attrs.field(factory=dict)
    start: Callable[[Any], dict[str, float]] = _own_states
    still: bool = True


LAWS: dict[str, Callable[[Any], Equations]] = {}
"""Equations by the name of a block's class, as a function of the block, whose options shape them."""


def law(name: str, y: Law | None = None, **more: Any) -> None:
    """Enter a block whose equations have one form."""
    made = Equations({"y": y} if y else more.pop("outputs"), **more)
    LAWS[name] = lambda block: made


def shaped(name: str) -> Callable[[Callable[[Any], Equations]], Callable[[Any], Equations]]:
    """Enter a function that makes the equations of a block from its options; a decorator."""

    def enter(make: Callable[[Any], Equations]) -> Callable[[Any], Equations]:
        LAWS[name] = make
        return make

    return enter
