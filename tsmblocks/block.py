"""What a block is: a frozen value with ports, states, parameters and pure equations.

It knows nothing of diagrams, of CasADi or of running; those read what is declared here.
One declaration serves the message, the fit's default bounds, the file format, the axis label
and the generated bad-value test, so a fact about a block stands in its class and nowhere else.
"""

from __future__ import annotations

import functools
import math
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, TypeVar, dataclass_transform

import attrs
import numpy as np

from tsmblocks.errors import BlockError, EquationError, ParameterError, in_words, near

# ---- what may be declared ---------------------------------------------------------------------


@attrs.frozen
class Input:
    """A port a signal comes in by.

    ``unit`` may be a label (``"rad/s"``), ``""`` for anything, or hold a unit of the block's own
    (``"?u"``, ``"?u/s"``): ports with the same letter must then agree, whatever they carry.
    With ``rate_of`` the port is the time derivative of that port and may stay unconnected: it is
    then formed exactly, by differentiating the expression of the driving signal.
    """

    about: str
    unit: str = ""
    rate_of: str = ""


@attrs.frozen
class Output:
    """A port a signal goes out by. ``unit`` as for Input."""

    about: str
    unit: str = ""


@attrs.frozen
class Tape:
    """A signal that the equations read and that ``tapes`` supplies as samples (noise, a recording)."""

    about: str


@attrs.frozen
class Past:
    """The value that port ``of`` had, ``by`` seconds ago (``by`` names a parameter).

    Before the run began the port is taken to have had the value of the parameter ``initial``.
    """

    about: str
    of: str
    by: str
    initial: str


@attrs.frozen
class State:
    """A state: its start value (a number, or a symbol in the twin), meaning and unit."""

    start: Any
    about: str
    unit: str = ""


@attrs.frozen(eq=False)
class Samples:
    """A signal known at instants ``t`` [s] only; ``hold`` says what it is in between.

    ``hold`` is ``"zero"``, ``"linear"`` or ``"cubic"``. A run may not reach beyond the instants, save
    that a zero-order hold keeps its last value.
    """

    t: np.ndarray
    y: np.ndarray
    hold: str = "linear"


@attrs.frozen
class Field:
    """What is known of one field of a block besides its value."""

    kind: str  # "parameter", "option" or "state"
    about: str
    unit: str = ""
    above: float = -math.inf
    below: float = math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    finite: bool = True
    choices: tuple[Any, ...] = ()
    default: Any = None

    @property
    def low(self) -> float:
        """Lower bound, whether or not it may be reached itself."""
        return max(self.above, self.at_least)

    @property
    def high(self) -> float:
        """Upper bound, whether or not it may be reached itself."""
        return min(self.below, self.at_most)

    def allows(self, value: float) -> bool:
        """Whether one number lies within the bounds (NaN never does)."""
        if math.isinf(value):
            return not self.finite and value == (self.low if value < 0 else self.high)
        return self.above < value < self.below and self.at_least <= value <= self.at_most

    def bounds(self) -> str:
        """The bounds in interval notation."""
        left = f"({self.above:g}" if self.above >= self.at_least else f"[{self.at_least:g}"
        right = f"{self.below:g})" if self.below <= self.at_most else f"{self.at_most:g}]"
        return f"{left}, {right}"


def _field(default: Any, spec: Field) -> Any:
    default = default if type(default) is int and spec.kind == "option" else _plain(default)
    return attrs.field(default=default, metadata={"tsm": attrs.evolve(spec, default=default)})


def parameter(
    *,
    default: Any,
    about: str,
    unit: str = "",
    above: float = -math.inf,
    below: float = math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    finite: bool = True,
) -> Any:
    """A number (or a tuple of numbers, or of rows) that stays a symbol until the run.

    It can therefore be swept, fitted and differentiated. ``above``/``below`` exclude the bound
    itself, ``at_least``/``at_most`` include it; they apply to each element of a tuple.
    ``finite=False`` admits an infinity where no bound stands in its way (a limit that never acts).
    """
    return _field(default, Field("parameter", about, unit, above, below, at_least, at_most, finite))


def option(
    *,
    default: Any,
    about: str,
    unit: str = "",
    choices: tuple[Any, ...] = (),
    above: float = -math.inf,
    at_least: float = -math.inf,
) -> Any:
    """A choice that shapes the equations (a sign string, an order, a period); never a symbol."""
    return _field(default, Field("option", about, unit, above=above, at_least=at_least, choices=choices))


def state(*, default: float, about: str, unit: str = "") -> Any:
    """A state; the field's value is where it starts. It may be fitted like a parameter."""
    return _field(default, Field("state", about, unit))


# ---- values -----------------------------------------------------------------------------------


