"""The promises every block keeps, as checks. A check's name is the promise, its docstring states it in words."""

from __future__ import annotations

import functools
import inspect
import math
import pickle
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import BlockError, ParameterError, TsmError, in_words
from tsmblocks.compiler.dependencies import results_of, structure_of, symbolic
from tsmblocks.model.block import Block, is_reference, leaves, map_leaves, signals

LETTER = re.compile(r"\?(\w+)")
"""A unit that ports of a block share."""
SCALES = (0.0, 1.0, 1e3, 1e6)
"""Magnitudes of states and inputs, in their units. Chosen: at rest, ordinary, and far outside normal use."""
MAX_SYMBOL_LENGTH = 12
"""Characters of a symbol at most. Chosen: they fit the box in a drawing."""

Promise = Callable[[Block], None]
PROMISES: dict[str, Promise] = {}


class BrokenPromise(TsmError):
    """A block does not keep one of its promises."""


def promise(check: Promise) -> Promise:
    """Add a check to the suite, under the name of its function; a decorator.

    Parameters
    ----------
    check : callable
        Function of a block that raises ``BrokenPromise``; its docstring states the promise.

    Returns
    -------
    callable
        The function itself.
    """
    PROMISES[check.__name__] = check
    return check


@attrs.frozen
class Check:
    """One promise for one block. Call it to check; its text is ``Block-promise``."""

    block: Block
    name: str

    def __call__(self) -> None:
        try:
            PROMISES[self.name](self.block)
        except BrokenPromise:
            raise
        except TsmError as error:
            raise BrokenPromise(str(error)) from error

    def __str__(self) -> str:
        return f"{type(self.block).__name__}-{self.name}"


def checks_for(block: Block) -> list[Check]:
    """Return a check of every promise for one block.

    ``@pytest.mark.parametrize("check", checks_for(MyBlock()), ids=str)`` makes each a test, which calls it.

    Parameters
    ----------
    block : Block
        The block.

    Returns
    -------
    list of Check
        Functions without arguments that raise ``BrokenPromise``.

    Examples
    --------
    >>> from tsmblocks.blocks import Gain
    >>> from tsmblocks.testing import checks_for
    >>> for check in checks_for(Gain()):
    ...     check()
    """
    return [Check(block, name) for name in PROMISES]


def broken_promises(block: Block) -> dict[str, str]:
    """Return the promises that a block breaks.

    Parameters
    ----------
    block : Block
        The block.

    Returns
    -------
    dict of str to str
        What was wrong, by promise; empty for a good block.

    Raises
    ------
    BlockError
        For anything that is no block.

    Examples
    --------
    >>> from tsmblocks.blocks import Gain
    >>> from tsmblocks.testing import broken_promises
    >>> broken_promises(Gain())
    {}
    """
    if not isinstance(block, Block):
        wanted = f"the class {block.__name__}: write {block.__name__}()" if isinstance(block, type) else in_words(block)
        raise BlockError(f"broken_promises takes a block, got {wanted}.")
    broken = {}
    for check in checks_for(block):
        try:
            check()
        except Exception as error:  # any error of a faulty block is a broken promise
            broken[check.name] = f"{type(error).__name__}: {error}"
    return broken


def need(condition: Any, text: str) -> None:
    """Raise BrokenPromise unless the condition holds."""
    if not condition:
        raise BrokenPromise(text)


# ---- looking at a block


@functools.lru_cache(maxsize=512)
def equations_as_numbers(block: Block) -> tuple[Any, list[str]]:
    """All equations as one function of (t, x, u, p), and the names of its results ("y.y", "dx.angle")."""
    made, column = symbolic(block), functools.partial(ca.vertcat, ca.SX(0, 1))
    reads = [made.t, *(column(*part) for part in (made.x, made.u, made.p))]
    return ca.Function("block", reads, [column(*made.results.values())]), [".".join(key) for key in made.results]


def parameter_values(block: Block) -> list[float]:
    """The numbers of a block in the order of its symbols; zero for a reference."""
    return [0.0 if is_reference(v) else v for value in block.parameters.values() for _, v in leaves(value)]


def _unused(block: Block, kind: str) -> list[str]:
    """Names of the symbols of a kind (``"p"``, ``"u"``) that no equation depends on."""
    made = symbolic(block)
    symbols, results = getattr(made, kind), ca.vertcat(ca.SX(0, 1), *made.results.values())
    return [symbol.name() for symbol in symbols if not ca.depends_on(results, symbol)]


def _declared(block: Block) -> list[tuple[str, Any]]:
    """Ports and fields, with their names."""
    ports = (block.inports, block.outports, block.tape_ports, block.past_ports)
    return [*(part for kind in ports for part in kind.items()), *block.fields().items()]


