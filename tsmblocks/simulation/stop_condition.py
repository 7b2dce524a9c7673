"""A run that ends where a condition becomes true, at the located instant."""

from __future__ import annotations

import copy
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.arguments import as_text
from tsmblocks.common.errors import RunError
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.session import Session, Stopped
from tsmblocks.metrics.conditions import Condition, condition
from tsmblocks.model.diagram import Diagram

FIRST_PIECE, PIECE_STEPS = 64, 4096
"""Steps between two checks of the condition, at first and at most. Chosen: a check costs little beside them."""
INSTANT_TOLERANCE = 1e-12
"""Share of a step to which the end is located. Chosen: some thousand roundings of a step."""


class IgnoredConditionWarning(UserWarning):
    """A condition at which a diagram ends its runs, which is ignored since that diagram is nested in another."""


def condition_of(diagram: Diagram, given: str | None) -> str:
    """The condition that ends a run: the one given, else that of the diagram's file; ``""`` for none.

    Warns of conditions of the diagrams inside, unless one is given.
    """
    if given is not None:
        return as_text("stop_when", given)
    for name, one in _inner_conditions(diagram):
        warnings.warn(
            f"diagram '{diagram.title}': runs of {name} alone end with stop_when = '{one}', which is ignored here, "
            "where its signals have other names. Give simulate its own stop_when, '' for none.",
            IgnoredConditionWarning,
            stacklevel=3,
        )
    return diagram.simulation.stop_when


def _inner_conditions(diagram: Diagram, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Names of diagrams inside that end their runs, and the condition of each."""
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            if block.simulation.stop_when:
                yield prefix + name, block.simulation.stop_when
            yield from _inner_conditions(block, f"{prefix}{name}.")


@attrs.frozen(eq=False)
class Watched:
    """A condition, and the columns of a session's rows in which its signals are."""

    condition: Condition
    columns: Mapping[str, int]

    def margin(self, rows: np.ndarray) -> np.ndarray:
        """By how much the condition holds in each row."""
        return self.condition.margin({name: rows[:, k] for name, k in self.columns.items()})


def stop_condition(eq: Equations, text: str) -> Condition:
    """Read the argument ``stop_when``. Raises ParameterError."""
    known = {name: eq.units.get(eq.aliases.get(name, name), "") for name in (*eq.aliases, *eq.y)}
    return condition("stop_when", text, known)


def watched(eq: Equations, one: Condition, kept: Sequence[int]) -> Watched:
    """The condition over rows of the signals ``kept``, positions in ``eq.y``."""
    places = {name: list(kept).index(eq.y.index(eq.aliases.get(name, name))) for name in one.signals}
    return Watched(one, places)


@attrs.frozen(eq=False)
class Ended:
    """The rows of a run and its last instant [s], None where the condition never held; the session at its end."""

    rows: np.ndarray
    session: Session
    stopped: Stopped | None
    at: float | None = None


def run_until(session: Session, steps: int, one: Watched, progress: Callable[[float], None] | None) -> Ended:
    """Run up to ``steps`` steps, or to where the condition becomes true.

    Raises RunError where it holds at the first instant.
    """
    every, first, stop = session.every, session.k, session.k + steps
    session.every = 1
    kept, piece = list[np.ndarray](), FIRST_PIECE
    while True:
        before, k = _copy(session), session.k
        rows, stopped = session.run(min(piece, stop - k), None)
        piece = min(2 * piece, PIECE_STEPS)
        holds = np.flatnonzero(one.margin(rows) > 0)
        if len(holds) and k + holds[0] == first:
            raise RunError(f"'{session.eq.title}': stop_when '{one.condition.text}' holds at the start.")
        if len(holds):
            return _ended(kept, before, rows, int(holds[0]), one, every)
        if stopped is not None or session.k >= stop:
            kept.append(_thinned(rows, k, every))
            session.every = every
            return Ended(np.concatenate(kept), session, stopped)
        kept.append(_thinned(rows[:-1], k, every))  # the next piece begins with the last row
        if progress is not None:
            progress((session.k - first) / steps)


def _copy(session: Session) -> Session:
    """A copy of the session as it is now; either may continue."""
    made = copy.copy(session)
    made.memory, made.events = session.memory.copy(), list(session.events)
    return made


def _thinned(rows: np.ndarray, k: int, every: int) -> np.ndarray:
    """The rows from step ``k`` on that are kept."""
    return rows[-k % every :: every]


def _ended(kept: list[np.ndarray], before: Session, rows: np.ndarray, place: int, one: Watched, every: int) -> Ended:
    """The run up to the condition, which first holds at row ``place`` of a piece that began as ``before``."""
    k, located = before.k, not before.eq.periods and not before.eq.q
    before.run(place - located, None)
    if located:
        margin = float(one.margin(rows[place - 1 : place])[0])
        last, end = _crossing(before, margin, one)
    else:
        last, end = rows[place : place + 1], before
    end.every = every
    kept = [*kept, _thinned(rows[:place], k, every), last]
    return Ended(np.concatenate(kept), end, None, end.start + end.k * end.h)


def _crossing(here: Session, margin: float, one: Watched) -> tuple[np.ndarray, Session]:
    """The last row, and the session there: one step of the length with which the condition becomes true."""
    from scipy.optimize import brentq

    ends: dict[float, tuple[np.ndarray, Session]] = {}

    def reached(length: float) -> float:
        end = _copy(here)
        end.h, end.start = length, here.start + here.k * (here.h - length)  # this instant keeps its number
        end.cut = here.k + 1 if length < here.h else None
        rows, _ = end.run(1, None)
        ends[length] = rows[-1:], end
        return float(one.margin(rows[-1:])[0]) or -sys.float_info.min

    begin = margin or -sys.float_info.min  # at zero it does not hold yet
    brentq(lambda v: reached(v) if v else begin, 0.0, here.h, xtol=INSTANT_TOLERANCE * here.h, rtol=1e-15)
    reached(here.h)
    return ends[min(v for v, (row, _) in ends.items() if one.margin(row)[0] > 0)]
