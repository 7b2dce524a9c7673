"""Plants that never forget where they began: experiments are cut into short pieces that begin anew."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.model import Asked, posed
from tsmblocks.diagram import Diagram

PIECE = 1.0
"""Length of a piece [s]: over longer ones the errors of an integrating plant grow and hide what they come from."""
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


def pieces(records: Mapping[str, Record]) -> dict[str, Record]:
    """Every experiment in pieces of about ``PIECE`` seconds, named ``experiment#1`` and so on."""
    made: dict[str, Record] = {}
    for name, record in records.items():
        length = max(PIECE, FEWEST * record.step)
        count = max(1, round((record.t[-1] - record.t[0]) / length))
        edges = np.linspace(record.t[0], record.t[-1], count + 1)
        for k in range(count):
            stop = edges[k + 1] - (record.step / 2 if k + 1 < count else 0.0)
            made[f"{name}{SIGN}{k + 1}"] = record.part(float(edges[k]), float(stop))
    return made


def whole(name: str) -> str:
    """The experiment that a piece belongs to."""
    return name.rpartition(SIGN)[0] or name
