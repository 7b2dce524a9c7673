"""The equations of a block as expressions, and what they depend on: feedthrough of each port, kinds of states.

A block declares none of this: it is read from its equations, once for each class and shape of options.
"""

from __future__ import annotations

import math
import traceback
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import attrs
import casadi as ca

from tsmblocks.common.errors import BlockError, EquationError, clip, in_words, near
from tsmblocks.model.block import Block, is_reference, leaves, signals
from tsmblocks.model.block_class import Unchanging

_PACKAGE = str(Path(__file__).parent.parent)

EQUATIONS = {"y": "outputs", "dx": "derivatives", "next": "updates"}
"""Kinds of results, and the method of a block that gives them."""


@attrs.frozen
class Structure:
    """Dependencies of one block: which inputs each output and each derivative reads, at the same instant.

    ``outputs`` and ``rates`` map the name of an output, or of a state with a derivative, to names of inputs (tapes and
    past values included). ``continuous`` states have a derivative, ``memory`` states only an update, ``resets`` both.
    ``moving`` are the outputs that change within a step though their inputs do not.
    """

    outputs: dict[str, frozenset[str]]
    rates: dict[str, frozenset[str]]
    continuous: tuple[str, ...]
    memory: tuple[str, ...]
    resets: tuple[str, ...]
    moving: frozenset[str]


_CACHE: dict[Any, Structure] = {}


def structure_of(block: Block) -> Structure:
    """The structure of a block, cached. Raises EquationError when its equations and its declarations disagree."""
    key = (type(block), tuple((k, nesting(v)) for k, v in block.parameters.items()), tuple(block.options.items()))
    if key not in _CACHE:
        _CACHE[key] = _analysed(block)
    return _CACHE[key]


def nesting(value: Any) -> Any:
    """Nesting of a parameter with its references, without its numbers."""
    return tuple(map(nesting, value)) if isinstance(value, tuple) else value if is_reference(value) else None


@attrs.frozen
class SymbolicEquations:
    """A block's equations as expressions: symbols for t, x, u and parameters, and ``results`` by kind and name."""

    t: Any
    x: Any
    u: Any
    p: list[Any]
    results: dict[tuple[str, str], Any]

    def of(self, kind: str) -> dict[str, Any]:
        """The expressions of one kind (``"y"``, ``"dx"``, ``"next"``), by name."""
        return {name: expression for (k, name), expression in self.results.items() if k == kind}


def symbolic(block: Block) -> SymbolicEquations:
    """The equations of a block as expressions. Raises EquationError."""
    made = block.with_symbols(lambda name, _: ca.SX.sym(name))
    t = ca.SX.sym("t")
    x = signals(list(block.states), [ca.SX.sym(k) for k in block.states])
    u = signals(list(block.read_names), [ca.SX.sym(k) for k in block.read_names])
    p = [symbol for value in made.parameters.values() for _, symbol in leaves(value)]
    return SymbolicEquations(t, x, u, p, results_of(made, t, x, u))


def results_of(block: Any, t: Any, x: Any, u: Any) -> dict[tuple[str, str], Any]:
    """Every equation of a block at t, x, u, by kind and name."""
    calls = {kind: call(block, equation, t, x, u) for kind, equation in EQUATIONS.items()}
    return {(kind, name): value for kind, values in calls.items() for name, value in values.items()}


