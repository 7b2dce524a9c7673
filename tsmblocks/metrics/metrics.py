"""Metrics: numbers of a run, written as text: ``"peak_to_peak(x_ref - x_out, after=10)"``.

A metric is arithmetic of reductions, and each reduction makes one number of an expression of signals. No text is ever
executed.
"""

from __future__ import annotations

import ast
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import pairwise
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, ParameterError, RunError, clip, in_words, near
from tsmblocks.metrics.expressions import FUNCTIONS, Expression, Reader, finite_or_none, name_in, reader
from tsmblocks.metrics.reductions import DIMENSIONLESS, OTHER_NAMES, RECIPES, REDUCTIONS

TIME = "t"
"""Name of the time [s] in a metric, where no signal has it."""
EXAMPLE = "Write for example 'rms(x_ref - x_out)'."
FAR = 0.05
"""Share of a step to a target below which there is a warning. Chosen: 60 for 60 deg in rad is 0.02."""
DEFAULT_METRICS = {
    "peak-to-peak error": "peak_to_peak(x_ref - x_out)",
    "rms error": "rms(x_ref - x_out)",
    "largest error": "largest(x_ref - x_out)",
    "effort": "rms(u)",
}
"""Default metrics of tracking; those are used whose signals exist."""


@attrs.frozen
class Part:
    """One reduction in a metric, of an expression of signals, at instants from ``after`` up to ``before`` [s]."""

    reduction: str
    expression: Expression
    numbers: tuple[float, ...] = ()
    after: float = -np.inf
    before: float = np.inf

    def value(self, name: str, t: np.ndarray, signals: Mapping[str, np.ndarray]) -> np.ndarray:
        """The number for each run, shape (runs,), from signals (N, runs); NaN where the signal is not finite."""
        inside = (t >= self.after - 1e-9) & (t <= self.before + 1e-9)
        if not inside.any():
            raise DataError(
                f"metric '{clip(name)}': no instant of the run lies between {self.after:g} and "
                f"{self.before:g} s; it is from {t[0]:g} to {t[-1]:g} s."
            )
        if not inside.all():
            t, signals = t[inside], {k: v[inside] for k, v in signals.items()}
        e = self.expression.of_arrays(signals)
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(e).all(axis=0), REDUCTIONS[self.reduction].run(e, t, *self.numbers), np.nan)


