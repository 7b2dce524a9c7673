"""Whether the step of a run was short enough: the run, or a sample of it, is taken again in other steps.

First with twice the step (half of it where that cannot be), which costs little. Where the states differ by more than
``TOLERANCE`` there, the steps are halved until they agree: this gives the error, and a step that suffices.
"""

from __future__ import annotations

import copy
import warnings
from collections import OrderedDict
from typing import Any

import attrs
import numpy as np

from tsmblocks.engine.events import Located, TooManySwitches
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel import Memory
from tsmblocks.engine.session import Session
from tsmblocks.simulation.repeated_steps import Interrupted, Part, Taken, scale_of
from tsmblocks.simulation.stability import StepWarning, step_warnings_are_off
from tsmblocks.simulation.step_advice import Examined, advice, step_finding
from tsmblocks.simulation.step_look import (
    DRIFT_STEPS,
    EXAMINED_STEPS,
    SEGMENTS,
    SHORTEST_LOOK,
    SHORTEST_SEGMENT,
    TOLERANCE,
    WHOLE_STEPS,
    doubts,
    grown,
    state_weights,
    with_outputs,
)
from tsmblocks.simulation.stop_condition import Ended

SURE = 20.0
"""How much below the tolerance the difference of two steps is that needs no confirmation by the next. Chosen: switches
make differences irregular."""
MOST_HALVINGS, MOST_FINE_STEPS = 7, 400_000
"""Times that a step is halved, and steps of a finer run, at most. Chosen: for speed, of runs that are wrong."""
INPUT_SAMPLES = 64
"""Samples of an input by which it is recognised. Chosen."""
MOST_KEPT = 256
"""Verdicts that are kept, at most."""
_VERDICTS: OrderedDict[Any, str] = OrderedDict()


@attrs.frozen(eq=False)
class StepCheck:
    """A check that is under way: ``begin`` is the memory before the first step; of a known run, what was found."""

    key: Any
    begin: Memory | None
    known: str = ""

    def finding(self, run: Taken | None) -> str:
        """Where the run's step was too long, by how much, and settings that suffice; empty if it was short enough."""
        if self.begin is None or run is None:
            return self.known
        try:
            text = verdict(run)
        except Interrupted:
            return ""
        _VERDICTS[self.key] = text
        while len(_VERDICTS) > MOST_KEPT:
            _VERDICTS.popitem(last=False)
        return text


def warn_of_step(title: str, h: float, poles: str, finding: str, stacklevel: int, which: str = "") -> None:
    """Give one warning of what is known of a step of ``h`` [s]: of the fastest ``poles``, and of the run as it went."""
    head = poles or f"diagram '{title}': the step of {h:g} s is too long for this run:"
    if poles or finding:
        said = f" In this run {finding}" if poles and finding else f" {finding}" if finding else ""
        warnings.warn(f"{head}{said}{which}", StepWarning, stacklevel=stacklevel)


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
        least = SHORTEST_SEGMENT if complete or steps > WHOLE_STEPS else SHORTEST_LOOK
        session.mark_every = 2 * every * -(-max(steps // SEGMENTS, least) // (2 * every))
    return StepCheck(key, memory.copy())


def _fingerprint(signal: Signal) -> Any:
    """The key by which an input is recognised: the function, or its hold and a sample of its values."""
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
    states, weights = state_weights(session.eq)
    return Taken(session, check.begin, k, steps, ended.rows, logged, k % session.every == 0, states, weights, backend)


def verdict(run: Taken) -> str:
    """The finding on a run; empty where its step was short enough."""
    with np.errstate(all="ignore"):
        try:
            found = [one for part in doubts(run) if (one := _examined(with_outputs(run, [part]), part)) is not None]
        except TooManySwitches:
            found = _examined_without_location(run)
        if not found:
            return ""
        worst = max(found, key=lambda one: one.gaps[0])
        return step_finding(worst, advice(worst, TOLERANCE), TOLERANCE)


def _examined_without_location(run: Taken) -> list[Examined]:
    """The beginning of a run that located its switches, of which there are many: shorter steps that do not locate them
    show where it is wrong, once they agree among themselves.
    """
    if not run.complete:  # its own states would have to be located again
        return []
    part = Part(run.begin, run.k, min(run.steps, EXAMINED_STEPS // run.every * run.every))
    found = _examined(with_outputs(run, [part]), part, located=False)
    if found is None or found.gaps[-1] > TOLERANCE:
        return []
    return [found] if found.error(found.states).max() > TOLERANCE + 2 * found.gaps[-1] else []


def _examined(run: Taken, part: Part, located: bool | None = None) -> Examined | None:
    """A part taken in ever shorter steps, with ``located`` as in the run unless given; None where its states agree."""
    n = part.n
    first = run.kept(part, run.every) if run.complete else run.all_again(part, 1.0)
    finer, before, gaps = 2.0, first, list[float]()
    while True:
        finest = run.all_again(part, finer, located)
        scale = scale_of(finest) * run.weights
        scale = np.maximum(scale, run.scale) if run.complete and np.isfinite(scale).all() and n < run.steps else scale
        apart = np.nan_to_num(np.abs(before - finest) / scale, nan=np.inf)
        gaps.append(float(apart.max()))
        if len(gaps) == 1 and DRIFT_STEPS <= n < run.steps:
            gaps[0] = max(gaps[0], grown(apart.max(axis=1)) * run.steps / n)
        if gaps[-1] <= (TOLERANCE if len(gaps) == 1 else TOLERANCE / SURE) or max(gaps[-2:]) <= TOLERANCE:
            break
        before, finer = finest, 2 * finer
        if len(gaps) >= MOST_HALVINGS or n * finer > max(MOST_FINE_STEPS, 4 * n):
            break
    return Examined(run, part, first, finest, scale, tuple(gaps)) if gaps[0] > TOLERANCE else None