def call(block: Any, equation: str, t: Any, x: Any, u: Any, name: str = "") -> dict[str, Any]:
    """One equation of a block, called with symbols or expressions, as scalars by name. Raises EquationError."""
    owner = f"{name} ({type(block).__name__})" if name else type(block).__name__
    try:
        result = getattr(block, equation)(t, x, u)
    except BlockError:
        raise
    except Exception as error:
        if error.__traceback__ is None or error.__traceback__.tb_next is None:  # it was never entered
            raise EquationError(f"{owner}.{equation} must take (self, t, x, u).") from None
        why, known = _failure_reason(block, error, x, u)
        raise EquationError(f"{owner}.{equation} {why} See {_line(error)}.") from (None if known else error)
    if not isinstance(result, dict):
        kinds = {type(None): "nothing (is there a return?)", ca.SX: "one expression"}
        got = kinds.get(type(result), in_words(result))
        raise EquationError(f"{owner}.{equation} must return values by name, such as dict(y=…), got {got}.")
    made = {}
    for key, value in result.items():
        try:
            scalar = value if isinstance(value, ca.SX) else ca.SX(value)
        except Exception:
            raise EquationError(f"{owner}.{equation} gives {key} = {in_words(value)}, which is not a number.") from None
        if scalar.shape != (1, 1):
            raise EquationError(f"{owner}.{equation} gives {key} with shape {scalar.shape}; every signal is a scalar.")
        made[key] = scalar
    return made


def _failure_reason(block: Any, error: Exception, x: Any, u: Any) -> tuple[str, bool]:
    """Why an equation failed, and whether that explains it completely (the original error is then left out)."""
    text = " ".join(str(error).split()).rstrip(".")
    if any(sign in text for sign in ("truth value", "__bool__", "Only scalars")):
        return (
            "branches on a signal, which has no value yet. Use ca.if_else, ca.fmin, ca.fmax or ca.logic_and instead "
            "of Python's if, min, max or and.",
            True,
        )
    name = str(getattr(error, "name", ""))
    if isinstance(error, Unchanging):
        return f"sets self.{name}, and a block does not change: declare a state for a value that it remembers.", True
    of: Any = getattr(error, "obj", None)  # what an AttributeError is about
    for owner, what in ((x, "state"), (u, "input")):
        if of is owner:
            return f"reads '{name}', which is no {what}.{near(name, owner._fields)}", True
    if of is block:
        return f"reads self.{name}, which is not declared.{near(name, block.fields())}", True
    return f"fails: {type(error).__name__}: {clip(text, 300)}.", False


def _line(error: Exception) -> str:
    """``file:line`` where an equation failed: its last line outside this package and other packages."""
    frames = traceback.extract_tb(error.__traceback__)[1:]
    own = [f for f in frames if "site-packages" not in f.filename and not f.filename.startswith(_PACKAGE)] or frames
    return f"{own[-1].filename}:{own[-1].lineno}"


def _analysed(block: Block) -> Structure:
    """Form the equations of a block, check them, and find what they depend on."""
    _check_ports(block)
    made, owner, states = symbolic(block), type(block).__name__, list(block.states)
    y, dx, fresh = map(made.of, EQUATIONS)
    _same_names(owner, "outputs", y, list(block.outports), all_of=True)
    _same_names(owner, "derivatives", dx, states, all_of=False)
    _same_names(owner, "updates", fresh, states, all_of=False)
    idle = [k for k in states if k not in dx and k not in fresh]
    if idle:
        raise EquationError(
            f"{owner} leaves state {', '.join(idle)} without a rate or an update. "
            "Give it one in derivatives or in updates."
        )
    if block.sampled and dx:
        raise EquationError(f"{owner} is sampled, so it has no rates; {', '.join(dx)} should be in updates.")
    if block.sampled and not isinstance(getattr(block, "period", None), float):
        raise EquationError(f"{owner} is sampled and needs an option 'period' in s.")
    for (kind, name), expression in made.results.items():
        _no_nan(owner, EQUATIONS[kind], name, expression)
        _no_call(owner, EQUATIONS[kind], name, expression)
    x = ca.vertcat(*(getattr(made.x, name) for name in dx))
    return Structure(
        outputs={k: _inputs_in(v, made.u) for k, v in y.items()},
        rates={k: _inputs_in(v, made.u) for k, v in dx.items()},
        continuous=tuple(k for k in states if k in dx),
        memory=tuple(k for k in states if k not in dx),
        resets=tuple(k for k in states if k in dx and k in fresh),
        # A jump at an instant does not count.
        moving=frozenset(k for k, v in y.items() if not ca.jtimes(v, made.t, 1).is_zero() or ca.depends_on(v, x)),
    )


