"""Conditions of signals, written as text: ``"x > 1"``, ``"abs(u) > 23.9 or y < 0"``."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.metrics.expressions import Expression, Reader, reader
from tsmblocks.metrics.metrics import margin_of_comparison, unit_of_expression


@attrs.frozen
class Condition:
    """A comparison of signals, or several joined by ``and`` and ``or``; ``margin`` is above zero where it holds."""

    text: str
    expression: Expression

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals that it reads."""
        return self.expression.names

    def margin(self, signals: Mapping[str, np.ndarray]) -> np.ndarray:
        """By how much it holds, for each instant; it does not where a signal is NaN."""
        with np.errstate(all="ignore"):
            return np.asarray(np.nan_to_num(self.expression.of_arrays(signals), nan=-1.0), dtype=float)


def condition(what: str, text: Any, signals: Mapping[str, str]) -> Condition:
    """Read a condition, ``what`` being the argument that gives it; ``signals`` maps names to units, ``""`` if unknown.

    Raises ParameterError for anything else, for unknown names, and for signals compared in different units.
    """
    read = reader(what, text, list(signals), "signal")
    made = read.read(_margin(read, read.tree, signals))
    if not made.names:
        read.refuse("this contains no signal. Write for example 'x > 1'.")
    return Condition(read.text, made)


def _margin(read: Reader, node: ast.expr, signals: Mapping[str, str]) -> ast.expr:
    """An expression that is above zero where a condition holds."""
    if isinstance(node, ast.Compare):
        made = margin_of_comparison(read, node)
        unit_of_expression(read, made, signals)  # refuses a comparison in different units
        return made
    if not isinstance(node, ast.BoolOp):
        read.refuse("a comparison is expected here, such as x > 1.", node)
    word = "min" if isinstance(node.op, ast.And) else "max"
    call = ast.Call(
        ast.copy_location(ast.Name(word, ast.Load()), node), [_margin(read, v, signals) for v in node.values], []
    )
    return ast.copy_location(call, node)
