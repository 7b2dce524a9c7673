"""Equations of diagrams, compiled once for each structure and kept, and parameters in their order."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.kept import KeptFor
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.compiler.dependencies import nesting
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import Signal
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions, as_diagram

SOLVE, REFUSE = "solve", "refuse"
"""The treatment of algebraic loops."""
_COMPILED: dict[Any, Equations] = {}
_KEPT = 256


def signature(diagram: Diagram) -> Any:
    """Everything about a diagram except its parameter values; equal signatures have the same equations."""
    parts: list[Any] = []
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            parts.append((name, signature(block)))
        else:
            parts.append((name, _block_signature(block)))
    inlets = tuple((k, v.unit, diagram.inlets[k]) for k, v in diagram.inputs.items())
    shown = (tuple(diagram.outputs.items()), tuple(diagram.output_units.items()))
    return (tuple(parts), frozenset(diagram.links), inlets, *shown, tuple(diagram.values))


def equations(diagram: Diagram, *, loops: str = SOLVE) -> Equations:
    """The equations of a diagram, compiled once for each structure: other parameter values reuse them.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    loops : {"solve", "refuse"}
        Solve algebraic loops, or raise AlgebraicLoop for one.

    Returns
    -------
    Equations
        States, inputs, parameters and outputs by name, and the right-hand side as CasADi functions.

    Raises
    ------
    RunError
        For an argument that is no diagram, and for ``loops`` other than these.
    DiagramError
        For a diagram that cannot be compiled: open ports, units that do not match, or a refused algebraic loop.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.equations(tsm.load("motor_linear")).x
    ('motor.angle', 'motor.speed')
    """
    diagram = as_diagram(diagram)
    if not isinstance(loops, str) or loops not in (SOLVE, REFUSE):
        raise RunError(f"loops must be 'solve' or 'refuse', got {in_words(loops)}.{near(str(loops), (SOLVE, REFUSE))}")
    return _refusing(diagram) if loops == REFUSE else _solving(diagram)


def for_inputs(
    eq: Equations, diagram: Diagram, signals: list[tuple[Signal, int]], start: float, step: float
) -> tuple[Equations, list[tuple[Signal, int]]]:
    """The equations of a diagram (``eq``) and its inputs for a run from ``start`` in steps of ``step`` [s].

    Where a held input is delayed its past is constant within steps, and not a curve through them; so is the input then,
    which is averaged over the steps in which it changes.
    """
    delayed = {one.name: one for one, _ in signals if one.name in eq.delayed_inputs and one.hold == "zero"}
    made = with_held(eq, diagram, delayed) if any(len(one.t) > 2 for one in delayed.values()) else eq
    if made is eq:
        return eq, signals
    return made, [(one.averaged(start, step) if one.name in delayed else one, order) for one, order in signals]


def for_run(eq: Equations, diagram: Diagram, options: RunOptions) -> tuple[Equations, list[tuple[Signal, int]]]:
    """As ``for_inputs``, with the inputs and the instants of a run. Raises as ``gather_signals`` does."""
    times = options.times
    return for_inputs(eq, diagram, options.signals(eq), times.start, times.h)


def with_held(eq: Equations, diagram: Diagram, inputs: Iterable[str]) -> Equations:
    """The equations of a diagram (``eq``) with some of its inputs held within steps; ``eq`` where no delay reads them.

    A rate of such an input does not exist; where ``eq`` has one they stay as they are.
    """
    held = eq.delayed_inputs & frozenset(inputs)
    made = _compiled(diagram, refuse=False, held=held) if held else eq
    return made if made.u == eq.u else eq


def _compiled(diagram: Diagram, refuse: bool, held: frozenset[str] = frozenset()) -> Equations:
    """The equations of a diagram, from those compiled before where its structure is known."""
    key = (diagram.title, signature(diagram), held)
    found = _COMPILED.pop(key, None)
    if found is None:
        found = compile_diagram(diagram, refuse_loops=refuse, held_inputs=held)
        while len(_COMPILED) >= _KEPT:
            _COMPILED.pop(next(iter(_COMPILED)))
    _COMPILED[key] = found
    if refuse and found.loops:
        compile_diagram(diagram, refuse_loops=True)  # raises
    return found


@KeptFor
def _block_signature(block: Block) -> Any:
    """Everything about a block except its parameter values; most blocks stay where a parameter changes."""
    shape = tuple((k, nesting(v)) for k, v in block.parameters.items())
    return type(block), shape, tuple(block.options.items())


@KeptFor
def _solving(diagram: Diagram) -> Equations:
    return _compiled(diagram, refuse=False)


@KeptFor
def _refusing(diagram: Diagram) -> Equations:
    return _compiled(diagram, refuse=True)


def parameter_vector(eq: Equations, diagram: Diagram) -> np.ndarray:
    """The parameter values of the diagram in the order of the equations."""
    values = _parameters(diagram)
    return np.array([values[name] for name in eq.p], dtype=float)


@KeptFor
def _parameters(diagram: Diagram) -> dict[str, float]:
    return diagram.parameters
