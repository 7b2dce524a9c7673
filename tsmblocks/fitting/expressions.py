"""Expressions of named parameters: constraints and ties as people write them; nothing in a text is ever run.

A text is parsed into Python's syntax tree, and only arithmetic, a few functions, comparisons and the names of
parameters are taken out of it. Messages show the text and point at the place.
"""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import attrs
import casadi as ca

from tsmblocks.errors import ParameterError, clip, in_words, near

LONGEST = 1000
"""Characters of one text; a longer one is a mistake."""
DEEPEST = 100
"""Levels of brackets and operations in one text."""
SHOWN = 80
"""Characters of a text shown around the place of a fault."""

_FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "abs": (1, ca.fabs), "exp": (1, ca.exp), "log": (1, ca.log), "sqrt": (1, ca.sqrt), "sin": (1, ca.sin),
    "cos": (1, ca.cos), "tan": (1, ca.tan), "tanh": (1, ca.tanh), "min": (2, ca.fmin), "max": (2, ca.fmax),
}  # fmt: skip
"""Functions that may be used: the fewest arguments they take, and what they are."""
_OPERATIONS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b, ast.Pow: lambda a, b: a**b,
}  # fmt: skip
_COMPARISONS: dict[type, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "=="}


@attrs.frozen
class Expression:
    """An expression of parameters: its ``text`` and the full ``names`` it uses, in order of appearance."""

    text: str
    names: tuple[str, ...]
    _node: ast.expr = attrs.field(repr=False, eq=False)
    _meaning: Mapping[str, str] = attrs.field(repr=False, eq=False)

    def symbolic(self, symbols: Mapping[str, Any]) -> Any:
        """Form the expression of CasADi symbols (or numbers) by full name. Raises ParameterError for one not given."""
        for name in self.names:
            if name not in symbols:
                raise ParameterError(f"'{clip(self.text)}' needs '{name}', which is not given.{near(name, symbols)}")
        return _formed(self._node, {written: symbols[full] for written, full in self._meaning.items()})


@attrs.frozen
class Constraint:
    """One comparison: ``expression`` is to be >= 0, or = 0 where ``equality`` says so.

    ``name`` is the one given, or the text itself; ``strict`` tells ``<`` from ``<=``.
    """

    name: str
    text: str
    expression: Expression
    equality: bool = False
    strict: bool = False


@attrs.frozen
class Ties:
    """Parameters that follow others, as (full name, expression), each after those it needs."""

    items: tuple[tuple[str, Expression], ...] = ()


def expression(text: str, known: Sequence[str]) -> Expression:
    """Read an expression such as ``"2 * tsm.theta"``.

    ``known`` are full names of parameters; the end of one (``theta``) will do where no other ends so.
    Arithmetic is ``+ - * / **``, brackets, ``pi`` and abs, exp, log, sqrt, sin, cos, tan, tanh, min, max.
    Raises ParameterError for anything else, for unknown names and for names that may mean several parameters.
    """
    return _expression("expression", text, known)


def _expression(what: str, text: Any, known: Sequence[str]) -> Expression:
    reader = _reader(what, text, known)
    if isinstance(reader.tree, (ast.Compare, ast.BoolOp)):
        reader.refuse("this compares, but an expression is wanted here.")
    return reader.read(reader.tree)


def constraints(given: Any, known: Sequence[str]) -> tuple[Constraint, ...]:
    """Read constraints: one text, a list of texts, or a mapping from names to texts. Raises ParameterError."""
    if isinstance(given, str):
        given = [given]
    if isinstance(given, Mapping):
        pairs = [(str(name), text) for name, text in given.items()]
    elif isinstance(given, Sequence):
        pairs = [("", text) for text in given]
    else:
        raise ParameterError(f"constraints must be texts such as 'theta > 0', a list or a mapping of them, "
                             f"got {in_words(given)}.")  # fmt: skip
    return tuple(one for name, text in pairs for one in constraint(name, text, known))


def constraint(name: str, text: str, known: Sequence[str]) -> tuple[Constraint, ...]:
    """Read one comparison; ``0 < a < b`` makes two constraints of the same ``name`` (by default, their texts).

    Raises ParameterError as ``expression`` does, and for what compares nothing or does not depend on a parameter.
    """
    reader = _reader(f"constraint '{clip(name, 40)}'" if name else "constraint", text, known)
    tree = reader.tree
    if isinstance(tree, ast.BoolOp):
        reader.refuse("one comparison is wanted. Write several as a list.")
    if not isinstance(tree, ast.Compare):
        reader.refuse("this compares nothing. Write for example 'theta > 0'.")
    made, sides = list[Constraint](), [tree.left, *tree.comparators]
    for left, sign, right in zip(sides, tree.ops, sides[1:], strict=False):
        if type(sign) not in _COMPARISONS:
            reader.refuse(f"comparisons are {', '.join(_COMPARISONS.values())}.", left, right)
        part = reader.text if len(tree.ops) == 1 else ast.unparse(ast.Compare(left, [sign], [right]))
        less, equality = isinstance(sign, (ast.Lt, ast.LtE)), isinstance(sign, ast.Eq)
        inside = reader.read(ast.BinOp(right if less else left, ast.Sub(), left if less else right), part)
        one = Constraint(name or part, part, inside, equality, isinstance(sign, (ast.Lt, ast.Gt)))
        holds = _decided(one)
        if holds is not None:
            always = "true" if holds else "false"
            reader.refuse(f"this is always {always}, whatever the parameters are.", left, right)
        made.append(one)
    return tuple(made)