def _plain(value: Any) -> Any:
    """Numbers as float, sequences as tuples; anything else as it came."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (list, tuple, np.ndarray)):
        return tuple(_plain(v) for v in value)
    if isinstance(value, (int, float, np.integer, np.floating)):
        return float(value)
    return value


def is_reference(value: Any) -> bool:
    """Whether a parameter stands for a number of the diagram's ``values`` table (``"$theta"``)."""
    return isinstance(value, str) and value.startswith("$")


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The single numbers of a parameter, with names: ``den`` gives ``den[0]``, ``den[1]``, …"""
    if isinstance(value, tuple):
        for k, v in enumerate(value):
            yield from leaves(v, f"{name}[{k}]")
    else:
        yield name, value


def map_leaves(f: Callable[[str, Any], Any], value: Any, name: str = "") -> Any:
    """The same nesting with ``f(name, leaf)`` in the place of each leaf."""
    if isinstance(value, tuple):
        return tuple(map_leaves(f, v, f"{name}[{k}]") for k, v in enumerate(value))
    return f(name, value)


@functools.cache
def _signal_type(names: tuple[str, ...]) -> Any:
    return namedtuple("Signals", names)  # type: ignore[misc]  # noqa: PYI024 - names known at run time only


def signals(names: tuple[str, ...] | list[str], values: Any) -> Any:
    """Values by name and by position, as equations receive their states and inputs."""
    return _signal_type(tuple(names))(*values)


# ---- the block --------------------------------------------------------------------------------

REGISTRY: dict[str, type[Block]] = {}
"""Every block that files may name, by class name."""


class Block:
    """Base of all blocks, and the only one: no block inherits from another.

    A block declares fields (``parameter``, ``option``, ``state``) and ports (``Input``, ``Output``,
    ``Tape``, ``Past``), and gives its equations with CasADi operations:

    - ``outputs(t, x, u)``: the outputs, by name;
    - ``derivatives(t, x, u)``: rates of the continuous states;
    - ``updates(t, x, u)``: new values of the memory states. A block with ``sampled = True`` (and an
      option ``period``) is updated at multiples of its period and its outputs are held in between;
      any other block is updated once at the start of each step. A continuous state named by
      ``updates`` is set to that value there (a reset).

    ``t`` is the time in s; ``x`` and ``u`` hold states and inputs (with tapes and past values) by name.
    ``source`` names the equation, paper or book; ``symbol`` is what the picture shows.
    """

    source: ClassVar[str] = ""
    symbol: ClassVar[str] = ""
    sampled: ClassVar[bool] = False
    _fields: ClassVar[dict[str, Field]] = {}
    _declared: ClassVar[dict[str, Any]] = {}

    # -- equations, to be written by the block

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        """Outputs by name."""
        raise EquationError(f"{type(self).__name__} gives no outputs.")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        """Rates of the continuous states by name, per second."""
        return {}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        """New values of the memory states by name."""
        return {}

    def tapes(self, start: float, stop: float, name: str = "") -> dict[str, Samples]:
        """Samples of each Tape that cover ``start`` to ``stop`` [s].

        ``name`` is the block's name in its diagram, so that two noises with one seed differ.
        """
        return {}

    def check(self) -> None:
        """Raise ParameterError when parameters do not go together. Never called with symbols."""

    # -- what is declared, for readers of blocks

    @property
    def inports(self) -> dict[str, Input]:
        """Input ports by name, in order. A block whose ports depend on an option overrides this."""
        return {k: p for k, p in self._declared.items() if isinstance(p, Input)}

    @property
    def outports(self) -> dict[str, Output]:
        """Output ports by name, in order."""
        return {k: p for k, p in self._declared.items() if isinstance(p, Output)}

    @property
    def states(self) -> dict[str, State]:
        """States by name, in order, with their start values."""
        return {
            k: State(getattr(self, k), f.about, f.unit)
            for k, f in self._fields.items()
            if f.kind == "state"
        }

    @property
    def tape_ports(self) -> dict[str, Tape]:
        """Signals supplied by ``tapes``."""
        return {k: p for k, p in self._declared.items() if isinstance(p, Tape)}

    @property
    def past_ports(self) -> dict[str, Past]:
        """Delayed values that the equations read."""
        return {k: p for k, p in self._declared.items() if isinstance(p, Past)}

    @property
    def read_names(self) -> tuple[str, ...]:
        """Names of everything ``u`` holds, in order: inputs, tapes, past values."""
        return (*self.inports, *self.tape_ports, *self.past_ports)

    @classmethod
    def fields(cls) -> Mapping[str, Field]:
        """What is declared of each field: meaning, unit, bounds, default."""
        return cls._fields

    @property
    def parameters(self) -> dict[str, Any]:
        """Values that stay symbols until the run: parameters and start values."""
        return {k: getattr(self, k) for k, f in self._fields.items() if f.kind != "option"}

    @property
    def options(self) -> dict[str, Any]:
        """Values that shape the equations."""
        return {k: getattr(self, k) for k, f in self._fields.items() if f.kind == "option"}

    def replace(self, **changes: Any) -> Block:
        """The same block with some fields changed; raises ParameterError for an unknown name."""
        values = {k: getattr(self, k) for k in self._fields}
        return type(self)(**{**values, **changes})

    def twin(self, symbol: Callable[[str, Any], Any]) -> Block:
        """The same block with each parameter's numbers replaced by ``symbol(name, value)``."""
        other = object.__new__(type(self))
        for k, f in self._fields.items():
            value = getattr(self, k)
            object.__setattr__(other, k, value if f.kind == "option" else map_leaves(symbol, value, k))
        return other

    def __attrs_post_init__(self) -> None:
        for name, field in self._fields.items():
            value = _plain(getattr(self, name))
            _validate(type(self).__name__, name, field, value)
            object.__setattr__(self, name, int(value) if isinstance(value, float) and type(field.default) is int else value)
        if not any(is_reference(v) for k in self.parameters for _, v in leaves(getattr(self, k))):
            self.check()


