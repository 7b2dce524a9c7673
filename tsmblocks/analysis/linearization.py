"""Linear models of diagrams, as python-control state spaces with names kept; loops opened where one says."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.discrete_time import model
from tsmblocks.analysis.operating_point import Point, Still, called, point_of, still
from tsmblocks.blocks import Encoder, Gain, Quantiser
from tsmblocks.common.arguments import as_integer, as_number
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.tables import unlike
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.wires import Fault, Link, parse, resolve, sentence
from tsmblocks.simulation.arguments import as_diagram

CUT, BACK = "cut", "back"
"""Names of the input and of the output of an opened loop."""
IMPROPER = 1e-12
"""Direct effect of an input's slope on an output, as a share of the largest number, that counts as none."""


def linearize(
    diagram: Diagram,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    at: Point | None = None,
    t: float = 0.0,
    pade: int | None = None,
) -> Any:
    r"""A linear model around a point: a ``control.StateSpace`` with the names of states, inputs and outputs.

    (``tsm.zeta`` becomes ``tsm_zeta``: there are no dots in names of python-control.)

    .. math:: \dot x = A x + B u, \qquad y = C x + D u

    in deviations from the point ``at`` (of ``trim``); without one, from the start values with inputs at zero, at time
    ``t`` [s]. ``inputs`` are inputs of the diagram (all of them), ``outputs`` any of its signals (all its outputs).
    Exact derivatives; at a kink (friction, hysteresis, a limit reached) the mean of both sides. An Encoder and a
    Quantiser, whose slope is 0 between their jumps, count as a gain of 1. Dead times become
    Padé approximations of order ``pade``.

    With sampled blocks it is a model in discrete time, exact from one instant at which all of them act to the next,
    ``dt`` being the time between; inputs are held over it, and ``states`` are those before the samples act.

    Raises RunError for blocks that remember from step to step (a backlash), for dead times without ``pade`` or beside
    samples, and for outputs that follow the slope of an input at once.
    """
    import control

    diagram = _unrounded(as_diagram(diagram))
    if at is not None and not isinstance(at, Point):
        raise RunError(f"at is a point that trim has found, got {in_words(at)}.")
    here = still(
        diagram, at.inputs if at is not None else {}, at.t if at is not None else as_number("t", t), sampled=True
    )
    if not here.inputs:
        raise RunError(
            f"diagram '{here.eq.title}' has no input for a linear model to begin at: give it one, or open "
            "a loop (analysis.opened, analysis.loop_gain)."
        )
    names = _chosen(here, inputs, list(here.inputs), "input")
    shown = _chosen(here, outputs, [*here.eq.aliases, *here.eq.y], "signal", list(here.eq.aliases))
    x = here.x
    if at is not None:
        missing = [k for k in here.eq.x if k not in at.states]
        if missing:
            raise RunError(f"the point is one of '{at.title}': it has no '{missing[0]}', as '{here.eq.title}' has.")
        x = np.array([at.states[k] for k in here.eq.x])
    if here.eq.periods:
        made = model(here, x, names, shown).without_idle()
        return control.ss(
            made.A,
            made.B,
            made.C,
            made.D,
            made.dt,
            states=_labels(made.states),
            inputs=_labels(names),
            outputs=_labels(shown),
        )
    J = _jacobians(here, x, shown)
    system = _proper(here, J, names)
    if here.eq.q:
        system = _with_delays(here, system, pade)
    return control.ss(*system, states=_states(here, system[0]), inputs=_labels(names), outputs=_labels(shown))