@attrs.frozen
class Metric:
    """One number of a run, as it was written in ``text``, shown as ``name`` in ``unit`` (``""`` where none is known).

    ``outer`` is arithmetic of the ``parts``, named ``#0``, ``#1``, … there; ``factor`` converts its value to
    ``unit``. ``given_name`` is the name as it was given: ``"error [deg]"`` of a metric called ``"error"``. Where it is
    ``timed``, ``TIME`` in it is the time, and no signal.
    """

    name: str
    text: str
    unit: str
    outer: Expression
    parts: tuple[Part, ...]
    factor: float = 1.0
    given_name: str = ""
    timed: bool = False

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals it needs."""
        names = (name for part in self.parts for name in part.expression.names)
        return tuple(dict.fromkeys(name for name in names if not (self.timed and name == TIME)))

    def __call__(self, t: np.ndarray, signals: Any) -> Any:
        """The number for signals of shape (N,), or one for each run, shape (runs,), for signals of shape (N, runs).

        ``t`` (N,) are the instants [s]; ``signals`` is a mapping by name, or a run. NaN where a signal is not finite.
        Raises DataError where no instant counts.
        """
        wide = self._columns(t, signals)
        found = {f"#{k}": part.value(self.name, np.asarray(t), wide) for k, part in enumerate(self.parts)}
        made = self.factor * self.outer.of_arrays(found)
        return float(made[0]) if all(np.ndim(signals[k]) == 1 for k in self.signals) else made

    def _columns(self, t: np.ndarray, signals: Any) -> dict[str, np.ndarray]:
        """The signals and the time, each with one column for each run."""
        wide = {k: np.asarray(signals[k], dtype=float).reshape(len(t), -1) for k in self.signals}
        return {**wide, TIME: np.asarray(t, dtype=float).reshape(-1, 1)} if self.timed else wide

    def far_targets(self, t: np.ndarray, signals: Any) -> Iterator[str]:
        """A message for each target to which a signal does next to nothing of the step, as for one in another unit."""
        for part in (part for part in self.parts if REDUCTIONS[part.reduction].numbers == ("target",)):
            e, target = part.expression.of_arrays(self._columns(t, signals)), part.numbers[0]
            moved, step = float(np.abs(e - e[0]).max()), abs(target - float(e[0].item()))
            if moved < FAR * step:
                yield (
                    f"metric '{clip(self.name)}': the signal does {moved / step:.1%} of the step from "
                    f"{e[0].item():.4g} to the target {target:g}. The target is a number in the unit of the signal."
                )


def metric(text: str, signals: Mapping[str, str], name: str = "") -> Metric:
    """Read a metric such as ``"rms(x_ref - x_out)"`` or ``"share(abs(u) > 23.9)"``.

    ``signals`` maps the signals that may be named to their units (``""`` where unknown); ``t`` is the time in s unless
    a signal has that name. Every reduction takes ``after=`` and ``before=`` [s]; which there are is in
    ``reductions.REDUCTIONS``. A ``name`` such as ``"error [deg]"`` states the unit of the result as well. Raises
    ParameterError for anything else, for unknown names, and for signals added up in different units; UnitError for a
    unit that does not fit.
    """
    given_name, (name, wanted) = name, named(name)
    timed = not any(one.rpartition(".")[2] == TIME for one in signals)
    signals = {**signals, TIME: "s"} if timed else signals
    if not name.isprintable() or name == "run":
        why = "the number of a run has that name" if name == "run" else "it cannot be printed"
        raise ParameterError(f"no metric can be called {in_words(name)}: {why}.")
    read = reader(f"metric '{clip(name, 40)}'" if name else "metric", text, list(signals), "signal")
    split = _Split(read, signals, timed)
    tree = split.outer(read.tree)
    if not split.parts:
        read.refuse(f"this does not reduce a signal to a number. {EXAMPLE}")
    inner = attrs.evolve(read, known=list(split.units))
    unit = unit_of_expression(inner, tree, split.units)
    if wanted and not unit:
        raise units.UnitError(
            f"{read.what}: the unit of '{clip(read.text)}' is not known, so it cannot be in {wanted}."
        )
    try:
        factor = units.factor(unit, wanted) if wanted else 1.0
    except units.UnitError as error:
        raise units.UnitError(f"{read.what}: {error}") from None
    parts, outer = tuple(split.parts), inner.read(tree)
    return Metric(name or read.text, read.text, wanted or unit, outer, parts, factor, given_name or read.text, timed)


def named(text: str) -> tuple[str, str]:
    """Name and unit of ``"error [deg]"``; the unit is ``""`` when none is given. Brackets of other kinds are names'."""
    match = re.fullmatch(r"(.*\S) \[([^\[\]]+)\]", text, re.DOTALL)
    return (match[1], match[2].strip()) if match else (text, "")


def metrics(given: Any, signals: Mapping[str, str]) -> tuple[Metric, ...]:
    """Read metrics: one text, a list of texts, or a mapping from names to texts; None for the usual ones.

    Raises as ``metric`` does, and ParameterError for none at all.
    """
    if given is None:
        given = {}
        for name, text in DEFAULT_METRICS.items():
            with suppress(ParameterError):
                given[name] = metric(text, signals).text
        if not given:
            raise ParameterError(
                "no metrics are given, and the diagram has no 'x_ref' with 'x_out', and no 'u'. Write for "
                f"example 'rms({next(iter(signals), 'y')})'."
            )
    listed = [given] if isinstance(given, str) else given
    if not isinstance(listed, (Mapping, Sequence)) or not listed:
        raise ParameterError(
            f"metrics must be texts such as 'rms(x_ref - x_out)', a list or a mapping of them, got {in_words(given)}."
        )
    pairs = listed.items() if isinstance(listed, Mapping) else (("", text) for text in listed)
    made = tuple(metric(text, signals, str(name)) for name, text in pairs)
    for one in made:
        if sum(one.name == other.name for other in made) > 1:
            raise ParameterError(f"two metrics have the name '{clip(one.name)}'.")
    return made


