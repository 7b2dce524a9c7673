"""What the continuous and the sampled linear blocks share: start values, ports, A, B, C and D."""

from __future__ import annotations

from typing import Any

from tsmblocks.block import Input, Output, State
from tsmblocks.errors import ParameterError

Rows = tuple[tuple[float, ...], ...]


def start_values(x0: tuple[Any, ...], n: int, about: str, letter: str = "x") -> dict[str, State]:
    """States ``x1`` to ``xn``; without start values they start at zero."""
    return {f"{letter}{k}": State(start, f"{about} {k}") for k, start in enumerate(x0 or (0.0,) * n, 1)}


def check_starts(owner: str, x0: tuple[Any, ...], n: int) -> None:
    """Raise ParameterError unless there are n start values or none."""
    if x0 and len(x0) != n:
        raise ParameterError(f"{owner}.x0 needs one number per state ({n}) or none, got {len(x0)}.")


def shape(block: Any) -> tuple[int, int, int]:
    """Numbers of states, inputs and outputs of a block with matrices."""
    return len(block.A), len((*block.B, *block.D, ())[0]), len(block.C or block.D)


def check_matrices(block: Any) -> None:
    """Raise ParameterError unless A, B, C and D go together."""
    owner = type(block).__name__
    for name in "ABCD":
        if not all(isinstance(row, tuple) for row in getattr(block, name)):
            raise ParameterError(f"{owner}.{name} must be a list of rows, such as [[1, 0], [0, 1]].")
    n, inputs, outputs = shape(block)
    if not inputs or not outputs:
        raise ParameterError(f"{owner} needs at least one input (columns of B) and one output (rows of C).")
    for name, rows, columns in (("A", n, n), ("B", n, inputs), ("C", outputs, n), ("D", outputs, inputs)):
        matrix = getattr(block, name)
        if not matrix and (not n or name == "D"):
            continue
        if len(matrix) != rows or any(len(row) != columns for row in matrix):
            lengths = ", ".join(str(len(row)) for row in matrix) or "none"
            raise ParameterError(
                f"{owner}.{name} must have {rows} rows of {columns}, as the other matrices have it, "
                f"got rows of length {lengths}."
            )
    check_starts(owner, block.x0, n)


def numbered(letter: str, n: int) -> list[str]:
    """``u`` for one port, ``u1``, ``u2``, … for more."""
    return [letter] if n == 1 else [f"{letter}{k}" for k in range(1, n + 1)]


def inputs_of(block: Any) -> dict[str, Input]:
    """One input for each column of B."""
    return {name: Input("any signal") for name in numbered("u", shape(block)[1])}


def outputs_of(block: Any) -> dict[str, Output]:
    """One output for each row of C."""
    return {name: Output("combination of states and inputs") for name in numbered("y", shape(block)[2])}


def state_map(block: Any, x: Any, u: Any) -> dict[str, Any]:
    """A x + B u, by the names of the states."""
    new = (_dot(a, x) + _dot(b, u) for a, b in zip(block.A, block.B, strict=True))
    return dict(zip(x._fields, new, strict=True))


def output_map(block: Any, x: Any, u: Any) -> dict[str, Any]:
    """C x + D u, by the names of the outputs; a matrix that is not there is no path."""
    n = shape(block)[2]
    kept = [_dot(c, x) for c in block.C if c] or [0.0] * n
    direct = [_dot(d, u) for d in block.D] or [0.0] * n
    return dict(zip(numbered("y", n), (c + d for c, d in zip(kept, direct, strict=True)), strict=True))


def _dot(row: Any, values: Any) -> Any:
    return sum(a * b for a, b in zip(row, values, strict=True))