def _validate(owner: str, name: str, field: Field, value: Any) -> None:
    """Raise ParameterError unless ``value`` is of the kind of the default and within the bounds."""
    unit = f" [{field.unit}]" if field.unit and "?" not in field.unit else ""
    meaning = f"It is: {field.about}{unit}."
    if field.choices and value not in field.choices:
        raise ParameterError(
            f"{owner}.{name} is {in_words(value)}, which is not a choice."
            f"{near(value, field.choices)} {meaning}"
        )
    numeric = field.kind != "option" or isinstance(field.default, float)
    if type(field.default) is int:
        if not isinstance(value, float) or not value.is_integer() or not field.allows(value):
            raise ParameterError(
                f"{owner}.{name} must be a whole number in {field.bounds()}, got {in_words(value)}. {meaning}"
            )
        return
    if not numeric:
        wanted = type(field.default)
        if wanted in (str, bool) and type(value) is not wanted:
            kind = {str: "text", bool: "true or false"}[wanted]
            raise ParameterError(f"{owner}.{name} must be {kind}, got {in_words(value)}. {meaning}")
        if wanted is tuple and not isinstance(value, tuple):
            raise ParameterError(f"{owner}.{name} must be a list, got {in_words(value)}. {meaning}")
        return
    if isinstance(value, tuple) != isinstance(field.default, tuple):
        wanted_words = "a list of numbers" if isinstance(field.default, tuple) else "a number"
        raise ParameterError(f"{owner}.{name} must be {wanted_words}, got {in_words(value)}. {meaning}")
    for leaf, number in leaves(value, name):
        if field.kind != "option" and is_reference(number):
            continue
        if not isinstance(number, float):
            raise ParameterError(f"{owner}.{leaf} must be a number, got {in_words(number)}. {meaning}")
        if not field.allows(number):
            raise ParameterError(
                f"{owner}.{leaf} must lie in {field.bounds()}, got {number:g}. {meaning}"
            )


B = TypeVar("B", bound=type[Block])


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(parameter, option, state))
def block(cls: B | None = None, *, register: bool = True) -> Any:
    """Make a class a block: frozen, compared by value, checked, and known to files by its name.

    ``register=False`` keeps it out of the registry (a block for one script). Raises BlockError when
    the class does not derive from Block itself, or when its name is taken by another block.
    """
    if cls is None:
        return functools.partial(block, register=register)
    if cls.__bases__ != (Block,):
        raise BlockError(f"{cls.__name__} must derive from Block itself, not from {cls.__bases__[0].__name__}.")
    specs = {k: v for k, v in vars(cls).items() if isinstance(v, (Input, Output, Tape, Past))}
    made = attrs.frozen(kw_only=True, slots=False)(cls)
    made._declared = specs
    made._fields = {a.name: a.metadata["tsm"] for a in attrs.fields(made) if "tsm" in a.metadata}
    type.__setattr__(made, "__init__", _guarded(made.__init__, made))
    if register:
        _register(made)
    return made


def _guarded(init: Callable[..., None], cls: type[Block]) -> Callable[..., None]:
    """The constructor with this package's message for a name or a position it does not know."""

    @functools.wraps(init)
    def __init__(self: Block, *args: Any, **values: Any) -> None:
        if args:
            first = next(iter(cls._fields), "gain")
            raise ParameterError(f"{cls.__name__} takes its parameters by name: {first}={in_words(args[0])}.")
        for name in values:
            if name not in cls._fields:
                raise ParameterError(f"{cls.__name__} has no parameter '{name}'.{near(name, cls._fields)}")
        init(self, **values)

    return __init__


def _register(cls: type[Block]) -> None:
    known = REGISTRY.get(cls.__name__)
    if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        raise BlockError(
            f"A block named {cls.__name__} exists already, in {known.__module__}. "
            "Choose another name, or use @block(register=False)."
        )
    REGISTRY[cls.__name__] = cls
