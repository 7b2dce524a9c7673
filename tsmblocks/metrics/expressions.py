"""Expressions written as text: of parameters in a fit, of signals in a metric. No text is ever executed.

A text is parsed into Python's syntax tree, and only arithmetic, a few functions and the names that are known are
taken out of it. Messages show the text and point at the place.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from typing import Any, NoReturn

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import ParameterError, clip, in_words, near

MAX_LENGTH = 1000
"""Characters of one text at most. Chosen: a longer one is a mistake."""
MAX_DEPTH = 100
"""Levels of brackets and operations in one text at most. Chosen: far below Python's limit of recursion, 1000."""
EXCERPT_LENGTH = 80
"""Characters of a text that a message has around a fault. Chosen: a line of a terminal."""
_OF_ONE = ("exp", "log", "sqrt", "sin", "cos", "tan", "tanh")
FUNCTIONS = ("abs", *_OF_ONE, "min", "max")
"""Functions that may be used: ``min`` and ``max`` of two arguments or more, the others of one."""
_OPERATIONS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


@attrs.frozen
class _Kind:
    """What expressions are evaluated with: the type of a plain number, and the functions by name."""

    number: Callable[[float], Any]
    functions: Mapping[str, Callable[..., Any]]


# Neither number is a Python number, which would raise on 9**9**9 or 1/0.
_SYMBOLIC = _Kind(ca.SX, {"abs": ca.fabs, "min": ca.fmin, "max": ca.fmax, **{k: getattr(ca, k) for k in _OF_ONE}})
_ARRAYS = _Kind(
    np.float64, {"abs": np.abs, "min": np.minimum, "max": np.maximum, **{k: getattr(np, k) for k in _OF_ONE}}
)


