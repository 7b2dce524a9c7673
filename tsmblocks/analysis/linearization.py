"""Linear models of diagrams as python-control state spaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.discrete_time import sampled_model
from tsmblocks.analysis.operating_point import LocalEquations, Point, evaluated, local_equations
from tsmblocks.analysis.steady import switched_as_they_are, without_rounding
from tsmblocks.common.arguments import as_integer, as_list, as_number
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.tables import unique_names
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.run import Run

NO_DIRECT_EFFECT = 1e-12
"""Direct effect of an input's derivative on an output, as a share of the largest entry, that is rounding. Chosen."""


def linearize(
    diagram: Diagram,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    at: Point | Run | None = None,
    t: float = 0.0,
    pade: int | None = None,
) -> Any:
    r"""A linear model around a point, with the names of states, inputs and outputs kept.

    .. math:: \dot x = A x + B u, \qquad y = C x + D u

    in deviations from the point. Derivatives are exact; at a kink (friction, hysteresis, a limit) they are the mean of
    both sides. An Encoder and a Quantiser, whose derivative is zero between their jumps, count as a gain of 1. With
    sampled blocks the model is in discrete time, exact over the period ``dt`` after which all samples coincide; inputs
    are held over it, and states are those just before a sample.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    inputs : list of str, optional
        Inputs of the diagram. By default all of them.
    outputs : list of str, optional
        Signals of the diagram. By default its outputs.
    at : Point or Run, optional
        An operating point, from ``trim``, or a run, whose last instant it is. By default the initial states with inputs
        at zero.
    t : float, default 0.0
        Time in s, where ``at`` is not given.
    pade : int, optional
        Order of the Padé approximations of transport delays; needed where there are any.

    Returns
    -------
    control.StateSpace
        The model; a dot in a name becomes an underscore (``tsm_zeta``).

    Raises
    ------
    RunError
        For memory from step to step (a backlash), for delays without ``pade`` or beside sampled blocks, for outputs
        that depend directly on the derivative of an input, and for unknown names.
    DataError
        For inputs of the point that are not suitable.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> model = tsm.linearize(tsm.load("motor_linear"))
    >>> model.state_labels, model.poles().real.round(3).tolist()
    (['motor_angle', 'motor_speed'], [0.0, -50.0])
    """
    import control

    here, x = equations_at("at", at, without_rounding(as_diagram(diagram)), as_number("t", t))
    eq = here.eq
    if not here.inputs:
        remedy = "add one, or open a loop (analysis.opened, analysis.loop_gain)"
        raise RunError(f"diagram '{eq.title}' has no input for a linear model: {remedy}.")
    names = _chosen(eq, "input", inputs, here.inputs, here.inputs)
    shown = _chosen(eq, "signal", outputs, eq.aliases, [*eq.aliases, *eq.y])
    if eq.periods:
        model = sampled_model(here, x, names, shown).without_idle()
        system, states = control.ss(model.A, model.B, model.C, model.D, model.dt), model.states
    else:
        system = control.ss(*_proper(here, x, names, shown))
        if eq.q:
            system = system.lft(_pade_delays(here, pade), len(eq.q), len(eq.q))
        states = [*eq.x, *(f"pade_{k}" for k in range(system.nstates - len(eq.x)))]
    return control.ss(system, states=_labels(states), inputs=_labels(names), outputs=_labels(shown))


def equations_at(
    what: str, point: Point | Run | None, diagram: Diagram, t: float = 0.0
) -> tuple[LocalEquations, np.ndarray]:
    """The equations at a point (the argument ``what``) and its states; by default the initial states, inputs zero."""
    if point is None:
        here = local_equations(diagram, {}, t, sampled=True)
        return here, here.x
    if isinstance(point, Run):
        point = end_of_run(point, diagram)
    if not isinstance(point, Point):
        raise RunError(f"{what} must be a point that trim returned, or a run, got {in_words(point)}.")
    if point.parameters:
        diagram = diagram.with_parameters(point.parameters)
    diagram = switched_as_they_are(diagram, point.memory)
    here = local_equations(diagram, point.inputs, point.t, sampled=True)
    missing = [k for k in here.eq.x if k not in point.states]
    if missing:
        raise RunError(f"the point is one of '{point.title}': it has no '{missing[0]}', as '{here.eq.title}' has.")
    d = np.array([point.memory.get(name, own) for name, own in zip(here.eq.d, here.d, strict=True)])
    return attrs.evolve(here, d=d), np.array([point.states[k] for k in here.eq.x])


def end_of_run(run: Run, diagram: Diagram) -> Point:
    """The last instant of a run as a point. Raises RunError where the run does not know it."""
    if run.state is None or run.state.diverged_at is not None:
        raise RunError(f"the run of '{run.title}' has no last instant at which it could be linearised.")
    missing = [name for name in diagram.inputs if name not in run]
    if missing:
        raise RunError(f"the run of '{run.title}' did not keep its input '{missing[0]}'. Run it with log='all'.")
    memory, names = run.state.memory, run.state.names
    states, rest = names[: len(memory.x)], names[len(memory.x) :]
    return Point(
        run.title,
        run.state.t,
        dict(zip(states, memory.x.tolist(), strict=True)),
        {name: float(run[name][-1]) for name in diagram.inputs},
        {},
        {},
        run.units,
        dict(zip(rest, memory.d.tolist(), strict=False)),
    )


