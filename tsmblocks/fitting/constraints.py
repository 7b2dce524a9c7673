"""Constraints and ties of a fit, written as text."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any

import attrs
import casadi as ca

from tsmblocks.common.errors import ParameterError, clip, in_words
from tsmblocks.metrics.expressions import Expression, expression, finite_or_none, full_name, reader

_COMPARISONS: dict[type, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "=="}


@attrs.frozen
class Constraint:
    """One comparison: ``expression`` is to be >= 0, or = 0 where ``equality`` says so.

    ``name`` is the one given, or the text itself; ``strict`` is True for ``<`` and ``>``.
    """

    name: str
    text: str
    expression: Expression
    equality: bool = False
    strict: bool = False


Ties = tuple[tuple[str, Expression], ...]
"""Parameters that follow others, as (full name, expression), each after those it needs."""


def constraints(
    given: Any, known: Sequence[str], *, what: str = "constraint", kind: str = "parameter"
) -> tuple[Constraint, ...]:
    """Read constraints: one text, a list of texts, or a mapping from names to texts. Raises ParameterError.

    Messages say ``what`` they are and of what ``kind`` the names.
    """
    if isinstance(given, str):
        given = [given]
    if isinstance(given, Mapping):
        pairs = [(str(name), text) for name, text in given.items()]
    elif isinstance(given, Sequence):
        pairs = [("", text) for text in given]
    else:
        raise ParameterError(
            f"{what}s must be texts such as 'theta > 0', a list or a mapping of them, got {in_words(given)}."
        )
    return tuple(one for name, text in pairs for one in constraint(name, text, known, what=what, kind=kind))


def constraint(
    name: str, text: str, known: Sequence[str], *, what: str = "constraint", kind: str = "parameter"
) -> tuple[Constraint, ...]:
    """Read one comparison; ``0 < a < b`` makes two constraints of the same ``name`` (by default, their texts).

    Raises ParameterError as ``expression`` does, and for a text without comparison or without a parameter.
    """
    read = reader(f"{what} '{clip(name, 40)}'" if name else what, text, known, kind)
    tree = read.tree
    if isinstance(tree, ast.BoolOp):
        read.refuse("one comparison is expected. Write several as a list.")
    if not isinstance(tree, ast.Compare):
        read.refuse("this is not a comparison. Write for example 'theta > 0'.")
    made, sides = list[Constraint](), [tree.left, *tree.comparators]
    for left, sign, right in zip(sides, tree.ops, sides[1:], strict=False):
        if type(sign) not in _COMPARISONS:
            read.refuse(f"comparisons are {', '.join(_COMPARISONS.values())}.", left, right)
        part = read.text if len(tree.ops) == 1 else ast.unparse(ast.Compare(left, [sign], [right]))
        less, equality = isinstance(sign, (ast.Lt, ast.LtE)), isinstance(sign, ast.Eq)
        inside = read.read(ast.BinOp(right if less else left, ast.Sub(), left if less else right), part)
        one = Constraint(name or part, part, inside, equality, isinstance(sign, (ast.Lt, ast.Gt)))
        holds = _decided(one)
        if holds is not None:
            always = "true" if holds else "false"
            read.refuse(f"this is always {always}, for any values of the {kind}s.", left, right)
        made.append(one)
    return tuple(made)


def _decided(one: Constraint) -> bool | None:
    """Whether a constraint is met, if that does not depend on any parameter."""
    value = one.expression.symbolic({name: ca.SX.sym(name) for name in one.expression.names})
    if not value.is_constant():
        return None
    g = float(value)
    return g == 0 if one.equality else g > 0 if one.strict else g >= 0


def ties(given: Mapping[str, Any], known: Sequence[str], free: Sequence[str]) -> Ties:
    """Read ties: parameter -> expression of others, or a number.

    ``free`` are parameters that the fit may change, which cannot follow anything as well. Raises ParameterError
    for that, as ``expression`` does, for one tied twice, and for parameters that depend on each other in a cycle.
    """
    if not isinstance(given, Mapping):
        raise ParameterError(
            f"ties must map parameters to expressions, such as {{'alpha2': 'alpha1'}}, got {in_words(given)}."
        )
    read: dict[str, Expression] = {}
    for name, text in given.items():
        try:
            full = full_name(str(name), known)
        except ParameterError as error:
            raise ParameterError(f"ties: {error}") from None
        if full in read:
            raise ParameterError(f"ties: '{full}' is tied twice.")
        if full in free:
            raise ParameterError(f"ties: '{full}' is free in this fit, so it cannot be tied to {in_words(text)}.")
        value = finite_or_none(text)
        read[full] = expression(text if value is None else repr(value), known, what=f"tie of '{full}'")
    follows = {name: [k for k in tie.names if k in read] for name, tie in read.items()}
    try:
        return tuple((name, read[name]) for name in TopologicalSorter(follows).static_order())
    except CycleError as error:
        circle = error.args[1][::-1]
        if len(circle) == 2:
            raise ParameterError(f"ties: '{circle[0]}' depends on itself.") from None
        way = clip(" -> ".join(circle), 300)
        raise ParameterError(f"ties: parameters depend on each other in a cycle, {way}.") from None
