"""Loops opened at a wire: their transfer at an operating point, and their stability margins."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.crossings import stability_margins
from tsmblocks.analysis.discrete_time import sampled_model
from tsmblocks.analysis.linearization import equations_at, linearize
from tsmblocks.analysis.operating_point import LocalEquations, Point, local_equations, point_at
from tsmblocks.analysis.steady import without_rounding
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.tables import listed
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.wires import Fault, Link, fault_sentence, parse_chain, resolve
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.run import Run

CUT_INPUT, CUT_OUTPUT = "cut", "back"
"""Names of the input and the output of an opened loop."""


class OperatingPointWarning(UserWarning):
    """A loop is linearised where a block on it is at a limit, or where its gain is zero."""


@attrs.frozen(eq=False)
class OpenedLoop:
    """The transfer of a loop opened at a wire, and the signals on it that block small changes."""

    transfer: Any
    blocked: Mapping[str, float]
    """Signals by name, with their value: outputs of blocks at a limit, in a dead zone, times zero."""

    @property
    def is_open(self) -> bool:
        """Whether the linear loop is no model of the loop in operation."""
        system = self.transfer
        return bool(self.blocked) or not (np.any(system.B) or np.any(system.D))


def loop_gain(diagram: Diagram, at: str, *, point: Point | Run | None = None, pade: int | None = None) -> Any:
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
    point : Point or Run, optional
        An operating point of the closed loop, from ``trim``, or a run, whose last instant it is. By default the initial
        states, with inputs at zero.
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

    Warns
    -----
    OperatingPointWarning
        Where a block on the loop is at a limit, so that the linear model does not describe the loop in operation.

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
    loop = opened_loop(diagram, at, point=point, pade=pade)
    if loop.is_open:
        warn_of_open_loop(loop, at, point)
    return loop.transfer


@attrs.frozen
class Margins:
    """Stability margins of a loop; ``str`` gives them as text.

    Parameters
    ----------
    gain : float
        The smallest factor, up or down, that makes the loop unstable; below 1 where it is unstable already; infinite
        where none does.
    phase : float
        Phase margin in degrees, negative where the loop is unstable; infinite where the gain nowhere is 1.
    """

    gain: float
    phase: float

    def __str__(self) -> str:
        gain = f"a factor of {self.gain:.3g}" if np.isfinite(self.gain) else "none (no gain makes it unstable)"
        phase = f"{self.phase:.1f} deg" if np.isfinite(self.phase) else "none (its gain is nowhere 1)"
        return f"gain margin {gain}, phase margin {phase}"


def margins(diagram: Diagram, at: str, *, point: Point | Run | None = None, pade: int | None = None) -> Margins:
    """Stability margins of a loop opened at a wire, at an operating point.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    at : str
        A wire (``"controller -> drive"``) or a signal (``"drive.y"``, all its wires).
    point : Point or Run, optional
        An operating point, as for ``loop_gain``. By default the initial states.
    pade : int, optional
        Order of the Padé approximations of transport delays; needed where there are any.

    Returns
    -------
    Margins
        Gain and phase margin; infinite where there is none.

    Raises
    ------
    RunError
        As for ``loop_gain``, and where a block on the loop is at a limit, so that the loop is open there.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> from tsmblocks.blocks import FirstOrderLag, Gain, Integrator, Sum
    >>> parts = {"e": Sum(), "k": Gain(gain=2.0), "i": Integrator(), "lag": FirstOrderLag(time_constant=0.5)}
    >>> loop = tsm.Diagram(blocks=parts, wires=["e -> k -> i -> lag -> e.minus"], inputs={"r": "e.plus"}, outputs={})
    >>> print(tsm.analysis.margins(loop, "k"))
    gain margin none (no gain makes it unstable), phase margin 51.8 deg
    """
    loop = opened_loop(diagram, at, point=point, pade=pade)
    if loop.is_open:
        raise RunError(_open_text(loop, at, point))
    return Margins(*stability_margins(loop.transfer))


def _open_text(loop: OpenedLoop, at: str, point: Point | Run | None) -> str:
    """The message on a loop that is open at its operating point."""
    where = "at the initial states" if point is None else "at this point"
    why = [f"{name} ({value:g})" for name, value in loop.blocked.items()]
    reason = f"{listed(why, 3)} blocks small changes: a limit, or a dead zone" if why else "its gain is zero"
    other = "Use another point: point=tsm.trim(…), or a run that ends in normal operation of the loop, point=run."
    return f"at='{at}': the loop is open {where}; {reason}. Its margins there are meaningless. {other}"


def warn_of_open_loop(loop: OpenedLoop, at: str, point: Point | Run | None) -> None:
    """Warn at the line that called the caller."""
    warnings.warn(_open_text(loop, at, point), OperatingPointWarning, stacklevel=3)


def opened_loop(diagram: Diagram, at: str, *, point: Point | Run | None = None, pade: int | None = None) -> OpenedLoop:
    """The transfer of a loop, with the signals that block it. Raises RunError."""
    diagram = as_diagram(diagram)
    cut, links = without_rounding(opened(diagram, at)), _links(diagram, at)
    if not _is_loop(diagram, links):
        raise RunError(f"at='{at}': this wire is not part of a loop.")
    outputs = {**diagram.outputs, CUT_OUTPUT: ".".join(links[0].source)}
    closed, x = equations_at("point", point, without_rounding(diagram).rewire(outputs=outputs))
    whole_point = point_at(closed, x, closed.u[closed.places])
    inputs = {**whole_point.inputs, CUT_INPUT: whole_point.signals[CUT_OUTPUT]}
    if closed.eq.periods:
        _check_closure(local_equations(cut, inputs, whole_point.t, sampled=True), closed, x, at)
    there = attrs.evolve(whole_point, inputs=inputs)
    system = _loop_transfer(linearize(cut, inputs=[CUT_INPUT], outputs=[CUT_OUTPUT], at=there, pade=pade))
    return OpenedLoop(system, _blocked(closed, x, whole_point, _on_loop(diagram, links)))


def _on_loop(diagram: Diagram, links: list[Link]) -> set[str]:
    """Names of the blocks on a path from the targets of these wires back to their source."""
    source = links[0].source[0]
    backward, fresh = set[str](), {source}
    while fresh:
        backward |= fresh
        fresh = {link.source[0] for link in diagram.links if link.target[0] in fresh} - backward
    return _reached(diagram, links) & backward


def _blocked(here: LocalEquations, x: np.ndarray, point: Point, blocks: set[str]) -> dict[str, float]:
    """Signals of blocks on a loop that depend on states or inputs, but with a derivative of zero here; the first ones.

    Sampled diagrams are not looked at: their outputs are held, and depend on the memory.
    """
    eq = here.eq
    if eq.periods or not len(eq.x):
        return {}
    still = _still(eq, x, here)
    first = [
        name
        for name in still
        if name.split(".")[0] in blocks and not still & {*eq.reads.get(name.rpartition(".")[0], ("", {}))[1].values()}
    ]
    return {name: point.signals[name] for name in eq.y if name in first}


def _still(eq: Equations, x: np.ndarray, here: LocalEquations) -> set[str]:
    """Signals that depend on the states by their form, but do not change with any of them here."""
    jacobian, depends = _signal_jacobian(eq)
    past = np.zeros(jacobian.size1_in(4))
    values = np.asarray(jacobian(here.t, x, here.d, here.u, past, here.p), dtype=float)
    still = depends & (np.abs(np.nan_to_num(values, nan=1.0)).max(axis=1) == 0.0)
    return {eq.y[k] for k in np.flatnonzero(still)}


@lru_cache(maxsize=64)
def _signal_jacobian(eq: Equations) -> tuple[Any, np.ndarray]:
    """The Jacobian of all signals by the states, and which of them depend on a state by their form."""
    given = eq.rhs.sx_in()
    J = ca.jacobian(eq.rhs.call(given)[1], given[1])
    depends = np.asarray(ca.DM(J.sparsity(), 1.0), dtype=float).any(axis=1)
    return ca.Function("jacobian", given, [ca.densify(J)]), np.asarray(depends)


def _check_closure(cut: LocalEquations, closed: LocalEquations, x: np.ndarray, at: str) -> None:
    """Raise RunError where the loop, closed over a signal held between samples, differs from the diagram's."""
    model = sampled_model(cut, x, [CUT_INPUT], [CUT_OUTPUT])
    if not model.closes_to(sampled_model(closed, x, [], [])):
        raise RunError(
            f"at='{at}': the signal on this wire matters, and changes, between the instants at which all "
            f"samples of '{closed.eq.title}' coincide ({model.dt:g} s apart). Open the loop where it "
            "enters or leaves the slowest sampled block."
        )


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
    return links[0].source[0] in _reached(diagram, links)


def _reached(diagram: Diagram, links: list[Link]) -> set[str]:
    """Names of the blocks that paths from the targets of these wires reach."""
    reached, fresh = set[str](), {link.target[0] for link in links}
    while fresh:
        reached |= fresh
        fresh = {link.target[0] for link in diagram.links if link.source[0] in fresh} - reached
    return reached


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
            raise RunError(f"at='{at}': {faults[0] if faults else 'one wire is expected.'}")
        return [link for link in diagram.links if link in links]
    try:
        source = resolve(at, diagram.blocks, "output")
    except Fault as fault:
        raise RunError(fault_sentence(f"at='{at}'", fault)) from None
    links = [link for link in diagram.links if link.source == source]
    if not links:
        raise RunError(f"at='{at}': no wire begins there.")
    return links