def loop_gain(diagram: Diagram, at: str, *, point: Point | None = None, pade: int | None = None) -> Any:
    r"""The gain around a loop opened at a wire, :math:`L`, for margins: a ``control.StateSpace`` with one input.

    ``at`` is a wire (``"controller -> drive"``) or a signal (``"drive.y"``, all its wires). The sign is that of
    negative feedback: the closed loop is :math:`1/(1 + L)`, and ``control.margin(L)`` gives its margins. Its input
    ``cut`` is what goes over the wire, its output ``back`` what comes back, the sign turned; states that are not on
    that way are left out. ``point`` is one of the closed loop (by default its start values); at a kink there (friction
    at rest, an edge of a limit) the mean of both sides is taken: set to zero what the margins are not to hold for.
    A loop with sampled blocks is opened where it enters or leaves the slowest one, and has a gain in discrete time.
    Raises RunError where no loop goes that way; other arguments and errors as for ``linearize``.
    """
    diagram = as_diagram(diagram)
    cut = _unrounded(opened(diagram, at))
    if not _comes_back(diagram, at):
        raise RunError(f"at='{at}': nothing that goes this way comes back, so there is no loop to open.")
    closed = _unrounded(diagram).rewire(outputs={**diagram.outputs, BACK: _source(diagram, at)})
    there = still(
        closed, point.inputs if point is not None else {}, point.t if point is not None else 0.0, sampled=True
    )
    x = np.array([point.states[k] for k in there.eq.x]) if point is not None else there.x
    whole_point = point_of(there, x, np.array([there.u[k] for k in there.places]))
    inputs = {**whole_point.inputs, CUT: whole_point.signals[BACK]}
    point = attrs.evolve(whole_point, inputs=inputs)
    if there.eq.periods:
        _must_close(still(cut, inputs, point.t, sampled=True), there, x, at)
    return _around(linearize(cut, inputs=[CUT], outputs=[BACK], at=point, pade=pade))


def _must_close(cut: Still, closed: Still, x: np.ndarray, at: str) -> None:
    """Raise RunError where samples make more of a loop than its cut, held from instant to instant, tells."""
    made = model(cut, x, [CUT], [BACK])
    if not made.closes_to(model(closed, x, [], [])):
        raise RunError(
            f"at='{at}': what goes over this wire counts, and changes, between the instants at which all "
            f"samples of '{closed.eq.title}' fall together ({made.dt:g} s apart). Open the loop where it "
            "enters or leaves the slowest sampled block."
        )


def _unrounded(diagram: Diagram) -> Diagram:
    """The diagram with a gain of 1, what rounding does in the mean, in the place of encoders and quantisers."""
    for name, block in diagram.blocks.items():
        if isinstance(block, (Encoder, Quantiser)):
            diagram = diagram.replace(name, Gain(unit=block.outports["y"].unit.removeprefix("?u")))
        elif isinstance(block, Diagram) and (inner := _unrounded(block)) is not block:
            diagram = diagram.replace(name, inner)
    return diagram


def _around(system: Any) -> Any:
    """What comes back, its sign turned, without states that inputs do not reach or outputs do not see."""
    import control

    A, B, C = (np.asarray(part) != 0 for part in (system.A, system.B, system.C))
    reached, seen = B.any(axis=1), C.any(axis=0)
    for _ in range(len(A)):
        reached, seen = reached | (A & reached[None, :]).any(axis=1), seen | (A & seen[:, None]).any(axis=0)
    kept = np.flatnonzero(reached & seen)
    labels = [system.state_labels[k] for k in kept]
    turned = (0.0 - np.asarray(part) for part in (system.C[:, kept], system.D))  # no -0.0, which would be printed
    return control.ss(
        system.A[np.ix_(kept, kept)],
        system.B[kept],
        *turned,
        system.dt,
        states=labels or None,
        inputs=system.input_labels,
        outputs=system.output_labels,
    )


def opened(diagram: Diagram, at: str) -> Diagram:
    """The diagram with a loop cut: what went over the wire is the output ``back``; what listened hears input ``cut``.

    ``at`` as for ``loop_gain``. Raises RunError where there is no such wire.
    """
    diagram = as_diagram(diagram)
    links = _links(diagram, at)
    source = ".".join(links[0].source)
    for name, side in ((CUT, diagram.inputs), (BACK, diagram.outputs)):
        if name in side:
            raise RunError(f"'{diagram.title}' has an {'input' if name == CUT else 'output'} '{name}' already.")
    ports = [".".join(link.target) for link in links]
    return diagram.rewire(
        cut=[f"{source} -> {port}" for port in ports],
        inputs={**diagram.inputs, CUT: Inlet(ports, diagram.unit(source))},
        outputs={**diagram.outputs, BACK: source},
    )


def _source(diagram: Diagram, at: str) -> str:
    return ".".join(_links(diagram, at)[0].source)


