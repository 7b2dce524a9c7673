"""Equations, ports and checks of linear systems, which continuous and sampled blocks share.

The two differ in their operator alone: what ``state_equation`` and ``fraction_states`` give are the rates of the states
of a continuous block, and the states at the next sample of a sampled one. The functions take a block as ``self``, so
that its class can use them as methods.
"""

# ruff: noqa: ARG001 - the methods of a block take t, x, u whether or not they read them

from __future__ import annotations

import re
from keyword import iskeyword
from typing import Any

import attrs

from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.common.units import UnitError, parse
from tsmblocks.model.block import Input, Output, State, option

Rows = tuple[tuple[float, ...], ...]
_NAMED = re.compile(r"\s*([A-Za-z]\w*)\s*(?:\[([^\[\]]*)\])?\s*", re.ASCII)


def initial_states(x0: tuple[Any, ...], n: int, about: str, letter: str = "x", unit: str = "") -> dict[str, State]:
    """States ``x1`` to ``xn``; without initial values they are zero."""
    return {f"{letter}{k}": State(start, f"{about} {k}", unit) for k, start in enumerate(x0 or (0.0,) * n, 1)}


def check_initial(owner: str, x0: tuple[Any, ...], n: int, what: str = "state") -> None:
    """Raise ParameterError unless there are n initial values or none."""
    if x0 and len(x0) != n:
        raise ParameterError(f"{owner}.x0 needs one number per {what} ({n}) or none, got {len(x0)}.")


# ---- num/den ------------------------------------------------------------------------------------


def section(num: Any, den: Any, x: Any, u: Any) -> tuple[tuple[Any, ...], Any]:
    """States under the operator, and output, of num/den in reachable canonical form.

    A missing coefficient must not appear: as a symbol, 0 * u would count as a path from input to output.
    """
    newest = (u - sum(a * z for a, z in zip(den[1:], x, strict=True))) / den[0]
    kept = (newest, *x)[len(den) - len(num) :]
    return (newest, *x)[: len(x)], sum(b * z for b, z in zip(num, kept, strict=True))


def fraction_states(block: Any, t: Any, x: Any, u: Any) -> dict[str, Any]:
    """Canonical states of a transfer function under the operator, by name."""
    return dict(zip(x._fields, section(block.num, block.den, x, u.u)[0], strict=True))


def fraction_output(block: Any, t: Any, x: Any, u: Any) -> dict[str, Any]:
    """Output of a transfer function in canonical form."""
    return dict(y=section(block.num, block.den, x, u.u)[1])


def check_fraction(block: Any) -> None:
    """Raise ParameterError unless num/den is a proper fraction of two polynomials."""
    owner, num, den = type(block).__name__, block.num, block.den
    if not den or den[0] == 0:
        raise ParameterError(f"{owner}.den must begin with a number other than 0, got {in_words(den)}.")
    if not 1 <= len(num) <= len(den):
        raise ParameterError(f"{owner} must be proper: 1 <= len(num) <= len(den), got {len(num)} and {len(den)}.")
    check_initial(owner, block.x0, len(den) - 1)


# ---- A, B, C, D ---------------------------------------------------------------------------------


def state_equation(block: Any, t: Any, x: Any, u: Any) -> dict[str, Any]:
    """A x + B u, the states under the operator, by name."""
    new = (_dot(a, x) + _dot(b, u) for a, b in zip(block.A, block.B, strict=True))
    return dict(zip(x._fields, new, strict=True))


def output_equation(block: Any, t: Any, x: Any, u: Any) -> dict[str, Any]:
    """C x + D u, by the names of the outputs; a missing matrix is no path."""
    n = _sizes(block)[2]
    kept = [_dot(c, x) for c in block.C if c] or [0.0] * n
    direct = [_dot(d, u) for d in _direct(block)] or [0.0] * n
    return dict(zip(block.outports, (c + d for c, d in zip(kept, direct, strict=True)), strict=True))


def _dot(row: Any, values: Any) -> Any:
    return sum(a * b for a, b in zip(row, values, strict=True))


def _direct(block: Any) -> Rows:
    """The direct matrix; without any matrix the signal passes unchanged."""
    return block.D if block.A or block.B or block.C or block.D else ((1.0,),)


def _sizes(block: Any) -> tuple[int, int, int]:
    """Numbers of states, inputs and outputs."""
    direct = _direct(block)
    return len(block.A), len((*block.B, *direct, ())[0]), len(block.C or direct)


