"""The warning of a step that is too long: where, by how much, and the settings that suffice."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.engine.events import TooManySwitches
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.session import Session, single_kernel
from tsmblocks.engine.switches import freeze
from tsmblocks.simulation.repeated_steps import Part, Taken

SETTLING = 0.02
"""Difference between the two shortest steps up to which they serve as a reference for other settings. Chosen."""
LEAST_ORDER = 0.4
"""Observed order of convergence below which no step is predicted. Chosen: half the order of a jump."""
MOST_PREDICTED = 10
"""Further halvings that are predicted, at most. Chosen: what needs a thousand times as many steps does not settle."""
STIFF_HALVINGS = 3
"""Halvings that a step needs from which an implicit method is tried. Chosen: a stiff plant needs many more."""
STIFF = " (the diagram is stiff)"
MOST_TRIED_STEPS, MOST_TRIED_STATES = 20_000, 40
"""Steps and states of a run up to which another method is tried. Chosen: for speed."""
CLOSER = 0.03
"""Share of the run's error that remains with other settings that settle, at most. Chosen: shorter steps, with
which this is compared, may be off themselves where switches make them converge slowly."""
EXPLICIT, IMPLICIT = "rk4", "sdirk4"
"""The method that is tried instead of one of low order, and the one where a diagram seems stiff."""


@attrs.frozen(eq=False)
class Examined:
    """A part of a run that compares what does not jump there: its signals as they were and in the shortest steps that
    were taken, and what counts as one of each.

    ``gaps`` are the largest differences between steps of each length and of half of it, the run's own first.
    """

    run: Taken
    part: Part
    states: np.ndarray
    finest: np.ndarray
    scale: np.ndarray
    gaps: tuple[float, ...]

    def error(self, states: np.ndarray) -> np.ndarray:
        """The error of states at all instants, as a share of their largest values."""
        return np.nan_to_num(np.abs(states - self.finest) / self.scale, nan=np.inf)


@attrs.frozen
class Advice:
    """``step`` [s] that suffices (None if not found), ``tried`` if it was; ``locate``, ``method`` that suffice."""

    step: float | None
    tried: bool
    locate: bool = False
    method: str = ""


def advice(found: Examined, tolerance: float) -> Advice:
    """The settings that suffice: found by trying them where that is cheap."""
    run, gaps = found.run, found.gaps
    h, rule = run.session.h, run.session.kernel.plan.method
    halved, tried = len(gaps), gaps[-1] <= tolerance
    step = h / 2 ** next(j for j in range(1, halved) if max(gaps[j:]) <= tolerance) if tried else None
    if not tried and halved > 1 and gaps[-1] < math.inf:
        order = min(math.log2(gaps[-2] / gaps[-1]), rule.order)
        more = math.ceil(math.log2(gaps[-1] / tolerance) / order) if order > LEAST_ORDER else None
        step = None if more is None or more > MOST_PREDICTED else h / 2 ** (halved - 1 + more)

    allowed = max(tolerance + 2 * gaps[-1], CLOSER * float(found.error(found.states).max()))

    def does(take: Callable[[float], np.ndarray]) -> bool:
        """Whether other settings, with steps so many times as short, settle at the run's own step."""
        try:
            states = take(1.0)
            agrees = np.nan_to_num(np.abs(states - take(2.0)) / found.scale, nan=np.inf).max() <= tolerance
        except TooManySwitches:
            return False
        return bool(agrees and found.error(states).max() <= allowed)

    part = found.part
    if part.n > MOST_TRIED_STEPS or gaps[-1] > SETTLING:
        return Advice(step, tried)
    if _can_locate(run) and does(lambda finer: _located(run, part, finer)):
        return Advice(step, tried, locate=True)
    for name in _other_methods(run, part.k, halved):
        kernel = single_kernel(run.session.eq, method_named(name), run.watched, run.backend)
        if does(lambda finer, kernel=kernel: run.by(kernel, part.n, finer)):  # type: ignore[misc]
            return Advice(step, tried, method=name)
    return Advice(step, tried)


def _can_locate(run: Taken) -> bool:
    session = run.session
    rule = session.kernel.plan.method
    return rule.order > 1 and not run.located and not session.eq.q and bool(_switches(run))


def _switches(run: Taken) -> bool:
    session = run.session
    try:
        return freeze(session.eq, session.kernel.plan.method, session.kernel.plan.y, run.backend) is not None
    except RunError:
        return False


def _located(run: Taken, part: Part, finer: float) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return run.all_again(part, finer, located=True)


def _other_methods(run: Taken, k: int, halved: int) -> list[str]:
    """Methods that may do better from step ``k`` on: one of higher order, and one for stiff diagrams."""
    rule, eq = run.session.kernel.plan.method, run.session.eq
    if rule.implicit or k != run.k or len(eq.x) > MOST_TRIED_STATES or run.located:
        return []
    return [*([EXPLICIT] if rule.name != EXPLICIT else []), *([IMPLICIT] if halved > STIFF_HALVINGS else [])]


# ---- text


def step_finding(found: Examined, remedy: Advice, tolerance: float) -> str:
    """The finding: the worst state, when, by how much, and the settings that suffice."""
    run, k = found.run, -(-found.part.k // found.run.every) * found.run.every
    session = run.session
    error = found.error(found.states)
    signal = int(np.argmax(error.max(axis=0)))
    first, worst = int(np.argmax(error[:, signal] > tolerance)), int(np.argmax(error[:, signal]))
    name = session.eq.y[run.watched[signal]]
    began, most = (f"{session.start + (k + i * run.every) * session.h:.6g} s" for i in (first, worst))
    unit = session.eq.units.get(name, "")
    value, right = (f"{x[worst, signal]:.4g}{f' {unit}' if unit else ''}" for x in (found.states, found.finest))
    size = error[worst, signal] * run.weights[signal]
    share = f" (it is off by {_percent(size)})" if math.isfinite(size) else ""
    return (
        f"{name} is {value} at t = {most}, where shorter steps give {right}{share}. It begins to differ at "
        f"t = {began}. {_remedy(session, found, remedy)}"
    )


def _up_to(session: Session, found: Examined) -> str:
    """Up to when the remedy was examined, where that is not the end of the run."""
    end = found.part.k + found.part.n
    return f" up to t = {session.start + end * session.h:.6g} s" if end < found.run.k + found.run.steps else ""


def _percent(share: float) -> str:
    if share < 3:
        return f"{100 * share:.{2 if share < 1 else 3}g} % of its largest value"
    return f"{share:.3g} times its largest value"


def _remedy(session: Session, found: Examined, remedy: Advice) -> str:
    ways = []
    if remedy.step is not None:
        ways.append(f"a step of {'' if remedy.tried else 'about '}{remedy.step:.8g} s")
    if remedy.locate:
        ways.append("locate=True at this step (the error arises where limits and signs switch between instants)")
    if remedy.method:
        ways.append(f"method='{remedy.method}' at this step{STIFF if remedy.method == IMPLICIT else ''}")
    if ways:
        text = f"{' or '.join(ways)} would do{_up_to(session, found)}."
        return text[0].upper() + text[1:]
    return (
        f"Down to steps of {session.h / 2 ** len(found.gaps):.4g} s results do not settle: the diagram may be chaotic, "
        "unstable or very stiff, or switch back and forth at one point."
    )
