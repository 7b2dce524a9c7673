"""Blocks: frozen values with ports, states, parameters and pure equations.

This module knows neither diagrams, nor CasADi, nor simulation; these read what is declared here.
"""

from __future__ import annotations

import functools
from collections import namedtuple
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar, dataclass_transform

import attrs

from tsmblocks.common.errors import BlockError, EquationError, ParameterError
from tsmblocks.common.units import UnitError, parse
from tsmblocks.common.views import view
from tsmblocks.model.block_class import by_name_only, check_declarations, refuse_change
from tsmblocks.model.fields import FLAT_LIST, Field, Input, Output, Past, Samples, State, Tape, option, parameter, state
from tsmblocks.model.values import is_reference, leaves, map_leaves, plain, validate


@functools.cache
def _signal_type(names: tuple[str, ...]) -> Any:
    """A named tuple with these names."""
    return namedtuple("Signals", names)  # type: ignore[misc]


def signals(names: tuple[str, ...] | list[str], values: Any) -> Any:
    """Return values by name and by position, as equations receive their states and inputs.

    Parameters
    ----------
    names : sequence of str
        Names of the signals.
    values : iterable
        Values of the signals, in this order.

    Returns
    -------
    namedtuple
        The values.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> x = tsm.signals(["position", "speed"], [0.5, 2.0])
    >>> x.speed, x[0]
    (2.0, 0.5)
    """
    return _signal_type(tuple(names))(*values)


REGISTRY: dict[str, type[Block]] = {}
"""Blocks that files may name, by class name."""


