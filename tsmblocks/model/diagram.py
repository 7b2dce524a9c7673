"""What a diagram is: named blocks, wires, inputs and outputs, as one value. Editing gives a new diagram.

It knows ports, names and units; nothing of equations or of running. A diagram may stand inside
another as a block, to any depth; a dot reaches into it (``"motor.drive.high"``).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import attrs

from tsmblocks.common import units
from tsmblocks.common.errors import DiagramError, ParameterError, TsmError, in_words, near
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.model import edits, unit_inference, validation
from tsmblocks.model.block import Block, Input, Output, is_reference, leaves, plain
from tsmblocks.model.wires import Link, chains, kind, not_a_block, short

_HERE = str(Path(__file__).parent.parent)
DEEPEST = 64
"""Levels of diagrams inside diagrams; more is a mistake or an attack."""


def _ports(given: Any) -> tuple[str, ...]:
    return tuple(given) if isinstance(given, (list, tuple)) else (given,)


@attrs.frozen
class Inlet:
    """An input of a diagram: the ports it drives, its unit and meaning."""

    ports: tuple[str, ...] = attrs.field(converter=_ports, eq=frozenset)
    unit: str = ""
    about: str = ""


def _frozen(given: Any) -> Any:
    """A mapping that stays as it is; anything else as it came, to be refused with a message."""
    return MappingProxyType(dict(given)) if isinstance(given, Mapping) else given


def _inlets(given: Any) -> Any:
    made = isinstance(given, Mapping)
    return _frozen({k: v if isinstance(v, Inlet) else Inlet(v) for k, v in given.items()} if made else given)


def _values(given: Any) -> Any:
    return _frozen({k: plain(v) for k, v in given.items()} if isinstance(given, Mapping) else given)


def _listed(wires: Any) -> Any:
    whole = isinstance(wires, str) or not isinstance(wires, Iterable)
    return wires if whole else tuple(wires)  # one text, or no list, is refused with the other faults


def _caller() -> str:
    """``file:line`` of the first frame outside this package: where the user wrote the diagram."""
    frame: Any = sys._getframe(1)
    while frame and (frame.f_code.co_filename.startswith((_HERE, "<attrs"))):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}" if frame else ""


@attrs.frozen(kw_only=True)
class Diagram:
    """Named blocks and the wires between them.

    ``blocks`` maps names to blocks (or diagrams); ``wires`` lists chains such as
    ``"error -> pid -> drive"``; ``inputs`` maps names to the port (or ports) they drive, or to an
    ``Inlet`` with a unit; ``outputs`` maps names to signals (``"tsm.y"``); ``values`` holds numbers
    used more than once, to which a block's parameter refers as ``"$theta"``.

    What these mean is found once, an end being (block, port): ``links`` from end to end, ``inlets`` the
    ends that each input drives, ``shown`` the end that each output shows, ``port_units`` the unit of each
    end where one is known, ``interface`` which inputs and outputs share a unit. ``where`` is the file and
    line in which the diagram was made, for messages.

    Raises DiagramError with all faults at once. Equal diagrams compare equal whatever the order of
    their wires.
    """

    title: str = ""
    source: str = ""
    blocks: Mapping[str, Block | Diagram] = attrs.field(converter=_frozen)
    wires: tuple[str, ...] = attrs.field(default=(), converter=_listed, eq=False, repr=False)
    inputs: Mapping[str, Inlet] = attrs.field(factory=dict, converter=_inlets)
    outputs: Mapping[str, str] = attrs.field(factory=dict, converter=_frozen)
    values: Mapping[str, float] = attrs.field(factory=dict, converter=_values)
    where: str = attrs.field(factory=_caller, eq=False, repr=False)
    links: tuple[Link, ...] = attrs.field(init=False, eq=frozenset, repr=False)
    inlets: Mapping[str, tuple[tuple[str, str], ...]] = attrs.field(init=False, eq=False, repr=False)
    shown: Mapping[str, tuple[str, str]] = attrs.field(init=False, eq=False, repr=False)
    port_units: Mapping[tuple[str, str], units.Unit] = attrs.field(init=False, eq=False, repr=False)
    interface: Mapping[str, tuple[str, units.Unit]] = attrs.field(init=False, eq=False, repr=False)

    def __attrs_post_init__(self) -> None:
        found = self._checked()
        object.__setattr__(self, "links", tuple(dict.fromkeys(found.links)))
        object.__setattr__(self, "inlets", _frozen(found.inlets))
        object.__setattr__(self, "shown", _frozen(found.shown))
        object.__setattr__(self, "port_units", _frozen(found.port_units))
        object.__setattr__(self, "interface", _frozen(found.interface))
        object.__setattr__(self, "wires", tuple(chains(self.links, self.blocks)))
        # one spelling of each end, so that "tsm" and "tsm.y" make equal diagrams
        full = {k: attrs.evolve(v, ports=[".".join(e) for e in found.inlets[k]]) for k, v in self.inputs.items()}
        object.__setattr__(self, "inputs", _frozen(full))
        object.__setattr__(self, "outputs", _frozen({k: ".".join(filter(None, e)) for k, e in found.shown.items()}))

    def _checked(self) -> validation.Checked:
        """What the wires, inputs and outputs mean; raises DiagramError with every fault found."""
        blocks = self.blocks
        wrong = [*validation.kind_faults({a.name: getattr(self, a.name) for a in attrs.fields(Diagram) if a.init})]
        if not wrong:
            wrong = [not_a_block(k, v) for k, v in blocks.items() if not isinstance(v, (Block, Diagram))]
        if not wrong and max((b.depth for b in blocks.values() if isinstance(b, Diagram)), default=0) >= DEEPEST:
            wrong = [f"diagrams stand inside diagrams more than {DEEPEST} deep."]
        if wrong:
            raise DiagramError(self.title, wrong, self.where)
        found = validation.examine(blocks, self.wires, self.inputs, self.outputs, self.values)
        if found.faults:
            raise DiagramError(self.title, found.faults, self.where)
        return found

    # ---- standing as a block in another diagram

    @property
    def depth(self) -> int:
        """Levels of diagrams inside this one."""
        return 1 + max((b.depth for b in self.blocks.values() if isinstance(b, Diagram)), default=0)

    @property
    def inports(self) -> dict[str, Input]:
        """Its inputs, as ports; an undeclared unit is the one found inside."""
        return {k: Input(v.about, v.unit or self._unit_of(*self.inlets[k])) for k, v in self.inputs.items()}

    @property
    def outports(self) -> dict[str, Output]:
        """Its outputs, as ports."""
        return {k: Output(f"signal {'.'.join(filter(None, end))}", self._unit_of(end)) for k, end in self.shown.items()}

    def _unit_of(self, *ends: tuple[str, str]) -> str:
        return next((unit_inference.name_of(self.port_units[e]) for e in ends if e in self.port_units), "")

    def unit(self, signal: str) -> str:
        """The unit of an output, or of a signal ``"block.port"``; ``""`` where none is known."""
        if signal in self.shown:
            return self._unit_of(self.shown[signal])
        if signal in self.inputs:
            return self.inports[signal].unit
        name, _, rest = signal.partition(".")
        block = self.blocks.get(name)
        if isinstance(block, Diagram) and rest:
            return block.unit(rest) or self._unit_of((name, rest))
        return self._unit_of((name, rest))

    # ---- parameters by name

    @property
    def parameters(self) -> dict[str, float]:
        """Every number that may be swept, fitted or overridden, by its full name.

        Numbers of the ``values`` table stand under their own name, once, not under the blocks
        that refer to them.
        """
        return dict(self._leaves())

    def _leaves(self, prefix: str = "") -> Iterator[tuple[str, float]]:
        for name, value in self.values.items():
            yield prefix + name, value
        for name, block in self.blocks.items():
            if isinstance(block, Diagram):
                yield from block._leaves(f"{prefix}{name}.")
                continue
            for key, value in block.parameters.items():
                for leaf, number in leaves(value, f"{prefix}{name}.{key}"):
                    if not is_reference(number):
                        yield leaf, number

    def parameter_names(self, prefix: str = "") -> Iterator[str]:
        """Every name ``with_parameters`` understands, options and whole lists included."""
        yield from (prefix + k for k in self.values)
        for name, block in self.blocks.items():
            if isinstance(block, Diagram):
                yield from block.parameter_names(f"{prefix}{name}.")
                continue
            for key in block.fields():
                yield f"{prefix}{name}.{key}"
                if not is_reference(getattr(block, key)) and isinstance(getattr(block, key), tuple):
                    yield from (leaf for leaf, _ in leaves(getattr(block, key), f"{prefix}{name}.{key}"))

    def with_parameters(self, changes: Mapping[str, Any]) -> Diagram:
        """The diagram with other numbers: ``{"pid.kp": 2.0, "motor.drive.high": 12.0, "theta": 5.0}``.

        A name of the ``values`` table changes every block that refers to it; naming one block's
        parameter changes that block alone. Raises ParameterError for a name it does not know.
        """
        if not isinstance(changes, Mapping) or not all(isinstance(name, str) for name in changes):
            raise ParameterError(f"parameters must map names to numbers, got {in_words(changes)}.")
        return edits.overridden(self, changes, self, "")

    def untied(self, names: Iterable[str]) -> Diagram:
        """The diagram in which each named parameter has its own number, equal to what it refers to now."""
        changes = {name: value for name in names if (value := self._referred(name)) is not None}
        return self.with_parameters(changes) if changes else self

    def _referred(self, name: str) -> float | None:
        """The number behind a parameter that refers to the values table; None for any other name."""
        head, _, rest = name.partition(".")
        block = self.blocks.get(head)
        if isinstance(block, Diagram):
            return block._referred(rest)
        if block is None:
            return None
        known: dict[str, Any] = {}
        for key, value in block.parameters.items():
            known.update(leaves(value, key))
        found = known.get(rest)
        return self.values[found[1:]] if found is not None and is_reference(found) else None

    # ---- edits

    def _with(self, **changes: Any) -> Diagram:
        """The same diagram with some fields changed (``wires`` may hold links or text)."""
        fields = {a.name: getattr(self, a.name) for a in attrs.fields(Diagram) if a.init}
        fields["wires"] = self.links
        return Diagram(**{**fields, **changes})

    def _inside(self, name: str, edit: str, *args: Any, **options: Any) -> Diagram | None:
        """Apply an edit whose name has a dot to the diagram it points into; None for a name without one."""
        head, _, rest = name.partition(".")
        if not rest:
            return None
        inner = self._need(head)
        if not isinstance(inner, Diagram):
            raise self._fault(
                f"{edit} '{name}': {head} is a {kind(inner)}, not a diagram, so nothing stands inside it."
            )
        try:
            changed = getattr(inner, edit)(rest, *args, **options)
        except DiagramError as error:
            raise DiagramError(self.title, [f"{head}: {p}" for p in error.problems], self.where) from None
        return self._with(blocks={**self.blocks, head: changed})

    def _fault(self, text: str) -> DiagramError:
        return DiagramError(self.title, [text], self.where)

    def _need(self, name: str) -> Block | Diagram:
        if name not in self.blocks:
            raise self._fault(f"there is no block '{name}'.{near(name, self.blocks)}")
        return self.blocks[name]

    def insert(
        self, name: str, block: Block | Diagram, *, after: str = "", before: str = "", wires: Iterable[str] = ()
    ) -> Diagram:
        """The diagram with a block put on a wire.

        ``after="motor"`` (or ``"motor.y"``, or an input's name) puts it on that signal: everything
        that listened, outputs included, now listens to the new block. ``before="tsm.x"`` (or an
        output's name) puts it in front of that one receiver. The block's usual input (of several, the one
        named ``u``) and output are used; ``wires`` connects any others, from inputs of the diagram too.
        A dotted ``name`` (``"motor.slack"``) edits the diagram inside block ``motor``, where ``after``,
        ``before`` and ``wires`` are then read.
        """
        inner = self._inside(name, "insert", block, after=after, before=before, wires=wires)
        if inner is not None:
            return inner
        if name in self.blocks:
            raise self._fault(f"there is a block '{name}' already; choose another name.")
        if bool(after) == bool(before):
            got = "both" if after else "neither"
            raise self._fault(f"insert '{name}' takes either after= or before=, got {got}.")
        return edits.inserted(self, name, block, after, before, edits.wires_in(self, "wires", wires))

    def replace(self, name: str, block: Block | Diagram, *, ports: Mapping[str, str] | None = None) -> Diagram:
        """The diagram with another block in the place of ``name``, wired the same way.

        ``ports`` maps old port names to new ones where they differ. Raises DiagramError when a port
        in use does not exist on the new block.
        """
        inner = self._inside(name, "replace", block, ports=ports)
        if inner is not None:
            return inner
        self._need(name)
        return edits.replaced(self, name, block, ports or {})

    def remove(self, name: str) -> Diagram:
        """The diagram without a block; what drove its only input then drives its listeners.

        Raises DiagramError when the block has several inputs or outputs in use, for then what should take its place
        is not known, and when its input is a rate ``v`` (friction, an observer), which cannot.
        """
        inner = self._inside(name, "remove")
        if inner is not None:
            return inner
        self._need(name)
        return edits.removed(self, name)

    def rewire(
        self,
        *,
        cut: Iterable[str] = (),
        add: Iterable[str] = (),
        blocks: Mapping[str, Block | Diagram] | None = None,
        inputs: Mapping[str, Any] | None = None,
        outputs: Mapping[str, str] | None = None,
        values: Mapping[str, float] | None = None,
        title: str | None = None,
        source: str | None = None,
    ) -> Diagram:
        """The diagram with wires cut (``"a.y -> b.u"``) and added, and other fields where they are given."""
        fields = {
            "blocks": blocks,
            "inputs": inputs,
            "outputs": outputs,
            "values": values,
            "title": title,
            "source": source,
        }
        return edits.rewired(
            self,
            edits.wires_in(self, "cut", cut),
            edits.wires_in(self, "add", add),
            {k: v for k, v in fields.items() if v is not None},
        )

    def __hash__(self) -> int:  # of what tells most diagrams apart
        return hash((self.title, frozenset(self.blocks), frozenset(self.links)))

    def __str__(self) -> str:
        lines = [self.title or "diagram", *(f"  {wire}" for wire in self.wires)]
        lines += [f"  {name} -> {', '.join(v.ports)}" for name, v in self.inputs.items()]
        lines += [f"  {signal} => {name}" for name, signal in self.outputs.items()]
        return "\n".join(lines)

    def __repr__(self) -> str:
        ends = {
            "inputs": {k: p.unit for k, p in self.inports.items()},
            "outputs": {k: self.unit(k) for k in self.outputs},
        }
        said = [
            f"{word} {few(f'{k} [{u}]' if u else k for k, u in named.items())}" for word, named in ends.items() if named
        ]
        count = f"{len(self.blocks)} block{'' if len(self.blocks) == 1 else 's'}"
        return f"Diagram({', '.join([repr(self.title), count, *said])})"

    def short(self, end: tuple[str, str]) -> str:
        """``block`` or ``block.port`` for an output port, as short as it can be said."""
        return short(end, self.blocks, "output")

    def _repr_svg_(self) -> str:
        """What notebooks show."""
        return view("svg", self)

    def __reduce__(self) -> Any:  # mapping proxies do not pickle
        plain = {
            "title": self.title,
            "source": self.source,
            "blocks": dict(self.blocks),
            "wires": self.links,
            "inputs": dict(self.inputs),
            "outputs": dict(self.outputs),
            "values": dict(self.values),
            "where": self.where,
        }
        return _rebuild, (plain,)


def needed(given: Any, use: str, error: type[TsmError]) -> Diagram:
    """``given``, if it is a diagram. Raises ``error``: only a diagram can be ``use`` ("run", "drawn")."""
    if isinstance(given, Diagram):
        return given
    hint = f" Load it first: tsmblocks.load({given!r})." if isinstance(given, str) else ""
    raise error(f"only a diagram can be {use}, got {in_words(given)}.{hint}")


def _rebuild(fields: dict[str, Any]) -> Diagram:
    return Diagram(**fields)