def measure(run: Any, wanted: Any = None) -> dict[str, float]:
    """Return metrics of a run.

    Parameters
    ----------
    run : Run
        The run.
    wanted : str, sequence of str, mapping of str to str or None, default None
        One text, a list, or a mapping from names to texts, as for ``study``; a name may state the unit
        (``"error [deg]"``). By default the tracking errors.

    Returns
    -------
    dict of str to float
        Values by the names given; NaN where a signal is not finite.

    Raises
    ------
    ParameterError
        For texts that are not metrics, unknown signals and sums of different units.
    UnitError
        For a unit that does not fit.
    RunError
        For anything that is not a run.

    Warns
    -----
    UserWarning
        Where a signal does less than a twentieth of the step to the target of its overshoot or rise time.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> run = tsm.simulate(tsm.load("fig16_feedforward_feedback"), stop=20.0)
    >>> {name: round(value, 2) for name, value in tsm.measure(run, {"error [deg]": "rms(x_ref - x_out)"}).items()}
    {'error [deg]': 1.55}
    """
    if not all(hasattr(run, part) for part in ("t", "unit", "keys")):
        raise RunError(f"only a run can be measured, got {in_words(run)}.")
    found = metrics(wanted, {name: run.unit(name) for name in run})
    for text in (text for one in found for text in one.far_targets(run.t, run)):
        warnings.warn(text, UserWarning, stacklevel=2)
    return {one.given_name: one(run.t, run) for one in found}


def expression_samples(run: Any, text: str) -> tuple[np.ndarray, str]:
    """Samples and unit of a signal of a run, or of an expression of signals such as ``"x_ref - x_out"``.

    The unit is ``""`` where it is not known. Raises RunError for an unknown signal; ParameterError for what is no
    expression, for unknown names in one, and for a sum of different units.
    """
    if text in run or re.fullmatch(r"[\w.\[\]]*", text):
        return run[text], run.unit(text)
    signals = {name: run.unit(name) for name in run}
    read = reader("signal", text, list(signals), "signal")
    if isinstance(read.tree, (ast.Compare, ast.BoolOp)):
        read.refuse("this is a comparison, which is no signal.")
    made = read.read(read.tree)
    values = made.of_arrays({name: run[name] for name in made.names})
    return np.broadcast_to(np.asarray(values, dtype=float), run.t.shape), unit_of_expression(read, read.tree, signals)


@attrs.define
class _Split:
    """Splits the tree of a metric: ``parts`` are its reductions, each replaced by a name ``#k`` in the outer tree.

    ``units`` are those of the names ``#k``, ``""`` where unknown.
    """

    read: Reader
    signals: Mapping[str, str]
    timed: bool
    parts: list[Part] = attrs.Factory(list)
    units: dict[str, str] = attrs.Factory(dict)

    def outer(self, node: ast.expr) -> ast.expr:
        """The tree with each reduction replaced by its name. Raises ParameterError."""
        written = name_in(node)
        if written is not None and written != "pi":
            full = clip(self.read.full(written, node))
            self.read.refuse(
                f"'{full}' is a signal over time; reduce it to one number, for example by rms({full}).", node
            )
        if isinstance(node, (ast.Compare, ast.BoolOp)):
            share = "For the share of the time at which it holds, write share(…)."
            self.read.refuse(f"this is a comparison, but a number is expected here. {share}", node)
        made: ast.expr = node
        if isinstance(node, ast.UnaryOp):
            made = ast.UnaryOp(node.op, self.outer(node.operand))
        elif isinstance(node, ast.BinOp):
            made = ast.BinOp(self.outer(node.left), node.op, self.outer(node.right))
        elif isinstance(node, ast.Call):
            made = self._call(node)
        return ast.copy_location(made, node)

    def _call(self, node: ast.Call) -> ast.expr:
        name = name_in(node.func) or ""
        if name in REDUCTIONS:
            self.parts.append(_part(self.read, node, name, self.timed))
            mark = f"#{len(self.parts) - 1}"
            inside = unit_of_expression(self.read, self.parts[-1].expression.tree, self.signals)
            self.units[mark] = REDUCTIONS[name].unit_of(inside)
            return ast.Name(mark, ast.Load())
        if name not in FUNCTIONS:
            recipe = RECIPES.get(name.casefold())
            hint = f" Write {recipe}, e being the error, such as x_ref - x_out." if recipe else ""
            hint = hint or near(OTHER_NAMES.get(name, name), [*REDUCTIONS, *FUNCTIONS], 20)
            self.read.refuse(f"the name '{clip(name, 40)}' is not known.{hint}", node.func)
        return ast.Call(node.func, [self.outer(a) for a in node.args], node.keywords)


