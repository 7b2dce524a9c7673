"""From a diagram to one set of equations, every parameter still a symbol.

Evaluation order and algebraic loops are exact, for each port and through hierarchy, since feedthrough is read from the
equations. Nothing here knows steps or data.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

import casadi as ca

from tsmblocks.common.errors import AlgebraicLoop
from tsmblocks.compiler.evaluate import Evaluator
from tsmblocks.compiler.flatten import FlatDiagram, is_held_output
from tsmblocks.engine.closure import Closure, functions, open_function
from tsmblocks.engine.equations import LAG, START, Equations, WatchedLoops
from tsmblocks.engine.loops import LoopForms
from tsmblocks.engine.substitution import other_symbols
from tsmblocks.model.diagram import Diagram


def compile_diagram(
    diagram: Diagram, *, refuse_loops: bool = False, held_inputs: frozenset[str] = frozenset()
) -> Equations:
    """Equations of a diagram, as CasADi functions (see ``Equations``).

    ``between`` forms all signals between samples, for ``rhs``; a second evaluator forms them at a sample instant, for
    ``update``. With ``refuse_loops`` an algebraic loop is an error. The ``held_inputs`` are constant within steps; what
    delays them then keeps their jumps. Raises AlgebraicLoop, EquationError or DiagramError, naming the place.
    """
    flat = FlatDiagram(diagram)
    between = Evaluator(flat, held=True, refuse=refuse_loops, held_inputs=held_inputs)
    between.form(("y", path, port) for path, block in flat.blocks.items() for port in block.outports)
    between.form(("dx", *key) for key in flat.x)
    signals = _signals(flat, between)
    update = _update(flat, between)  # may add derivatives of inputs that nothing else needs
    pasts, value, p = flat.pasts.values(), between.value, _column(list(flat.p.values()))
    rates = [value["dx", *key] for key in flat.x]
    results = [_column(part) for part in (rates, list(signals.values()), [value[one.source] for one in pasts])]
    begin = (_initial(flat, flat.x), _initial(flat, flat.d), [one.initial for one in pasts])
    start = ca.Function("start", [p], [ca.densify(_column(values)) for values in begin], *START)
    lag = ca.Function("lag", [p], [ca.densify(_column([one.delay for one in pasts]))], *LAG)
    return Equations(
        title=diagram.title,
        x=tuple(".".join(k) for k in flat.x),
        d=tuple(flat.d_name(k) for k in flat.d),
        u=tuple(between.sampled_inputs()),
        p=tuple(flat.p),
        y=tuple(signals),
        q=tuple(".".join(k) for k in flat.pasts),
        min_delay_steps=tuple(0 if one.past.now else 1 for one in pasts),
        delayed_inputs=_delayed_inputs(flat, between),
        **_closed(_reads(flat, between), between, results, update),
        start=start,
        lag=lag,
        periods=tuple(flat.periods),
        aliases={k: flat.signal_name(end) for k, end in flat.shown.items()},
        units=_units(diagram, flat, signals),
        tapes={k: functools.partial(b.tapes, name=k) for k, b in flat.blocks.items() if b.tape_ports},
        every_step=any(not flat.blocks[k].sampled and (s.memory or s.resets) for k, s in flat.structures.items()),
        reads={k: (type(b).__name__, flat.reads(k)) for k, b in flat.blocks.items()},
        sampled={k: flat.periods[group] for k, group in flat.group.items()},
    )


def _reads(flat: FlatDiagram, evaluator: Evaluator) -> list[Any]:
    """Arguments of every function of the equations: t, x, d, u, q, p."""
    return [flat.t, *map(_column, (*evaluator.symbols(), list(flat.p.values())))]


def _delayed_inputs(flat: FlatDiagram, evaluator: Evaluator) -> frozenset[str]:
    """Inputs with which a delayed signal is constant within steps, but none of those whose derivative is needed."""
    made = {key: evaluator.constant_with(one.source) for key, one in flat.pasts.items()}
    inputs = {key: one.inputs for key, one in made.items() if one is not None}
    differentiated = (v for key, v in inputs.items() if key in evaluator.differentiated)
    return frozenset[str]().union(*inputs.values()).difference(*differentiated)


def _update(flat: FlatDiagram, between: Evaluator) -> tuple[Evaluator, list[Any]] | None:
    """Memory and states after a sample instant, and the evaluator that formed them; None when nothing is updated."""
    if not (flat.d or flat.resets):
        return None
    evaluator = Evaluator(flat, held=False, refuse=between.refuse, held_inputs=between.held_inputs, share=between)
    return evaluator, [_column(part) for part in evaluator.updates()]


def _closed(
    reads: list[Any], between: Evaluator, results: list[Any], update: tuple[Evaluator, list[Any]] | None
) -> dict[str, Any]:
    """``rhs`` and ``update`` with their loops solved, ``loops``, the ``forms`` of both for kernels, ``watched``."""
    closures = [_closure(between, 0)]
    at_samples = (None, None, None)
    if update is not None:
        closures.append(_closure(update[0], closures[0].count))
        at_samples = functions("update", [*reads, update[0].hit], update[1], closures[1])

    def formed(columns: list[Any]) -> tuple[Any, LoopForms | None]:
        rhs, plain, exact = functions("rhs", reads, columns, closures[0])
        if not any(c.size for c in closures):
            return rhs, None
        opened = open_function(reads, columns, closures[0])
        return rhs, LoopForms((plain, at_samples[1]), (exact, at_samples[2]), opened)

    rhs, forms = formed(results)
    loops = tuple(loop for closure in closures for loop in closure.loops)
    moving = {path: one for path, one in closures[0].determinants if other_symbols(one, reads[-1]).shape[0]}
    watched = None
    if moving:
        signals = ca.vertcat(results[1], *moving.values())
        watched = WatchedLoops(tuple(moving), *formed([results[0], signals, results[2]]))
    return {"rhs": rhs, "update": at_samples[0], "loops": loops, "forms": forms, "watched": watched}


def _closure(evaluator: Evaluator, first: int) -> Closure:
    """The loops of an evaluator, solved. Raises AlgebraicLoop for one that is singular whatever the parameters."""
    made = Closure(list(evaluator.tears.values()), first, function="rhs" if evaluator.held else "update")
    for path in made.singular:
        text = (
            f"{' -> '.join(path)} passes its own value on unchanged (its loop gain is 1), so it has no solution, or "
            "infinitely many. Check the signs of its sums, or break it with a block that has a state."
        )
        raise AlgebraicLoop(evaluator.flat.title, [text], evaluator.flat.where, path)
    return made


def _initial(flat: FlatDiagram, keys: Iterable[tuple[str, ...]]) -> list[Any]:
    """Initial states in terms of parameters; a held output is set by its first sample."""
    states = {path: block.states for path, block in flat.symbolic_blocks.items()}
    return [ca.SX(0) if is_held_output(key) else ca.SX(states[key[0]][key[1]].start) for key in keys]


def _column(elements: list[Any]) -> Any:
    """A column of expressions, which may be empty."""
    return ca.vertcat(*elements) if elements else ca.SX(0, 1)


def _signals(flat: FlatDiagram, evaluator: Evaluator) -> dict[str, Any]:
    """Expressions of all signals that can be logged: inputs, outputs of blocks as evaluated, states."""
    signals = {name: evaluator.value["u", name] for name in flat.inputs}
    signals |= {f"{node[1]}.{node[2]}": value for node, value in evaluator.value.items() if node[0] == "y"}
    states = (*evaluator.x.items(), *evaluator.d.items())  # no state has the name of a port
    return signals | {".".join(key): value for key, value in states if not is_held_output(key)}


def _units(diagram: Diagram, flat: FlatDiagram, names: Iterable[str]) -> dict[str, str]:
    """Units of signals, where they are known."""
    found = {name: diagram.unit(name) for name in names}
    for key, block in flat.blocks.items():
        for name, state in block.states.items():
            if not found.get(f"{key}.{name}") and "?" not in state.unit:
                found[f"{key}.{name}"] = state.unit
    return {k: v for k, v in found.items() if v}
