"""A nested diagram as one level of blocks, with symbols for parameters.

Wires are followed through the borders of inner diagrams, and every symbol of a parameter is made once. No equation is
called here.
"""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

from tsmblocks.common.errors import AlgebraicLoop, DiagramError, EquationError
from tsmblocks.compiler import switched
from tsmblocks.compiler.dependencies import Structure, structure_of
from tsmblocks.compiler.switched import Switch
from tsmblocks.model.block import Block, Past, is_reference
from tsmblocks.model.diagram import Diagram

Key = tuple[str, str]
"""Block and port, or block and state."""
Node = tuple[str, ...]
"""``("y", block, port)`` an output, ``("u", name)`` an input of the diagram.

While wires are followed there are ``("in", block, name)``, an input port, and ``("out", diagram, name)`` too.
``evaluate`` adds ``("dx", block, state)``, the derivative of a state, ``("rate", *node)``, the time derivative of
a signal, ``("past", block, name)``, a past value, and ``("tape", block, name)``, samples that a block supplies.
"""


@attrs.frozen(eq=False)
class PastValue:
    """A past value that is read: its declaration, the delayed node, the delay [s], and the value before the start."""

    past: Past
    source: Node
    delay: Any
    initial: Any


def is_held_output(key: tuple[str, ...]) -> bool:
    """Whether an element of ``d`` is an output held between samples, and not a memory state."""
    return len(key) == 3


