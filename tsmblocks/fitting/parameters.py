"""The free parameters of a fit, their bounds, and the parameters of each experiment as functions of them."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import arguments, units
from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.fitting.constraints import Constraint, Ties
from tsmblocks.model.block import Field, is_reference, leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.edits import near_path
from tsmblocks.model.unit_inference import RATIO_OF_UNITS, SHARED_UNIT

FAR = 1e100
"""A bound beyond this counts as none. Chosen."""
MARGIN = 1e-9
"""How far inside an excluded bound a fit stays, relative to the parameter. Chosen."""


@attrs.frozen
class Unknown:
    """One unknown: a parameter of the diagram, in all experiments or (``experiment``) in one.

    ``start`` is where the search begins, ``low`` and ``high`` the bounds, all in ``unit``.
    """

    parameter: str
    start: float
    low: float
    high: float
    unit: str = ""
    about: str = ""
    experiment: str = ""

    @property
    def name(self) -> str:
        """The parameter's name, with ``@experiment`` where it belongs to one alone."""
        return f"{self.parameter}@{self.experiment}" if self.experiment else self.parameter


@attrs.frozen(eq=False)
class Unknowns:
    """All unknowns, and the map from them to the parameters ``p`` of each experiment.

    ``order`` lists the names of ``p``; ``base`` holds the numbers that stay.
    """

    items: tuple[Unknown, ...]
    order: tuple[str, ...]
    base: np.ndarray
    experiments: tuple[str, ...]
    starts: tuple[Mapping[str, float], ...] = ()
    """Initial states of each experiment in place of those of ``base``, by name; empty where there are none."""
    tied: tuple[int, ...] = ()
    tie: Any = None  # p -> (tied numbers, their derivatives), a CasADi function
    _maps: tuple[tuple[np.ndarray, np.ndarray], ...] = attrs.field(init=False)
    """Unknowns of each experiment, and their places in ``p``."""

    @_maps.default
    def _made_maps(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        at, made = {name: k for k, name in enumerate(self.order)}, []
        for name in self.experiments:
            own = [k for k, item in enumerate(self.items) if item.experiment in ("", name)]
            places = [at[self.items[k].parameter] for k in own]
            made.append((np.array(own, dtype=int), np.array(places, dtype=int)))
        return tuple(made)

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each unknown."""
        return tuple(item.name for item in self.items)

    @functools.cached_property
    def start(self) -> np.ndarray:
        """The start of the search, shape (unknowns,)."""
        return _constant(item.start for item in self.items)

    @functools.cached_property
    def low(self) -> np.ndarray:
        """Lower bounds, shape (unknowns,)."""
        return _constant(item.low for item in self.items)

    @functools.cached_property
    def high(self) -> np.ndarray:
        """Upper bounds, shape (unknowns,)."""
        return _constant(item.high for item in self.items)

    @functools.cached_property
    def is_local(self) -> np.ndarray:
        """Which unknowns belong to one experiment alone, shape (unknowns,)."""
        return _constant((bool(item.experiment) for item in self.items), dtype=bool)

    @functools.cached_property
    def common(self) -> np.ndarray:
        """The unknowns that belong to all experiments."""
        return np.flatnonzero(~self.is_local)

    @functools.cached_property
    def own(self) -> tuple[np.ndarray, ...]:
        """The unknowns of each experiment alone."""
        return tuple(columns[self.is_local[columns]] for columns, _ in self._maps)

    @functools.cached_property
    def bases(self) -> np.ndarray:
        """The numbers of each experiment that stay, with its own initial states, shape (experiments, parameters)."""
        made = np.repeat(self.base[None], len(self.experiments), axis=0)
        for e, own in enumerate(self.starts):
            for name, value in own.items():
                made[e, self.order.index(name)] = value
        return made

    def columns(self, e: int) -> np.ndarray:
        """Which unknowns matter to experiment ``e``."""
        return self._maps[e][0]

    def changed(self, e: int) -> list[int]:
        """Places in ``p`` that may differ from ``base`` in experiment ``e``."""
        own = {self.order.index(name) for starts in self.starts for name in starts}
        return sorted({*self._maps[e][1].tolist(), *self.tied, *own})

    def parameters(self, theta: np.ndarray, e: int) -> np.ndarray:
        """Parameters ``p`` of experiment ``e``, shape (parameters,)."""
        p, (columns, places) = self.bases[e].copy(), self._maps[e]
        p[places] = theta[columns]
        if self.tie is not None:
            p[list(self.tied)] = np.asarray(self.tie(p)[0]).ravel()
        return p

    def sets(self, thetas: np.ndarray) -> np.ndarray:
        """Parameters of all experiments for ``thetas`` (sets, unknowns), shape (experiments, parameters, sets)."""
        every = range(len(self.experiments))
        if self.tie is not None:
            return np.array([np.stack([self.parameters(theta, e) for theta in thetas], axis=1) for e in every])
        p = np.empty((len(every), len(self.base), len(thetas)))
        p[:] = self.bases[:, :, None]
        experiment, columns, places = self._places
        p[experiment, places] = thetas[:, columns].T
        return p

    @functools.cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For each number that an unknown sets: its experiment, the unknown, and its place in ``p``."""
        columns, places = zip(*self._maps, strict=True)
        experiment = np.repeat(np.arange(len(columns)), [len(own) for own in columns])
        return experiment, np.concatenate(columns), np.concatenate(places)

    def jacobians(self, p: np.ndarray) -> np.ndarray:
        """``jacobian`` of all experiments, for ``p`` (experiments, parameters)."""
        return self._seeds if self.tie is None else np.array([self.jacobian(one, e) for e, one in enumerate(p)])

    @functools.cached_property
    def _seeds(self) -> np.ndarray:
        return np.array([self.jacobian(self.base, e) for e in range(len(self.experiments))])

    def jacobian(self, p: np.ndarray, e: int) -> np.ndarray:
        """Derivatives of ``p`` with respect to the unknowns of ``columns(e)``, shape (parameters, columns)."""
        places = self._maps[e][1]
        made = np.zeros((len(p), len(places)))
        made[places, np.arange(len(places))] = 1.0
        if self.tie is not None:
            made[list(self.tied)] = np.asarray(self.tie(p)[1]) @ made
        return made

    def symbolic(self, theta: Any, e: int) -> Any:
        """Parameters ``p`` of experiment ``e`` as CasADi expressions of the unknowns."""
        import casadi as ca

        p = ca.SX(self.bases[e])
        for k, place in zip(*self._maps[e], strict=True):
            p[int(place)] = theta[int(k)]
        if self.tie is not None:
            tied = self.tie.call([p])[0]
            for i, place in enumerate(self.tied):
                p[place] = tied[i]
        return p

    def settings(self, theta: np.ndarray, e: int) -> dict[str, float]:
        """Numbers of experiment ``e`` by parameter name, ties included."""
        p = self.parameters(theta, e)
        return {self.order[k]: float(p[k]) for k in self.changed(e)}


def _constant(values: Iterable[Any], dtype: type = float) -> np.ndarray:
    """A read-only copy of an array."""
    made: np.ndarray = np.array(list(values), dtype=dtype)
    made.setflags(write=False)
    return made


def with_ties(unknowns: Unknowns, ties: Ties) -> Unknowns:
    """The same unknowns with some parameters following others."""
    if not ties:
        return unknowns
    import casadi as ca

    p = ca.SX.sym("p", len(unknowns.order))
    symbols = {name: p[k] for k, name in enumerate(unknowns.order)}
    for name, expression in ties:
        symbols[name] = expression.symbolic(symbols)
    tied = tuple(unknowns.order.index(name) for name, _ in ties)
    values = ca.vertcat(*(symbols[name] for name, _ in ties))
    function = ca.Function("tie", [p], [values, ca.densify(ca.jacobian(values, p))])
    return attrs.evolve(unknowns, tied=tied, tie=function)


@attrs.frozen(eq=False)
class Constraints:
    """Constraints as functions of the unknowns: ``values`` >= 0, or = 0 where ``equal``."""

    names: tuple[str, ...]
    equal: np.ndarray
    rows: tuple[tuple[int, np.ndarray], ...]  # (experiment, which constraints)
    function: Any  # p -> (values, derivatives)
    unknowns: Unknowns

    def values(self, theta: np.ndarray) -> np.ndarray:
        """How far inside each constraint ``theta`` is, shape (constraints,)."""
        functions = ((self.function(self.unknowns.parameters(theta, e))[0], rows) for e, rows in self.rows)
        return np.concatenate([np.empty(0), *(np.asarray(g).ravel()[rows] for g, rows in functions)])

    def violations(self, theta: np.ndarray) -> np.ndarray:
        """By how much each constraint is violated, shape (constraints,)."""
        values = self.values(theta)
        return np.abs(np.where(self.equal, values, np.minimum(values, 0.0)))

    def symbolic(self, theta: Any) -> Any:
        """The values as CasADi expressions of the unknowns."""
        import casadi as ca

        parts = []
        for e, rows in self.rows:
            g = self.function.call([self.unknowns.symbolic(theta, e)])[0]
            parts += [g[int(k)] for k in rows]
        return ca.vertcat(*parts) if parts else ca.SX(0, 1)

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Derivatives of the values, shape (constraints, unknowns)."""
        made = np.zeros((len(self.names), len(theta)))
        first = 0
        for e, rows in self.rows:
            p = self.unknowns.parameters(theta, e)
            with np.errstate(invalid="ignore"):  # a derivative may be infinite, as that of a logarithm at zero
                jacobian = np.asarray(self.function(p)[1])[rows] @ self.unknowns.jacobian(p, e)
            made[first : first + len(rows), self.unknowns.columns(e)] = jacobian
            first += len(rows)
        return made


def constraint_functions(constraints: Sequence[Constraint], unknowns: Unknowns) -> Constraints:
    """Constraints on the unknowns; one on a parameter of one experiment alone counts in each of them."""
    import casadi as ca

    p = ca.SX.sym("p", len(unknowns.order))
    symbols = {name: p[k] for k, name in enumerate(unknowns.order)}
    g = ca.vertcat(*(c.expression.symbolic(symbols) for c in constraints)) if constraints else ca.SX(0, 1)
    function = ca.Function("limits", [p], [g, ca.densify(ca.jacobian(g, p))])
    own = {item.parameter for item in unknowns.items if item.experiment}
    everywhere = [any(name in own for name in c.expression.names) for c in constraints]
    rows, names, equal = [], list[str](), list[bool]()
    for e, experiment in enumerate(unknowns.experiments):
        here = [k for k in range(len(constraints)) if e == 0 or everywhere[k]]
        if here:
            rows.append((e, np.array(here)))
        names += [f"{constraints[k].name}@{experiment}" if everywhere[k] else constraints[k].name for k in here]
        equal += [constraints[k].equality for k in here]
    return Constraints(tuple(names), np.array(equal, dtype=bool), tuple(rows), function, unknowns)


# ---- which parameters, between which bounds --------------------------------------------------------


def declarations(diagram: Diagram, prefix: str = "") -> Iterator[tuple[str, Field, str]]:
    """Every single number of a diagram: its full name, its declaration, and the shared number it refers to."""
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            yield from declarations(block, f"{prefix}{name}.")
            continue
        known = block.fields()
        for key, value in block.parameters.items():
            for leaf, number in leaves(value, f"{prefix}{name}.{key}"):
                yield leaf, known[key], prefix + number[1:] if is_reference(number) else ""


def numbers(diagram: Diagram) -> dict[str, list[Field]]:
    """Names that may be freed, each with the declarations that bind it (a shared number has several)."""
    found: dict[str, list[Field]] = {}
    for name, field, shared in declarations(diagram):
        found[name] = [field]
        if shared:
            found.setdefault(shared, []).append(field)
    for name in diagram.parameters:
        found.setdefault(name, [])
    return found


def chosen(diagram: Diagram, patterns: Iterable[str] | None, what: str = "free") -> list[str]:
    """Parameters named by patterns (``tsm.*``, ``offset.bias``), in the diagram's order.

    Without patterns: all but initial states, and parameters that are ``known`` by declaration. Raises ParameterError
    for a pattern that matches nothing.
    """
    known = numbers(diagram)
    endless = {name for name, value in diagram.parameters.items() if not math.isfinite(value)}  # limits that never act
    if patterns is None:
        return [name for name in diagram.parameters if name not in endless and not _is_set(known[name])]
    found: set[str] = set()
    for pattern in arguments.as_names(what, patterns, "tsm.*"):
        hits = [k for k in known if k == pattern]
        if hits and pattern in endless:
            raise ParameterError(
                f"{what} '{pattern}': it is infinite, so it cannot be estimated; set a finite value first."
            )
        hits = hits or [k for k in known if fnmatchcase(k, pattern) and not _is_set(known[k]) and k not in endless]
        if not hits:
            hint = near_path(pattern, known)
            raise ParameterError(f"{what} '{pattern}' names no parameter of '{diagram.title}'.{hint}")
        found.update(hits)
    return [name for name in known if name in found]


def is_start(fields: list[Field]) -> bool:
    """Whether a number is the initial value of a state: patterns leave those out, names do not."""
    return bool(fields) and all(f.kind == "state" or f.initial for f in fields)


def with_initial_values(diagram: Diagram) -> Diagram:
    """The diagram in which empty lists of initial values are zeros, so that each value can be named."""
    changed: dict[str, Any] = {}
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            inner = with_initial_values(block)
            changed |= {} if inner is block else {name: inner}
            continue
        given = block.parameters
        empty = [k for k, f in block.fields().items() if f.initial and given.get(k) == ()]
        if empty and block.states:
            changed[name] = block.replace(**dict.fromkeys(empty, (0.0,) * len(block.states)))
    return diagram.rewire(blocks={**diagram.blocks, **changed}) if changed else diagram


def _is_set(fields: list[Field]) -> bool:
    """Whether a number is free only where it is named: an initial state, or one that is known."""
    return bool(fields) and all(f.kind == "state" or f.known or f.initial for f in fields)


def bounds_of(fields: list[Field], value: float) -> tuple[float, float]:
    """Bounds by declaration; an excluded bound is kept off by a margin, since steps may land on it."""
    size = MARGIN * max(abs(value), 1e-3)
    low = max((max(f.at_least, f.above + size) for f in fields), default=-math.inf)
    high = min((min(f.at_most, f.below - size) for f in fields), default=math.inf)
    return low, high


def given_bounds(
    given: Mapping[str, Any] | None, free: Sequence[str], known: Iterable[str]
) -> dict[str, tuple[float, float]]:
    """Bounds given by name or pattern. Raises ParameterError for invalid bounds, or a name that is not free."""
    made: dict[str, tuple[float, float]] = {}
    for pattern, pair in arguments.as_mapping("bounds", given, "'tsm.theta': (0.1, 50.0)").items():
        hits = [k for k in free if k == pattern] or [k for k in free if fnmatchcase(k, pattern)]
        if not hits:
            why = "is not free in this fit" if pattern in known else "names no parameter that is free"
            raise ParameterError(f"bounds: '{pattern}' {why}.{near_path(pattern, free)}")
        made.update(dict.fromkeys(hits, _pair(pattern, pair)))
    return made


def _pair(name: str, pair: Any) -> tuple[float, float]:
    try:
        ends = (math.copysign(math.inf, s) if v is None else float(v) for v, s in zip(pair, (-1, 1), strict=True))
        low, high = (math.copysign(math.inf, v) if abs(v) > FAR else v for v in ends)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(
            f"bounds of '{name}' must be a pair (low, high), None for no bound, got {in_words(pair)}."
        ) from None
    if not low < high:
        raise ParameterError(f"bounds of '{name}': the lower one must be below the upper one, got ({low:g}, {high:g}).")
    return low, high


def unknown(name: str, diagram: Diagram, fields: list[Field], own: tuple[float, float] | None) -> Unknown:
    """One parameter with its bounds. Raises ParameterError when it starts outside them."""
    value = diagram.parameters[name]
    low, high = bounds_of(fields, value)
    if own is not None:
        low, high = max(low, own[0]), min(high, own[1])
        if not low < high:
            raise ParameterError(
                f"bounds of '{name}': ({own[0]:g}, {own[1]:g}) do not overlap the bounds of its block, "
                f"{fields[0].bounds() if fields else 'any number'}."
            )
    if not low <= value <= high:
        raise ParameterError(
            f"'{name}' starts at {value:g}, outside its bounds of {low:g} to {high:g}. Start inside: "
            f"start={{'{name}': …}}, or other bounds."
        )
    unit = unit_of(name, diagram, fields)
    about = fields[0].about if fields else "shared number"
    return Unknown(name, value, low, high, unit, about)


def unit_of(name: str, diagram: Diagram, fields: list[Field]) -> str:
    """The unit of a number: as declared, or that which the wires give the ports of its block; ``""`` without either."""
    declared = next((f.unit for f in fields if f.unit and "?" not in f.unit), "")
    return declared or (_unit_of_ports(name, diagram, fields[0].unit) if fields else "")


def _unit_of_ports(name: str, diagram: Diagram, label: str) -> str:
    """The unit of a number that depends on those of the ports of its block, such as ``?u*s`` or ``?y/?u``."""
    block: Any = diagram
    *way, _ = name.split(".")
    for part in way:
        block = block.blocks.get(part) if isinstance(block, Diagram) else None
    if not way or isinstance(block, Diagram | None):
        return ""
    ports = {**block.inports, **block.outports}

    def of_letter(letter: str) -> str:
        """The unit of the ports that share a letter."""
        alike = [port for port, spec in ports.items() if spec.unit == f"?{letter}"]
        return next((unit for port in alike if (unit := diagram.unit(".".join([*way, port])))), "")

    if ratio := RATIO_OF_UNITS.fullmatch(label):
        return units.quotient(of_letter(ratio[1]), of_letter(ratio[2]))
    shared = SHARED_UNIT.fullmatch(label)
    if shared is None:
        return ""
    unit = of_letter(shared[1])
    for sign, base, power in re.findall(r"([*/])(\w+)(?:\^(\d+))?", shared[2] if unit else ""):
        for _ in range(int(power or 1)):
            unit = units.times(unit, base, 1 if sign == "*" else -1)
    return unit