def _comes_back(diagram: Diagram, at: str) -> bool:
    """Whether there is a way along the wires from where these lead to the block they come from."""
    links = _links(diagram, at)
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
        links, faults = parse(at, diagram.blocks)
        missing = [str(link) for link in links if link not in diagram.links]
        if missing:
            raise RunError(f"at='{at}': there is no wire '{missing[0]}'.{near(missing[0], map(str, diagram.links))}")
        if faults or len({link.source for link in links}) != 1:
            raise RunError(f"at='{at}': {faults[0] if faults else 'one wire is wanted.'}")
        return [link for link in diagram.links if link in links]
    try:
        source = resolve(at, diagram.blocks, "output")
    except Fault as fault:
        raise RunError(sentence(f"at='{at}'", fault)) from None
    links = [link for link in diagram.links if link.source == source]
    if not links:
        raise RunError(f"at='{at}': no wire begins there, so there is nothing to open.")
    return links


def _chosen(
    here: Still, asked: Sequence[str] | None, known: list[str], what: str, usual: list[str] | None = None
) -> list[str]:
    if isinstance(asked, str):
        asked = [asked]
    chosen = list(asked) if asked is not None else list(usual if usual is not None else known)
    for name in chosen:
        if name not in known:
            raise RunError(f"diagram '{here.eq.title}' has no {what} '{name}'.{near(name, known)}")
    if not chosen:
        argument = "inputs" if what == "input" else "outputs"
        raise RunError(f"no {what} of diagram '{here.eq.title}' is asked for: say {argument}=[…].{near('', known)}")
    return chosen


def _jacobians(here: Still, x: np.ndarray, shown: Sequence[str]) -> dict[tuple[str, str], np.ndarray]:
    """Derivatives of rates, signals and what is delayed by states ``x``, samples ``u`` and delayed values ``w``."""
    eq = here.eq
    slopes, late = _slopes(eq, tuple(eq.aliases.get(name, name) for name in shown))
    u, w = np.asarray(here.u, dtype=float), np.zeros(len(eq.q))
    for _ in range(len(eq.q)):
        w = np.asarray(late(x, u, w, here.t, here.p)).ravel()
    *made, moved = (np.asarray(J, dtype=float) for J in slopes(x, u, w, here.t, here.p))
    if np.abs(moved).max(initial=0.0) > 1e-9:
        raise RunError(
            f"'{eq.title}' follows the slope of a delayed signal, which no state space holds. Put a lag "
            "behind the delay."
        )
    found = dict(zip(_KEYS, made, strict=True))
    rows = {"dx": [f"the rate of {name}" for name in eq.x], "y": list(shown), "s": [f"what {q} delays" for q in eq.q]}
    bad = [rows[a][k] for (a, _), J in found.items() for k in np.flatnonzero(~np.isfinite(J).all(axis=1))]
    if bad:
        said = ", ".join(list(dict.fromkeys(bad))[:3])
        raise RunError(f"the slopes of '{eq.title}' are not finite here: {said}.")
    return found


_KEYS = [(a, b) for a in ("dx", "y", "s") for b in ("x", "u", "w")]


