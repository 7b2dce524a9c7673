"""Operating points: equilibria of a diagram, searched or given."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.root_search import found_root
from tsmblocks.analysis.steady import switched_as_they_are
from tsmblocks.common.arguments import as_list, as_number
from tsmblocks.common.errors import DataError, RunError, in_words, near
from tsmblocks.common.tables import columns, few
from tsmblocks.engine.equations import DELAY_SAMPLES, Equations, function_values
from tsmblocks.engine.session import gather_signals
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram, as_inputs
from tsmblocks.simulation.compiled import equations, parameter_vector

REST_INSTANTS = 1e6
"""Instants of the past of a delayed signal that has been constant. Chosen: longer than any delay reads."""
HELD_SUFFIX = " (held)"
"""End of the name of an output that is held between samples, as the compiler writes it."""
SOURCE_SPAN = 1e-3
"""Time [s] over which sources are evaluated; only the first instant is used."""


@attrs.frozen(eq=False)
class Point:
    """A diagram at one instant; ``point["motor.angle"]`` is a state, input or signal.

    ``simulate(diagram, initial=point.states)`` starts a run there.

    Parameters
    ----------
    title : str
        Title of the diagram.
    t : float
        Time in s.
    states, inputs, signals : dict of str to float
        States, inputs of the diagram, and all signals, outputs of the diagram included, by name.
    rates : dict of str to float
        Time derivatives of the states, per s.
    units : dict of str to str, optional
        Unit labels of signals.
    memory : dict of str to float, optional
        Memory of sampled blocks and their held outputs, by name; the others are as at the start.
    parameters : dict of str to float, optional
        Parameters that ``trim`` was free to choose.
    """

    title: str
    t: float
    states: Mapping[str, float]
    inputs: Mapping[str, float]
    signals: Mapping[str, float] = attrs.field(repr=False)
    rates: Mapping[str, float] = attrs.field(repr=False)
    units: Mapping[str, str] = attrs.field(factory=dict, repr=False)
    memory: Mapping[str, float] = attrs.field(factory=dict, repr=False)
    parameters: Mapping[str, float] = attrs.field(factory=dict, repr=False)

    def __getitem__(self, name: str) -> float:
        """A state, input or signal by name. Raises RunError with the near miss."""
        sides = (self.signals, self.states, self.inputs, self.parameters)
        for side in sides:
            if name in side:
                return side[name]
        raise RunError(f"the point has no '{name}'.{near(name, [known for side in sides for known in side])}")

    def __iter__(self) -> Iterator[str]:
        return iter([*self.states, *self.inputs])

    def __str__(self) -> str:
        def listed(side: Mapping[str, float]) -> list[tuple[str, str, str]]:
            return [(k, f"{v:.6g}", self.units.get(k, "")) for k, v in side.items()]

        rows = [("state", "value", "unit"), *listed(self.states), ("input", "", ""), *listed(self.inputs)]
        rows += [("parameter", "", ""), *listed(self.parameters)] if self.parameters else []
        return f"{self.title} at t = {self.t:g} s\n{columns(rows, left=(0, 2))}"


@attrs.frozen(eq=False)
class LocalEquations:
    """The equations of a diagram at the instant ``t``, where all sources are as they are then.

    ``u`` are the sampled inputs, of which ``inputs`` names the diagram's own; their time derivatives are zero.
    """

    eq: Equations
    t: float
    p: np.ndarray
    u: np.ndarray
    x: np.ndarray
    inputs: tuple[str, ...]
    d: np.ndarray
    """Memory and held outputs after the first samples; empty in continuous time."""

    @property
    def places(self) -> list[int]:
        """Positions of the diagram's inputs among the sampled inputs of the equations."""
        names = [feed.name if not feed.block and not feed.order else "" for feed in self.eq.u]
        return [names.index(name) for name in self.inputs]


