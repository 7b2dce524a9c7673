"""The sets of parameters of a batch: read, and checked before anything is run."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.engine.equations import Equations
from tsmblocks.model.block import Block, is_reference, leaves, map_leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path


def parameter_sets(eq: Equations, diagram: Diagram, parameters: Mapping[str, Any]) -> tuple[dict[str, np.ndarray], int]:
    """The values of each parameter, shape (sets,), and the number of sets. Raises ParameterError."""
    for name in parameters:
        parameter_index(eq, name, diagram)
    sets = {name: _column(name, values) for name, values in parameters.items()}
    lengths = {name: len(v) for name, v in sets.items()}
    if not sets or min(lengths.values()) == 0:
        raise ParameterError(f"a batch of '{diagram.title}' needs at least one parameter with at least one value.")
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{k} has {n}" for k, n in lengths.items())
        raise ParameterError(f"the parameters of a batch need one value per set each; {listed}.")
    _check_sets(diagram, sets)
    return sets, next(iter(lengths.values()))


def _column(name: str, values: Any) -> np.ndarray:
    try:
        column = np.atleast_1d(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        raise ParameterError(f"'{name}' must have one number per set of the batch, got {in_words(values)}.") from None
    if column.ndim != 1:
        raise ParameterError(
            f"'{name}' must have one number per set of the batch, got an array of shape {column.shape}."
        )
    return column


def _check_sets(diagram: Diagram, sets: Mapping[str, np.ndarray]) -> None:
    """Raise ParameterError for a set that a block refuses, with the block's message.

    Bounds are intervals, so the sets with the extreme values are checked; of blocks that check several varied
    parameters together (a lower and an upper limit), every set.
    """
    extremes = sorted({int(f(v)) for v in sets.values() for f in (np.argmin, np.argmax)})
    for k in extremes:
        try:
            diagram.with_parameters({name: float(v[k]) for name, v in sets.items()})
        except ParameterError as error:
            raise ParameterError(f"set {k} of the batch: {error}") from None
    for path, block_in in _checked_together(diagram, sets):
        for k in range(len(next(iter(sets.values())))):
            try:
                block_in(k)
            except ParameterError as error:
                raise ParameterError(f"set {k} of the batch: {path}: {error}") from None


def _checked_together(
    diagram: Diagram, sets: Mapping[str, np.ndarray], prefix: str = ""
) -> Iterator[tuple[str, Callable[[int], Block]]]:
    """Paths of the blocks that check several varied parameters together, and each block in set k."""
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            yield from _checked_together(block, sets, f"{prefix}{name}.")
            continue
        names = {
            leaf: prefix + v[1:] if is_reference(v) else f"{prefix}{name}.{leaf}"
            for key, value in block.parameters.items()
            for leaf, v in leaves(value, key)
        }
        if type(block).check is not Block.check and sum(v in sets for v in names.values()) > 1:
            yield prefix + name, functools.partial(_in_set, block, diagram.values, names, sets)


def _in_set(
    block: Block, values: Mapping[str, float], names: Mapping[str, str], sets: Mapping[str, np.ndarray], k: int
) -> Block:
    """A block in set k; ``values`` are those of its diagram, ``names`` the full names of its own parameters."""

    def number(leaf: str, value: Any) -> float:
        if names[leaf] in sets:
            return float(sets[names[leaf]][k])
        return values[value[1:]] if is_reference(value) else value

    return block.replace(**{key: map_leaves(number, v, key) for key, v in block.parameters.items()})


def parameter_index(eq: Equations, name: str, diagram: Diagram) -> int:
    """Position of a parameter that can vary between runs. Raises ParameterError for any other name."""
    if name not in eq.p and name in diagram.parameter_names():
        raise ParameterError(
            f"'{name}' changes the equations of '{eq.title}' (it is an option, or a whole list), so it "
            "cannot vary between runs side by side. Simulate once for each value."
        )
    if name not in eq.p:
        raise ParameterError(
            f"diagram '{eq.title}' has no parameter '{name}' that can vary between runs.{near_path(str(name), eq.p)}"
        )
    return eq.p.index(name)