@lru_cache(maxsize=64)
def _slopes(eq: Equations, signals: tuple[str, ...]) -> tuple[Any, Any]:
    """The derivatives, and what is delayed, as functions of (x, u, w, t, p): kept, since making them takes longest.

    The last of the derivatives is that of everything by the slopes of what is delayed.
    """
    xs, us, ws = ca.SX.sym("x", len(eq.x)), ca.SX.sym("u", len(eq.u)), ca.SX.sym("w", len(eq.q))
    t, p, moves = ca.SX.sym("t"), ca.SX.sym("p", len(eq.p)), ca.SX.sym("moves", len(eq.q))
    dx, y, s = called(eq, xs, us, ws, t, p, moves)
    rows = {"dx": dx, "y": ca.vertcat(*(y[eq.y.index(name)] for name in signals)), "s": s}
    by = {"x": xs, "u": us, "w": ws}
    given = [xs, us, ws, t, p]
    made = [ca.jacobian(rows[a], by[b]) for a, b in _KEYS] + [ca.jacobian(ca.vertcat(*rows.values()), moves)]
    still = [ca.densify(ca.substitute(one, moves, ca.DM.zeros(len(eq.q)))) for one in made]
    return ca.Function("slopes", given, still), ca.Function("delayed", given, [ca.densify(s)])


Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _proper(here: Still, J: dict[tuple[str, str], np.ndarray], names: Sequence[str]) -> Matrices:
    r"""State space with inputs ``names``, then delayed signals; outputs the signals, then what is delayed.

    Where a rate follows the slope of an input, :math:`x' = A x + B u + E u'`, the state :math:`x - E u` is used.
    """
    eq = here.eq
    place = {
        (feed.name.removeprefix("d/dt " * feed.order), feed.order): k for k, feed in enumerate(eq.u) if not feed.block
    }
    own = [place[name, 0] for name in names]
    A, rows = J["dx", "x"], np.vstack([J["y", "x"], J["s", "x"]])
    direct = np.vstack([J["y", "u"], J["s", "u"]])
    B = np.hstack([J["dx", "u"][:, own], J["dx", "w"]])
    D = np.hstack([direct[:, own], np.vstack([J["y", "w"], J["s", "w"]])])
    none = IMPROPER * max(1.0, float(np.abs(direct).max(initial=0.0)))
    for k, name in enumerate(names):
        slope = place.get((name, 1))
        if slope is None:
            continue
        if np.abs(direct[:, slope]).max(initial=0.0) > none or (name, 2) in place:
            raise RunError(
                f"a signal of '{eq.title}' follows the slope of its input '{name}' at once, so there is no "
                "state space from there. Put a lag on the input, or ask for other outputs."
            )
        E = J["dx", "u"][:, slope]
        B[:, k] += A @ E
        D[:, k] += rows @ E
    return A, B, rows, D


def _with_delays(here: Still, system: Matrices, pade: int | None) -> Matrices:
    """The system closed over its delays, each a Padé approximation."""
    import control

    eq = here.eq
    lags = np.asarray(eq.lag(here.p), dtype=float).ravel()
    if pade is None:
        said = ", ".join(f"{v:g} s" for v in lags)
        raise RunError(
            f"'{eq.title}' has dead times ({said}), which no state space holds. "
            "Say pade=3 for an approximation of third order."
        )
    order = as_integer("pade", pade, 1)
    parts = [
        control.ss(control.tf(*control.pade(lag, order))) if lag > 0 else control.ss([], [], [], 1.0) for lag in lags
    ]
    delays = control.append(*parts) if len(parts) > 1 else parts[0]
    A, B, C, D = system
    n, m = B.shape[1] - len(lags), C.shape[0] - len(lags)
    Bu, Bw, Cy, Cs = B[:, :n], B[:, n:], C[:m], C[m:]
    Dyu, Dyw, Dsu, Dsw = D[:m, :n], D[:m, n:], D[m:, :n], D[m:, n:]
    # w = Dd s + Cd z, s = Cs x + Dsu u + Dsw w
    Dd, Cd = np.asarray(delays.D), np.asarray(delays.C)
    solve = np.linalg.inv(np.eye(len(lags)) - Dd @ Dsw)
    Wx, Wz, Wu = solve @ Dd @ Cs, solve @ Cd, solve @ Dd @ Dsu
    Sx, Sz, Su = Cs + Dsw @ Wx, Dsw @ Wz, Dsu + Dsw @ Wu
    Bd = np.asarray(delays.B)
    return (
        np.block([[A + Bw @ Wx, Bw @ Wz], [Bd @ Sx, np.asarray(delays.A) + Bd @ Sz]]),
        np.vstack([Bu + Bw @ Wu, Bd @ Su]),
        np.hstack([Cy + Dyw @ Wx, Dyw @ Wz]),
        Dyu + Dyw @ Wu,
    )


def _states(here: Still, A: np.ndarray) -> list[str]:
    """Names of the states; those of Padé approximations come last."""
    names = list(here.eq.x)
    return _labels([*names, *(f"pade_{k}" for k in range(len(A) - len(names)))])


def _labels(names: Sequence[str]) -> list[str]:
    """Names as python-control takes them: without dots, no two alike."""
    return unlike(name.replace(".", "_") for name in names)