def evaluated(eq: Equations, t: Any, x: Any, d: Any, u: Any, p: Any, w: Any, moves: Any) -> list[Any]:
    """``(dx, y, s)`` of the equations with delay outputs ``w`` and their time derivatives ``moves``.

    The past of a delayed signal is its values at four instants around the one that is read.
    """
    lags = eq.lag.call([p])[0]
    away = [float(i) - 0.5 * (DELAY_SAMPLES - 1) for i in range(DELAY_SAMPLES)]
    past = []
    for k in range(len(eq.q)):
        past += [*(w[k] + moves[k] * a for a in away), t - lags[k] + away[-1], 1.0, REST_INSTANTS]
    values: list[Any] = eq.rhs.call([t, x, d, u, ca.SX(ca.vertcat(*past)), p])
    return values


def _without(name: str) -> str:
    outer, _, inner = name.rpartition(".")
    return f"diagram.remove('{name}')" if not outer else f"diagram.replace('{outer}', …) by one without '{inner}'"


def with_held_outputs(
    eq: Equations, t: float, x: np.ndarray, d: np.ndarray, u: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Memory ``d`` with the held outputs of sampled blocks updated by a sample."""
    if not eq.periods or eq.q:
        return d
    fresh = np.asarray(eq.update(t, x, d, u, ca.DM(0, 1), p, np.ones(len(eq.periods)))[0], dtype=float).ravel()
    return np.where([name.endswith(HELD_SUFFIX) for name in eq.d], fresh, d)


def local_equations(
    diagram: Diagram, inputs: Mapping[str, float], t: float, *, sampled: bool = False
) -> LocalEquations:
    """The equations at an instant. Raises RunError for blocks that act at their own instants.

    With ``sampled``, sampled blocks are accepted, but not memory from step to step.
    """
    diagram = switched_as_they_are(diagram)
    eq = equations(diagram)
    if (eq.periods or eq.d) and not (sampled and eq.periods and not eq.every_step):
        owners = list(dict.fromkeys(name.rpartition(".")[0] for name in eq.d))
        names = [name for name in owners if name not in eq.sampled] if sampled else [*eq.sampled] or owners
        act, their, them = ("acts", "its", "it") if len(names) == 1 else ("act", "their", "them")
        lack = "there is no linear model in continuous time" if sampled else "its rates do not determine an equilibrium"
        where = f"{', '.join(names[:4])} of '{diagram.title}' {act} at {their} own instants"
        raise RunError(
            f"{where} (samples, or memory from step to step, as a backlash has it), so {lack}. "
            f"Replace or remove {them} first: {_without(names[0])}."
        )
    p = parameter_vector(eq, diagram)
    wanted = tuple(feed.name for feed in eq.u if not feed.block and not feed.order)
    signals = gather_signals(eq, {**dict.fromkeys(wanted, 0.0), **inputs}, np.array([t, t + SOURCE_SPAN]), "zero")
    u = np.array(
        [
            0.0 if not feed.block and feed.order else signal.at(np.array([t]), order)[0]
            for feed, (signal, order) in zip(eq.u, signals, strict=True)
        ]
    )
    x, d = function_values(eq.start, p)[:2]
    return LocalEquations(eq, t, p, u, x, wanted, with_held_outputs(eq, t, x, d, u, p))


def point_at(here: LocalEquations, x: np.ndarray, u: np.ndarray) -> Point:
    """A point from the values of states and inputs."""
    dx, y = (np.asarray(ca.DM(part), dtype=float).ravel() for part in _at_rest(here, x, u, here.p))
    eq = here.eq
    signals = dict(zip(eq.y, y.tolist(), strict=True))
    signals |= {name: signals[signal] for name, signal in eq.aliases.items()}
    return Point(
        eq.title,
        here.t,
        dict(zip(eq.x, x.tolist(), strict=True)),
        dict(zip(here.inputs, u.tolist(), strict=True)),
        signals,
        dict(zip(eq.x, dx.tolist(), strict=True)),
        eq.units,
    )


def _at_rest(here: LocalEquations, x: Any, u: Any, p: Any) -> list[Any]:
    """``(dx, y)`` with these inputs of the diagram and parameters, the outputs of delays being their inputs."""
    eq = here.eq
    sampled = [ca.SX(float(v)) for v in here.u]
    for k, place in enumerate(here.places):
        sampled[place] = u[k]
    w, still = ca.SX.sym("w", len(eq.q)), ca.SX.zeros(len(eq.q))
    given = (here.t, x, ca.SX(ca.DM(here.d)), ca.SX(ca.vertcat(*sampled)), p)
    dx, y, s = evaluated(eq, *given, w, still)
    if not eq.q:
        return [dx, y]
    for _ in range(len(eq.q).bit_length()):  # a delayed signal may be made of others: each pass doubles their number
        s = ca.substitute(s, w, s)
    if ca.depends_on(s, w):
        raise RunError(f"'{eq.title}' has a loop that consists only of delays, whose equilibrium is not determined.")
    return evaluated(eq, *given, s, still)[:2]


def trim(
    diagram: Diagram,
    *,
    inputs: Mapping[str, float] | None = None,
    outputs: Mapping[str, float] | None = None,
    at: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    start: Mapping[str, float] | None = None,
    t: float = 0.0,
) -> Point:
    """Find an equilibrium: a point at which no state changes and outputs have given values.

    Where there are many (hysteresis at rest, an integrator before a motor at rest) it is the one nearest to the start.
    Where the search from the start fails, as where a controller is at its limit, it begins again nearer to zero and in
    places further away.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    inputs : dict of str to float, optional
        Inputs that are held at a value, in their unit; the others are determined by ``outputs``, zero without them.
    outputs : dict of str to float, optional
        Signals and the values they should have, in their unit.
    at : dict of str to float, optional
        States that are held at a value, in their unit.
    free : list of str, optional
        Parameters that may be chosen so that there is an equilibrium; ``point.parameters`` has their values.
    start : dict of str to float, optional
        States, free inputs and free parameters at which the search starts. By default the initial states, zero, and the
        diagram's own parameters.
    t : float, default 0.0
        Time in s at which sources are evaluated.

    Returns
    -------
    Point
        The operating point.

    Raises
    ------
    RunError
        Where there is no equilibrium (the message names the state that still changes), for blocks that act at their own
        instants, and for unknown names.
    DataError
        For a value that is no finite number.
    ParameterError
        Where a free parameter would have to leave its bounds.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> from tsmblocks.blocks import FirstOrderLag
    >>> lag = tsm.Diagram(
    ...     blocks={"lag": FirstOrderLag(time_constant=0.1)}, wires=[], inputs={"u": "lag.u"}, outputs={"y": "lag.y"}
    ... )
    >>> point = tsm.trim(lag, outputs={"y": 2.0})
    >>> round(point["u"], 9)
    2.0
    """
    diagram, given = as_diagram(diagram), as_inputs(inputs)
    for name, values in (("outputs", outputs), ("at", at), ("start", start)):
        if values is not None and not isinstance(values, Mapping):
            raise RunError(f"{name} must map names to numbers, got {in_words(values)}.")
    wanted = dict(outputs or {})
    here = local_equations(
        diagram, {k: as_number(f"input '{k}'", v, DataError) for k, v in given.items()}, as_number("t", t)
    )
    inputs_free = [name for name in here.inputs if name not in given] if wanted or at else []
    unknowns = _unknowns(here, at or {}, inputs_free, as_list(free))
    conditions, names = _conditions(here, wanted, unknowns)
    search = found_root(conditions, unknowns.guess(start or {}), len(names))
    if not search.found:
        off = f"{names[search.worst]} is {search.error:.3g} off"
        advice = "No input is free to reach it: leave one out of inputs, or free a parameter (free=[…])."
        if inputs_free or free or not (wanted or at):
            advice = _where_to_start([name for name, k in zip(unknowns.values, search.idle, strict=True) if k])
        raise RunError(f"'{diagram.title}' has no equilibrium here: {off}. {advice}")
    _, _, x, u, p = (np.asarray(part, dtype=float) for part in conditions(search.z))
    chosen = {name: p.item(here.eq.p.index(name)) for name in unknowns.parameters}
    diagram.with_parameters(chosen)  # refuses what is out of bounds
    found = point_at(attrs.evolve(here, p=p.ravel()), x.ravel(), u.ravel())
    return attrs.evolve(found, parameters=chosen)


def _where_to_start(idle: list[str]) -> str:
    """Advice where a search fails and some unknowns have no effect at its start."""
    if not idle:
        return "Start elsewhere (start={…}), or choose an instant when no source drives it (t=…)."
    has, it = ("has", "it") if len(idle) == 1 else ("have", "they")
    return (
        f"At the start {few(idle)} {has} no effect, as behind a block at its limit: start where {it} {has} "
        f"(start={{'{idle[0]}': …}}), or choose an instant when no source drives it (t=…)."
    )


@attrs.frozen
class _Unknowns:
    """The unknowns of a search: states, inputs and parameters by name, with their own values; ``held`` states not."""

    eq: Equations
    held: Mapping[str, float]
    states: Mapping[str, float]
    inputs: Mapping[str, float]
    parameters: Mapping[str, float]

    @property
    def values(self) -> dict[str, float]:
        """The values of all of them."""
        return {**self.states, **self.inputs, **self.parameters}

    def guess(self, start: Mapping[str, float]) -> np.ndarray:
        """Where the search starts. Raises RunError for an unknown name."""
        known = self.values
        for name, value in start.items():
            as_number(f"start: '{name}'", value, DataError)
            if name not in known:
                raise RunError(f"start: there is no state or free input '{name}'.{near(name, known)}")
        return np.array([float(start.get(name, v)) for name, v in known.items()])


def _unknowns(
    here: LocalEquations, held: Mapping[str, float], inputs: Sequence[str], parameters: Sequence[str]
) -> _Unknowns:
    """The unknowns of a search. Raises RunError for an unknown state or parameter."""
    eq = here.eq
    for name in held:
        if name not in eq.x:
            raise RunError(f"at: '{eq.title}' has no state '{name}'.{near(name, eq.x)}")
    for name in parameters:
        if name in eq.x:
            raise RunError(f"free: '{name}' is a state, which is determined anyway; only parameters can be freed.")
        if name not in eq.p:
            raise RunError(f"free: '{eq.title}' has no parameter '{name}'.{near(name, eq.p)}")
    values = {name: as_number(f"at: '{name}'", value, DataError) for name, value in held.items()}
    own = {name: float(v) for name, v in zip(eq.x, here.x, strict=True) if name not in held}
    given = {name: float(here.p[eq.p.index(name)]) for name in parameters}
    return _Unknowns(eq, values, own, dict.fromkeys(inputs, 0.0), given)


def _conditions(here: LocalEquations, wanted: Mapping[str, float], unknowns: _Unknowns) -> tuple[Any, list[str]]:
    """Residuals, their Jacobian, all states, inputs and parameters as a function of the unknowns; residuals' names."""
    eq, known = here.eq, list(unknowns.values)
    z = ca.SX.sym("z", len(known))

    def of(names: Sequence[str], free: Mapping[str, float], fixed: Sequence[float]) -> Any:
        values = zip(names, fixed, strict=True)
        return ca.vertcat(
            ca.SX(0, 1), *(z[known.index(name)] if name in free else ca.SX(float(v)) for name, v in values)
        )

    x = of(eq.x, unknowns.states, [unknowns.held.get(name, 0.0) for name in eq.x])
    u = of(here.inputs, unknowns.inputs, [here.u[place] for place in here.places])
    p = of(eq.p, unknowns.parameters, here.p.tolist())
    dx, y = _at_rest(here, x, [u[k] for k in range(len(here.inputs))], p)
    rows, names = [dx], [f"the rate of {name}" for name in eq.x]
    for name, value in wanted.items():
        signal = eq.aliases.get(name, name)
        if signal not in eq.y:
            raise RunError(f"diagram '{eq.title}' has no signal '{name}'.{near(name, [*eq.aliases, *eq.y])}")
        rows.append(y[eq.y.index(signal)] - as_number(f"output '{name}'", value, DataError))
        names.append(name)
    residual = ca.vertcat(*rows)
    return ca.Function("conditions", [z], [residual, ca.jacobian(residual, z), x, u, p]), names
