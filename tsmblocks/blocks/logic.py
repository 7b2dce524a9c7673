"""Logic: comparison, logic operations, sample and hold, a state machine. A signal above 0.5 counts as true."""

from __future__ import annotations

import re
from functools import reduce
from keyword import iskeyword
from typing import Any

import casadi as ca

from tsmblocks.common.errors import ParameterError, clip, in_words, near
from tsmblocks.metrics.conditions import Condition, condition
from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter, state

TRUE = 0.5
"""Value above which a signal counts as true."""
SINCE = "since"
"""Name, in a condition of a state machine, of the time [s] since the present state was entered."""
_TRANSITION = re.compile(r"\s*(\w+)\s*->\s*(\w+)\s*:\s*(.*\S)\s*", re.ASCII)
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def _number(true: Any) -> Any:
    return ca.if_else(true, 1.0, 0.0)


@block
class Comparison(Block):
    r"""Whether a signal is above or below a level.

    .. math:: y = 1 \text{ where } u > c \text{ (or } \ge, <, \le\text{)}, \quad 0 \text{ otherwise}

    With ``locate=True`` it switches at the located instant. Against chatter: ``Relay``, which has two levels.
    """

    source = "definition"
    symbol = "u > c"
    symbol_with_values = "u {sign} {level:unit}"

    sign: str = option(default=">", about="comparison operator", choices=(">", ">=", "<", "<="))
    level: float = parameter(default=0.0, about="the level c", unit="?u")
    u = Input("any signal", unit="?u")
    y = Output("1 where it holds, else 0", unit="1")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        holds = {">": u.u > self.level, ">=": u.u >= self.level, "<": u.u < self.level, "<=": u.u <= self.level}
        return dict(y=_number(holds[self.sign]))


@block
class Logic(Block):
    r"""A logic operation on signals, of which those above 0.5 are true.

    .. math:: y = 1 \text{ where } \min(u_1, \dots, u_n) > \tfrac12 \text{ (and)}, \quad
        \max(u_1, \dots, u_n) > \tfrac12 \text{ (or)}, \quad 0 \text{ otherwise}

    With "xor" an odd number of them must be true; "nand", "nor" and "not" invert the result.
    """

    source = "definition"
    symbol = "∧"

    operation: str = option(default="and", about="the operation", choices=("and", "or", "xor", "nand", "nor", "not"))
    n: int = option(default=2, about="number of inputs", at_least=1, at_most=100)
    y = Output("1 where it holds, else 0", unit="1")

    def check(self) -> None:
        if self.operation == "not" and self.n != 1:
            raise ParameterError(f"Logic: 'not' takes one input, so n=1, got n={self.n}.")

    @property
    def inports(self) -> dict[str, Input]:
        return {f"u{k}": Input(f"condition {k}, true above 0.5") for k in range(1, self.n + 1)}

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        if self.operation in ("and", "nand"):
            made = _number(reduce(ca.fmin, u) > TRUE)
        elif self.operation in ("or", "nor", "not"):
            made = _number(reduce(ca.fmax, u) > TRUE)
        else:
            made = reduce(lambda a, b: ca.fabs(a - b), (_number(one > TRUE) for one in u))
        return dict(y=1.0 - made if self.operation in ("nand", "nor", "not") else made)


@block
class TriggeredHold(Block):
    r"""Sample and hold: the value that a signal had when a trigger last became true.

    .. math:: y = u(t_k), \qquad t_k \text{ the last instant at which the trigger rose above } 0.5

    It acts as a step begins, and with ``locate=True`` at the located instant.
    """

    source = "definition"
    symbol = "hold"

    initial: float = parameter(default=0.0, about="output before the first trigger", unit="?u")
    u = Input("any signal", unit="?u")
    trigger = Input("takes the value as it rises above 0.5")
    y = Output("the sampled value", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        about = "1 while the trigger is above 0.5"
        return {"held": State(self.initial, "the sampled value", "?u"), "armed": State(0.0, about, "1")}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        taken = ca.if_else(x.armed < TRUE, u.u, x.held)
        return dict(held=ca.if_else(u.trigger > TRUE, taken, x.held), armed=_number(u.trigger > TRUE))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.held)