@attrs.frozen
class Expression:
    """An expression: its ``text`` and the full ``names`` it uses, in order of appearance.

    ``tree`` is what was read; ``meaning`` maps names as they are written there to full ones.
    """

    text: str
    names: tuple[str, ...]
    tree: ast.expr = attrs.field(repr=False, eq=False)
    meaning: Mapping[str, str] = attrs.field(repr=False, eq=False)

    def symbolic(self, symbols: Mapping[str, Any]) -> Any:
        """Form the expression of CasADi symbols (or numbers) by full name. Raises ParameterError for one not given."""
        for name in self.names:
            if name not in symbols:
                raise ParameterError(f"'{clip(self.text)}' needs '{name}', which is not given.{near(name, symbols)}")
        return _evaluated(self.tree, self._by_written(symbols), _SYMBOLIC)

    def of_arrays(self, values: Mapping[str, Any]) -> Any:
        """The same of NumPy arrays by full name, element by element; where it has no value, NaN or infinity."""
        with np.errstate(all="ignore"):
            return _evaluated(self.tree, self._by_written(values), _ARRAYS)

    def _by_written(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {written: values[full] for written, full in self.meaning.items()}


def expression(text: str, known: Sequence[str], *, what: str = "expression", kind: str = "parameter") -> Expression:
    """Read an expression such as ``"2 * tsm.theta"``: numbers, ``+ - * / **``, brackets, ``pi`` and the functions.

    ``known`` are full names; the end of one (``theta``) is enough where no other ends so. Messages begin with
    ``what`` it is, and ``kind`` says of what the names are. Raises ParameterError for anything else, for unknown
    names and for names that may mean several.
    """
    read = reader(what, text, known, kind)
    if isinstance(read.tree, (ast.Compare, ast.BoolOp)):
        read.refuse("this is a comparison, but an expression is expected here.")
    return read.read(read.tree)


# ---- names -----------------------------------------------------------------------------------------


def full_name(name: str, known: Sequence[str], kind: str = "parameter") -> str:
    """The full name that a name means. Raises ParameterError where it means none, or several."""
    if name in known:
        return name
    hits = [k for k in known if k.endswith(f".{name}")]
    if len(hits) == 1:
        return hits[0]
    if hits:
        more = f" or {len(hits) - 3} more" if len(hits) > 4 else ""
        raise ParameterError(
            f"'{clip(name)}' may mean {' or '.join(hits[: 3 if more else 4])}{more}. Give the full name."
        )
    hints = near(name, known), near(name, {k.rpartition(".")[2] for k in known})
    raise ParameterError(
        f"there is no {kind} '{clip(name)}'.{next((h for h in hints if 'Did you mean' in h), hints[0])}"
    )


def name_in(node: ast.AST) -> str | None:
    """``tsm.alpha1``, ``lag.den[0]`` or ``alpha1`` as a text; None for anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        end = f".{node.attr}"
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and type(node.slice.value) is int:
        end = f"[{node.slice.value}]"
    else:
        return None
    head = name_in(node.value)
    return None if head is None else head + end


# ---- reading ---------------------------------------------------------------------------------------


@attrs.frozen(eq=False)
class Reader:
    """One text being read: its tree, and messages about places in it.

    ``what`` begins every message; ``known`` are the names that it may have, and ``kind`` says of what.
    """

    what: str
    text: str
    tree: ast.expr
    known: Sequence[str]
    kind: str = "parameter"

    def refuse(self, why: str, node: ast.expr | None = None, last: ast.expr | None = None) -> NoReturn:
        """Raise ParameterError, with the text and a mark under a place (up to the end of ``last``)."""
        node = node or self.tree
        _refuse(self.what, self.text, why, self._at(node.col_offset), self._at((last or node).end_col_offset))

    def _at(self, offset: int | None) -> int:
        """Place of a character; the tree counts in bytes."""
        return len(self.text.encode()[:offset].decode())

    def read(self, node: ast.expr, text: str = "") -> Expression:
        """Read a part of the tree, every piece of it checked."""
        meaning: dict[str, str] = {}
        self._check(node, meaning)
        return Expression(text or self.text, tuple(dict.fromkeys(meaning.values())), node, meaning)

    def full(self, name: str, node: ast.expr) -> str:
        """The full name that a name at this place means."""
        try:
            return full_name(name, self.known, self.kind)
        except ParameterError as error:
            self.refuse(str(error), node)

    def _check(self, node: ast.expr, meaning: dict[str, str]) -> None:
        """Refuse all but finite arithmetic; collect the names."""
        name = name_in(node)
        if name is not None:
            if name != "pi":
                meaning[name] = self.full(name, node)
            return
        if isinstance(node, ast.Constant):
            if finite_or_none(node.value) is None:
                self.refuse(f"{in_words(node.value, 30)} is no finite number.", node)
            return
        inside: dict[str, str] = {}
        for part in self._parts(node):
            self._check(part, inside)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and _is_zero(node.right):
            self.refuse("this is a division by zero.", node)
        if not inside and hasattr(node, "lineno") and not math.isfinite(float(_evaluated(node, {}, _SYMBOLIC))):
            self.refuse("this is no finite number.", node)
        meaning.update(inside)

    def _parts(self, node: ast.expr) -> list[ast.expr]:
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            return [node.operand]
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
            return [node.left, node.right]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor):
            self.refuse("there is no operation '^'. Write ** for a power.", node)
        if isinstance(node, ast.Tuple):
            self.refuse("these are several expressions. Give each as a separate text.", node)
        if not isinstance(node, ast.Call):
            self.refuse(
                f"this is no arithmetic. Known here: numbers, + - * / **, {', '.join(FUNCTIONS)}, pi, and "
                f"names of {self.kind}s.",
                node,
            )
        return self._arguments(node)

    def _arguments(self, node: ast.Call) -> list[ast.expr]:
        name = name_in(node.func)
        if name not in FUNCTIONS:
            shown = "" if name is None else f" '{clip(name, 40)}'"
            self.refuse(f"there is no function{shown}.{near(name or '', FUNCTIONS, most=12)}", node.func)
        if any(isinstance(a, ast.Starred) for a in node.args) or node.keywords:
            self.refuse(f"{name} takes plain arguments.", node)
        several = name in ("min", "max")
        if len(node.args) < 2 if several else len(node.args) != 1:
            wanted = "two arguments or more" if several else "one argument"
            self.refuse(f"{name} takes {wanted}, got {len(node.args)}.", node)
        return node.args


def reader(what: str, text: Any, known: Sequence[str], kind: str = "parameter") -> Reader:
    """Parse a text. Raises ParameterError for anything else, for one that is too long or cannot be parsed."""
    text = " ".join(text.split()) if isinstance(text, str) else text
    if not isinstance(text, str) or not text or not text.isprintable():
        raise ParameterError(f"{what}: a text such as '2 * theta' is expected, got {in_words(text)}.")
    if len(text) > MAX_LENGTH:
        start = in_words(text[:50], 30)
        raise ParameterError(f"{what}: {start} has {len(text)} characters; {MAX_LENGTH} are the most.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # '1if' and '\d' in quotes, which are refused below
            tree = ast.parse(text, mode="eval").body
    except SyntaxError as error:
        place = min(max((error.offset or 1) - 1, 0), len(text) - 1)
        hint = " Write == for equal." if text[place] == "=" or "==" in error.msg else _unit_hint(text, kind)
        _refuse(what, text, f"this cannot be read from here on.{hint}", place, place + 1)
    except (ValueError, RecursionError, MemoryError):
        _refuse(what, text, "this cannot be read.", 0, len(text))
    if _depth(tree) > MAX_DEPTH:
        _refuse(what, text, f"this is nested more than {MAX_DEPTH} deep.", 0, len(text))
    return Reader(what, text, tree, known, kind)


def _unit_hint(text: str, kind: str) -> str:
    """A hint where a number has a unit in a text that cannot be read, else ``""``."""
    for number, unit in re.findall(r"(?<![\w.])(\d+\.?\d*(?:e[+-]?\d+)?) ?(%|°|[^\W\d_]+)", text):
        if unit == "%":
            return f" {number} % is written {float(number) / 100:g}."
        with suppress(units.UnitError):
            units.parse(unit)
            return f" A number has no unit here; it is in that of the {kind}. 1 deg in rad is pi / 180."
    return ""


def _refuse(what: str, text: str, why: str, first: int, last: int) -> NoReturn:
    start = max(0, min(first - EXCERPT_LENGTH // 2, len(text) - EXCERPT_LENGTH))
    shown, before = text[start : start + EXCERPT_LENGTH], "…" if start else ""
    after = "…" if start + EXCERPT_LENGTH < len(text) else ""
    mark = " " * (len(before) + first - start) + "^" * max(min(last, start + EXCERPT_LENGTH) - first, 1)
    raise ParameterError(f"{what}: {why}\n    {before}{shown}{after}\n    {mark}")


def _depth(node: ast.AST) -> int:
    """Levels of a tree, counted without recursion, up to one more than may be."""
    level, deepest = [node], 0
    while level and deepest <= MAX_DEPTH:
        level, deepest = [child for n in level for child in ast.iter_child_nodes(n)], deepest + 1
    return deepest


def _is_zero(node: ast.expr) -> bool:
    """Whether a part is zero without any parameter in it."""
    named = any(name_in(n) not in (None, "pi", *FUNCTIONS) for n in ast.walk(node))
    return not named and float(_evaluated(node, {}, _SYMBOLIC)) == 0


def finite_or_none(value: Any) -> float | None:
    """A finite number, or None: texts, truth values, complex numbers and infinity are none."""
    if isinstance(value, (bool, str, complex)):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _evaluated(node: ast.AST, values: Mapping[str, Any], kind: _Kind) -> Any:
    name = name_in(node)
    if name is not None:
        return kind.number(math.pi) if name == "pi" else values[name]
    if isinstance(node, ast.Constant):
        return kind.number(finite_or_none(node.value) or 0.0)
    if isinstance(node, ast.UnaryOp):
        inner = _evaluated(node.operand, values, kind)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return _OPERATIONS[type(node.op)](_evaluated(node.left, values, kind), _evaluated(node.right, values, kind))
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    function, arguments = kind.functions[node.func.id], [_evaluated(a, values, kind) for a in node.args]
    return reduce(function, arguments) if len(arguments) > 1 else function(*arguments)
