"""Differences in a diagram: control errors, with the wires from there on, and deflections of elastic parts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import attrs

from tsmblocks.blocks import Gain, Integrator, Product, Sum
from tsmblocks.common.units import is_one_of, parse
from tsmblocks.diagnosis.signal_paths import FORCE_TO_POSITION, blocks_behind, driven_by, integration_count, source_of
from tsmblocks.model.diagram import Diagram

ELASTIC_DIMENSIONS = {parse(unit).dimension for unit in ("N", "N*m", "m/s^2", "rad/s^2")}
"""Dimensions of what a spring makes of a deflection: a force, a torque, or either of them by its inertia."""

POSITION_DIMENSIONS = {parse(unit).dimension for unit in ("mm", "deg")}
"""Dimensions of a position."""
SENSOR_DIMENSIONS = {parse(unit).dimension for unit in ("V", "A", "%")} | POSITION_DIMENSIONS
"""Dimensions of what a sensor of it shows."""


@attrs.frozen
class ControlLoop:
    """A loop around the block ``error``, a sum, which compares a reference with what arrives at its port ``fed_back``.

    ``commands`` are the ports from the control error to the command: those that the error drives, and those that the
    controller does. ``actuated`` is what an actuator behind them moves, as the spool of a valve, where it is multiplied
    by other signals; empty where there is none.
    """

    error: str
    fed_back: str
    commands: tuple[str, ...]
    actuated: str


def control_loops(diagram: Diagram, source: str, named: Collection[str]) -> Iterator[ControlLoop]:
    """The control loops in which the signal ``source`` is fed back: as it is, by a sensor, or through ``named`` blocks.

    A sum whose result a spring makes into a force is the deflection of that spring, and no control error. Neither is a
    sum in which the reference is taken from what is fed back: a loss to the surroundings is driven by that.
    """
    head = source.partition(".")[0]
    for error, block in diagram.blocks.items():
        if not isinstance(block, Sum) or head not in blocks_behind(diagram, error) or is_elastic(diagram, error):
            continue
        fed_back = [k for k in _ports(diagram, error) if _is_fed_back(diagram, source, k, named)]
        if has_reference(diagram, error, head) and len(fed_back) == 1 and not _is_loss(block, fed_back[0]):
            commands = tuple(_commands(diagram, error, head))
            yield ControlLoop(error, fed_back[0], commands, _actuated(diagram, commands, source))


def _is_fed_back(diagram: Diagram, source: str, port: str, named: Collection[str]) -> bool:
    """Whether a signal arrives at a port as it is, or a position does through the gains of its sensor.

    A speed or a current that a gain turns into a voltage may be that of a motor, and no measurement.
    """
    signal = in_front(diagram, source_of(diagram, port), named)[0]
    if signal == source:
        return True
    seen = set[str]()
    while signal not in {*seen, *diagram.inputs} and _is_sensor(diagram, signal.partition(".")[0]):
        seen.add(signal)
        signal = in_front(diagram, source_of(diagram, f"{signal.partition('.')[0]}.u"), named)[0]
    moved = integration_count(diagram, source, before=port, after="") >= FORCE_TO_POSITION
    return signal == source and moved and is_one_of(diagram.unit(source), POSITION_DIMENSIONS)


def _is_sensor(diagram: Diagram, name: str) -> bool:
    """Whether a block may turn a position into what a sensor shows: a gain that makes no force of it, by its unit."""
    block, unit = diagram.blocks.get(name), diagram.unit(f"{name}.y") if name in diagram.blocks else ""
    return isinstance(block, Gain) and (is_one_of(unit, SENSOR_DIMENSIONS) or (not unit and block.gain == 1.0))


def _is_loss(difference: Sum, port: str) -> bool:
    """Whether the signal at a port counts positive in a difference, as a level does in what drives its loss."""
    return port.rpartition(".")[2].startswith("plus") and "-" in difference.signs


def has_reference(diagram: Diagram, block: str, output: str = "") -> bool:
    """Whether a block is driven from outside the loop that it is in.

    An outer loop, whose signals come back through the block of the ``output``, is outside.
    """
    behind = blocks_behind(diagram, block, output)
    from_inputs = any(end[0] == block for ends in diagram.inlets.values() for end in ends)
    return from_inputs or any(x.target[0] == block and x.source[0] not in behind for x in diagram.links)


def is_elastic(diagram: Diagram, difference: str) -> bool:
    """Whether what reads a difference makes a force of it, by its unit, as a spring does of its deflection."""
    readers = {x.target[0] for x in diagram.links if x.source[0] == difference}
    units = (diagram.unit(f"{head}.y") for head in readers if "y" in diagram.blocks[head].outports)
    return any(is_one_of(unit, ELASTIC_DIMENSIONS) for unit in units)


def is_deflection(diagram: Diagram, block: str, port: str) -> bool:
    """Whether a block takes a signal that a force at ``port`` moves from another such signal, or from a given one.

    One is given that is an input, or that no force moves, as the position of a drive behind its gear. It is a
    difference of positions, or the integral of one of speeds. A difference from an input that becomes a
    command, and no force, is a control error; so is one of speeds from an input, whatever its integral becomes.
    """
    into = [x.source[0] for x in diagram.links if x.target[0] == block]
    of_speeds = isinstance(diagram.blocks[block], Integrator) and bool(into)
    difference = into[0] if of_speeds else block
    if not isinstance(diagram.blocks[difference], Sum):
        return False
    ends = [".".join(x.source) for x in diagram.links if x.target[0] == difference]
    count = len(ends) + sum(end[0] == difference for inlets in diagram.inlets.values() for end in inlets)
    behind = blocks_behind(diagram, difference)
    ends = [end for end in ends if of_speeds or end.partition(".")[0] in behind]  # the others are given
    moved = [integration_count(diagram, end, before=port, after="") >= FORCE_TO_POSITION - of_speeds for end in ends]
    elastic = not has_reference(diagram, difference) or (not of_speeds and is_elastic(diagram, block))
    return count > 1 and bool(moved) and all(moved) and elastic


def in_front(diagram: Diagram, source: str, named: Collection[str]) -> tuple[str, str]:
    """The signal in front of the chain of named blocks up to ``source``, and the port it drives.

    The wires between them are left out: they would double the run time for nearly the same candidates.
    """
    port = ""
    while (head := source.partition(".")[0]) in named:
        before = source_of(diagram, f"{head}.u")
        if before in diagram.inputs:
            break
        source, port = before, f"{head}.u"
    return source, port


def _actuated(diagram: Diagram, commands: Sequence[str], source: str) -> str:
    """The signal behind a chain of blocks from the last command on that is multiplied by others; empty without one."""
    head = commands[-1].partition(".")[0] if commands else ""
    while head and len(_ports(diagram, head)) == 1 and head != source.partition(".")[0]:
        driven = {port.partition(".")[0] for port in driven_by(diagram, f"{head}.y")}
        if any(isinstance(diagram.blocks[one], Product) for one in driven):
            return f"{head}.y"
        head = driven.pop() if len(driven) == 1 else ""
    return ""


def _ports(diagram: Diagram, block: str) -> list[str]:
    """The ports of a block that other blocks drive."""
    return [".".join(x.target) for x in diagram.links if x.target[0] == block]


def _commands(diagram: Diagram, error: str, output: str) -> Iterator[str]:
    """The ports that a control error drives, and those behind the blocks there, up to the block of the ``output``."""
    for x in diagram.links:
        if x.source[0] == error:
            yield ".".join(x.target)
            controller = x.target[0]
            if controller != output:
                yield from (".".join(further.target) for further in diagram.links if further.source[0] == controller)
