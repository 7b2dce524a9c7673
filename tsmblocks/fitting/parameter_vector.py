"""The unknowns of a fit as one vector; the parameters of each experiment, ties and constraints as functions of it."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.fitting.constraints import Constraint, Ties


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
