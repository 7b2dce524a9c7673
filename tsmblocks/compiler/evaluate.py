"""Signals as expressions, formed on demand in the order that the equations dictate.

A node is an output of a block, the derivative of a state, the time derivative of a signal, or a past value. It is
formed when all nodes that it reads are formed. A node that is needed while it is being formed is part of an algebraic
loop, and the stack is the path of the loop: the loop is torn there, that is, the node is a symbol for what reads it,
and its own expression is kept to be solved (``engine.closure``). There is no recursion, so chains may be long. Past
values are expressions of what the engine stores of a signal.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

import casadi as ca

from tsmblocks.common.errors import AlgebraicLoop, DiagramError
from tsmblocks.compiler.constant_signals import ConstantWith, constant_with
from tsmblocks.compiler.dependencies import EQUATIONS, call
from tsmblocks.compiler.flatten import FlatDiagram, Node, is_held_output
from tsmblocks.compiler.past_values import held_past, interpolated_past, mean_past
from tsmblocks.engine.closure import Tear
from tsmblocks.engine.equations import DELAY_NUMBERS, SampledInput
from tsmblocks.model.block import signals

_PENDING = ca.SX.sym("pending")
"""Placeholder of an input that has not been formed."""
_RATE_OF = {"x": "dx", "loop": "rate"}
"""Kind of the node that is the time derivative of a symbol."""


class Evaluator:
    """Expressions of all signals, either between samples (``held``) or at a sample instant.

    Between samples the outputs of sampled blocks are symbols, the values held; at a sample instant they are recomputed.
    ``share`` is an evaluator whose symbols this one uses, so that the expressions of both belong together.
    ``held_inputs`` are inputs of the diagram that are constant within steps.

    ``value`` holds the nodes that have been formed, ``tears`` those at which loops are torn; with ``refuse`` a loop is
    an error. Symbols: ``x`` and ``d`` of states, ``u`` of sampled inputs and their derivatives, ``q`` of the past of
    delayed signals, ``hit`` whether each rate group is sampled now; ``owner`` maps a symbol (its hash) to what it
    denotes. ``differentiated`` are the past values that a rate was formed of.
    """

    def __init__(
        self,
        flat: FlatDiagram,
        *,
        held: bool,
        refuse: bool,
        held_inputs: frozenset[str],
        share: Evaluator | None = None,
    ) -> None:
        self.flat, self.held, self.refuse, self.held_inputs = flat, held, refuse, held_inputs
        self.tears: dict[Node, Tear] = {}
        self.differentiated: set[tuple[str, str]] = set() if share is None else share.differentiated
        if share is None:
            self.x = {k: ca.SX.sym(".".join(k)) for k in flat.x}
            self.d = {k: ca.SX.sym(flat.d_name(k)) for k in flat.d}
            self.u: dict[tuple[Any, ...], Any] = {}  # ("u", name[, order]) or ("tape", block, name, ...)
            self.q = {k: ca.vertsplit(ca.SX.sym(".".join(k), DELAY_NUMBERS)) for k in flat.pasts}
            states: dict[str, dict[Any, Any]] = {"x": self.x, "d": self.d}
            self.owner: dict[int, tuple[Any, ...]] = {flat.t.element_hash(): ("t",)}
            self.owner |= {v.element_hash(): (kind, k) for kind, table in states.items() for k, v in table.items()}
            self.owner |= {v.element_hash(): ("q", k) for k, kept in self.q.items() for v in kept}
        else:
            self.x, self.d, self.u, self.q, self.owner = share.x, share.d, share.u, share.q, share.owner
        self.value: dict[Node, Any] = {("u", name): self._input_symbol(("u", name, 0)) for name in flat.inputs}
        self.hit = ca.SX.sym("hit", len(flat.periods))

    # ---- results, for ``compile``

    def updates(self) -> tuple[list[Any], list[Any]]:
        """Memory and held outputs after a sample instant, and continuous states after it."""
        flat = self.flat
        fresh: dict[tuple[str, ...], Any] = {}
        for path, shape in flat.structures.items():
            if shape.memory or shape.resets:
                fresh |= self._updated(path)
            elif flat.switches[path]:
                self.form(self._switch_nodes(path, "y"))
        held = [key[:2] for key in flat.d if is_held_output(key)]
        self.form(("y", *key) for key in held)
        fresh |= {(*key, "held"): self.value["y", *key] for key in held}
        d = [fresh[key] for key in flat.d]
        switched = {path: self._states(path) for path, _ in flat.x if flat.switches[path]}
        x = [fresh.get(key, getattr(switched[key[0]], key[1]) if key[0] in switched else self.x[key]) for key in flat.x]
        return d, x

    def _updated(self, path: str) -> dict[tuple[str, ...], Any]:
        """New memory of one block; a sampled block keeps its own between samples."""
        flat, block = self.flat, self.flat.symbolic_blocks[path]
        nodes = {name: self._source(path, name) for name in block.read_names}
        self.form([*nodes.values(), *self._switch_nodes(path, "dx")])
        new = self._call(path, "updates", {name: self.value[node] for name, node in nodes.items()})
        acts = self._sampled_now(path) if path in flat.group else self._on(path)
        if acts is not None:
            x = self._states(path)
            new = {k: ca.if_else(acts, v, getattr(x, k)) for k, v in new.items()}
        return {(path, k): v for k, v in new.items()}

    def sampled_inputs(self) -> Iterable[Any]:
        """The sampled inputs in use, in the order of ``symbols``."""
        for kind, *path, order in self.u:
            name, (block, tape) = ".".join(path), path if kind == "tape" else ("", "")
            unit = self.flat.inputs[name] if kind == "u" else ""
            yield SampledInput("d/dt " * order + name, block, tape, order, unit)

    def symbols(self) -> tuple[list[Any], ...]:
        """Symbols of x, d, u and q, each in order."""
        x, d = [self.x[k] for k in self.flat.x], [self.d[k] for k in self.flat.d]
        return x, d, list(self.u.values()), list(itertools.chain(*self.q.values()))

    # ---- forming nodes

    def form(self, goals: Iterable[Node]) -> None:
        """Form nodes and all that they need, depth first, with a stack."""
        for goal in goals:
            if goal in self.value:
                continue
            stack, place = [goal], {goal: 0}  # what is being formed, and the place of each in the stack
            while stack:
                node = stack[-1]
                missing = next((n for n in self._form(node) if n not in self.value), None)
                if missing is None:
                    stack.pop()
                    del place[node]
                    continue
                if missing in place:
                    self._tear([*stack[place[missing] :], missing])
                    continue
                place[missing] = len(stack)
                stack.append(missing)

    def _tear(self, nodes: list[Node]) -> None:
        """Tear a loop at the node where it closes. Raises AlgebraicLoop where loops are refused."""
        node = nodes[-1]
        if self.refuse:
            self._raise_loop(nodes)
        symbol = ca.SX.sym(f"loop at {self._named(node)}")
        self.tears[node] = Tear(symbol, self._loop_path(nodes))
        self.value[node] = symbol
        self.owner[symbol.element_hash()] = ("loop", node)

    def _set(self, node: Node, value: Any) -> None:
        """Keep the expressions that have been formed."""
        if node in self.tears:
            self.tears[node].expression = value
        else:
            self.value[node] = value

    def _form(self, node: Node) -> Iterable[Node]:
        """Form a node and return nothing; or, where it cannot be formed yet, return the nodes that it needs first."""
        if node[0] == "rate":
            return self._form_rate(node)
        if node[0] == "past":
            return self._form_past(node)
        if node[0] == "tape":
            self._set(node, self._input_symbol((*node, 0)))
            return ()
        kind, path, name = node
        flat, shape = self.flat, self.flat.structures[path]
        if kind == "y" and self.held and (path, name) in flat.held:
            self.value[node] = self.d[path, name, "held"]
            return ()
        wanted = shape.outputs[name] if kind == "y" else shape.rates[name]
        block = flat.symbolic_blocks[path]
        # In the order of ports: that of the set ``wanted`` differs between processes.
        ordered = wanted if len(wanted) < 2 else [name for name in block.read_names if name in wanted]
        needed = [*(self._source(path, k) for k in ordered), *self._switch_nodes(path, kind)]
        missing = [n for n in needed if n not in self.value]
        if not missing:
            self._evaluate(path, kind)
        return missing

    def _evaluate(self, path: str, kind: str) -> None:
        """Form every output (or derivative) of a block whose inputs have been formed.

        The equation gives all results at once; an input that has not been formed is replaced by a placeholder, and
        results that depend on it are discarded.
        """
        flat, block, shape = self.flat, self.flat.symbolic_blocks[path], self.flat.structures[path]
        nodes = {name: self._source(path, name, strict=False) for name in block.read_names}
        values = {name: self.value.get(node, _PENDING) for name, node in nodes.items()}
        ready = {name for name, node in nodes.items() if node in self.value}
        needs = shape.outputs if kind == "y" else shape.rates
        result = self._call(path, EQUATIONS[kind], values)
        on = self._on(path) if kind == "dx" else None
        for name, wanted in needs.items():
            node = (kind, path, name)
            if wanted <= ready and (node not in self.value or node in self.tears):
                value = result[name] if on is None else ca.if_else(on, result[name], 0.0)
                if kind == "y" and path in flat.group:
                    begins = self._begins(path)
                    acts = self._sampled_now(path)
                    acts = acts if begins is None else ca.logic_or(acts, begins)
                    value = ca.if_else(acts, value, self.d[path, name, "held"])
                self._set(node, value)

    # ---- diagrams that are switched on and off

    def _switch_nodes(self, path: str, kind: str) -> list[Node]:
        """Nodes for when the switches of a block act, as far as its outputs (or derivatives) need them."""
        flat, around = self.flat, self.flat.switches[path]
        if not around:
            return []
        on = [one.on for one in around if kind == "dx" or (not self.held and path in flat.group)]
        return on + [one.begins for one in around if one.resets and not self.held and flat.blocks[path].states]

    def _on(self, path: str) -> Any:
        """Whether everything that switches a block is on; None without any."""
        nodes = [self.value[one.on] for one in self.flat.switches[path]]
        return functools.reduce(ca.logic_and, nodes) if nodes else None

    def _begins(self, path: str) -> Any:
        """Whether the states of a block take their initial values at this instant; None where they never do."""
        nodes = [self.value[one.begins] for one in self.flat.switches[path] if one.resets]
        return functools.reduce(ca.logic_or, nodes) if nodes and not self.held else None

    def _sampled_now(self, path: str) -> Any:
        """Whether a sampled block acts at this instant."""
        hit, on = self.hit[self.flat.group[path]], self._on(path)
        if any(one.triggers for one in self.flat.switches[path]):
            return on
        return hit if on is None else ca.logic_and(hit, on)

    def _form_past(self, node: Node) -> Iterable[Node]:
        """A past value; where the present value takes part in it, that is formed first."""
        t, one, kept = self.flat.t, self.flat.pasts[node[1], node[2]], self.q[node[1], node[2]]
        if one.past.now and one.source not in self.value:
            return (one.source,)
        first = None if one.past.first else one.initial
        now = self.value[one.source] if one.past.now else None
        constant = self.constant_with(one.source)
        if constant is None or not constant.inputs <= self.held_inputs:
            past = interpolated_past(kept, t, one.delay, first, now)
        elif one.past.now or constant.inputs:
            past = mean_past(kept, t, one.delay, first, now)
        else:
            past = held_past(kept, t, one.delay, first)
        self._set(node, past)
        return ()

    def constant_with(self, source: Node) -> ConstantWith | None:
        """With which inputs a signal is constant within steps; None where it never is."""
        return constant_with(self.flat, source, self._source)

    def _form_rate(self, node: Node) -> Iterable[Node]:
        """The time derivative of a signal, by the chain rule over its states, inputs and time."""
        source: Node = node[1:]
        if source not in self.value:
            return (source,)
        expression = self.tears[source].expression if source in self.tears else self.value[source]
        if expression is None:  # it is being formed: its derivative would be part of it
            self._raise_loop([node, source, node])
        symbols = ca.symvar(expression)
        owners = [self.owner.get(s.element_hash(), ("p",)) for s in symbols]
        needs = [(_RATE_OF[o[0]], *o[1]) for o in owners if o[0] in _RATE_OF]
        missing = [n for n in needs if n not in self.value]
        if missing:
            return missing
        rates = [self._symbol_rate(owner, source) for owner in owners]
        self._set(node, ca.jtimes(expression, ca.vertcat(ca.SX(0, 1), *symbols), ca.vertcat(ca.SX(0, 1), *rates)))
        return ()

    def _symbol_rate(self, owner: tuple[Any, ...], source: Node) -> Any:
        """The time derivative of a symbol."""
        kind = owner[0]
        if kind == "t":
            return ca.SX(1)
        if kind == "q":
            return self._past_rate(owner[1], source)
        if kind in _RATE_OF:
            return self.value[_RATE_OF[kind], *owner[1]]
        if kind == "input":
            *name, order = owner[1]
            return self._input_symbol((*name, order + 1))
        if kind == "d" and is_held_output(owner[1]):
            self._raise_sampled_rate(owner[1], source)
        return ca.SX(0)

    def _past_rate(self, key: tuple[str, str], source: Node) -> Any:
        """The time derivative of a stored value of a delayed signal, which is a number; of samples there is none."""
        self.differentiated.add(key)
        one = self.constant_with(self.flat.pasts[key].source)
        if one is not None and one.samples:
            self._raise_sampled_rate(one.samples[0], source)
        return ca.SX(0)

    def _raise_sampled_rate(self, sample: tuple[str, ...], source: Node) -> NoReturn:
        fault = (
            f"{self._ports_with_rate(source)}, which depends on {'.'.join(sample[:2])}, a sampled output held "
            "constant between samples. Use a FilteredDerivative, or differentiate before sampling."
        )
        raise DiagramError(self.flat.title, [fault], self.flat.where)

    def _ports_with_rate(self, source: Node) -> str:
        """The ports that need the derivative of a signal."""
        flat = self.flat
        ports = [
            f"{path}.{name}"
            for path, block in flat.symbolic_blocks.items()
            for name in block.inports
            if self._source(path, name, strict=False) == ("rate", *source)
        ]
        ports_are = f"{', '.join(ports)} {'is' if len(ports) == 1 else 'are'} the derivative"
        return f"{ports_are if ports else 'the derivative is needed'} of {self._named(source)}"

    # ---- names, sources and calls

    def _named(self, node: Node) -> str:
        """The log name of a signal, or of its rate."""
        return f"d/dt {self._named(node[1:])}" if node[0] == "rate" else self.flat.signal_name(node)

    def _input_symbol(self, key: tuple[Any, ...]) -> Any:
        """The symbol of a sampled input, or of its derivative of some order; made on first use."""
        if key not in self.u:
            symbol = ca.SX.sym(" ".join(map(str, key[1:])))
            self.u[key] = symbol
            self.owner[symbol.element_hash()] = ("input", key)
        return self.u[key]

    def _source(self, path: str, name: str, strict: bool = True) -> Any:
        """The node that an input reads: a signal, its derivative, a past value or a tape."""
        flat = self.flat
        if (path, name) in flat.driver:
            return flat.driver[path, name]
        port = flat.symbolic_blocks[path].inports.get(name)
        if port is None:
            return ("past" if (path, name) in flat.pasts else "tape", path, name)
        driver = self._source(path, port.rate_of, strict=False) if port.rate_of else None
        if driver is None and strict:
            fault = f"{path}.{name} is the rate of {path}.{port.rate_of}, which is driven by nothing."
            raise DiagramError(flat.title, [fault], flat.where)
        return None if driver is None else ("rate", *driver)

    def _states(self, path: str) -> Any:
        """States of a block by name."""
        block, shape = self.flat.symbolic_blocks[path], self.flat.structures[path]
        values = {k: self.x[path, k] if k in shape.rates else self.d[path, k] for k in block.states}
        begins = self._begins(path) if values else None
        if begins is not None:
            values = {k: ca.if_else(begins, block.states[k].start, v) for k, v in values.items()}
        return signals(list(values), values.values())

    def _call(self, path: str, equation: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """One equation of a block, with ``values`` as its inputs, in the order of ports."""
        block, inputs = self.flat.symbolic_blocks[path], signals(list(values), values.values())
        return call(block, equation, self.flat.t, self._states(path), inputs, path)

    def _raise_loop(self, nodes: list[Node]) -> None:
        """Raise AlgebraicLoop with the path of the loop."""
        path = self._loop_path(nodes)
        raise AlgebraicLoop(self.flat.title, [self._loop_text(path, nodes)], self.flat.where, path)

    def _loop_path(self, nodes: list[Node]) -> list[str]:
        """Signals around a loop, in the direction of flow."""
        path: list[str] = []
        for node in reversed(nodes):
            signal = self._named(node) if node[0] == "rate" else f"{node[1]}.{node[2]}"
            if node[0] not in ("dx", "past") and (not path or path[-1] != signal):
                path.append(signal)
        if len(path) == 1 or path[0] != path[-1]:
            path.append(path[0])
        return path

    def _loop_text(self, path: list[str], nodes: list[Node]) -> str:
        """The message of a loop, with the remedy for its kind."""
        ring = " -> ".join(path)
        if any(node[0] == "rate" for node in nodes):
            return (
                f"{ring} needs its own value at the same instant: a derivative removes the state that it "
                "differentiates. Replace it by a FilteredDerivative."
            )
        states = "a block that has a state (a lag, an integrator)"
        if any(node[0] == "y" and node[1] in self.flat.group for node in nodes):
            at, remedy = "a sample", f"a UnitDelay, or with {states}."
        else:
            at, remedy = "one instant", f"{states}, with a Delay, or with a sampled block."
            remedy += self._zero_coefficient_hint(nodes)
        return f"{ring} has no state in it, so its value at {at} depends on itself. Break it with {remedy}"

    def _zero_coefficient_hint(self, nodes: list[Node]) -> str:
        """A sentence on blocks of a loop without direct feedthrough, a coefficient being 0; ``""`` without any."""
        flat, idle = self.flat, list[str]()
        numbers = ca.vertcat(*flat.p.values()), ca.DM(flat.p_values)
        for (kind, path, port), read in itertools.pairwise(node for node in nodes if node[0] != "rate"):
            symbols = {name: ca.SX.sym(name) for name in flat.symbolic_blocks[path].read_names}
            around = [s for k, s in symbols.items() if self._source(path, k, strict=False) == read]
            if kind == "y" and around:
                made = self._call(path, "outputs", symbols)[port]
                if not ca.depends_on(ca.substitute(made, *numbers), ca.vertcat(*around)):
                    idle.append(path)
        what = (
            "would have no direct feedthrough, since a coefficient is 0; a leading 0 of num, or a D of zeros, counts "
            "as a path"
        )
        return f" Now {' and '.join(idle)} {what} until it is left out." if idle else ""