@block
class StateMachine(Block):
    r"""A state machine: modes, and conditions under which one follows another.

    .. math:: m_k = \begin{cases} j & \text{a transition } m_{k-1} \to j \text{ holds} \\ m_{k-1} & \text{otherwise}
        \end{cases}

    ``modes`` are names, the first is that at the start. A transition is a text, ``"idle -> run: u > 1 and v < 2"``: of
    those from the present mode the first that holds is taken, one at a time. ``since`` in a condition is the time in s
    since the mode was entered. Outputs are the number of the mode, from 0, that time, and 1 or 0 for each mode by
    name. It acts as a step begins, and with ``locate=True`` at the located instant.
    """

    source = "Harel, Sci. Comput. Program. 8 (1987) 231, without hierarchy"
    symbol = "modes"

    modes: tuple[str, ...] = option(default=("off", "on"), about="names of the modes")
    signals: tuple[str, ...] = option(default=("u",), about="names of the inputs")
    transitions: tuple[str, ...] = option(
        default=("off -> on: u > 0.5", "on -> off: u < -0.5"), about="from, to and condition of each transition"
    )
    active: float = state(default=0.0, about="number of the mode", unit="1")
    entered: float = state(default=0.0, about="when it was entered", unit="s")
    mode = Output("number of the mode, from 0", unit="1")
    since = Output("time since it was entered", unit="s")

    def check(self) -> None:
        names = [*self.modes, *self.signals]
        for name in names:
            if not isinstance(name, str) or not _NAME.fullmatch(name) or iskeyword(name):
                raise ParameterError(f"StateMachine: {in_words(name)} is no name: write letters, digits, underscores.")
            if names.count(name) > 1 or name in ("mode", "active", "entered", SINCE):
                raise ParameterError(f"StateMachine: the name '{name}' is taken already. Choose another.")
        if not self.modes:
            raise ParameterError("StateMachine needs at least one mode.")
        if not (self.active.is_integer() and 0 <= self.active < len(self.modes)):
            last = len(self.modes) - 1
            raise ParameterError(f"StateMachine.active is the number of a mode, 0 to {last}, got {self.active:g}.")
        self._rules()

    def _rules(self) -> list[tuple[int, int, Condition]]:
        """Numbers of the modes of each transition, and its condition. Raises ParameterError."""
        made, known = [], dict.fromkeys([*self.signals, SINCE], "")
        for text in self.transitions:
            found = _TRANSITION.fullmatch(text) if isinstance(text, str) else None
            if found is None:
                shown = clip(text) if isinstance(text, str) else in_words(text)
                raise ParameterError(f"StateMachine: '{shown}' is no transition. Write 'off -> on: u > 1'.")
            for name in found.group(1, 2):
                if name not in self.modes:
                    hint = near(name, self.modes)
                    raise ParameterError(f"StateMachine: transition '{clip(text)}': there is no mode '{name}'.{hint}")
            first, following = (self.modes.index(name) for name in found.group(1, 2))
            made.append((first, following, condition("StateMachine", found[3], known)))
        return made

    @property
    def inports(self) -> dict[str, Input]:
        return {name: Input("read by the conditions") for name in self.signals}

    @property
    def outports(self) -> dict[str, Output]:
        return {**super().outports, **{name: Output(f"1 in the mode '{name}', else 0", "1") for name in self.modes}}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        signals = {**dict(zip(self.signals, u, strict=True)), SINCE: t - x.entered}
        new = x.active
        for first, following, one in reversed(self._rules()):
            holds = one.expression.symbolic({name: signals[name] for name in one.signals}) > 0
            new = ca.if_else(ca.fabs(x.active - first) < TRUE, ca.if_else(holds, float(following), new), new)
        return dict(active=new, entered=ca.if_else(ca.fabs(new - x.active) < TRUE, x.entered, t))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        each = {name: _number(ca.fabs(x.active - k) < TRUE) for k, name in enumerate(self.modes)}
        return dict(mode=x.active, since=t - x.entered, **each)