@property  # type: ignore[misc]
def matrix_inputs(block: Any) -> dict[str, Input]:
    """One input for each column of B."""
    names = _names_and_units(block.input_names, "u", _sizes(block)[1])
    return {name: Input("any signal", unit) for name, unit in names}


@property  # type: ignore[misc]
def matrix_outputs(block: Any) -> dict[str, Output]:
    """One output for each row of C."""
    names = _names_and_units(block.output_names, "y", _sizes(block)[2])
    return {name: Output("combination of states and inputs", unit) for name, unit in names}


@property  # type: ignore[misc]
def matrix_states(block: Any) -> dict[str, State]:
    """One state for each row of A."""
    usual = initial_states(block.x0, len(block.A), "state")
    if not block.state_names:
        return usual
    names = map(_name_and_unit, block.state_names)
    return {name: attrs.evolve(s, unit=unit) for (name, unit), s in zip(names, usual.values(), strict=True)}


def names_of(what: str, usual: str) -> Any:
    """An option for names of ports or states."""
    return option(default=(), about=f"names of the {what}, such as 'a' or 'a [rad]'; an empty list means {usual}")


def _name_and_unit(text: str) -> tuple[str, str]:
    """Name and unit of ``"a [rad]"``; no name where it is written otherwise."""
    found = _NAMED.fullmatch(text)
    return (found[1], found[2] or "") if found else ("", "")


def _names_and_units(names: tuple[str, ...], letter: str, n: int) -> list[tuple[str, str]]:
    """The names that were given, else ``u`` for one port, ``u1``, ``u2``, … for more."""
    usual = [letter] if n == 1 else [f"{letter}{k}" for k in range(1, n + 1)]
    return [_name_and_unit(text) for text in names] or [(name, "") for name in usual]


def check_matrices(block: Any) -> None:
    """Raise ParameterError unless A, B, C and D have matching dimensions."""
    owner = type(block).__name__
    for name in "ABCD":
        if not all(
            isinstance(row, tuple) and not any(isinstance(v, tuple) for v in row) for row in getattr(block, name)
        ):
            raise ParameterError(f"{owner}.{name} must be a list of rows, such as [[1, 0], [0, 1]].")
    n, inputs, outputs = _sizes(block)
    if any(len(row) != n for row in block.A):
        lengths = ", ".join(str(len(row)) for row in block.A)
        raise ParameterError(f"{owner}.A must be square, got {n} row{'s' * (n > 1)} of length {lengths}.")
    if not inputs or not outputs:
        raise ParameterError(f"{owner} needs at least one input (columns of B) and one output (rows of C).")
    for name, rows, columns in (("B", n, inputs), ("C", outputs, n), ("D", outputs, inputs)):
        matrix = getattr(block, name)
        missing = not matrix and (not n or name == "D")
        if not missing and (len(matrix) != rows or any(len(row) != columns for row in matrix)):
            lengths = ", ".join(str(len(row)) for row in matrix) or "none"
            wanted = f"{rows} rows of {columns}, to match the other matrices"
            raise ParameterError(f"{owner}.{name} must have {wanted}, got rows of length {lengths}.")
    check_initial(owner, block.x0, n)
    _check_names(block)


def _check_names(block: Any) -> None:
    """Raise ParameterError unless there is a name for each port and state (or none at all), no two alike."""
    owner, taken = type(block).__name__, set[str]()
    for what, n in zip(("state", "input", "output"), _sizes(block), strict=True):
        names, field = getattr(block, f"{what}_names"), f"{owner}.{what}_names"
        if names and len(names) != n:
            raise ParameterError(f"{field} needs one name per {what} ({n}) or none, got {len(names)}.")
        for text in names:
            name = _checked(field, text)
            if name in taken:
                own = "states, inputs and outputs need different names"
                raise ParameterError(f"{field}: '{name}' is taken already; {own}.")
            taken.add(name)


def _checked(field: str, text: Any) -> str:
    """The name in a text such as ``"a [rad]"``; raises ParameterError where there is none, or no unit."""
    name, unit = _name_and_unit(text) if isinstance(text, str) else ("", "")
    if not name or iskeyword(name):
        write = "Write letters, digits and underscores, and a unit in brackets where there is one, such as 'a [rad]'."
        raise ParameterError(f"{field}: {in_words(text)} is no name. {write}")
    try:
        parse(unit)
    except UnitError as error:
        raise ParameterError(f"{field}: '{text}': {error}") from None
    return name