def _check_ports(block: Block) -> None:
    """Raise EquationError when a port refers to an unknown one, or a name is used twice."""
    owner, inports = type(block).__name__, block.inports

    def need(port: str, what: str, name: str, known: Iterable[str], kind: str) -> None:
        if name not in known:
            hint = near(name, [k for k in known if k != port])
            raise EquationError(f"{owner}.{port} {what} '{name}', which is {kind}.{hint}")

    rates = {name: port.rate_of for name, port in inports.items() if port.rate_of}
    for name, of in rates.items():
        need(name, "is the rate of", of, inports, "no input")
    for name in rates:
        chain = [name]
        while chain[-1] in rates and rates[chain[-1]] not in chain:
            chain.append(rates[chain[-1]])
        if chain[-1] in rates:
            ring = " of ".join([*chain, rates[chain[-1]]])
            raise EquationError(f"{owner}.{name} is its own rate: {ring}.")
    for name, past in block.past_ports.items():
        need(name, "is the past of", past.of, inports, "no input")
        for number in (past.by, past.initial):
            need(name, "needs the parameter", number, block.parameters, "not declared")
    _check_names(block)


def _check_names(block: Block) -> None:
    """Raise EquationError when a name is used twice, or a state does not start at a number."""
    owner, names = type(block).__name__, Counter([*block.read_names, *block.outports, *block.states])
    twice = next((k for k, count in names.items() if count > 1), None)
    if twice is not None:
        raise EquationError(f"{owner}.{twice} is used twice (as a port and a state); give one of them another name.")
    for name, state in block.states.items():
        if not isinstance(state.start, float) and not is_reference(state.start):
            raise EquationError(f"{owner}.{name} must start at a number, got {in_words(state.start)}.")


def _inputs_in(expression: Any, u: Any) -> frozenset[str]:
    """The inputs that an expression depends on."""
    return frozenset(k for k, s in zip(u._fields, u, strict=True) if ca.depends_on(expression, s))


def _same_names(owner: str, equation: str, given: Iterable[str], wanted: list[str], *, all_of: bool) -> None:
    """Raise EquationError for a result that is not declared, and with ``all_of`` for one that is left out."""
    missing, extra = [k for k in wanted if k not in given and all_of], [k for k in given if k not in wanted]
    faults = [f"leaves out {', '.join(missing)}"] if missing else []
    if extra:
        faults.append(f"returns {', '.join(extra)}, which is not {'declared' if all_of else 'a state'}")
    if faults:
        raise EquationError(f"{owner}.{equation} {' and '.join(faults)}. Declared: {', '.join(wanted) or 'nothing'}.")


def _no_nan(owner: str, equation: str, name: str, expression: Any) -> None:
    """Raise EquationError for NaN in an expression: a function of ``math`` applied to a symbol gives it silently."""
    f = ca.Function("f", ca.symvar(expression), [expression])
    constants = (f.instruction_constant(k) for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST)
    if any(math.isnan(c) for c in constants):
        raise EquationError(
            f"{owner}.{equation} makes {name} not a number. Inside equations use casadi's functions "
            "(ca.tanh, ca.fabs), not math's or float()."
        )


def _no_call(owner: str, equation: str, name: str, expression: Any) -> None:
    """Raise EquationError for a call that CasADi keeps as a call: machine code is made of operations."""
    f = ca.Function("f", ca.symvar(expression), [expression])
    nodes = f.instructions_sx()
    for k in range(f.n_instructions()):
        if f.instruction_id(k) == ca.OP_CALL:
            raise EquationError(
                f"{owner}.{equation} calls the CasADi function '{nodes[k].which_function().name()}' for {name}, whose "
                "operations cannot be seen. Make it without the option never_inline."
            )