def _decided(one: Constraint) -> bool | None:
    """Whether a constraint is met, if that does not depend on any parameter."""
    value = one.expression.symbolic({name: ca.SX.sym(name) for name in one.expression.names})
    if not value.is_constant():
        return None
    g = float(value)
    return g == 0 if one.equality else g > 0 if one.strict else g >= 0


def ties(given: Mapping[str, str | float], known: Sequence[str], free: Sequence[str]) -> Ties:
    """Read ties: parameter -> expression of others, or a number.

    ``free`` are parameters that the fit may change, which cannot follow anything as well. Raises ParameterError
    for that, as ``expression`` does, for one tied twice, and for parameters that follow each other in a circle.
    """
    if not isinstance(given, Mapping):
        raise ParameterError(
            f"ties must map parameters to expressions, such as {{'alpha2': 'alpha1'}}, got {in_words(given)}."
        )
    read: dict[str, Expression] = {}
    for name, text in given.items():
        full = _full(str(name), known)
        if isinstance(full, _Unclear):
            raise ParameterError(f"ties: {full.why}")
        if full in read:
            raise ParameterError(f"ties: '{full}' is tied twice.")
        if full in free:
            raise ParameterError(f"ties: '{full}' is free in this fit, so it cannot follow {in_words(text)} as well.")
        number = _number(text)
        read[full] = _expression(f"tie of '{full}'", text if number is None else repr(number), known)
    return Ties(tuple((name, read[name]) for name in _ordered(read)))


def _ordered(read: Mapping[str, Expression]) -> list[str]:
    """Names so that each comes after those it follows."""
    left, done = dict(read), list[str]()
    while left:
        ready = [name for name, e in left.items() if not any(k in left for k in e.names)]
        if not ready:
            raise ParameterError(f"ties: {_circle(left)}.")
        done += ready
        for name in ready:
            del left[name]
    return done


def _circle(left: Mapping[str, Expression]) -> str:
    """One circle among ties of which each follows another one."""
    path = [next(iter(left))]
    while path[-1] not in path[:-1]:
        path.append(next(k for k in left[path[-1]].names if k in left))
    path = path[path.index(path[-1]) :]
    if len(path) == 2:
        return f"'{path[0]}' follows itself"
    return f"parameters follow each other in a circle, {clip(' -> '.join(path), 300)}"


# ---- names -----------------------------------------------------------------------------------------


@attrs.frozen
class _Unclear:
    """Why a name means no parameter."""

    why: str


def _full(name: str, known: Sequence[str]) -> str | _Unclear:
    """The full name that a name means."""
    if name in known:
        return name
    hits = [k for k in known if k.endswith(f".{name}")]
    if len(hits) == 1:
        return hits[0]
    if hits:
        more = f" or {len(hits) - 3} more" if len(hits) > 4 else ""
        return _Unclear(f"'{clip(name)}' may mean {' or '.join(hits[: 3 if more else 4])}{more}. Say which.")
    close = near(name, known)
    if "Did you mean" not in close:
        ends = near(name, {k.rpartition(".")[2] for k in known})
        close = ends if "Did you mean" in ends else close
    return _Unclear(f"there is no parameter '{clip(name)}'.{close}")