def _points(block: Block) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Times, states and inputs to try: each scale, with mixed signs and with one sign, reproducibly."""
    made, rng, nx = [], np.random.default_rng(20), len(block.states)
    ones = np.ones(nx + len(block.read_names))
    for scale in SCALES:
        for signs in (rng.uniform(-1, 1, len(ones)), ones, -ones):
            values = scale * signs + 0.0  # and not -0
            made.append((scale, values[:nx], values[nx:]))
    return made


# ---- the promises


@promise
def documented(block: Block) -> None:
    """A sentence, an equation, a source, a short symbol, and a description of every port and field."""
    owner = type(block).__name__
    text, most = inspect.cleandoc(type(block).__dict__.get("__doc__") or ""), MAX_SYMBOL_LENGTH
    need(text.partition("\n\n")[0].endswith("."), f"{owner} has no opening sentence.")
    need(".. math::" in text or hasattr(block, "function"), f"{owner} shows no equation (.. math::).")
    need(block.source, f"{owner} names no source.")
    need(0 < len(block.symbol) <= most, f"{owner} needs a symbol of at most {most} characters for its box.")
    for name, part in _declared(block):
        need(part.about.strip(), f"{owner}.{name} has no description.")


@promise
def works_as_it_comes(block: Block) -> None:
    """It can be made without arguments."""
    need(type(block)() == type(block)(), f"{type(block).__name__} made twice differs.")


@promise
def equations_cover_what_is_declared(block: Block) -> None:
    """The equations return every output, every state and nothing else."""
    structure_of(block)


@promise
def units_are_known(block: Block) -> None:
    """Every unit is one this package can read."""
    for name, part in [*_declared(block), *block.states.items()]:
        unit = getattr(part, "unit", "")
        try:
            units.parse(LETTER.sub("1", unit))
        except units.UnitError as error:
            raise BrokenPromise(f"{type(block).__name__}.{name}: {error}") from None
    ports = {*_letters(block.inports.values()), *_letters(block.outports.values())}
    loose = {*_letters(block.fields().values()), *_letters(block.states.values())} - ports
    need(not loose, f"no port of {type(block).__name__} has the unit ?{', ?'.join(sorted(loose))}.")


def _letters(parts: Iterable[Any]) -> set[str]:
    return {letter for part in parts for letter in LETTER.findall(part.unit)}


@promise
def every_parameter_matters(block: Block) -> None:
    """Each parameter changes an equation; none was frozen into a number."""
    states = block.with_symbols(lambda name, _: ca.SX.sym(name)).states.values()
    elsewhere = {symbol.name() for state in states for symbol in ca.symvar(ca.SX(state.start))}
    elsewhere |= {name for past in block.past_ports.values() for name in (past.by, past.initial)}
    idle = [name for name in _unused(block, "p") if name not in elsewhere]
    need(not idle, f"no equation of {type(block).__name__} uses {', '.join(idle)}.")


@promise
def every_input_matters(block: Block) -> None:
    """Each input, tape and past value is read by some equation."""
    elsewhere = {k.of for k in block.past_ports.values()} | {k.rate_of for k in block.inports.values()}
    idle = [name for name in _unused(block, "u") if name not in elsewhere]
    need(not idle, f"no equation of {type(block).__name__} reads {', '.join(idle)}.")


@promise
def every_state_matters(block: Block) -> None:
    """Each state reaches an output, at once or by way of other states."""
    made = symbolic(block)
    x, results = made.x, {**made.of("dx"), **made.of("next")}
    reached, found = {""}, set(x._fields) if not block.outports else set[str]()
    while reached:
        of = [results[k] for k in reached if k in results] or list(made.of("y").values())
        reached = {k for k, s in zip(x._fields, x, strict=True) if any(ca.depends_on(e, s) for e in of)} - found
        found |= reached
    idle = [k for k in x._fields if k not in found]
    need(not idle, f"no output of {type(block).__name__} depends on {', '.join(idle)}.")


@promise
def tapes_are_supplied(block: Block) -> None:
    """Each tape is samples that cover the run, and the same at every call."""
    owner, wanted = type(block).__name__, list(block.tape_ports)
    given, again = block.tapes(-0.5, 2.0), block.tapes(-0.5, 2.0)
    need(sorted(given) == sorted(wanted), f"{owner}.tapes gives {sorted(given)}, and its tapes are {sorted(wanted)}.")
    for name, tape in given.items():
        same = np.array_equal(tape.t, again[name].t) and np.array_equal(tape.y, again[name].y)
        need(same, f"{owner}.{name} differs from call to call.")
        finite = len(tape.t) == len(tape.y) and np.isfinite(tape.y).all()
        need(finite, f"{owner}.{name} is not a list of finite numbers.")


@promise
def floats_and_symbols_agree(block: Block) -> None:
    """The equations give the same with numbers as with symbols, and the same twice."""
    f, results = equations_as_numbers(block)
    for t, x, u in _points(block)[3:6] if is_singular(block) else _points(block)[:6]:
        expected = np.asarray(f(t, x, u, parameter_values(block))).ravel()
        states, inputs = signals(list(block.states), x.tolist()), signals(list(block.read_names), u.tolist())
        for _ in range(2):
            direct = {f"{kind}.{k}": float(v) for (kind, k), v in results_of(block, t, states, inputs).items()}
            for name, value in zip(results, expected, strict=True):
                same = direct[name] == value or math.isclose(direct[name], value, rel_tol=1e-9, abs_tol=1e-12)
                same = same or (math.isnan(value) and math.isnan(direct[name]))
                need(same, f"{type(block).__name__} {name} is {direct[name]:g} with numbers, {value:g} with symbols.")


def is_singular(block: Block) -> bool:
    """Whether a block is declared to be infinite somewhere."""
    return bool(getattr(block, "singular", ""))


@promise
def finite_everywhere(block: Block) -> None:
    """No NaN or infinity: at rest, at zero, and far outside normal use."""
    if is_singular(block):
        return  # declared to be infinite somewhere (a division by zero)
    f, results = equations_as_numbers(block)
    for t, x, u in _points(block):
        values = np.asarray(f(t, x, u, parameter_values(block))).ravel()
        bad = [n for n, v in zip(results, values, strict=True) if not np.isfinite(v)]
        need(not bad, f"{type(block).__name__} {', '.join(bad)} is not finite at t={t:g}, x={x}, u={u}.")


@promise
def slopes_are_finite(block: Block) -> None:
    """Derivatives with respect to states, inputs and parameters are finite, which fits and designs need."""
    if is_singular(block):
        return
    f, results = equations_as_numbers(block)
    t, x, u, p = f.sx_in()
    jacobian = ca.Function("derivatives", [t, x, u, p], [ca.jacobian(f(t, x, u, p), ca.vertcat(x, u, p))])
    finite = [v if math.isfinite(v) else 0.0 for v in parameter_values(block)]
    for time, xs, us in _points(block):
        values = np.asarray(jacobian(time, xs, us, finite))
        rows = [n for n, row in zip(results, values, strict=True) if not np.isfinite(row).all()]
        need(not rows, f"a derivative of {type(block).__name__} {', '.join(rows)} is not finite at x={xs}, u={us}.")


@promise
def is_a_value(block: Block) -> None:
    """Frozen, equal to its copy, hashable, and it pickles."""
    owner, copy = type(block).__name__, block.replace()
    try:
        need(copy == block and hash(copy) == hash(block), f"{owner} is not equal to its copy.")
        need(pickle.loads(pickle.dumps(block)) == block, f"{owner} changes when pickled.")
    except (TypeError, pickle.PicklingError, AttributeError) as error:
        raise BrokenPromise(f"{owner} holds something that is not a value: {error}") from error
    for name in block.fields():
        with suppress(AttributeError):
            setattr(block, name, None)
            raise BrokenPromise(f"{owner} can be changed in place.")


@promise
def survives_a_file(block: Block) -> None:
    """Written to a diagram file and read back, it is the same block."""
    from tsmblocks.files import dumps, loads
    from tsmblocks.model.block import REGISTRY
    from tsmblocks.model.diagram import Diagram

    owner = type(block).__name__
    need(REGISTRY.get(owner) is type(block), f"{owner} is not known to files by its name.")
    for name in block.fields():
        kinds = {type(v) for _, v in leaves(getattr(block, name))}
        need(kinds <= {float, int, str, bool}, f"{owner}.{name} cannot be written to a file.")
    inputs = {f"in_{k}": f"block.{k}" for k in block.inports}
    alone = Diagram(title="alone", blocks={"block": block}, inputs=inputs)
    need(loads(dumps(alone)) == alone, f"{owner} changes when written to a file.")


@promise
def refuses_bad_numbers(block: Block) -> None:
    """Text, NaN and values outside the bounds are refused, naming block and parameter."""
    owner = type(block).__name__
    for name, field in block.fields().items():
        value = getattr(block, name)
        if isinstance(field.default, (str, bool)) or not isinstance(field.default, (int, float, tuple)):
            continue
        if isinstance(value, tuple) and (field.kind == "option" or not list(leaves(value))):
            continue  # an option may be a list of anything, which the block itself checks
        outside = (field.above, field.below, field.at_least - 1, field.at_most + 1)
        for bad in ("three", math.nan, *filter(math.isfinite, outside)):
            try:
                block.replace(**{name: map_leaves(lambda *_, bad=bad: bad, value)})
            except ParameterError as error:
                need(owner in str(error) and name in str(error), f"the refusal does not name {owner}.{name}: {error}")
            else:
                raise BrokenPromise(f"{owner}.{name} takes {bad!r}.")


@promise
def fits_a_page(block: Block) -> None:
    """No equation is longer than 40 lines: a longer one is better a diagram."""
    for equation in ("outputs", "derivatives", "updates"):
        try:
            lines = len(inspect.getsource(getattr(type(block), equation)).splitlines())
        except OSError:  # of a class that was typed at a prompt there is no text
            continue
        need(lines <= 40, f"{type(block).__name__}.{equation} has {lines} lines.")
