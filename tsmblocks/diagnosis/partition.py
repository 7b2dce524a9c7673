"""A diagram cut at its measured signals into parts, each simulated from measurements; experiments cut into pieces."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.insertion_points import is_speed, positions_of
from tsmblocks.diagnosis.model import Model, ModelSettings, pose_model
from tsmblocks.fitting.experiments import Window
from tsmblocks.fitting.parameters import named_by
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.wires import Link
from tsmblocks.simulation.compiled import equations, parameter_vector

SHORTEST_PIECE = 1.0
"""Length [s] of the shortest pieces of an experiment, but for rough models. Source: the method's prototype; over longer
ones large errors of an integrating plant grow and mask their cause."""
PIECE_RATIO = 4.0
"""Length of pieces over that of the next shorter ones that are tried. Chosen: for the run time."""
MAX_GROWN_ERROR = 10.0
"""Mean square [noise variances] of a base up to which errors have not grown too much. Chosen: in shorter pieces, free
initial states absorb an error of about the noise; one of several times the noise is seen in shorter ones as well."""
MIN_GROWTH = 4.0
"""Mean square of a base in whole recordings over that in pieces from which errors have grown. Chosen: an error twice as
large."""
MAX_WHOLE_ERROR = 100.0
"""Mean square [noise variances] of a base in whole recordings up to which these are kept where errors have not grown.
Chosen: an error of ten times the noise; from larger ones fits are slow in whole recordings."""
LEAD_SHARE = 0.1
"""Share of a piece that is simulated before the comparison starts. Chosen: initial contents of delays are unknown and
have to leave them first."""
DELAY_MARGIN = 2.0
"""Length of that lead in multiples of all delays of the diagram, at least. Chosen: a fit may lengthen the delays."""
MIN_PIECE_SAMPLES = 100
"""Samples of a piece at least. Chosen: enough for its initial states beside the common parameters."""
LASTING_MEMORY_SHARE = 0.5
"""Share of the largest influence of an initial state that remains at the end of an experiment with lasting memory.
Chosen: 0 for stable plants, 1 for integrating ones."""
ROUGH_ERROR = 1e4
"""Mean square [noise variances] of a base from which it is rough: its parameters say little, and shorter pieces are
taken. Chosen: an error of 100 times the noise is that of another mechanism; an inertia that is fitted without a large
friction is several times too large."""
PIECE_SEPARATOR = "#"
"""Between the name of an experiment and the number of its piece."""


@attrs.frozen(eq=False)
class Part:
    """A part of a diagram. ``cut`` maps its inputs that are measured signals to the signals they replace."""

    name: str
    diagram: Diagram
    outputs: tuple[str, ...]
    cut: Mapping[str, str]


def partition(diagram: Diagram, measured: Sequence[str]) -> list[Part]:
    """Cut a diagram at measured outputs, except where that would open a loop; parts in the order of the signals.

    A closed loop is one part: its controller compensates in the position for what is then visible in the drive.
    """
    wires = [(x.source[0], x.target[0]) for x in diagram.links]
    cut: dict[str, list[Link]] = {}
    seen = {diagram.shown[name][0] for name in measured}
    for name in measured:
        source = diagram.shown[name]
        if not source[0] or name in diagram.inputs:
            continue
        away = [x for x in diagram.links if x.source == source and source[0] not in _reached(x.target[0], wires)]
        away = [x for x in away if not _is_position_of_speed(diagram, x, seen)]
        taken = {x for links in cut.values() for x in links}
        if away and not taken & set(away):
            cut[name] = away
    gone = {x for links in cut.values() for x in links}
    links = [x for x in diagram.links if x not in gone]
    result = [_part(diagram, group, links, cut, measured) for group in _groups(diagram, links)]
    kept = [part for part in result if part.outputs]
    return sorted(kept, key=lambda part: min(list(measured).index(k) for k in part.outputs)) if len(kept) > 1 else kept


def _is_position_of_speed(diagram: Diagram, link: Link, measured: Collection[str]) -> bool:
    """Whether a wire leads from a speed to a block that makes a position of it, which is not measured.

    What moves a motor may depend on its angle, as a ripple of its torque does.
    """
    head = link.target[0]
    speed = is_speed(diagram.unit(".".join(link.source)))
    return speed and head not in measured and bool(positions_of(diagram, head))


def _reached(start: str, wires: Sequence[tuple[str, str]]) -> set[str]:
    """Blocks to which wires (from, to) lead from one block, itself included."""
    found, todo = {start}, [start]
    while todo:
        here = todo.pop()
        new = {after for before, after in wires if before == here} - found
        found |= new
        todo += new
    return found


def _groups(diagram: Diagram, links: Sequence[Link]) -> list[list[str]]:
    """Connected blocks, each group in the diagram's order."""
    ends = [(x.source[0], x.target[0]) for x in links]
    both_ways, result = [*ends, *((b, a) for a, b in ends)], list[list[str]]()
    for name in diagram.blocks:
        if not any(name in group for group in result):
            inside = _reached(name, both_ways)
            result.append([k for k in diagram.blocks if k in inside])
    return result