class FlatDiagram:
    """One level of blocks with symbols; raises AlgebraicLoop for a ring of inner diagrams without a block.

    A block's path is its name after the names of the diagrams around it (``motor.drive``).

    - By path: ``blocks`` as given, ``symbolic_blocks`` with symbols, ``structures`` (their dependencies), ``group``
      (of a sampled block, the index of its period in ``periods`` [s]), ``switches`` (what switches the diagrams around
      it, the outermost first).
    - Wiring: ``driver`` is the node that drives each input port, ``shown`` the node of each output of the diagram.
    - Keys: ``x`` are the continuous states, ``resets`` those that updates set, ``d`` memory states, then the outputs of
      sampled blocks, which are ``held`` between samples. ``p`` are the symbols of parameters by name.
      ``pasts`` are the past values that are read, by block and port.
    """

    def __init__(self, diagram: Diagram) -> None:
        self.title, self.where = diagram.title, diagram.where
        self.t = ca.SX.sym("t")
        self.blocks: dict[str, Block] = {}  # as given
        self.symbolic_blocks: dict[str, Any] = {}  # with symbols for numbers
        self.structures: dict[str, Structure] = {}
        self.p: dict[str, Any] = {}
        self.p_values: list[float] = []
        self.inputs: dict[str, str] = {k: v.unit for k, v in diagram.inports.items()}
        self.switches: dict[str, tuple[Switch, ...]] = {}
        self._wires: dict[Node, Node] = {}  # an input port, or an output of a diagram -> what drives it
        self._collect(diagram, "", ())
        followed = {node: self._followed(node) for node in self._wires}
        self.driver = {(path, port): v for (kind, path, port), v in followed.items() if path in self.blocks}
        self.shown = {k: followed["out", "", k] for k in diagram.shown}
        self._list_states()

    # ---- hierarchy

    def _collect(self, diagram: Diagram, prefix: str, around: tuple[Switch, ...]) -> None:
        scope = {name: self._parameter(prefix + name, value) for name, value in diagram.values.items()}
        switch = self._switch(diagram, prefix)
        inside = (*around, switch) if switch else around
        for name, block in diagram.blocks.items():
            path = prefix + name
            if isinstance(block, Diagram):
                self._collect(block, path + ".", inside)
            else:
                self._add(path, block, scope)
                self.switches[path] = around if switch and path == switch.path else inside

        def source(end: Key) -> Node:
            """The node of an output port; for a port of a diagram (an input of this one, too) its border."""
            name, port = end
            if not name:
                return ("in", prefix[:-1], port) if prefix else ("u", port)
            return "out" if isinstance(diagram.blocks[name], Diagram) else "y", prefix + name, port

        driven = [(link.target, link.source) for link in diagram.links]
        driven += [(end, ("", name)) for name, ends in diagram.inlets.items() for end in ends]
        for (name, port), end in driven:
            self._wires["in", prefix + name, port] = source(end)
        shown = {port: source(end) for port, end in diagram.shown.items()}
        if switch:
            shown |= self._switched(switch, around, {k: v for k, v in shown.items() if v[1] != switch.path})
        self._wires |= {("out", prefix[:-1], port): node for port, node in shown.items()}

    def _switch(self, diagram: Diagram, prefix: str) -> Switch | None:
        """The block that switches a diagram on and off, if one does. Raises DiagramError for several."""
        found = {name: block for name, block in diagram.blocks.items() if getattr(block, "switches", "")}
        if len(found) > 1:
            names = " and ".join(prefix + name for name in found)
            fault = (
                f"{names} both switch their diagram. Keep one, driven by a Logic block that combines the conditions."
            )
            raise DiagramError(self.title, [fault], self.where)
        return next((Switch(prefix + name, block) for name, block in found.items()), None)

    def _switched(self, switch: Switch, around: tuple[Switch, ...], shown: dict[str, Node]) -> dict[str, Node]:
        """Outputs of a diagram that is switched on and off, each behind a block that gives its value while off."""
        initial = switch.block.initial
        if len(initial) not in (0, len(shown)):
            outputs = f"{len(shown)} ({', '.join(shown)})"
            fault = (
                f"{switch.path}.initial needs one value for each output of its diagram, {outputs}, got {len(initial)}."
            )
            raise DiagramError(self.title, [fault], self.where)
        for number, (port, node) in enumerate(shown.items()):
            path = f"{switch.path}.{port}"
            made = switched.switched_output(switch, self.symbolic_blocks[switch.path], number)
            self.blocks[path], self.symbolic_blocks[path] = made
            self.structures[path], self.switches[path] = structure_of(made[0]), around
            self._wires["in", path, "u"], self._wires["in", path, "on"] = node, switch.on
        return {port: ("y", f"{switch.path}.{port}", "y") for port in shown}

    def _followed(self, node: Node) -> Node:
        """The output of a block, or the input of the whole diagram, that lies behind borders of inner diagrams."""
        seen: list[Node] = []
        while node[0] in ("in", "out"):
            if node in seen:
                back = [*seen[seen.index(node) :], node]  # against the flow
                names = [f"{path}.{port}" for _, path, port in reversed(back)]
                text = (
                    f"{' -> '.join(names)} connects diagrams in a ring without any block, so the signal has no value."
                )
                raise AlgebraicLoop(self.title, [text], self.where, names)
            seen.append(node)
            node = self._wires[node]
        return node

    # ---- symbols

    def _parameter(self, name: str, value: float) -> Any:
        self.p[name] = ca.SX.sym(name)
        self.p_values.append(value)
        return self.p[name]

    def _add(self, path: str, block: Block, scope: dict[str, Any]) -> None:
        def symbol(leaf: str, value: Any) -> Any:
            return scope[value[1:]] if is_reference(value) else self._parameter(f"{path}.{leaf}", value)

        self.blocks[path] = block
        self.symbolic_blocks[path] = block.with_symbols(symbol)
        try:
            self.structures[path] = structure_of(block)
        except EquationError as error:
            raise EquationError(f"{path}: {error}") from error.__cause__

    def _list_states(self) -> None:
        self.x: list[Key] = []
        self.d: list[tuple[str, ...]] = []  # (block, state) for memory, then (block, port, "held")
        self.resets: list[Key] = []
        self.periods: list[float] = []
        self.group: dict[str, int] = {}
        self.pasts: dict[Key, PastValue] = {}
        held, faults = list[Key](), list[str]()
        for path, block in self.blocks.items():
            shape = self.structures[path]
            faults += switched.faults(self.switches[path], path, block, shape.continuous)
            self.x += [(path, k) for k in shape.continuous]
            self.d += [(path, k) for k in shape.memory]
            self.resets += [(path, k) for k in shape.resets]
            if block.sampled:
                held += [(path, k) for k in block.outports]
                period = block.period  # type: ignore[attr-defined]
                if period not in self.periods:
                    self.periods.append(period)
                self.group[path] = self.periods.index(period)
            for name, past in block.past_ports.items():
                self.pasts[path, name] = self._past(path, past)
        if faults:
            raise DiagramError(self.title, faults, self.where)
        self.held = set(held)
        self.d += [(*key, "held") for key in held]

    def _past(self, path: str, past: Past) -> PastValue:
        source, block = self.driver.get((path, past.of)), self.symbolic_blocks[path]
        if source is None:
            fault = f"{path}.{past.of} is delayed inside {path} and must be wired."
            raise DiagramError(self.title, [fault], self.where)
        return PastValue(past, source, getattr(block, past.by), getattr(block, past.initial))

    # ---- names

    def d_name(self, key: tuple[str, ...]) -> str:
        """The name of a memory state; that of a held output is marked, since a state may have the same name."""
        return f"{key[0]}.{key[1]}" + (" (held)" if is_held_output(key) else "")

    def signal_name(self, node: Node) -> str:
        """The log name of a node."""
        return node[1] if node[0] == "u" else f"{node[1]}.{node[2]}"

    def reads(self, path: str) -> dict[str, str]:
        """The signal at each input port of a block."""
        drivers = {port: self.driver.get((path, port)) for port in self.blocks[path].inports}
        return {port: self.signal_name(node) for port, node in drivers.items() if node is not None}