class Block:
    """Base of all blocks, and the only one: no block inherits from another.

    A block declares fields (``parameter``, ``option``, ``state``) and ports (``Input``, ``Output``, ``Tape``,
    ``Past``), and gives its equations with CasADi operations: ``outputs``, ``derivatives`` and ``updates``. One with
    ``sampled = True`` (and an option ``period``) is updated as the run starts and every period after, its outputs held
    in between; any other is updated once at the start of each step. ``source`` names the origin of the equations
    (paper, book, "definition"); ``symbol`` is the text in drawings, ``symbol_with_values`` the text that shows
    parameters, named in braces: ``"{gain}/({time_constant:s}+1)"``; ``{level:unit}`` adds the unit of its signal,
    ``{low:value}`` is the number alone, angles in degrees. One that ``switches`` its diagram ("enable", "trigger") has
    an output ``on`` that says when the diagram acts.

    Parameters
    ----------
    *_, **__ : object
        Fields, by keyword: a class made by ``block`` has its own constructor.

    Raises
    ------
    BlockError
        For a class that was not made by ``block``.
    """

    source: ClassVar[str] = ""
    symbol: ClassVar[str] = ""
    symbol_with_values: ClassVar[str] = ""
    sampled: ClassVar[bool] = False
    switches: ClassVar[str] = ""
    _fields: ClassVar[dict[str, Field]] = {}  # parameters, options and states by name
    _declared: ClassVar[dict[str, Any]] = {}  # ports by name: Input, Output, Tape, Past

    def __init__(self, *_: Any, **__: Any) -> None:
        owner = type(self).__name__  # where @block was left out
        raise BlockError(f"{owner} is not a block yet: write @block above class {owner}(Block).")

    # -- equations, to be written by the block

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        """Return the outputs.

        Parameters
        ----------
        t : SX or float
            Time [s].
        x, u : namedtuple
            States; inputs, tapes and past values, by name.

        Returns
        -------
        dict of str to SX or float
            Outputs by name.
        """
        if self.outports:
            method = f"{type(self).__name__} has no method outputs(self, t, x, u)"
            raise EquationError(f"{method}, which should give {', '.join(self.outports)}.")
        return {}

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        """Return the time derivatives of the continuous states.

        Parameters
        ----------
        t : SX or float
            Time [s].
        x, u : namedtuple
            States; inputs, tapes and past values, by name.

        Returns
        -------
        dict of str to SX or float
            Derivatives by name of the state, in its unit per second.
        """
        return {}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        """Return the new values of the memory states, and of the continuous states that are reset.

        All blocks are updated at once, from the signals before the update: where the memory of another block jumps at
        that instant, as a relay switches, this one reads the jump at its next update (a step, or a sample, later). With
        ``simulate(..., locate=True)`` it reads the value before the jump and the one after it.

        Parameters
        ----------
        t : SX or float
            Time [s].
        x, u : namedtuple
            States before the update; inputs, tapes and past values, by name.

        Returns
        -------
        dict of str to SX or float
            Values by name of the state.
        """
        return {}

    def tapes(self, start: float, stop: float, name: str = "") -> dict[str, Samples]:
        """Return the samples of each ``Tape``.

        Parameters
        ----------
        start, stop : float
            Times [s] that the samples must cover.
        name : str, default ""
            Name of the block in its diagram, so that two noise blocks with one seed differ.

        Returns
        -------
        dict of str to Samples
            Samples by name of the tape.
        """
        return {}

    def check(self) -> None:
        """Raise ParameterError when parameters are inconsistent. Never called with symbols."""

    # -- declarations, read by compiler, files and pages

    @property
    def inports(self) -> dict[str, Input]:
        """Input ports by name, in order. A block whose ports depend on an option overrides this."""
        return {k: self._in_unit(p) for k, p in self._declared.items() if isinstance(p, Input)}

    @property
    def outports(self) -> dict[str, Output]:
        """Output ports by name, in order."""
        return {k: self._in_unit(p) for k, p in self._declared.items() if isinstance(p, Output)}

    def _in_unit(self, port: Any) -> Any:
        """A port with the unit that its option gives, if it does."""
        unit = getattr(self, port.unit_option) if port.unit_option else ""
        return attrs.evolve(port, unit=unit) if unit else port

    @property
    def states(self) -> dict[str, State]:
        """States by name, in order, with their initial values."""
        return {k: State(getattr(self, k), f.about, f.unit) for k, f in self._fields.items() if f.kind == "state"}

    @property
    def tape_ports(self) -> dict[str, Tape]:
        """Signals that ``tapes`` supplies."""
        return {k: p for k, p in self._declared.items() if isinstance(p, Tape)}

    @property
    def past_ports(self) -> dict[str, Past]:
        """Past values that the equations read."""
        return {k: p for k, p in self._declared.items() if isinstance(p, Past)}

    @property
    def read_names(self) -> tuple[str, ...]:
        """Names of everything in ``u``, in order: inputs, tapes, past values."""
        return (*self.inports, *self.tape_ports, *self.past_ports)

    @classmethod
    def fields(cls) -> Mapping[str, Field]:
        """The declaration of each field: meaning, unit, bounds, default."""
        return cls._fields

    @property
    def parameters(self) -> dict[str, Any]:
        """Values that stay symbols until the run: parameters and initial values of states."""
        return {k: getattr(self, k) for k, f in self._fields.items() if f.kind != "option"}

    @property
    def options(self) -> dict[str, Any]:
        """Values that shape the equations."""
        return {k: getattr(self, k) for k, f in self._fields.items() if f.kind == "option"}

    def replace(self, **changes: Any) -> Block:
        """Return the same block with some fields changed.

        Parameters
        ----------
        **changes : object
            New values by name.

        Returns
        -------
        Block
            The changed block.

        Raises
        ------
        ParameterError
            For an unknown name, and for a value that the block refuses.
        """
        values = {k: getattr(self, k) for k in self._fields}
        return type(self)(**{**values, **changes})

    def with_symbols(self, symbol: Callable[[str, Any], Any]) -> Block:
        """Return the same block with symbols instead of its numbers.

        Parameters
        ----------
        symbol : callable
            ``symbol(name, value)`` gives the symbol of one number; ``name`` is ``"den[1]"`` for an element of a list.

        Returns
        -------
        Block
            A block whose equations are expressions of these symbols. It is not checked.
        """
        other = object.__new__(type(self))
        for k, f in self._fields.items():
            value = getattr(self, k)
            object.__setattr__(other, k, value if f.kind == "option" else map_leaves(symbol, value, k))
        return other

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={_short(getattr(self, name))}" for name in self._fields)
        return f"{type(self).__name__}({values})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __attrs_post_init__(self) -> None:
        for name, field in self._fields.items():
            value = plain(getattr(self, name))
            validate(type(self).__name__, name, field, value)
            whole = isinstance(value, float) and type(field.default) is int  # ``plain`` makes every number a float
            object.__setattr__(self, name, int(value) if whole else value)
        # A reference has no number yet; the checks follow when the diagram puts its value in.
        if not any(is_reference(v) for k in self.parameters for _, v in leaves(getattr(self, k))):
            self._check_units()
            self.check()

    def _check_units(self) -> None:
        """Raise ParameterError where an option that gives the unit of a port is no unit."""
        for name in (port.unit_option for port in self._declared.values() if isinstance(port, (Input, Output))):
            try:
                parse(getattr(self, name) if name else "")
            except UnitError as error:
                raise ParameterError(f"{type(self).__name__}.{name}: {error}") from None


