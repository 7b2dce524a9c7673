"""From a diagram to one set of equations, every parameter still a symbol.

Evaluation order and algebraic loops are exact, for each port and through hierarchy, since feedthrough is read from the
equations. Nothing here knows steps or data.
"""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca

from tsmblocks.compiler.evaluate import Evaluator
from tsmblocks.compiler.flatten import FlatDiagram, flatten, is_held_output
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram

_LABELS = {
    "rhs": (["t", "x", "d", "u", "q", "p"], ["dx", "y", "s"]),
    "update": (["t", "x", "d", "u", "q", "p", "hit"], ["d_next", "x_next"]),
    "start": (["p"], ["x", "d", "s"]),
}
"""Names of the arguments and results of each function."""


def compile_diagram(diagram: Diagram) -> Equations:
    """Equations of a diagram, as CasADi functions (see ``Equations``).

    ``between`` forms all signals between samples, for ``rhs``; a second evaluator forms them at a sample instant, for
    ``update``. Raises AlgebraicLoop, EquationError or DiagramError, naming the place.
    """
    flat = flatten(diagram)
    between = Evaluator(flat, held=True)
    between.form_all()
    names, signals = _signals(flat, between)
    update = _update(flat, between)  # may add derivatives of inputs that nothing else needs
    results = [_column(between.rates()), _column(signals), _column(between.delayed())]
    rhs = ca.Function("rhs", _reads(flat, between), results, *_LABELS["rhs"])
    p = _column(flat.p)
    begin = [*(between.initial_values(keys) for keys in (flat.x, flat.d)), flat.first_past]
    start = ca.Function("start", [p], [ca.densify(_column(values)) for values in begin], *_LABELS["start"])
    lag = ca.Function("lag", [p], [ca.densify(_column(flat.delays))], ["p"], ["tau"])
    return Equations(
        title=diagram.title,
        x=tuple(".".join(k) for k in flat.x),
        d=tuple(flat.d_name(k) for k in flat.d),
        u=tuple(between.sampled_inputs()),
        p=tuple(flat.p_names),
        y=tuple(names),
        q=tuple(".".join(k) for k in flat.past_keys),
        min_delay_steps=tuple(0 if past.now else 1 for past in flat.pasts),
        rhs=rhs,
        update=update,
        start=start,
        lag=lag,
        periods=tuple(flat.periods),
        aliases={k: flat.signal_name(end) for k, end in flat.shown.items()},
        units=_units(diagram, flat, names),
        tapes={k: functools.partial(b.tapes, name=k) for k, b in flat.blocks.items() if b.tape_ports},
        every_step=any(not flat.blocks[k].sampled and (s.memory or s.resets) for k, s in flat.structures.items()),
        reads={k: (type(b).__name__, flat.reads(k)) for k, b in flat.blocks.items()},
        sampled={k: flat.periods[group] for k, group in flat.group.items()},
    )


def _reads(flat: FlatDiagram, evaluator: Evaluator) -> list[Any]:
    """Arguments of every function of the equations: t, x, d, u, q, p."""
    return [flat.t, *map(_column, (*evaluator.symbols(), flat.p))]


def _update(flat: FlatDiagram, between: Evaluator) -> Any:
    """Memory and states after a sample instant, as a function; None when nothing is updated."""
    if not (flat.d or flat.resets):
        return None
    d_next, x_next, hit = Evaluator(flat, held=False, share=between).updates()
    reads = [*_reads(flat, between), hit]
    return ca.Function("update", reads, [_column(d_next), _column(x_next)], *_LABELS["update"])


def _column(elements: list[Any]) -> Any:
    """A column of expressions, which may be empty."""
    return ca.vertcat(*elements) if elements else ca.SX(0, 1)


def _signals(flat: FlatDiagram, evaluator: Evaluator) -> tuple[list[str], list[Any]]:
    """Names and expressions of all signals that can be logged: inputs, outputs of blocks as evaluated, states."""
    names = list(flat.inputs)
    values = [evaluator.value[("u", k)] for k in flat.inputs]
    for node, value in evaluator.value.items():
        if node[0] == "y":
            names.append(f"{node[1]}.{node[2]}")
            values.append(value)
    known = set(names)
    for key, symbol in [*evaluator.x.items(), *evaluator.d.items()]:
        name = ".".join(key)
        if not is_held_output(key) and name not in known:  # a held output is logged as evaluated
            names.append(name)
            values.append(symbol)
    return names, values


def _units(diagram: Diagram, flat: FlatDiagram, names: list[str]) -> dict[str, str]:
    """Units of signals, where they are known."""
    found = {name: diagram.unit(name) for name in names}
    for key, block in flat.blocks.items():
        for name, state in block.states.items():
            if not found.get(f"{key}.{name}") and "?" not in state.unit:
                found[f"{key}.{name}"] = state.unit
    return {k: v for k, v in found.items() if v}