def _chosen(
    eq: Equations, what: str, given: Sequence[str] | None, usual: Iterable[str], known: Iterable[str]
) -> list[str]:
    """The signals or inputs that are given, by default the usual ones. Raises RunError for an unknown name."""
    chosen = list(usual) if given is None else as_list(given)
    for name in chosen:
        if name not in known:
            raise RunError(f"diagram '{eq.title}' has no {what} '{name}'.{near(name, known)}")
    if not chosen:
        argument = "inputs" if what == "input" else "outputs"
        raise RunError(f"no {what} of diagram '{eq.title}' is chosen: give {argument}=[…].{near('', known)}")
    return chosen


def _jacobians(here: LocalEquations, x: np.ndarray, shown: Sequence[str]) -> list[np.ndarray]:
    """Jacobians of rates, then signals, then what is delayed, by states, sampled inputs and delay outputs."""
    eq = here.eq
    jacobian, delayed = _jacobian_functions(eq, tuple(eq.aliases.get(name, name) for name in shown))
    w = np.zeros(len(eq.q))
    for _ in range(len(eq.q)):
        w = np.asarray(delayed(x, here.u, w, here.t, here.p)).ravel()
    J = np.asarray(jacobian(x, here.u, w, here.t, here.p), dtype=float)
    *parts, by_moves = np.split(J, np.cumsum([len(eq.x), len(eq.u), len(eq.q)]), axis=1)
    if np.abs(by_moves).max(initial=0.0) > 1e-9:
        raise RunError(
            f"'{eq.title}' depends on the derivative of a delayed signal, which no state space holds. Put a lag "
            "behind the delay."
        )
    rows = [*(f"the rate of {name}" for name in eq.x), *shown, *(f"what {name} delays" for name in eq.q)]
    bad = [rows[k] for k in np.flatnonzero(~np.isfinite(J).all(axis=1))]
    if bad:
        raise RunError(f"the derivatives of '{eq.title}' are not finite here: {', '.join(bad[:3])}.")
    return parts


@lru_cache(maxsize=64)
def _jacobian_functions(eq: Equations, signals: tuple[str, ...]) -> tuple[Any, Any]:
    """The Jacobian, and what is delayed, as functions of (x, u, w, t, p): cached, since making them takes longest.

    The last columns of the Jacobian are those by the time derivatives of the delay outputs.
    """
    x, u, w = ca.SX.sym("x", len(eq.x)), ca.SX.sym("u", len(eq.u)), ca.SX.sym("w", len(eq.q))
    t, p, moves = ca.SX.sym("t"), ca.SX.sym("p", len(eq.p)), ca.SX.sym("moves", len(eq.q))
    dx, y, s = evaluated(eq, t, x, ca.SX(0, 1), u, p, w, moves)
    J = ca.jacobian(ca.vertcat(dx, *(y[eq.y.index(name)] for name in signals), s), ca.vertcat(x, u, w, moves))
    J, s = (ca.densify(ca.substitute(one, moves, ca.DM.zeros(len(eq.q)))) for one in (J, s))
    given = [x, u, w, t, p]
    return ca.Function("jacobian", given, [J]), ca.Function("delayed", given, [s])


def _proper(
    here: LocalEquations, x: np.ndarray, names: Sequence[str], shown: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    r"""State space with inputs ``names``, then delayed signals; outputs the signals, then what is delayed.

    Where a rate depends on the derivative of an input, :math:`x' = A x + B u + E u'`, the state :math:`x - E u` is
    used.
    """
    eq, n = here.eq, len(x)
    by_x, by_u, by_w = _jacobians(here, x, shown)
    place = {(u.name.removeprefix("d/dt " * u.order), u.order): k for k, u in enumerate(eq.u) if not u.block}
    own = [place[name, 0] for name in names]
    A, C, direct = by_x[:n], by_x[n:], by_u[n:]
    B, D = np.split(np.hstack([by_u[:, own], by_w]), [n])
    none = NO_DIRECT_EFFECT * max(1.0, float(np.abs(direct).max(initial=0.0)))
    for k, name in enumerate(names):
        column = place.get((name, 1))
        if column is None:
            continue
        if np.abs(direct[:, column]).max(initial=0.0) > none or (name, 2) in place:
            raise RunError(
                f"a signal of '{eq.title}' depends on the derivative of its input '{name}' at once, so there is no "
                "state space from there. Put a lag on the input, or choose other outputs."
            )
        E = by_u[:n, column]
        B[:, k] += A @ E
        D[:, k] += C @ E
    return A, B, C, D


def _pade_delays(here: LocalEquations, order: int | None) -> Any:
    """The delays as Padé approximations, side by side."""
    import control

    lags = np.asarray(here.eq.lag(here.p), dtype=float).ravel()
    if order is None:
        listed = ", ".join(f"{v:g} s" for v in lags)
        raise RunError(
            f"'{here.eq.title}' has dead times ({listed}), which no state space holds. "
            "Give pade=3 for an approximation of third order."
        )
    order = as_integer("pade", order, 1)
    return control.append(*(control.ss(control.tf(*control.pade(lag, order))) for lag in lags))


def _labels(names: Sequence[str]) -> list[str]:
    """Names as python-control takes them: without dots, all different."""
    return unique_names(name.replace(".", "_") for name in names)