def _name(node: ast.AST) -> str | None:
    """``tsm.alpha1``, ``lag.den[0]`` or ``alpha1`` as a text; None for anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        head = _name(node.value)
        return None if head is None else f"{head}.{node.attr}"
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and type(node.slice.value) is int:
        head = _name(node.value)
        return None if head is None else f"{head}[{node.slice.value}]"
    return None


# ---- reading ---------------------------------------------------------------------------------------


@attrs.frozen(eq=False)
class _Reader:
    """One text being read: its tree, and how to complain about places in it. ``what`` it is begins every complaint."""

    what: str
    text: str
    tree: ast.expr
    known: Sequence[str]

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

    def _check(self, node: ast.expr, meaning: dict[str, str]) -> None:
        """Refuse all but finite arithmetic; collect the names."""
        name = _name(node)
        if name is not None:
            if name != "pi":
                full = _full(name, self.known)
                if isinstance(full, _Unclear):
                    self.refuse(full.why, node)
                meaning[name] = full
            return
        if isinstance(node, ast.Constant):
            if _number(node.value) is None:
                self.refuse(f"{in_words(node.value, 30)} is no finite number.", node)
            return
        inside: dict[str, str] = {}
        for part in self._parts(node):
            self._check(part, inside)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and _is_zero(node.right):
            self.refuse("this divides by zero.", node)
        if not inside and hasattr(node, "lineno") and not math.isfinite(float(_formed(node, {}))):
            self.refuse("this is no finite number.", node)
        meaning.update(inside)

    def _parts(self, node: ast.expr) -> list[ast.expr]:
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            return [node.operand]
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
            return [node.left, node.right]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor):
            self.refuse("there is no operation '^'. Write ** for a power.", node)
        if not isinstance(node, ast.Call):
            self.refuse(f"this is no arithmetic. Known here: numbers, + - * / **, {', '.join(_FUNCTIONS)}, pi, and "
                        "names of parameters.", node)  # fmt: skip
        return self._arguments(node)

    def _arguments(self, node: ast.Call) -> list[ast.expr]:
        name = _name(node.func)
        if name not in _FUNCTIONS:
            shown = "" if name is None else f" '{clip(name, 40)}'"
            self.refuse(f"there is no function{shown}.{near(name or '', _FUNCTIONS, most=12)}", node.func)
        least = _FUNCTIONS[name][0]
        if any(isinstance(a, ast.Starred) for a in node.args) or node.keywords:
            self.refuse(f"{name} takes plain arguments.", node)
        if len(node.args) < least or (least == 1 and len(node.args) > 1):
            wanted = "one argument" if least == 1 else "two arguments or more"
            self.refuse(f"{name} takes {wanted}, got {len(node.args)}.", node)
        return list(node.args)


def _reader(what: str, text: Any, known: Sequence[str]) -> _Reader:
    """Parse a text. Raises ParameterError for what is none, is too long, or has no tree."""
    if not isinstance(text, str):
        raise ParameterError(f"{what}: a text such as '2 * theta' is wanted, got {in_words(text)}.")
    if len(text) > LONGEST:
        raise ParameterError(f"{what}: {in_words(text[:50], 30)} has {len(text)} characters; {LONGEST} are the most.")
    text = " ".join(text.split())
    if not text or not text.isprintable():
        raise ParameterError(f"{what}: a text such as '2 * theta' is wanted, got {in_words(text)}.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # '1if' and '\d' in quotes, which are refused below
            tree = ast.parse(text, mode="eval").body
    except SyntaxError as error:
        place = min(max((error.offset or 1) - 1, 0), len(text) - 1)
        hint = " Write == for equal." if text[place] == "=" or "==" in error.msg else ""
        _refuse(what, text, f"this cannot be read from here on.{hint}", place, place + 1)
    except (ValueError, RecursionError, MemoryError):
        _refuse(what, text, "this cannot be read.", 0, len(text))
    if _depth(tree) > DEEPEST:
        _refuse(what, text, f"this is nested more than {DEEPEST} deep.", 0, len(text))
    return _Reader(what, text, tree, known)


def _refuse(what: str, text: str, why: str, first: int, last: int) -> NoReturn:
    start = 0 if len(text) <= SHOWN or first < SHOWN // 2 else min(first - SHOWN // 2, len(text) - SHOWN)
    shown, before = text[start : start + SHOWN], "…" if start else ""
    after = "…" if start + SHOWN < len(text) else ""
    mark = " " * (len(before) + first - start) + "^" * max(min(last, start + SHOWN) - first, 1)
    raise ParameterError(f"{what}: {why}\n    {before}{shown}{after}\n    {mark}")


def _depth(node: ast.AST) -> int:
    """Levels of a tree, counted without recursion, up to one more than may be."""
    level, deepest = [node], 0
    while level and deepest <= DEEPEST:
        level, deepest = [child for n in level for child in ast.iter_child_nodes(n)], deepest + 1
    return deepest


def _is_zero(node: ast.expr) -> bool:
    """Whether a part is zero without any parameter in it."""
    named = any(_name(n) not in (None, "pi", *_FUNCTIONS) for n in ast.walk(node))
    return not named and float(_formed(node, {})) == 0


def _number(value: Any) -> float | None:
    """A finite number, or None: texts, truth values, complex numbers and infinity are none."""
    if isinstance(value, (bool, str, complex)):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _formed(node: ast.AST, values: Mapping[str, Any]) -> Any:
    name = _name(node)
    if name is not None:
        return ca.SX(math.pi) if name == "pi" else values[name]
    if isinstance(node, ast.Constant):
        return ca.SX(_number(node.value) or 0.0)  # not a Python number, which would raise on 9**9**9 or 1/0
    if isinstance(node, ast.UnaryOp):
        inner = _formed(node.operand, values)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return _OPERATIONS[type(node.op)](_formed(node.left, values), _formed(node.right, values))
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    given = [_formed(a, values) for a in node.args]
    least, function = _FUNCTIONS[node.func.id]
    if least == 1:
        return function(given[0])
    made = given[0]
    for more in given[1:]:
        made = function(made, more)
    return made
