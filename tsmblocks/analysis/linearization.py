"""Linear models of diagrams as python-control state spaces, and loops opened at a wire."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.discrete_time import sampled_model
from tsmblocks.analysis.operating_point import LocalEquations, Point, evaluated, local_equations, point_at
from tsmblocks.blocks import Encoder, Gain, Quantiser
from tsmblocks.common.arguments import as_integer, as_list, as_number
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.tables import unique_names
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.wires import Fault, Link, fault_sentence, parse_chain, resolve
from tsmblocks.simulation.arguments import as_diagram

CUT_INPUT, CUT_OUTPUT = "cut", "back"
"""Names of the input and the output of an opened loop."""
NO_DIRECT_EFFECT = 1e-12
"""Direct effect of an input's derivative on an output, as a share of the largest entry, that is rounding. Chosen."""


def linearize(
    diagram: Diagram,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    at: Point | None = None,
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
    at : Point, optional
        An operating point, from ``trim``. By default the initial states with inputs at zero.
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

    here, x = _equations_at("at", at, _without_rounding(as_diagram(diagram)), as_number("t", t))
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


def _equations_at(
    what: str, point: Point | None, diagram: Diagram, t: float = 0.0
) -> tuple[LocalEquations, np.ndarray]:
    """The equations at a point (the argument ``what``) and its states; by default the initial states, inputs zero."""
    if point is None:
        here = local_equations(diagram, {}, t, sampled=True)
        return here, here.x
    if not isinstance(point, Point):
        raise RunError(f"{what} must be a point that trim returned, got {in_words(point)}.")
    here = local_equations(diagram, point.inputs, point.t, sampled=True)
    missing = [k for k in here.eq.x if k not in point.states]
    if missing:
        raise RunError(f"the point is one of '{point.title}': it has no '{missing[0]}', as '{here.eq.title}' has.")
    return here, np.array([point.states[k] for k in here.eq.x])


def loop_gain(diagram: Diagram, at: str, *, point: Point | None = None, pade: int | None = None) -> Any:
    """The transfer of a loop opened at a wire, :math:`L`, for stability margins.

    The sign is that of negative feedback: the closed loop is :math:`1/(1 + L)`, and ``control.margin(L)`` gives its
    margins. At a kink the mean of both sides is taken: set to zero the parameters for which margins should not hold. A
    loop with sampled blocks is opened where it enters or leaves the slowest one; its transfer is in discrete time.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    at : str
        A wire (``"controller -> drive"``) or a signal (``"drive.y"``, all its wires).
    point : Point, optional
        An operating point of the closed loop. By default its initial states.
    pade : int, optional
        Order of the Padé approximations of transport delays; needed where there are any.

    Returns
    -------
    control.StateSpace
        From ``cut``, the signal on the wire, to ``back``, the returned signal with its sign changed; states that are
        not on this path are left out.

    Raises
    ------
    RunError
        For a wire that is in no loop, and as for ``linearize``.

    Examples
    --------
    >>> import control, tsmblocks as tsm
    >>> from tsmblocks.analysis import loop_gain
    >>> from tsmblocks.blocks import Gain, Integrator
    >>> parts = {"integrator": Integrator(), "gain": Gain(gain=-2.0)}
    >>> loop = tsm.Diagram(blocks=parts, wires=["integrator -> gain -> integrator"], outputs={"y": "integrator"})
    >>> L = loop_gain(loop, "gain -> integrator")
    >>> print(f"{control.margin(L)[1]:.1f} deg at {control.margin(L)[3]:.1f} rad/s")
    90.0 deg at 2.0 rad/s
    """
    diagram = as_diagram(diagram)
    cut, links = _without_rounding(opened(diagram, at)), _links(diagram, at)
    if not _is_loop(diagram, links):
        raise RunError(f"at='{at}': this wire is in no loop, so there is nothing to open.")
    outputs = {**diagram.outputs, CUT_OUTPUT: ".".join(links[0].source)}
    closed, x = _equations_at("point", point, _without_rounding(diagram).rewire(outputs=outputs))
    whole_point = point_at(closed, x, closed.u[closed.places])
    inputs = {**whole_point.inputs, CUT_INPUT: whole_point.signals[CUT_OUTPUT]}
    if closed.eq.periods:
        _check_closure(local_equations(cut, inputs, whole_point.t, sampled=True), closed, x, at)
    there = attrs.evolve(whole_point, inputs=inputs)
    return _loop_transfer(linearize(cut, inputs=[CUT_INPUT], outputs=[CUT_OUTPUT], at=there, pade=pade))


def _check_closure(cut: LocalEquations, closed: LocalEquations, x: np.ndarray, at: str) -> None:
    """Raise RunError where the loop, closed over a signal held between samples, differs from the diagram's."""
    model = sampled_model(cut, x, [CUT_INPUT], [CUT_OUTPUT])
    if not model.closes_to(sampled_model(closed, x, [], [])):
        raise RunError(
            f"at='{at}': the signal on this wire matters, and changes, between the instants at which all "
            f"samples of '{closed.eq.title}' coincide ({model.dt:g} s apart). Open the loop where it "
            "enters or leaves the slowest sampled block."
        )


def _without_rounding(diagram: Diagram) -> Diagram:
    """The diagram with encoders and quantisers replaced by a gain of 1, their mean effect."""
    for name, block in diagram.blocks.items():
        if isinstance(block, (Encoder, Quantiser)):
            diagram = diagram.replace(name, Gain(unit=block.outports["y"].unit.removeprefix("?u")))
        elif isinstance(block, Diagram) and (inner := _without_rounding(block)) is not block:
            diagram = diagram.replace(name, inner)
    return diagram


def _loop_transfer(system: Any) -> Any:
    """The returned signal with its sign changed, without uncontrollable or unobservable states."""
    import control

    A, B, C = (np.asarray(part) != 0 for part in (system.A, system.B, system.C))
    reached, seen = B.any(axis=1), C.any(axis=0)
    for _ in range(len(A)):
        reached, seen = reached | (A & reached[None, :]).any(axis=1), seen | (A & seen[:, None]).any(axis=0)
    kept = np.flatnonzero(reached & seen)
    states = [system.state_labels[k] for k in kept] or None
    C, D = 0.0 - system.C[:, kept], 0.0 - system.D  # avoids -0.0 in prints
    model = control.ss(system.A[np.ix_(kept, kept)], system.B[kept], C, D, system.dt, states=states)
    return control.ss(model, inputs=system.input_labels, outputs=system.output_labels)


def opened(diagram: Diagram, at: str) -> Diagram:
    """The diagram with a loop cut at a wire.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    at : str
        A wire or a signal, as for ``loop_gain``.

    Returns
    -------
    Diagram
        The signal on the wire is its output ``back``, and the former targets of the wire get its input ``cut``.

    Raises
    ------
    RunError
        Where there is no such wire, or an input ``cut`` or an output ``back`` already.
    """
    diagram = as_diagram(diagram)
    links = _links(diagram, at)
    source = ".".join(links[0].source)
    for what, name, known in (("input", CUT_INPUT, diagram.inputs), ("output", CUT_OUTPUT, diagram.outputs)):
        if name in known:
            raise RunError(f"'{diagram.title}' has an {what} '{name}' already.")
    ports = [".".join(link.target) for link in links]
    return diagram.rewire(
        cut=[f"{source} -> {port}" for port in ports],
        inputs={**diagram.inputs, CUT_INPUT: Inlet(ports, diagram.unit(source))},
        outputs={**diagram.outputs, CUT_OUTPUT: source},
    )


def _is_loop(diagram: Diagram, links: list[Link]) -> bool:
    """Whether a path along the wires leads from the targets of these back to their source."""
    reached, fresh = set[str](), {link.target[0] for link in links}
    while fresh:
        reached |= fresh
        fresh = {link.target[0] for link in diagram.links if link.source[0] in fresh} - reached
    return links[0].source[0] in reached


def _links(diagram: Diagram, at: str) -> list[Link]:
    """The wires that a text means: one, or all from a signal."""
    if not isinstance(at, str):
        raise RunError(f"at is a wire such as 'controller -> drive', or a signal, got {in_words(at)}.")
    if "->" in at:
        links, faults = parse_chain(at, diagram.blocks)
        missing = [str(link) for link in links if link not in diagram.links]
        if missing:
            raise RunError(f"at='{at}': there is no wire '{missing[0]}'.{near(missing[0], map(str, diagram.links))}")
        if faults or len({link.source for link in links}) != 1:
            raise RunError(f"at='{at}': {faults[0] if faults else 'one wire is wanted.'}")
        return [link for link in diagram.links if link in links]
    try:
        source = resolve(at, diagram.blocks, "output")
    except Fault as fault:
        raise RunError(fault_sentence(f"at='{at}'", fault)) from None
    links = [link for link in diagram.links if link.source == source]
    if not links:
        raise RunError(f"at='{at}': no wire begins there, so there is nothing to open.")
    return links


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