def _short(value: Any) -> str:
    """A value as Python text; the first elements of a long list."""
    if isinstance(value, tuple) and len(value) > 8:
        return f"({', '.join(map(repr, value[:3]))}, … {len(value)} in all)"
    return repr(value)


B = TypeVar("B", bound=type[Block])


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(parameter, option, state))
def block(target: B | None = None, *, register: bool = True) -> Any:
    """Make a class a block: frozen, compared by value, checked, and known to files by its name.

    Parameters
    ----------
    target : type or None, default None
        The class, which derives from ``Block``; None where the decorator is used with arguments.
    register : bool, default True
        Whether files may name the block. ``False`` is for a block of one script.

    Returns
    -------
    type or callable
        The class, or a decorator where ``target`` is None.

    Raises
    ------
    BlockError
        For a class that does not derive from ``Block`` directly, declares what a block cannot have, or has the name of
        another block.
    ParameterError
        For a default out of its bounds.

    Examples
    --------
    >>> from tsmblocks.block import Block, Input, Output, block, parameter
    >>> @block(register=False)
    ... class Doubled(Block):
    ...     source, symbol = "definition", "2u"
    ...     factor: float = parameter(default=2.0, about="factor on the input")
    ...     u = Input("any signal", unit="?u")
    ...     y = Output("the signal times the factor", unit="?u")
    ...
    ...     def outputs(self, t, x, u):
    ...         return dict(y=self.factor * u.u)
    >>> Doubled(factor=3.0)
    Doubled(factor=3.0)
    """
    if target is None:
        return functools.partial(block, register=register)
    owner = target.__name__
    if target.__bases__ != (Block,):
        base = target.__bases__[0].__name__
        raise BlockError(f"{owner} must derive from Block itself, not from {base}. Write class {owner}(Block).")
    if "__init__" in vars(target):
        wrong = f"{owner} must not have __init__: it is made from what is declared."
        raise BlockError(f"{wrong} Check parameters against each other in check().")
    ports = {k: v for k, v in vars(target).items() if isinstance(v, (Input, Output, Tape, Past))}
    cls: Any = attrs.frozen(kw_only=True, slots=False, repr=False)(target)
    cls._declared = ports
    cls._fields = {
        a.name: attrs.evolve(a.metadata["tsm"], flat=str(a.type) == FLAT_LIST)
        for a in attrs.fields(cls)
        if "tsm" in a.metadata
    }
    check_declarations(cls)
    cls.__init__ = by_name_only(cls.__init__, cls)
    cls.__setattr__ = refuse_change
    if register:
        _register(cls)
    return cls


def _register(cls: type[Block]) -> None:
    """Enter a class in the registry. Raises BlockError where the name is taken."""
    known = REGISTRY.get(cls.__name__)
    if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        taken = f"A block named {cls.__name__} exists already, in {known.__module__}."
        raise BlockError(f"{taken} Choose another name, or use @block(register=False).")
    REGISTRY[cls.__name__] = cls


__all__ = [
    "REGISTRY",
    "Block",
    "Field",
    "Input",
    "Output",
    "Past",
    "Samples",
    "State",
    "Tape",
    "block",
    "is_reference",
    "leaves",
    "map_leaves",
    "option",
    "parameter",
    "plain",
    "signals",
    "state",
    "validate",
]
