"""Insertion points of effects: the signals that were measured, the signal that drives them, and the inputs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from tsmblocks.blocks import Gain, Sum, ViscousFriction
from tsmblocks.common.units import is_one_of, parse
from tsmblocks.diagnosis.control_loops import control_loops, in_front, is_deflection
from tsmblocks.diagnosis.direction import moves_backwards
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.signal_paths import (
    FORCE_TO_POSITION,
    blocks_behind,
    driven_by,
    driving_port,
    integration_count,
    reaches_through_a_state,
    source_of,
    upstream_ports,
)
from tsmblocks.effects import Effect
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.wires import Fault, resolve

SPEED_DIMENSIONS = {parse(unit).dimension for unit in ("rad/s", "m/s")}
"""Dimensions of outputs that are speeds."""
POSITION_DIMENSIONS = {parse(unit).dimension for unit in ("rad", "m")}
"""Dimensions of signals that are positions."""
LEVEL_DIMENSIONS = {parse("m").dimension}
"""Dimensions of signals that may be levels."""
NOT_MECHANICAL = {parse(unit).dimension for unit in ("Pa", "K", "degC", "A", "W", "kg/s", "m^3/s")}
"""Dimensions of signals that are neither motions nor forces."""
NO_MOTIONS = NOT_MECHANICAL | {parse(unit).dimension for unit in ("N", "N*m")}
"""Dimensions of signals that are no motions, so that nothing rubs, springs or ripples along them. Voltages are not
among them: sensors of motions have them."""


def insertion_points(
    diagram: Diagram,
    outputs: Sequence[str],
    effects: Iterable[Effect] = (),
    named: Collection[str] = (),
    measured: Mapping[str, str] | None = None,
) -> list[InsertionPoint]:
    """Every insertion point of a diagram, given the outputs that were measured.

    ``measured`` holds the units of the recordings, for outputs without one in the diagram.

    Effects of an output are inserted in front of the blocks that were ``named`` before as well: their order matters
    where both have memory. Blocks named at an input come before all others, which read the signal behind them. A
    measured drive (the voltage in a position loop) drives another output and is not itself an output. Where a signal
    that is measured acts on other blocks too, as a position does on a spring, there is a point behind all of it, for
    the sensor alone. The wires that ``effects`` made for this diagram name are included.
    """
    found: list[InsertionPoint] = []
    for name in outputs:
        head, port = diagram.shown[name]
        if not head:
            continue  # the output is an input: there is nothing in between
        source = f"{head}.{port}"
        found += _at_the_output(diagram, name, source, named)
        found += _behind_the_sensor(diagram, name, source, outputs)
        unit = diagram.unit(name) or (measured or {}).get(name, "")
        speed = is_speed(unit)
        drive = driving_port(diagram, name, FORCE_TO_POSITION - speed)
        signal = source_of(diagram, drive) if drive else source
        driving = signal if drive else _driving_input(diagram, name)
        if driving not in ("", source) and not is_no_motion(unit):
            found.append(InsertionPoint("mode", name, source, other=driving, after=source))
        if signal != source:  # an output that is its own drive has no drive in front of it
            found += _at_the_drive(diagram, name, source, drive, unit)
        for port, moved in _inner_drives(diagram, name, drive):
            found.append(InsertionPoint("drive", name, source_of(diagram, port), before=port))
            if moved != source or not is_no_motion(unit):
                found.append(_against_motion("load", name, diagram, port, moved))
        found += _in_the_control_loop(diagram, name, source, named)
        if is_no_motion(unit) or is_one_of(unit, LEVEL_DIMENSIONS):
            found += _of_a_level(diagram, name, source, drive, named, unit)
        found += _at_elements(diagram, name, source, named, "element", (Gain, ViscousFriction))
        inside = list(_inside_the_transmission(diagram, name, source))
        found += [*inside, *_along_a_deflection(diagram, name, drive, inside)]
    found += [InsertionPoint("input", outputs[0], k, after=k) for k in diagram.inputs if diagram.inlets[k]]
    found += _branches(diagram, outputs[0])
    found = _without_doubles(found)
    own = (own_insertion_point(diagram, outputs[0], effect) for effect in effects if effect.receiver)
    found += [point for point in own if point is not None]
    unique: dict[object, InsertionPoint] = {}
    for point in found:
        unique.setdefault(point.edit, point)
    return list(unique.values())


def _without_doubles(points: Sequence[InsertionPoint]) -> list[InsertionPoint]:
    """The points without those at which another place has the same wire."""
    loads, branches = ({point.before for point in points if point.place == place} for place in ("load", "branch"))
    drives = {point.signal for point in points if point.place == "drive"}
    taken = {"brake": loads, "element": branches}
    return [
        point
        for point in points
        if point.before not in taken.get(point.place, ())
        and not (point.place in ("output", "across") and point.signal in drives)
    ]


def _against_motion(place: str, output: str, diagram: Diagram, port: str, moved: str) -> InsertionPoint:
    """The point where a force resists the motion of the signal ``moved``, in front of the port that drives it."""
    signal, opposite = source_of(diagram, port), moves_backwards(diagram, moved, port)
    return InsertionPoint(place, output, signal, other=moved, before=port, opposite=opposite)


def _at_the_output(diagram: Diagram, name: str, source: str, named: Collection[str]) -> Iterator[InsertionPoint]:
    """Wires of a measured output, alone and beside an input: those behind all blocks and in front of those named."""
    yield InsertionPoint("output", name, source, after=source)
    if driven_by(diagram, source):  # what is measured acts on other blocks too
        yield InsertionPoint("output", name, source, before=name)
    signal, port = in_front(diagram, source, named)
    if port:
        yield InsertionPoint("output", name, signal, before=port)
    for k in diagram.inputs:
        read = _behind(diagram, k, named)
        if integration_count(diagram, name, before="", after=k) == 0:
            yield InsertionPoint("across", name, source, other=read, after=source)
            if port:
                yield InsertionPoint("across", name, signal, other=read, before=port)
        if reaches_through_a_state(diagram, name, k):
            yield InsertionPoint("parallel", name, source, other=read, after=source)


def _driving_input(diagram: Diagram, name: str) -> str:
    """The input that reaches an output through one integration or lag; empty where there is none."""
    return next((k for k in diagram.inputs if integration_count(diagram, name, before="", after=k) == 1), "")


def _behind_the_sensor(diagram: Diagram, name: str, source: str, outputs: Sequence[str]) -> Iterator[InsertionPoint]:
    """The wire from a measured signal to the blocks that it drives, where another measured output depends on them."""
    driven = driven_by(diagram, source)
    behind = blocks_behind(diagram, source.partition(".")[0])
    if driven and any(diagram.shown[other][0] in behind for other in outputs if other != name):
        yield InsertionPoint("branch", name, source, before=", ".join(driven))


def _acting_back(diagram: Diagram, name: str, source: str, named: Collection[str]) -> Iterator[InsertionPoint]:
    """Wires on which what is measured acts back on itself, as the loss of a heat balance does; no control loop.

    They begin at the measured signal, or at one in front of it from which it follows without a state.
    """
    signal, seen = source, set[str]()
    while (head := signal.partition(".")[0]) not in seen and signal not in diagram.inputs:
        seen.add(head)
        control = {loop.fed_back for loop in control_loops(diagram, signal, named)}
        driven = driven_by(diagram, signal)
        for port in driven if len(driven) + (signal == source) > 1 else []:
            block = port.partition(".")[0]
            if port not in control and head in blocks_behind(diagram, block):
                yield InsertionPoint("branch", name, signal, before=port)
        into = [".".join(x.target) for x in diagram.links if x.target[0] == head]
        if len(into) == 1 and integration_count(diagram, name, before=into[0], after="") == 0:
            signal = source_of(diagram, into[0])


def _is_balance(diagram: Diagram, point: InsertionPoint) -> bool:
    """Whether a signal sets its own rate at a point, as the level of a tank does, and not its acceleration."""
    return integration_count(diagram, point.signal, before=point.before, after="") == FORCE_TO_POSITION - 1


def _at_elements(
    diagram: Diagram, name: str, source: str, named: Collection[str], place: str, kinds: tuple[type, ...]
) -> Iterator[InsertionPoint]:
    """Wires to what makes a flow of a level, or a force of a motion, and takes it from a balance; no controller.

    A loss does so, a spring, or a viscous friction: blocks of some ``kinds``.
    """
    control = {port for loop in control_loops(diagram, source, named) for port in (loop.fed_back, *loop.commands)}
    for port in upstream_ports(diagram, diagram.shown[name][0]):
        head, signal = port.partition(".")[0], source_of(diagram, port)
        balanced = any(isinstance(diagram.blocks[x.target[0]], Sum) for x in diagram.links if x.source[0] == head)
        element = balanced and isinstance(diagram.blocks[head], kinds) and head in blocks_behind(diagram, head)
        if element and port not in control and signal not in (source, *diagram.inputs):
            yield InsertionPoint(place, name, signal, before=port)


def _in_the_control_loop(diagram: Diagram, name: str, source: str, named: Collection[str]) -> Iterator[InsertionPoint]:
    """Wires of the loops in which a measured output is fed back.

    Its sensor alone, where the output acts on other blocks as well; what is fed back alone; the wires from the control
    error to the command; and what an actuator behind it moves.
    """
    for loop in control_loops(diagram, in_front(diagram, source, named)[0], named):
        fed_back = source_of(diagram, loop.fed_back)
        if fed_back == source and driven_by(diagram, source) != [loop.fed_back]:
            yield InsertionPoint("loop", name, source, before=f"{loop.fed_back}, {name}")
        yield InsertionPoint("loop", name, fed_back, before=loop.fed_back)
        for port in loop.commands:
            yield InsertionPoint("drive", name, source_of(diagram, port), before=port)
            yield InsertionPoint("loop", name, source_of(diagram, port), before=port)
        if loop.actuated:
            yield InsertionPoint("loop", name, loop.actuated, before=", ".join(driven_by(diagram, loop.actuated)))


def _behind(diagram: Diagram, name: str, named: Collection[str]) -> str:
    """The signal behind the chain of blocks named at an input; the input where there are none."""
    signal, ends = name, [*diagram.inlets[name]]
    while len(ends) == 1 and ends[0][0] in named and ends[0][1] == "u":
        signal = f"{ends[0][0]}.y"
        ends = [x.target for x in diagram.links if ".".join(x.source) == signal]
    return signal


def _branches(diagram: Diagram, output: str) -> Iterator[InsertionPoint]:
    """Both ends of parallel branches: ports that an input drives, where these are several, and ports of a sum.

    Of a branch that is a single block without a state the first of them is enough.
    """
    for name, ends in diagram.inlets.items():
        if len(ends) < 2:
            continue
        yield from (InsertionPoint("branch", output, name, before=".".join(end)) for end in ends)
        driven = {head: {head, *blocks_behind(diagram, head)} for head, _ in ends}
        for head, block in diagram.blocks.items():
            into = [x for x in diagram.links if x.target[0] == head] if isinstance(block, Sum) else []
            branches = [x for x in into if any(x.source[0] in those for those in driven.values())]
            if len(branches) < 2 or blocks_behind(diagram, head) & {head}:
                continue
            for x in branches:
                signal = ".".join(x.source)
                if x.source[0] not in driven or integration_count(diagram, signal, before="", after=name):
                    yield InsertionPoint("branch", output, signal, before=".".join(x.target))


def own_insertion_point(diagram: Diagram, output: str, effect: Effect) -> InsertionPoint | None:
    """The wire that an effect made for one diagram names; None where the diagram has no such port or signal."""
    try:
        port = ".".join(resolve(effect.receiver, diagram.blocks, "input"))
        reads = effect.reads
        if reads and reads not in diagram.inputs:
            reads = ".".join(resolve(reads, diagram.blocks, "output"))
    except Fault:
        return None
    return InsertionPoint(effect.place, output, source_of(diagram, port), reads, before=port, adds=effect.adds)


def is_speed(unit: str) -> bool:
    """Whether a unit is that of a speed, of turning or straight on; one that is not known is none."""
    return is_one_of(unit, SPEED_DIMENSIONS)


def is_no_motion(unit: str) -> bool:
    """Whether a unit is known, and that of no motion."""
    return is_one_of(unit, NO_MOTIONS)


def is_not_mechanical(unit: str) -> bool:
    """Whether a unit is known, and that of neither a motion nor a force."""
    return is_one_of(unit, NOT_MECHANICAL)


def _positions(diagram: Diagram, speed: str) -> Iterator[str]:
    """The positions that blocks make of a speed; they need not be measured."""
    for head in dict.fromkeys(port.partition(".")[0] for port in driven_by(diagram, speed)):
        yield from positions_of(diagram, head)


def positions_of(diagram: Diagram, block: str) -> list[str]:
    """The signals of a block that are positions, by their units."""
    signals = [f"{block}.{port}" for port in diagram.blocks[block].outports]
    return [one for one in signals if is_one_of(diagram.unit(one), POSITION_DIMENSIONS)]


def _at_the_drive(diagram: Diagram, name: str, source: str, drive: str, unit: str) -> Iterator[InsertionPoint]:
    """The wire that drives a measured output of a unit, alone and with the motion that a force there resists."""
    yield InsertionPoint("drive", name, source_of(diagram, drive), before=drive)
    if not is_no_motion(unit):
        yield _against_motion("brake" if is_speed(unit) else "load", name, diagram, drive, source)
    for position in _positions(diagram, source) if is_speed(unit) else ():
        yield _against_motion("load", name, diagram, drive, position)


def _of_a_level(
    diagram: Diagram, name: str, source: str, drive: str, named: Collection[str], unit: str
) -> Iterator[InsertionPoint]:
    """Wires of a level, a temperature or the like: the one that fills or heats it, and those on which it acts back.

    What fills it is no input, and not the ``drive`` of a motion.
    """
    port = driving_port(diagram, name, 1)
    signal = source_of(diagram, port) if port else source
    filled = InsertionPoint("balance", name, signal, before=port)
    inside = port != drive and signal not in (source, *diagram.inputs)
    if inside and (is_no_motion(unit) or _is_balance(diagram, filled)):
        yield filled
    elements = _at_elements(diagram, name, source, named, "branch", (Gain,))
    for point in (*_acting_back(diagram, name, source, named), *elements):
        # what a motion acts back with is a load, or in the deflection of a spring
        if is_no_motion(unit) or _is_balance(diagram, point):
            yield point


def _inner_drives(diagram: Diagram, output: str, nearest: str) -> Iterator[tuple[str, str]]:
    """Ports farther from an output than the ``nearest`` drive that move a signal of their own block as a force does.

    With that signal: the motor in front of an elastic shaft has friction, and a load, of its own.
    """
    ports = list(upstream_ports(diagram, diagram.shown[output][0]))
    for port in ports[ports.index(nearest) + 1 :] if nearest in ports else ():
        head = port.partition(".")[0]
        for moved in dict.fromkeys(".".join(x.source) for x in diagram.links if x.source[0] == head):
            if integration_count(diagram, moved, before=port, after="") >= FORCE_TO_POSITION:
                yield port, moved


def _inside_the_transmission(diagram: Diagram, output: str, source: str) -> Iterator[InsertionPoint]:
    """Wires inside the model that have a position: from one part of a transmission to the next.

    Either nothing acts back on what moves the wire, and it has dynamics on both of its sides (``"transmission"``), or
    it is the difference of two positions, or the integral of that of two speeds, of which one depends on it, and the
    other does so too or is an input: the deflection of an elastic part (``"deflection"``).
    """
    for port in upstream_ports(diagram, diagram.shown[output][0]):
        signal = source_of(diagram, port)
        if signal in diagram.inputs or signal == source or not is_one_of(diagram.unit(signal), POSITION_DIMENSIONS):
            continue
        head, driven = signal.partition(".")[0], blocks_behind(diagram, port.partition(".")[0])
        if head not in driven:
            before = [integration_count(diagram, signal, before="", after=k) for k in diagram.inputs]
            dynamic = max(before, default=0) > 0 and 0 not in before
            if dynamic and integration_count(diagram, output, before=port, after="") > 0:
                yield InsertionPoint("transmission", output, signal, before=port)
        elif is_deflection(diagram, head, port):
            yield InsertionPoint("deflection", output, signal, before=port)


def _along_a_deflection(
    diagram: Diagram, output: str, drive: str, inside: Iterable[InsertionPoint]
) -> Iterator[InsertionPoint]:
    """Where a force resists a deflection from an input, as dry friction of a damper does on a base that is moved.

    Between two parts that are both free to move the force would act on the other one as well.
    """
    moved = {end[0] for ends in diagram.inlets.values() for end in ends}
    for point in inside:
        if drive and point.place == "deflection" and point.signal.partition(".")[0] in moved:
            yield _against_motion("load", output, diagram, drive, point.signal)