def _part(read: Reader, node: ast.Call, name: str, timed: bool) -> Part:
    """The reduction ``name`` as it is called at ``node``. Raises ParameterError for wrong arguments."""
    first, numbers = "comparison" if name == "share" else "signal", REDUCTIONS[name].numbers
    given = {k.arg: k.value for k in node.keywords}
    once, rest = len(given) == len(node.keywords), numbers[max(len(node.args) - 1, 0) :]
    by_name = [given.pop(one) for one in rest if one in given]
    complete = len(node.args) + len(by_name) == 1 + len(numbers) and len(by_name) == len(rest) and node.args
    if not complete or not given.keys() <= {"after", "before"} or not once:
        wanted = ", ".join([first, *numbers, "after=", "before="])
        read.refuse(f"{name} takes ({wanted}), the last two being optional.", node)
    signal, *others = [*node.args, *by_name]
    if isinstance(signal, ast.Compare) != (name == "share"):
        read.refuse(f"{name} takes a {first}{', such as abs(u) > 23.9' if name == 'share' else ''}.", signal)
    expression = read.read(margin_of_comparison(read, signal) if isinstance(signal, ast.Compare) else signal)
    if not {*expression.names} - ({TIME} if timed else set()):
        read.refuse(f"this contains no signal. {EXAMPLE}", signal)
    window = {k: _constant(read, value) for k, value in given.items() if k}
    return Part(name, expression, tuple(_constant(read, one) for one in others), **window)


def margin_of_comparison(read: Reader, node: ast.Compare) -> ast.expr:
    """An expression above zero where a comparison holds."""
    made, sides = list[ast.expr](), [node.left, *node.comparators]
    place = partial(ast.copy_location, old_node=node)
    for (left, right), sign in zip(pairwise(sides), node.ops, strict=True):
        if not isinstance(sign, (ast.Lt, ast.LtE, ast.Gt, ast.GtE)):
            read.refuse("signals are compared by <, <=, > or >=.", node)
        low, high = (left, right) if isinstance(sign, (ast.Lt, ast.LtE)) else (right, left)
        above = place(ast.BinOp(high, ast.Sub(), low))
        if isinstance(sign, (ast.LtE, ast.GtE)):  # equality holds too: so small a number changes nothing but zero
            above = place(ast.BinOp(above, ast.Add(), place(ast.Constant(sys.float_info.min))))
        made.append(above)
    return made[0] if len(made) == 1 else place(ast.Call(place(ast.Name("min", ast.Load())), made, []))


def _constant(read: Reader, node: ast.expr) -> float:
    """A number written out, such as ``0.02`` or ``2 * pi``."""
    if any(name_in(one) not in (None, "pi", *FUNCTIONS) for one in ast.walk(node)):
        read.refuse("a plain number is expected here.", node)
    value = finite_or_none(read.read(node).of_arrays({}))
    if value is None:
        read.refuse("this is no finite number.", node)
    return value


def unit_of_expression(read: Reader, node: ast.expr, labels: Mapping[str, str]) -> str:
    """The unit of an expression, ``""`` where it is not known. Raises ParameterError for a sum of different ones."""
    return _unit_or_any(read, node, labels) or ""


def _unit_or_any(read: Reader, node: ast.expr, labels: Mapping[str, str]) -> str | None:
    """The unit of an expression, ``""`` where it is not known, None for a plain number, which takes any."""
    written = name_in(node)
    if written is not None:
        return None if written == "pi" else labels[read.full(written, node)]
    match node:
        case ast.UnaryOp(operand=inner):
            parts, of_one_unit = [inner], True
        case ast.BinOp(left=first, right=second):
            parts, of_one_unit = [first, second], isinstance(node.op, (ast.Add, ast.Sub))
        case ast.Call(args=parts):
            of_one_unit = name_in(node.func) in ("abs", "min", "max")
        case _:
            return None
    found = [_unit_or_any(read, part, labels) for part in parts]
    if of_one_unit:
        return _common_unit(read, node, found)
    if all(one is None for one in found):
        return None
    if isinstance(node, ast.Call):
        return DIMENSIONLESS if DIMENSIONLESS in found else ""
    left, right = found
    if isinstance(node.op, ast.Div) and left and right and units.same(left, right):
        return DIMENSIONLESS
    if isinstance(node.op, (ast.Mult, ast.Div)) and right == DIMENSIONLESS:
        return left
    return right if isinstance(node.op, ast.Mult) and left == DIMENSIONLESS else ""


def _common_unit(read: Reader, node: ast.expr, found: Sequence[str | None]) -> str | None:
    known = [one for one in found if one]
    for one in known[1:]:
        if not units.same(known[0], one):
            read.refuse(f"this mixes {known[0]} and {one}.", node)
    return "" if "" in found else known[0] if known else None
