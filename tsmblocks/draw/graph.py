"""A diagram as a graph to be drawn: nodes, signals, columns and feedback. It has no coordinates."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import attrs

from tsmblocks.draw import cycles
from tsmblocks.draw.faces import symbol_of
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameter_units import unit_of

End = tuple[str, str]
"""Key of a node, and port. Blocks have their names as keys, terminals ``>name`` and ``<name``."""

SUMS, PRODUCTS = ("Σ", "Sum"), ("×", "Product")
"""Symbols of the blocks that are drawn as circles."""
GAINS = ("K",)
"""Symbols of the blocks that are drawn as triangles."""


@attrs.define(eq=False)
class Node:
    """One box, circle or terminal. ``ins`` and ``outs`` are the ports that have a wire.

    ``diagram`` is the one that the block is in, which knows the units of its signals.
    """

    key: str
    name: str
    shape: str
    block: Any = None
    ins: tuple[str, ...] = ()
    outs: tuple[str, ...] = ()
    diagram: Diagram | None = None

    def unit_of(self, parameter: str) -> str:
        """The unit of a parameter of the block; nothing where none is known."""
        if self.diagram is None:
            return ""
        return unit_of(f"{self.key}.{parameter}", self.diagram, [self.block.fields()[parameter]])

    @property
    def round(self) -> bool:
        """Whether wires may also come from above and below."""
        return self.shape == "round"

    def ports(self, side: str) -> tuple[str, ...]:
        """``ins`` or ``outs``."""
        return self.ins if side == "in" else self.outs


@attrs.define(eq=False)
class Net:
    """One signal: its source, the ports ahead of it, and the ports it is fed back to."""

    source: End
    ahead: list[End] = attrs.field(factory=list)
    back: list[End] = attrs.field(factory=list)
    outputs: tuple[str, ...] = ()
    note: str = ""

    @property
    def tapped(self) -> bool:
        """Whether an output of the diagram is read off the wire, because the signal goes on."""
        return bool(self.outputs) and not any(key.startswith("<") for key, _ in self.ahead)


@attrs.define(eq=False)
class Loop:
    """One feedback: its signals, from right to left, and the blocks between them."""

    nets: tuple[Net, ...]
    blocks: tuple[str, ...] = ()


@attrs.define(eq=False)
class Graph:
    """Nodes, signals and feedbacks, with the column of every node that is not in a feedback path."""

    nodes: dict[str, Node]
    nets: list[Net]
    column: dict[str, int]
    loops: list[Loop]


def graph(diagram: Diagram, notes: Mapping[End, str]) -> Graph:
    """The diagram with its feedback found and its blocks in columns."""
    nodes, nets = _read(diagram, notes)
    _split(nodes, nets)
    loops = _loops(nodes, nets)
    hidden = {name for loop in loops for name in loop.blocks}
    placed = [key for key in nodes if key not in hidden]
    edges = [(net.source[0], key) for net in nets for key, _ in net.ahead]
    fed, inputs = {v for _, v in edges}, {k for k in placed if k.startswith(">")}
    column = cycles.columns(placed, edges, lambda k: int(bool(inputs) and k in fed), inputs)
    lowest, last = min(column.values(), default=0), max(column.values(), default=-1) + 1
    for net in nets:  # an edge taken for feedback may turn out to lead forward after all
        late = [end for end in net.back if net.source[0] in column and column[end[0]] > column[net.source[0]]]
        net.ahead += late
        net.back = [end for end in net.back if end not in late]
        if net.outputs and not net.ahead:
            for name in net.outputs:
                nodes["<" + name] = Node("<" + name, name, "terminal")
                net.ahead.append(("<" + name, ""))
                column["<" + name] = last
    loops = [loop for loop in loops if loop.nets[-1].back]
    return Graph(nodes, nets, {k: c - lowest for k, c in column.items()}, loops)


def _read(diagram: Diagram, notes: Mapping[End, str]) -> tuple[dict[str, Node], list[Net]]:
    """Nodes and signals in the order of the diagram's blocks and ports, whatever the order of the wires."""
    nodes = {">" + name: Node(">" + name, name, "terminal") for name in diagram.inputs}
    inports = [(name, port) for name, block in diagram.blocks.items() for port in block.inports]
    place = {end: k for k, end in enumerate(inports)}
    targets: dict[End, list[End]] = {(">" + name, ""): list(ends) for name, ends in diagram.inlets.items()}
    for link in diagram.links:
        targets.setdefault(link.source, []).append(link.target)
    shown: dict[End, list[str]] = {}
    for output, (name, port) in diagram.shown.items():
        shown.setdefault((name, port) if name else (">" + port, ""), []).append(output)
    wired, sending = {end for ends in targets.values() for end in ends}, {*targets, *shown}
    for name, block in diagram.blocks.items():
        ins = tuple(p for p in block.inports if (name, p) in wired)
        outs = tuple(p for p in block.outports if (name, p) in sending or notes.get((name, p)))
        nodes[name] = Node(name, name, _shape(block, ins, outs), block, ins, outs, diagram)
    sources = [(key, "") for key in nodes if key.startswith(">")]
    sources += [(key, port) for key, node in nodes.items() for port in node.outs]
    nets = []
    for source in sources:
        ahead = sorted(set(targets.get(source, ())), key=place.__getitem__)
        nets.append(Net(source, ahead, outputs=tuple(shown.get(source, ())), note=notes.get(source, "")))
    return nodes, nets


