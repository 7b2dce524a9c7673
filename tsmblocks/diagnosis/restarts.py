"""Plants that never forget where they began: experiments are cut into short pieces that begin anew."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.model import Asked, posed
from tsmblocks.diagram import Diagram
from tsmblocks.fitting.trials import Window
from tsmblocks.simulate import equations, parameter_vector

PIECE = 1.0
"""Length of a piece [s]: over longer ones the errors of an integrating plant grow and hide what they come from."""
LEAD = 0.1
"""Share of a piece that runs ahead of what is compared: what delays hold when it begins is not known, and has to go."""
SURE = 2.0
"""How many times the delays of the diagram a piece runs ahead at least: those of a fit may be found longer."""
FEWEST = 100
"""Samples of a piece at least."""
KEPT = 0.3
"""Share of a start value's first influence that is still there at the end of an experiment that remembers it."""
SIGN = "#"
"""Between the name of an experiment and the number of its piece."""


def remembers(diagram: Diagram, records: Mapping[str, Record], asked: Asked) -> bool:
    """Whether the start of every experiment still shows at its end, as in a plant that integrates."""
    if not asked.start_states:
        return False
    problem, _ = posed(diagram, records, asked, asked.free)
    _, J = problem.jacobian(problem.unknowns.start)
    items, count = problem.unknowns.items, problem.trials[0].measured.shape[1]
    if not any(item.experiment for item in items):
        return False
    kept = []
    for e in range(len(problem.trials)):
        own = [k for k in problem.unknowns.columns(e) if items[k].experiment]
        shares = []
        for i in range(count):
            part = np.abs(J[problem.segments[e * count + i]][:, own])
            tenth = max(len(part) // 10, 1)
            first, last = part[:tenth].max(axis=0), part[-tenth:].mean(axis=0)
            shares.append(float(np.max(np.where(first > 0, last / np.where(first > 0, first, 1.0), 0.0), initial=0.0)))
        kept.append(max(shares, default=0.0))
    return min(kept) > KEPT


def delays(diagram: Diagram) -> float:
    """All delays of a diagram together [s]: no signal is longer on its way."""
    eq = equations(diagram)
    return float(np.sum(np.asarray(eq.lag(parameter_vector(eq, diagram))))) if eq.q else 0.0


def pieces(records: Mapping[str, Record], late: float = 0.0) -> tuple[dict[str, Record], dict[str, Window]]:
    """Every experiment in pieces named ``experiment#1`` and so on, and the window of each that is compared.

    About ``PIECE`` seconds of each are compared. It begins ahead of them, where the piece before it is still compared,
    by a share of its length or longer than signals are on their way (``late`` [s]), whichever is more.
    """
    made: dict[str, Record] = {}
    windows: dict[str, Window] = {}
    for name, record in records.items():
        begin, end = float(record.t[0]), float(record.t[-1])
        length = max(PIECE, FEWEST * record.step)
        lead = min(max(LEAD * min(length, end - begin), SURE * late), (end - begin) / 2)
        count = max(1, round((end - begin - lead) / length))
        edges = np.linspace(begin + lead, end, count + 1).tolist()
        for k, (first, last) in enumerate(itertools.pairwise(edges)):
            stop = last - (record.step / 2 if k + 1 < count else 0.0)
            one = f"{name}{SIGN}{k + 1}"
            made[one], windows[one] = record.part(first - lead, stop), (first, None)
    return made, windows


def whole(name: str) -> str:
    """The experiment that a piece belongs to."""
    return name.rpartition(SIGN)[0] or name
