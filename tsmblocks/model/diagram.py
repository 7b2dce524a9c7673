"""Diagrams: named blocks, wires, inputs and outputs, as one value. Editing gives a new diagram.

It knows ports, names and units, but no equations and no simulation. A diagram may be a block of another, to any
depth; a dotted name refers to what is inside (``"motor.drive.high"``).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import attrs

from tsmblocks.common import headings, units
from tsmblocks.common.errors import TsmError, in_words
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.model import edits, parameters, unit_inference
from tsmblocks.model.arguments import Inlet, as_inlets, as_values, as_wires, caller, meaning, read_only
from tsmblocks.model.block import Block, Input, Output
from tsmblocks.model.simulation import Simulation
from tsmblocks.model.wires import End, Link, end_text, short_name


@attrs.frozen(kw_only=True)
class Diagram:
    """Named blocks and the wires between them: a value, equal to another whatever the order of their wires.

    The arguments are texts, whose meaning is computed once, in terms of ends, that is pairs (block, port): ``links``
    are the ``wires`` from end to end, ``inlets`` the ends that each of the ``inputs`` drives, ``shown`` the end behind
    each of the ``outputs``, ``port_units`` the known unit of each end, ``interface`` which inputs and outputs share a
    unit. ``inports`` and ``outports`` are the inputs and outputs as ports of a block.

    Parameters
    ----------
    title, source : str, default ""
        Title, and origin of the diagram (a paper, a data sheet).
    blocks : mapping of str to Block or Diagram
        Blocks by name.
    wires : sequence of str, default ()
        Chains such as ``"error -> pid -> drive.u, scope"``; a port is left out where the block has only one.
    inputs : mapping of str to str, sequence of str or Inlet, default {}
        Port (or ports) that each input drives.
    outputs : mapping of str to str, default {}
        Signal of each output (``"tsm.y"``).
    values : mapping of str to float, default {}
        Numbers that several parameters refer to, as ``"$theta"``.
    output_units : mapping of str to str, default {}
        Unit of an output where no port gives one.
    where : str, optional
        ``file:line`` for messages, by default that of the caller.
    simulation : Simulation, optional
        How it was simulated on recordings, as files of fitted diagrams say; ignored when diagrams are compared.

    Raises
    ------
    DiagramError
        For blocks and wires that do not fit together, with every fault.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> from tsmblocks.blocks import FirstOrderLag, Gain
    >>> tsm.Diagram(
    ...     title="an amplifier",
    ...     blocks={"gain": Gain(gain=3.0), "lag": FirstOrderLag(time_constant=0.1)},
    ...     wires=["gain -> lag"],
    ...     inputs={"u": "gain"},
    ...     outputs={"y": "lag"},
    ... )
    Diagram('an amplifier', 2 blocks, inputs u, outputs y)
    """

    title: str = ""
    source: str = ""
    blocks: Mapping[str, Block | Diagram] = attrs.field(converter=read_only)
    wires: tuple[str, ...] = attrs.field(default=(), converter=as_wires, eq=False, repr=False)
    inputs: Mapping[str, Inlet] = attrs.field(factory=dict, converter=as_inlets)
    outputs: Mapping[str, str] = attrs.field(factory=dict, converter=read_only)
    values: Mapping[str, float] = attrs.field(factory=dict, converter=as_values)
    output_units: Mapping[str, str] = attrs.field(factory=dict, converter=read_only)
    where: str = attrs.field(factory=caller, eq=False, repr=False)
    simulation: Simulation = attrs.field(factory=Simulation, eq=False, repr=False)
    links: tuple[Link, ...] = attrs.field(init=False, eq=frozenset, repr=False)
    inlets: Mapping[str, tuple[End, ...]] = attrs.field(init=False, eq=False, repr=False)
    shown: Mapping[str, End] = attrs.field(init=False, eq=False, repr=False)
    port_units: Mapping[End, units.Unit] = attrs.field(init=False, eq=False, repr=False)
    interface: Mapping[str, tuple[str, units.Unit]] = attrs.field(init=False, eq=False, repr=False)

    def __attrs_post_init__(self) -> None:
        for name, value in meaning(self, Diagram).items():
            object.__setattr__(self, name, value)

    # ---- as a block of another diagram

    @property
    def depth(self) -> int:
        """Levels of diagrams inside this one."""
        return 1 + max((b.depth for b in self.blocks.values() if isinstance(b, Diagram)), default=0)

    @property
    def inports(self) -> dict[str, Input]:
        """Its inputs as ports; an undeclared unit is inferred from the ports that they drive."""
        return {k: Input(v.about, v.unit or self._unit_of(*self.inlets[k])) for k, v in self.inputs.items()}

    @property
    def outports(self) -> dict[str, Output]:
        """Its outputs as ports."""
        return {k: Output(f"signal {end_text(end)}", self.unit(k)) for k, end in self.shown.items()}

    def _unit_of(self, *ends: End) -> str:
        return next((unit_inference.unit_label(self.port_units[e]) for e in ends if e in self.port_units), "")

    def unit(self, signal: str) -> str:
        """Return the unit of a signal.

        Parameters
        ----------
        signal : str
            An output or input of the diagram, or ``"block.port"``.

        Returns
        -------
        str
            Its unit, ``""`` where none is known.
        """
        if signal in self.shown:
            return self.output_units.get(signal) or self._unit_of(self.shown[signal])
        if signal in self.inputs:
            return self.inports[signal].unit
        name, _, rest = signal.partition(".")
        block = self.blocks.get(name)
        inner = block.unit(rest) if isinstance(block, Diagram) and rest else ""
        return inner or self._unit_of((name, rest))

    # ---- parameters by name

    @property
    def parameters(self) -> dict[str, float]:
        """Every number that may be swept, fitted or overridden, by its full name.

        Entries of the ``values`` table are listed under their own name, not under the blocks that refer to them.
        """
        return parameters.numbers(self)

    def parameter_names(self) -> Iterator[str]:
        """Yield every name that ``with_parameters`` takes, options and whole lists included.

        Yields
        ------
        str
            A full name (``"pid.kp"``, ``"filter.den[1]"``).
        """
        yield from parameters.names(self)

    def with_parameters(self, changes: Mapping[str, Any]) -> Diagram:
        """Return the diagram with other parameters.

        Parameters
        ----------
        changes : mapping of str to float
            Values by full name: ``{"pid.kp": 2.0, "motor.drive.high": 12.0, "theta": 5.0}``. An entry of the ``values``
            table changes every block that refers to it, a parameter of one block only that block.

        Returns
        -------
        Diagram
            The changed diagram.

        Raises
        ------
        ParameterError
            For an unknown name, and for a value that a block refuses.
        """
        return parameters.changed(self, changes)

    def with_simulation(self, simulation: Simulation) -> Diagram:
        """Return the diagram with settings of its simulation on recordings.

        Parameters
        ----------
        simulation : Simulation
            Step, method, interpolation and initial states.

        Returns
        -------
        Diagram
            The same diagram otherwise.
        """
        return self._with(simulation=simulation)

    def untied(self, names: Iterable[str]) -> Diagram:
        """Return the diagram in which parameters have their own numbers instead of references.

        Parameters
        ----------
        names : iterable of str
            Parameters; those that refer to the ``values`` table get the present value of their entry.

        Returns
        -------
        Diagram
            The changed diagram.
        """
        changes = parameters.referred(self, names)
        return self.with_parameters(changes) if changes else self

    # ---- edits

    def _fields(self) -> dict[str, Any]:
        """The arguments that make this diagram."""
        return {a.name: getattr(self, a.name) for a in attrs.fields(Diagram) if a.init}

    def _with(self, **changes: Any) -> Diagram:
        """The same diagram with some fields changed (``wires`` may hold links or text)."""
        fields = {**self._fields(), "wires": self.links, **changes}
        kept = {k: v for k, v in fields["output_units"].items() if k in fields["outputs"]}
        return Diagram(**{**fields, "output_units": kept})

    def _with_numbers(self, blocks: Mapping[str, Any], values: Mapping[str, Any]) -> Diagram:
        """The same diagram with other numbers in blocks whose ports stay the same; nothing is checked.

        Checks of wires and units take most of the time that a new set of parameters costs.
        """
        made: Diagram = object.__new__(Diagram)
        for field in attrs.fields(Diagram):
            object.__setattr__(made, field.name, getattr(self, field.name))
        object.__setattr__(made, "blocks", read_only(blocks))
        object.__setattr__(made, "values", as_values(values))
        return made

    def insert(
        self, name: str, block: Block | Diagram, *, after: str = "", before: str = "", wires: Iterable[str] = ()
    ) -> Diagram:
        """Return the diagram with a block put on a wire.

        The wire enters the block's only input, or the one named ``u``. With a dotted ``name`` (``"motor.slack"``)
        the diagram inside block ``motor`` is edited, to which ``after``, ``before`` and ``wires`` refer.

        Parameters
        ----------
        name : str
            Name of the new block.
        block : Block or Diagram
            The new block.
        after : str, default ""
            Signal that the block is put on (``"motor"``, ``"motor.y"``, an input): it then drives all its receivers,
            outputs of the diagram included.
        before : str, default ""
            Receiver that the block is put in front of (``"tsm.x"``, an output), where ``after`` is not given; or
            several that one signal drives, with commas (``"error.minus, x"``).
        wires : iterable of str, default ()
            Chains to other ports of the block, from inputs of the diagram too.

        Returns
        -------
        Diagram
            The changed diagram.

        Raises
        ------
        DiagramError
            When the name is taken, or the block does not fit.
        """
        return edits.insert(self, name, block, after, before, wires)

    def replace(self, name: str, block: Block | Diagram, *, ports: Mapping[str, str] | None = None) -> Diagram:
        """Return the diagram with one block replaced by another, wired the same way.

        Parameters
        ----------
        name : str
            The block that is replaced.
        block : Block or Diagram
            The new block.
        ports : mapping of str to str, optional
            Port of the new block for each port of the old one whose name differs.

        Returns
        -------
        Diagram
            The changed diagram.

        Raises
        ------
        DiagramError
            When a port in use does not exist on the new block.
        """
        return edits.replace(self, name, block, ports or {})

    def remove(self, name: str) -> Diagram:
        """Return the diagram without a block; the signal at its only input then drives its receivers.

        Parameters
        ----------
        name : str
            The block that is removed.

        Returns
        -------
        Diagram
            The changed diagram.

        Raises
        ------
        DiagramError
            When the block has several inputs or outputs in use, or its input is a rate ``v`` (friction, an observer),
            so that no signal can replace it.
        """
        return edits.remove(self, name)

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
        """Return the diagram with wires cut and added, and other fields where they are given.

        Parameters
        ----------
        cut : iterable of str, default ()
            Wires to remove (``"a.y -> b.u"``).
        add : iterable of str, default ()
            Chains to add.
        blocks, inputs, outputs, values : mapping, optional
            Whole fields that replace those of the diagram.
        title, source : str, optional
            As for ``Diagram``.

        Returns
        -------
        Diagram
            The changed diagram.

        Raises
        ------
        DiagramError
            When a wire to cut does not exist, or the result does not fit together.
        """
        changes = dict(title=title, source=source, blocks=blocks, inputs=inputs, outputs=outputs, values=values)
        return edits.rewire(self, cut, add, changes)

    def __hash__(self) -> int:  # of parts in which most diagrams differ
        return hash((self.title, frozenset(self.blocks), frozenset(self.links)))

    def __str__(self) -> str:
        lines = [self.title or "diagram", *(f"  {wire}" for wire in self.wires)]
        lines += [f"  {name} -> {', '.join(v.ports)}" for name, v in self.inputs.items()]
        lines += [f"  {signal} => {name}" for name, signal in self.outputs.items()]
        return "\n".join(lines)

    def __repr__(self) -> str:
        count = f"{len(self.blocks)} block{'' if len(self.blocks) == 1 else 's'}"
        parts = [repr(self.title), count]
        for word, ports in (("inputs", self.inports), ("outputs", self.outports)):
            if ports:
                parts.append(f"{word} {few(headings.heading(k, p.unit) for k, p in ports.items())}")
        return f"Diagram({', '.join(parts)})"

    def short(self, end: End) -> str:
        """Return the shortest name of an output port.

        Parameters
        ----------
        end : tuple of (str, str)
            Block and port.

        Returns
        -------
        str
            ``block`` where the port is its only one, else ``block.port``.
        """
        return short_name(end, self.blocks, "output")

    def _repr_svg_(self) -> str:
        """The drawing of the diagram, for notebooks."""
        return view("svg", self)

    def __reduce__(self) -> Any:  # mapping proxies do not pickle
        fields: dict[str, Any] = {**self._fields(), "wires": self.links}
        fields |= {k: dict(v) for k, v in fields.items() if isinstance(v, Mapping)}
        return functools.partial(Diagram, **fields), ()


def required_diagram(given: Any, use: str, error: type[TsmError]) -> Diagram:
    """``given``, if it is a diagram. Raises ``error`` otherwise: only a diagram can be ``use`` ("run", "drawn")."""
    if isinstance(given, Diagram):
        return given
    hint = f" Load it first: tsmblocks.load({in_words(given)})." if isinstance(given, str) else ""
    raise error(f"only a diagram can be {use}, got {in_words(given)}.{hint}")