def _shape(block: Any, ins: tuple[str, ...], outs: tuple[str, ...]) -> str:
    if isinstance(block, Diagram):
        return "double"
    if symbol_of(block) in GAINS and len(block.inports) == len(block.outports) == 1:
        return "triangle"
    if symbol_of(block) not in (*SUMS, *PRODUCTS) or len(outs) > 1:
        return "box"
    if len(ins) <= 3:
        return "round"
    return "tall" if symbol_of(block) in SUMS else "box"


def sign_of(node: Node, port: str) -> str:
    """The sign beside an input of a sum."""
    signs, ports = getattr(node.block, "signs", None), list(node.block.inports)
    if isinstance(signs, str) and len(signs) == len(ports):
        return signs[ports.index(port)].replace("-", "−")
    return "−" if port.startswith("minus") else "+"


def _split(nodes: Mapping[str, Node], nets: list[Net]) -> None:
    """Part the targets of each signal into those ahead and those it is fed back to."""
    edges = list(dict.fromkeys((net.source[0], key) for net in nets for key, _ in net.ahead))
    joins = {key for key, node in nodes.items() if node.shape in ("round", "tall")}
    shown = {net.source[0] for net in nets if net.outputs}
    found = cycles.feedback(list(nodes), edges, joins, shown)
    for net in nets:
        net.back = [end for end in net.ahead if (net.source[0], end[0]) in found]
        net.ahead = [end for end in net.ahead if (net.source[0], end[0]) not in found]


def _loops(nodes: Mapping[str, Node], nets: list[Net]) -> list[Loop]:
    """The feedback loops; blocks that only return a signal are taken out of the columns."""
    driver = {end: net for net in nets for end in (*net.ahead, *net.back)}
    receivers = {net.source: len(net.ahead) + len(net.back) + len(net.outputs) for net in nets}
    sources = [net.source[0] for net in nets]
    after = cycles.successors(nodes, [(net.source[0], key) for net in nets for key, _ in net.ahead])
    loops = []
    for net in nets:
        if not net.back:
            continue
        path = [net]
        while _returns(nodes[path[-1].source[0]], path, receivers, sources):
            path.append(driver[path[-1].source[0], nodes[path[-1].source[0]].ins[0]])
        start = path[-1]
        entry = path[-2].source[0] if len(path) > 1 else ""
        distance = cycles.distances(after, [net.back[0][0]]).get(start.source[0], -1)
        room = distance + 1  # columns the feedback runs below
        branches = receivers[start.source] > 1 and entry in [key for key, _ in start.ahead]
        if not branches or len(path) - 1 > room:
            loops.append(Loop((net,)))
            continue
        for ahead, one in itertools.pairwise(reversed(path)):
            ahead.ahead = [end for end in ahead.ahead if end[0] != one.source[0]]
        loops.append(Loop(tuple(reversed(path)), tuple(one.source[0] for one in reversed(path[:-1]))))
    return loops


def _returns(node: Node, path: list[Net], receivers: Mapping[End, int], sources: list[str]) -> bool:
    """Whether a block is in a feedback path: one input, one output, one receiver."""
    return (
        not node.round
        and len(node.ins) == 1
        and sources.count(node.key) == 1
        and receivers[path[-1].source] == 1
        and node.key not in [net.source[0] for net in path[:-1]]
    )