def _part(
    diagram: Diagram,
    blocks: Sequence[str],
    links: Sequence[Link],
    cut: Mapping[str, list[Link]],
    measured: Sequence[str],
) -> Part:
    """One group of blocks as a separate diagram."""
    inputs, replaced = dict[str, Inlet](), {}
    for name, inlet in diagram.inputs.items():
        ports = [".".join(e) for e in diagram.inlets[name] if e[0] in blocks]
        if ports:
            inputs[name] = attrs.evolve(inlet, ports=ports)
    for name, gone in cut.items():
        ports = [".".join(x.target) for x in gone if x.target[0] in blocks]
        if ports:
            inputs[name] = Inlet(ports, diagram.unit(name), f"measured {name}")
            replaced[name] = ".".join(diagram.shown[name])
    outputs = {k: v for k, v in diagram.outputs.items() if diagram.shown[k][0] in blocks and k not in inputs}
    sub = diagram._with(
        blocks={k: diagram.blocks[k] for k in blocks},
        wires=[x for x in links if x.source[0] in blocks],
        inputs=inputs,
        outputs=outputs,
    )
    own = tuple(k for k in measured if k in outputs)
    return Part(f"{', '.join(inputs) or 'start'} -> {', '.join(own)}", sub, own, replaced)


def in_whole_diagram(point: InsertionPoint, part: Part) -> InsertionPoint:
    """An insertion point of a part as one of the whole diagram, where the cut input is a signal again."""
    point = attrs.evolve(
        point, other=part.cut.get(point.other, point.other), signal=part.cut.get(point.signal, point.signal)
    )
    if point.after not in part.cut:
        return point
    return attrs.evolve(point, after="", before=".".join(part.diagram.inlets[point.after][0]))


def has_lasting_memory(diagram: Diagram, records: Mapping[str, Record], settings: ModelSettings) -> bool:
    """Whether initial states still have an influence at the end of every experiment, as in a plant that integrates."""
    if not settings.start_states:
        return False
    problem, _ = pose_model(diagram, records, settings, settings.free)
    _, J = problem.jacobian(problem.unknowns.start)
    given = {k for p in settings.local for k in named_by(p, diagram.parameters)}
    unknowns, count = problem.unknowns, problem.experiments[0].measured.shape[1]
    kept = np.zeros(len(problem.experiments))
    for e in range(len(kept)):
        states = [i for i, k in enumerate(unknowns.own[e]) if unknowns.items[k].parameter not in given]
        for rows in problem.segments[e * count : (e + 1) * count]:
            part = np.abs(J.own[rows][:, states])
            largest, last = part.max(axis=0, initial=0.0), part[-max(len(part) // 10, 1) :].mean(axis=0)
            kept[e] = max(kept[e], np.max(last[largest > 0] / largest[largest > 0], initial=0.0))
    return bool(kept.min() > LASTING_MEMORY_SHARE)


def total_delay(diagram: Diagram) -> float:
    """Sum of all delays of a diagram [s], an upper bound on that of any path."""
    eq = equations(diagram)
    return float(np.sum(np.asarray(eq.lag(parameter_vector(eq, diagram))))) if eq.q else 0.0


def within_windows(records: Mapping[str, Record], windows: Mapping[str, Window] | None) -> dict[str, Record]:
    """The part of each recording that is compared."""
    return {name: r if windows is None else r.part(*windows[name]) for name, r in records.items()}


def piece_lengths(records: Mapping[str, Record]) -> list[float]:
    """Lengths [s] of pieces to try, from the longest that cuts an experiment to the shortest for rough models."""
    longest, lengths = max(float(r.t[-1] - r.t[0]) for r in records.values()), [SHORTEST_PIECE]
    shortest = MIN_PIECE_SAMPLES * max(r.step for r in records.values())
    while lengths[-1] * PIECE_RATIO < longest / 2:
        lengths.append(lengths[-1] * PIECE_RATIO)
    while lengths[0] / PIECE_RATIO >= shortest:
        lengths.insert(0, lengths[0] / PIECE_RATIO)
    return lengths[::-1]


def split_into_pieces(
    records: Mapping[str, Record], delay: float = 0.0, length: float = SHORTEST_PIECE
) -> tuple[dict[str, Record], dict[str, Window]]:
    """Every experiment in pieces named ``experiment#1`` and so on, and the window of each that is compared.

    About ``length`` seconds of each are compared. Its simulation starts earlier, within the piece before it, by a
    share of its length or by more than the delays of the diagram (``delay`` [s]), whichever is longer.
    """
    result: dict[str, Record] = {}
    windows: dict[str, Window] = {}
    for name, record in records.items():
        start, end = float(record.t[0]), float(record.t[-1])
        own = max(length, MIN_PIECE_SAMPLES * record.step)
        lead = min(max(LEAD_SHARE * min(own, end - start), DELAY_MARGIN * delay), (end - start) / 2)
        count = max(1, round((end - start - lead) / own))
        edges = np.linspace(start + lead, end, count + 1).tolist()
        for k, (first, last) in enumerate(itertools.pairwise(edges)):
            stop = last - (record.step / 2 if k + 1 < count else 0.0)
            one = f"{name}{PIECE_SEPARATOR}{k + 1}"
            result[one], windows[one] = record.part(first - lead, stop), (first, None)
    return result, windows


def experiment_of(name: str) -> str:
    """The experiment of a piece."""
    return name.rpartition(PIECE_SEPARATOR)[0] or name


def rows_of_experiments(model: Model, output: int) -> dict[str, np.ndarray]:
    """The rows of one output in the residual by experiment; pieces of an experiment are joined."""
    count, groups = len(model.setup.outputs), dict[str, list[np.ndarray]]()
    for experiment, part in zip(model.setup.experiments, model.problem.segments[output::count], strict=True):
        groups.setdefault(experiment_of(experiment.name), []).append(np.arange(part.start, part.stop))
    return {name: np.concatenate(rows) for name, rows in groups.items()}
