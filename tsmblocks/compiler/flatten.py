"""A nested diagram as one level of blocks, with symbols for parameters.

Wires are followed through the borders of inner diagrams, and every symbol of a parameter is made once. No equation is
called here.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.common.errors import AlgebraicLoop, DiagramError, EquationError
from tsmblocks.compiler.dependencies import Structure, structure_of
from tsmblocks.model.block import Block, Past, is_reference
from tsmblocks.model.diagram import Diagram

Key = tuple[str, str]
"""Block and port, or block and state."""
Node = tuple[str, ...]
"""``("y", block, port)`` an output, ``("u", name)`` an input of the diagram.

While wires are followed there are ``("in", block, name)`` and ``("out", block, name)`` too, the borders of an inner
diagram. ``evaluate`` adds ``("dx", block, state)``, the derivative of a state, ``("rate", *node)``, the time derivative
of a signal, ``("past", block, name)``, a past value, and ``("tape", block, name)``, samples that a block supplies.
"""


def is_held_output(key: tuple[str, ...]) -> bool:
    """Whether an element of ``d`` is an output held between samples, and not a memory state."""
    return len(key) == 3


class FlatDiagram:
    """One level of blocks with symbols. Built once by ``flatten`` and only read afterwards.

    A block's path is its name after the names of the diagrams around it (``motor.drive``).

    - By path: ``blocks`` as given, ``symbolic_blocks`` with symbols, ``structures`` (their dependencies), ``group``
      (of a sampled block, the index of its period in ``periods`` [s]).
    - Wiring: ``driver`` is the node that drives each input port, ``shown`` the node of each output of the diagram.
    - Keys: ``x`` are the continuous states, ``resets`` those that updates set, ``d`` memory states, then the outputs of
      sampled blocks, which are ``held`` between samples. ``p`` are the symbols of parameters.
    - For each past value that is read one element of ``past_keys`` (block, port), ``pasts`` (its declaration),
      ``past_source`` (the delayed node), ``delays`` [s] and ``first_past`` (its value before the start).
    """

    def __init__(self, diagram: Diagram) -> None:
        self.diagram = diagram
        self.title, self.where = diagram.title, diagram.where
        self.t = ca.SX.sym("t")
        self.blocks: dict[str, Block] = {}  # as given
        self.symbolic_blocks: dict[str, Any] = {}  # with symbols for numbers
        self.structures: dict[str, Structure] = {}
        self.p: list[Any] = []
        self.p_names: list[str] = []
        self.p_values: list[float] = []
        self.inputs: dict[str, str] = {k: v.unit for k, v in diagram.inports.items()}
        self._raw: dict[Key, Node] = {}  # an input port (also of an inner diagram) -> what drives it
        self._inner: dict[str, Diagram] = {"": diagram}
        self._collect(diagram, "")
        followed = {k: self._followed(v) for k, v in self._raw.items()}
        self.driver = {k: v for k, v in followed.items() if k[0] in self.blocks}
        self.shown = {k: self._followed(self._source_node(diagram, "", end)) for k, end in diagram.shown.items()}
        self._make_symbols()

    # ---- hierarchy

    def _collect(self, diagram: Diagram, prefix: str) -> None:
        scope = {}
        for name, value in diagram.values.items():
            scope[name] = self._parameter(prefix + name, value)
        for name, block in diagram.blocks.items():
            path = prefix + name
            if isinstance(block, Diagram):
                self._inner[path + "."] = block
                self._collect(block, path + ".")
            else:
                self._add(path, block, scope)
        for link in diagram.links:
            self._raw[prefix + link.target[0], link.target[1]] = self._source_node(diagram, prefix, link.source)
        for name, ends in diagram.inlets.items():
            for end in ends:
                node = ("u", name) if not prefix else ("in", prefix[:-1], name)
                self._raw[prefix + end[0], end[1]] = node

    def _source_node(self, diagram: Diagram, prefix: str, end: Key) -> Node:
        """The node of an output port; for a port of an inner diagram, the border of that diagram."""
        name, port = end
        if not name:  # an input passed straight through
            return ("u", port) if not prefix else ("in", prefix[:-1], port)
        if isinstance(diagram.blocks[name], Diagram):
            return ("out", prefix + name, port)
        return ("y", prefix + name, port)

    def _followed(self, node: Node) -> Node:
        """The output of a block, or the input of the whole diagram, that lies behind borders of inner diagrams."""
        seen: list[Node] = []
        while node[0] in ("in", "out"):
            if node in seen:
                back = [*seen[seen.index(node) :], node]  # against the flow
                names = [f"{path}.{port}" for _, path, port in reversed(back)]
                raise AlgebraicLoop(
                    self.title,
                    [f"{' -> '.join(names)} joins diagrams in a ring that holds no block, so the signal has no value."],
                    self.where,
                    names,
                )
            seen.append(node)
            kind, path, port = node
            if kind == "in":
                node = self._raw[path, port]
            else:
                inner = self._inner[path + "."]
                node = self._source_node(inner, path + ".", inner.shown[port])
        return node

    # ---- symbols

    def _parameter(self, name: str, value: float) -> Any:
        symbol = ca.SX.sym(name)
        self.p.append(symbol)
        self.p_names.append(name)
        self.p_values.append(value)
        return symbol

    def _add(self, path: str, block: Block, scope: dict[str, Any]) -> None:
        def symbol(leaf: str, value: Any) -> Any:
            return scope[value[1:]] if is_reference(value) else self._parameter(f"{path}.{leaf}", value)

        self.blocks[path] = block
        self.symbolic_blocks[path] = block.with_symbols(symbol)
        try:
            self.structures[path] = structure_of(block)
        except EquationError as error:
            raise EquationError(f"{path}: {error}") from error.__cause__

    def _make_symbols(self) -> None:
        self.x: list[Key] = []
        self.d: list[tuple[str, ...]] = []  # (block, state) for memory, then (block, port, "held")
        self.resets: list[Key] = []
        self.periods: list[float] = []
        self.group: dict[str, int] = {}
        self.past_keys: list[Key] = []
        self.delays: list[Any] = []
        self.first_past: list[Any] = []
        self.past_source: list[Node] = []
        self.pasts: list[Past] = []
        held: list[Key] = []
        for path, block in self.blocks.items():
            shape = self.structures[path]
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
                self._past(path, name, past)
        self.held = set(held)
        self.d += [(*key, "held") for key in held]

    def _past(self, path: str, name: str, past: Past) -> None:
        source = self.driver.get((path, past.of))
        if source is None:
            raise DiagramError(
                self.title, [f"{path}.{past.of} is delayed inside {path} and must be wired."], self.where
            )
        self.past_keys.append((path, name))
        self.delays.append(getattr(self.symbolic_blocks[path], past.by))
        self.first_past.append(getattr(self.symbolic_blocks[path], past.initial))
        self.past_source.append(source)
        self.pasts.append(past)

    # ---- names

    def d_name(self, key: tuple[str, ...]) -> str:
        """The name of a memory state; that of a held output is marked, since a state may have the same name."""
        return f"{key[0]}.{key[1]}" + (" (held)" if is_held_output(key) else "")

    def signal_name(self, node: Node) -> str:
        """The log name of a node."""
        return node[1] if node[0] == "u" else f"{node[1]}.{node[2]}"

    def reads(self, path: str) -> dict[str, str]:
        """The signal at each input port of a block."""
        return {
            port: self.signal_name(self.driver[path, port])
            for port in self.blocks[path].inports
            if (path, port) in self.driver
        }


def flatten(diagram: Diagram) -> FlatDiagram:
    """One level of blocks with symbols. Raises AlgebraicLoop for a ring of inner diagrams without a block."""
    return FlatDiagram(diagram)
