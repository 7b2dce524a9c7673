"""Whether the step of a run was short enough: the run, or a sample of it, is taken again in other steps.

First with twice the step (half of it where that cannot be), which costs little. Where the states differ by more than
``TOLERANCE`` there, the steps are halved until they agree: this gives the error, and a step that would do.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections import OrderedDict
from typing import Any

import attrs
import numpy as np

from tsmblocks.engine.equations import Equations
from tsmblocks.engine.events import Located, TooManySwitches
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel import Memory
from tsmblocks.engine.session import Session, check_delays
from tsmblocks.simulation.repeated_steps import Interrupted, Taken, scale_of
from tsmblocks.simulation.stability import StepWarning, step_warnings_are_off
from tsmblocks.simulation.step_advice import Examined, advice, step_message
from tsmblocks.simulation.stop_condition import Ended

TOLERANCE = 5e-4
"""Error of an output, as a share of its largest value, from which there is a warning. Chosen: not seen in a plot."""
STATE_WEIGHT = 10.0
"""How much larger the error of a state that is no output may be. Chosen: with 0.5 % a signal inside still serves."""
JUMP, JUMP_RATIO = 0.05, 5.0
"""Share of its range by which an output changes in a step that jumps, and how many times as much as in the steps before
and after: then it is not compared. Chosen: a smooth signal changes by much in some steps, but not in one alone."""
WHOLE_STEPS = 8192
"""Steps up to which all of a run is taken again, and about so many of a longer one. Chosen: for speed."""
SEGMENTS, SHORTEST_SEGMENT = 32, 2048
"""Segments of which the beginnings are taken again, at most, and the fewest steps of one. Chosen: for speed."""
DOUBLED, HALVED = 0.25, 0.5
"""Share of the tolerance that differences in doubled and in halved steps may take without doubt. Derived for halved
steps, which show half of the error at order 1. Chosen for doubled ones, whose error may be alike by chance."""
SURE = 20.0
"""How much below the tolerance the difference of two steps is that needs no confirmation by the next. Chosen: switches
make differences irregular."""
EXAMINED_STEPS = 50_000
"""Steps that are taken again in halved steps, at most. Chosen: for speed."""
MOST_HALVINGS, MOST_FINE_STEPS = 7, 400_000
"""Times that a step is halved, and steps of a finer run, at most. Chosen: for speed, of runs that are wrong."""
MOST_EXAMINED_NUMBERS = 4_000_000
"""Numbers of a run that is taken again, at most (32 MB). Chosen."""
SHORTEST_LOOK = 64
"""Steps of a segment that are taken again, at least. Chosen: more than a transient of a plant that suits the step."""
DECAY_STEPS = 16
"""Steps that are examined beyond the last one in doubt. Chosen: few."""
GROWING = 1.5
"""Ratio of differences in the last half of some steps and in the quarter before, from which they grow with time.
Chosen: below 2, that of a steady drift."""
DRIFT_STEPS = 20_000
"""Steps from the start that are taken again where parts suggest a drift. Chosen: for speed."""
INPUT_SAMPLES = 64
"""Samples of an input by which it is recognised. Chosen."""
MOST_KEPT = 256
"""Verdicts that are kept, at most."""
_VERDICTS: OrderedDict[Any, str] = OrderedDict()


@attrs.frozen(eq=False)
class StepCheck:
    """A check that is under way: ``begin`` is the memory before the first step; of a run known already, its verdict."""

    key: Any
    begin: Memory | None
    verdict: str = ""

    def warn(self, run: Taken | None, stacklevel: int) -> None:
        """Give the warning of the run, if there is one."""
        text = self.verdict
        if self.begin is not None and run is not None:
            try:
                text = verdict(run)
            except TooManySwitches:
                text = ""
            except Interrupted:
                return
            _VERDICTS[self.key] = text
            while len(_VERDICTS) > MOST_KEPT:
                _VERDICTS.popitem(last=False)
        if text:
            warnings.warn(text, StepWarning, stacklevel=stacklevel)


def prepared(session: Session, steps: int, logged: tuple[int, ...], whole: bool) -> StepCheck | None:
    """The check of a run that begins now; None where warnings of the step are off or there is nothing to integrate.

    The same run is often repeated, so its verdict is kept. Unless the run is taken as a ``whole`` it is marked, so that
    parts of it can be taken again.
    """
    if step_warnings_are_off() or not session.eq.x or steps < 2:
        return None
    memory, h, every = session.memory, session.h, session.every
    inputs = tuple(_fingerprint(signal) for signal, _ in session.signals)
    place = (type(session), session.kernel.plan.method, h, session.start, session.k, steps, every, logged)
    key = (session.eq, *place, memory.p.tobytes(), memory.x.tobytes(), memory.d.tobytes(), inputs)
    if key in _VERDICTS:
        return StepCheck(key, None, _VERDICTS[key])
    complete = session.k % every == 0 and {session.eq.y[k] for k in logged}.issuperset(session.eq.x)
    if not whole and not (complete and steps <= WHOLE_STEPS):
        least = SHORTEST_SEGMENT if complete else SHORTEST_LOOK
        session.mark_every = 2 * every * -(-max(steps // SEGMENTS, least) // (2 * every))
    return StepCheck(key, memory.copy())


def _fingerprint(signal: Signal) -> Any:
    """What an input is recognised by: the function, or its hold and a sample of its values."""
    if signal.function is not None:
        return signal.function
    t, y = signal.t, signal.y
    few = slice(None, None, max(1, len(y) // INPUT_SAMPLES))
    return signal.hold, len(t), float(t[0]), float(t[-1]), y[few].tobytes(), float(y.sum())


def taken(
    check: StepCheck, ended: Ended, k: int, origin: float, h: float, logged: tuple[int, ...], backend: str
) -> Taken | None:
    """The run that has ended, in whole steps of ``h`` [s] from step ``k``; None where there is nothing to be found."""
    if check.begin is None:
        return None
    session = ended.session
    if isinstance(session, Located) and session.warned:  # of a sliding mode, where errors have the step's order
        return None
    steps = session.k - k
    if session.h != h:  # the last step is a part of one
        session = copy.copy(session)
        session.h, session.start, steps = h, origin, steps - 1
    steps -= steps % (2 * session.every)
    if steps <= 0:
        return None
    watched, weights = _watched(session.eq, logged, ended.rows)
    aligned = k % session.every == 0
    columns = {i: logged.index(one) for i, one in enumerate(watched) if one in logged} if aligned else {}
    return Taken(session, check.begin, k, steps, ended.rows, watched, weights, columns, backend)


def _watched(eq: Equations, logged: tuple[int, ...], rows: np.ndarray) -> tuple[tuple[int, ...], np.ndarray]:
    """Positions of the signals that are compared, and their weights: states, and outputs that do not jump."""
    shown = {eq.y.index(signal) for signal in eq.aliases.values()}
    states = [eq.y.index(name) for name in eq.x]
    smooth = [one for one in sorted(shown.difference(states)) if not _jumps(rows[:, logged.index(one)])]
    weights = [*(1.0 if one in shown else STATE_WEIGHT for one in states), *(1.0 for _ in smooth)]
    return (*states, *smooth), np.array(weights)


def _jumps(y: np.ndarray) -> bool:
    """Whether a signal jumps from a row to the next."""
    change = np.abs(np.diff(y))
    large = change > JUMP * float(y.max() - y.min())
    if len(change) < 3 or not large.any():
        return False
    around = np.zeros_like(change)
    around[1:] += change[:-1]
    around[:-1] += change[1:]
    return bool((large & (change > JUMP_RATIO * around)).any())


def verdict(run: Taken) -> str:
    """The warning of a run; empty where its step was short enough."""
    with np.errstate(all="ignore"):
        found = [one for part in _doubts(run) if (one := _examined(run, part)) is not None]
        if not found:
            return ""
        worst = max(found, key=lambda one: one.gaps[0])
        return step_message(run, worst, advice(run, worst, TOLERANCE), TOLERANCE)


# ---- the quick look


def _doubts(run: Taken) -> list[Part]:
    """The steps in doubt."""
    finer = 0.5 if _can_be_doubled(run) else 2.0
    allowed = TOLERANCE * (DOUBLED if finer < 1 else HALVED)
    looks = [_look(run, part, finer, allowed) for part in _parts(run, WHOLE_STEPS if finer < 1 else WHOLE_STEPS // 4)]
    doubts = [look.doubt for look in looks if look.doubt is not None]
    grown = sum(look.grown for look in looks) * run.steps / sum(look.part.n for look in looks)
    if len(looks) > 1 and grown > allowed:
        longer = Part(run.begin, run.k, run.steps - run.steps % (2 * run.every))
        longer = attrs.evolve(longer, n=min(longer.n, DRIFT_STEPS - DRIFT_STEPS % (2 * run.every) or longer.n))
        look = _look(run, longer, finer, allowed)
        if look.grown * run.steps / longer.n > allowed:
            doubts = [Part(run.begin, run.k, run.steps)]
        elif look.doubt is not None:
            doubts = [look.doubt, *(one for one in doubts if one.k >= run.k + longer.n)]
    most = max(1, min(EXAMINED_STEPS, MOST_EXAMINED_NUMBERS // len(run.session.eq.x)))
    most = max(most - most % run.every, run.every)
    return [attrs.evolve(one, n=min(one.n, most)) for one in doubts]


@attrs.frozen(eq=False)
class Part:
    """``n`` steps of a run from step ``k``, and the memory before them."""

    memory: Memory
    k: int
    n: int


@attrs.frozen(eq=False)
class _Look:
    """How far signals of a part differ in other steps, as a share of their largest values, if that grows, else 0."""

    part: Part
    grown: float
    doubt: Part | None


def _can_be_doubled(run: Taken) -> bool:
    """Whether the run can be taken in steps of twice the length."""
    session = run.session
    held = any(s.function is None and s.hold == "zero" and len(s.t) > 2 for s, _ in session.signals)
    late = bool(session.eq.q) and min(check_delays(session.eq, run.begin.p, session.h)) < 4
    return run.k % 2 == 0 and not held and not late and all(n % 2 == 0 for n in session.hits)


def _parts(run: Taken, budget: int) -> list[Part]:
    """The parts of a run that are looked at."""
    every, end = run.session.mark_every, run.k + run.steps
    if run.steps <= budget or not run.session.marks:
        return [Part(run.begin, run.k, run.steps)]
    pair = 2 * run.every
    starts = [Part(run.begin, run.k, 0)]
    starts += [Part(memory, k, 0) for k, memory in run.session.marks if k <= end - pair]
    if run.complete:
        each = pair * -(-max(budget // len(starts), SHORTEST_LOOK) // pair)
        return [attrs.evolve(one, n=min(each, end - one.k)) for one in starts]
    count = max(2, min(len(starts), budget // every))
    chosen = sorted({round(i) for i in np.linspace(0, len(starts) - 1, count)})
    return [attrs.evolve(starts[i], n=min(every, end - starts[i].k)) for i in chosen]


def _look(run: Taken, part: Part, finer: float, allowed: float) -> _Look:
    """Take a part again in other steps."""
    k, n, stride = part.k, part.n, run.stride(finer)
    doubt, grown = None, 0.0
    if run.columns:
        x = run.kept(k, n, stride)
        gap = np.nan_to_num(np.abs(run.again(part.memory, k, n, finer) - x) / run.scale, nan=np.inf).max(axis=1)
        grown = _grown(gap)
        over = np.flatnonzero(gap > allowed)
        if len(over):
            pair = 2 * run.every
            doubt = attrs.evolve(part, n=min(n, pair * ((stride * int(over[-1]) + DECAY_STEPS) // pair + 1)))
    if not run.complete:
        at_marks = _gap_at_marks(run, part, finer)
        doubt = part if at_marks > allowed else doubt
        grown = grown if run.columns else at_marks
    return _Look(part, grown, doubt)


def _grown(gap: np.ndarray) -> float:
    """The last of a difference that grows from the second to the last quarters of some steps; 0 where it does not."""
    quarter, half = len(gap) // 4, len(gap) // 2
    if quarter == half:
        return 0.0
    late = float(gap[half:].max())
    return late if late > GROWING * float(gap[quarter:half].max()) else 0.0


def _gap_at_marks(run: Taken, part: Part, finer: float) -> float:
    """How far all states differ where the run has marks."""
    ends = [one.x for at, one in run.session.marks if part.k < at <= part.k + part.n]
    if not ends:
        return 0.0
    again = run.marks_again(part.memory, part.k, part.n, finer)
    if len(again) < len(ends):
        return math.inf
    scale = scale_of(np.array([run.begin.x, *(one.x for _, one in run.session.marks)]))
    scale = scale * run.weights[: len(scale)]
    return float(np.nan_to_num(np.abs(again[: len(ends)] - np.array(ends)) / scale, nan=np.inf).max())


# ---- halving


def _examined(run: Taken, part: Part) -> Examined | None:
    """A part taken in ever shorter steps; None where its states agree."""
    k, n = part.k, part.n
    first = run.kept(k, n, run.every) if run.complete else run.all_again(part.memory, k, n, 1.0)
    finer, before, gaps = 2.0, first, list[float]()
    while True:
        finest = run.all_again(part.memory, k, n, finer)
        scale = scale_of(finest) * run.weights
        scale = np.maximum(scale, run.scale) if run.complete and np.isfinite(scale).all() and n < run.steps else scale
        apart = np.nan_to_num(np.abs(before - finest) / scale, nan=np.inf)
        gaps.append(float(apart.max()))
        if len(gaps) == 1 and DRIFT_STEPS <= n < run.steps:
            gaps[0] = max(gaps[0], _grown(apart.max(axis=1)) * run.steps / n)
        if gaps[-1] <= (TOLERANCE if len(gaps) == 1 else TOLERANCE / SURE) or max(gaps[-2:]) <= TOLERANCE:
            break
        before, finer = finest, 2 * finer
        if len(gaps) >= MOST_HALVINGS or n * finer > max(MOST_FINE_STEPS, 4 * n):
            break
    return Examined(part, first, finest, scale, tuple(gaps)) if gaps[0] > TOLERANCE else None
