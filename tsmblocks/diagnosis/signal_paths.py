"""Paths of signals through a diagram: what drives a port, what depends on a block, and the integrations between."""

from __future__ import annotations

from collections.abc import Iterator

from tsmblocks.blocks import Bias
from tsmblocks.common.errors import TsmError
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import equations

PROBE_BLOCK = "probe_of_the_wire"
"""Name of the block by which the integrations behind a wire are counted."""
PROBE = f"{PROBE_BLOCK}.bias"
"""Its parameter."""
FORCE_TO_POSITION = 2
"""Integrations from a force to the position at least; to the speed one less. Source: Newton's second law."""

Entry = tuple[str, int]
"""A signal ``y``, derivative of a state ``x``, memory ``d`` or parameter ``p`` of equations, by its position."""
Dependencies = dict[Entry, set[Entry]]
"""Entry -> entries on which it depends directly."""


def source_of(diagram: Diagram, port: str) -> str:
    """The signal, or input of the diagram, that drives a port (``block.port``)."""
    link = next((x for x in diagram.links if ".".join(x.target) == port), None)
    if link is not None:
        return ".".join(link.source)
    return next(k for k, ends in diagram.inlets.items() if port in {".".join(e) for e in ends})


def driven_by(diagram: Diagram, signal: str) -> list[str]:
    """The ports (``block.port``) that a signal drives."""
    return [".".join(x.target) for x in diagram.links if ".".join(x.source) == signal]


def driving_port(diagram: Diagram, output: str, least: int = FORCE_TO_POSITION) -> str:
    """The nearest port that moves an output through ``least`` integrations or more; ``""`` where there is none."""
    ports = upstream_ports(diagram, diagram.shown[output][0])
    return next((k for k in ports if integration_count(diagram, output, before=k, after="") >= least), "")


def upstream_ports(diagram: Diagram, block: str) -> Iterator[str]:
    """Driven ports, from those of ``block`` on against the direction of the wires, nearest first."""
    todo = [block]
    for name in todo:  # grows while it is read
        into = [x for x in diagram.links if x.target[0] == name]
        yield from (".".join(x.target) for x in into)
        yield from (".".join(e) for ends in diagram.inlets.values() for e in ends if e[0] == name)
        todo += [head for head in dict.fromkeys(x.source[0] for x in into) if head not in todo]


def blocks_behind(diagram: Diagram, block: str, up_to: str = "") -> set[str]:
    """The blocks that depend on a block, with that one where it depends on itself.

    Those that do so through the block ``up_to`` alone are left out.
    """
    todo, found = [block], set[str]()
    for name in todo:  # grows while it is read
        after = {x.target[0] for x in diagram.links if x.source[0] == name and name != up_to} - found
        found |= after
        todo += after
    return found


def integration_count(diagram: Diagram, output: str, *, before: str, after: str) -> int:
    """Integrations between a wire and an output, or a signal: 0 for direct feedthrough, -1 where it does not reach it.

    From the sparsity of the equations. Memory that is updated between steps counts as one integration.
    """
    found = _reach(diagram, output, before, after)
    if found is None:
        return -1
    rows, goal, probe = found
    front = {probe}
    known = set(front)
    for degree in range(len(rows) + 1):
        if rows[goal] & known:
            return degree
        front = {state for state, reads in rows.items() if state[0] in "xd" and reads & known} - known
        if not front:
            return -1
        known |= front
    return -1


def reaches_through_a_state(diagram: Diagram, output: str, name: str) -> bool:
    """Whether an input acts on the rate of a state that an output reads: a lag, or an integrator, between them."""
    found = _reach(diagram, output, "", name)
    if found is None:
        return False
    rows, goal, probe = found
    return any(kind == "x" and probe in rows[kind, i] for kind, i in rows[goal])


def _reach(diagram: Diagram, output: str, before: str, after: str) -> tuple[Dependencies, Entry, Entry] | None:
    """The dependencies of a diagram with a probe on a wire, the output and the probe in them.

    None where the diagram has no such wire, or no such output, as one of a diagram that is used as a block.
    """
    found = probed(diagram, output, before, after)
    if found is None:
        return None
    _, eq, place = found
    return _dependencies(eq), ("y", place), ("p", eq.p.index(PROBE))


def probed(diagram: Diagram, signal: str, before: str = "", after: str = "") -> tuple[Diagram, Equations, int] | None:
    """A diagram with a probe on a wire, its equations, and the place of a signal among theirs.

    None where it has no such wire or signal.
    """
    try:
        edited = diagram.insert(PROBE_BLOCK, Bias(), before=before, after=after)
        eq = equations(edited)
    except TsmError:
        return None
    name = eq.aliases.get(signal, signal)
    return (edited, eq, eq.y.index(name)) if name in eq.y else None


def _dependencies(eq: Equations) -> Dependencies:
    """For each signal, derivative and memory: the parameters, states and memories it depends on directly."""
    found: Dependencies = {}
    results = [("x", eq.rhs, 0), ("y", eq.rhs, 1)] + ([("d", eq.update, 0)] if eq.update is not None else [])
    for kind, function, result in results:
        found |= {(kind, i): set() for i in range(function.size1_out(result))}
        for name, argument in (("x", 1), ("d", 2), ("p", 5)):
            for i, k in zip(*function.jac_sparsity(result, argument).get_triplet(), strict=True):
                found[kind, i].add((name, k))
    return found
