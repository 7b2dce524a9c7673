"""Fastest poles of the equations at the start of a run, and the warning of a step that is too long for them."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common.rounding import to_digits_below
from tsmblocks.common.tables import few
from tsmblocks.engine.equations import DELAY_SAMPLES, Equations, function_values
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel import Memory
from tsmblocks.engine.methods import Method

MOST_STATES = 120
"""States up to which eigenvalues are computed; above, the diagonal of the Jacobian is used. Chosen: for speed."""
MOST_CHECKED = 16
"""Sets of parameters whose poles are computed, at most. Chosen: for speed."""

BISECTIONS = 60
"""Halvings in the search for the longest stable step. Chosen: to rounding."""

_SILENT: ContextVar[bool] = ContextVar("quiet", default=False)
"""Whether step warnings are off in this context."""


class StepWarning(UserWarning):
    """The step is too long for the fastest pole of the diagram."""


@attrs.frozen(eq=False)
class RunStart:
    """The start of a run: time ``start`` [s], states and memory (those of the diagram unless given).

    ``signals`` are the inputs with the order of their derivatives; without them inputs are zero. ``label`` names the
    set of parameters where there are several.
    """

    eq: Equations
    p: np.ndarray
    start: float = 0.0
    signals: Sequence[tuple[Signal, int]] = ()
    memory: Memory | None = None
    label: str = ""


def warn_of_fast_poles(runs: Sequence[RunStart], rule: Method, h: float) -> bool:
    """Warn when a mode that decays would grow under this method at this step of ``h`` [s]; whether it was.

    One warning reports the worst of several runs, at the line that called the caller.
    """
    text = fast_poles(runs, rule, h)
    if text:
        warnings.warn(text, StepWarning, stacklevel=3)
    return bool(text)


def fast_poles(runs: Sequence[RunStart], rule: Method, h: float) -> str:
    """The warning of a mode that decays and would grow under this method at this step of ``h`` [s]; empty for none."""
    if _SILENT.get():
        return ""
    checked = [(fastest_growing_pole(one, rule, h), one) for one in runs]
    growing = [(found, one) for found, one in checked if found is not None]
    if not growing:
        return ""
    (pole, state, _), worst = max(growing, key=lambda one: abs(one[0].pole))
    longest = min(_longest_step(found.poles, rule, h) for found, _ in growing)
    which = f" {concerned(len(checked), len(growing), worst.label)}" if worst.label else ""
    return (
        f"diagram '{worst.eq.title}': the step of {h:g} s is too long for the fastest pole "
        f"({abs(pole):.3g} rad/s, at {state}); {rule.name} needs a step of about "
        f"{to_digits_below(longest)} s there, an implicit method (sdirk2) does not.{which}"
    )


def concerned(checked: int, found: int, worst: str) -> str:
    """Which sets of parameters a warning is about."""
    if checked == 1:
        return f"This is for {worst}."
    return f"Of {checked} sets of parameters that were checked this concerns {found}, most of all {worst}."


def step_warnings_are_off() -> bool:
    """Whether warnings of the step are off in this context."""
    return _SILENT.get()


@contextmanager
def no_step_warnings() -> Iterator[None]:
    """No step warnings within this context: a call that does many runs has given one already."""
    before = _SILENT.set(True)
    try:
        yield
    finally:
        _SILENT.reset(before)


def extreme_sets(columns: Mapping[str, np.ndarray]) -> list[int]:
    """Positions of the first set and of the extremes of each parameter, ``MOST_CHECKED`` at most."""
    numbers = [values for values in columns.values() if values.dtype.kind == "f"]
    ends = (int(end(values)) for values in numbers for end in (np.argmin, np.argmax))
    return list(dict.fromkeys([0, *ends]))[:MOST_CHECKED]


def set_text(numbers: Mapping[str, Any]) -> str:
    """One set of parameters in a line."""
    return few(
        f"{name} = {value:.4g}" if isinstance(value, float) else f"{name} = {value!r}"
        for name, value in numbers.items()
    )


class GrowingPole(NamedTuple):
    """The fastest decaying pole that grows under a method, its state, and all ``poles`` of the equations."""

    pole: complex
    state: str
    poles: np.ndarray


def fastest_growing_pole(run: RunStart, rule: Method, h: float) -> GrowingPole | None:
    """The fastest decaying pole that grows under the method, with the state it belongs to; None if there is none."""
    if not run.eq.x:
        return None
    return _growing_pole(run.eq, rule, h, run.start, *(part.tobytes() for part in (run.p, *_start_values(run, h))))


@functools.lru_cache(maxsize=128)
def _growing_pole(eq: Equations, rule: Method, h: float, start: float, *bits: bytes) -> GrowingPole | None:
    """As ``fastest_growing_pole``, of the bytes of parameters, states, memory and inputs.

    Kept, since the same run is often repeated: the poles take longer than a short run.
    """
    p, x, d, u = map(np.frombuffer, bits)
    a = _jacobian_at(eq, start, h, p, x, d, u)
    if len(eq.x) > MOST_STATES:
        values = a.astype(complex)
        worst = _fastest_growing(values, rule, h)
        return None if worst is None else GrowingPole(values[worst], eq.x[worst], values)
    if not np.isfinite(a).all():
        return None  # the run reports what is not finite, and where
    if _fastest_growing(np.linalg.eigvals(a), rule, h) is None:
        return None
    values, vectors = np.linalg.eig(a)
    worst = _fastest_growing(values, rule, h)
    if worst is None:
        return None
    return GrowingPole(values[worst], _state_of(eq, vectors[:, worst]), values)


def _growing(values: np.ndarray, rule: Method, h: float) -> np.ndarray:
    """Which of some poles decay and grow under a method."""
    with np.errstate(all="ignore"):
        return np.asarray((values.real < 0) & np.isfinite(values) & rule.grows(h * values))


def _longest_step(values: np.ndarray, rule: Method, h: float) -> float:
    """The longest step [s] at which none of some poles does, less than ``h`` at which one does."""
    low, high = 0.0, h
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if _growing(values, rule, middle).any() else (middle, high)
    return low


def _fastest_growing(values: np.ndarray, rule: Method, h: float) -> int | None:
    """Position of the fastest of the decaying modes that grow under a method."""
    growing = _growing(values, rule, h)
    return int(np.argmax(np.where(growing, np.abs(values), -1.0))) if growing.any() else None


def poles(eq: Equations, p: np.ndarray) -> np.ndarray:
    """Poles of the equations at the initial states, with inputs of zero; none where they are not finite."""
    a = _jacobian_at_start(eq, p)
    return np.linalg.eigvals(a) if a.size and np.isfinite(a).all() else np.empty(0)


def growing_pole(eq: Equations, p: np.ndarray) -> tuple[float, str] | None:
    """The largest growth rate [1/s] of a pole at the initial states, and the state it belongs to; None if none grows.

    None for more than ``MOST_STATES`` states as well.
    """
    if not eq.x or len(eq.x) > MOST_STATES:
        return None
    a = _jacobian_at_start(eq, p)
    if not np.isfinite(a).all():
        return None
    values, vectors = np.linalg.eig(a)
    k = int(np.argmax(values.real))
    return (float(values[k].real), _state_of(eq, vectors[:, k])) if values[k].real > 0 else None


def _state_of(eq: Equations, vector: np.ndarray) -> str:
    """The state that takes part most in a mode, given its eigenvector."""
    return eq.x[int(np.argmax(np.abs(vector)))]


def _jacobian_at_start(eq: Equations, p: np.ndarray) -> np.ndarray:
    """The Jacobian of the equations at the initial states, with inputs of zero, whatever their number."""
    return _jacobian_at(eq, 0.0, np.inf, p, *_start_values(RunStart(eq, p), np.inf), whole=True)


def _start_values(run: RunStart, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, memory and inputs at the start of a run with steps of ``h`` s; a jump has just passed."""
    instant = np.array([run.start])
    u = [s.at(instant, order, 1e-6 * h)[0] for s, order in run.signals] or np.zeros(len(run.eq.u))
    x, d = (run.memory.x, run.memory.d) if run.memory else function_values(run.eq.start, run.p)[:2]
    return x, d, np.asarray(u, dtype=float)


def _jacobian_at(
    eq: Equations,
    start: float,
    h: float,
    p: np.ndarray,
    x: np.ndarray,
    d: np.ndarray,
    u: np.ndarray,
    whole: bool = False,
) -> np.ndarray:
    """d(dx)/dx at the time ``start`` [s]; delays have no past yet. Of many states its diagonal, unless ``whole``."""
    q = np.tile([*np.zeros(DELAY_SAMPLES), start, 1 / h, 0.0], len(eq.q))
    whole = whole or len(eq.x) <= MOST_STATES
    values = function_values(_jacobian(eq, whole), np.float64(start), x, d, u, q, p)[0]
    return values.reshape((len(eq.x), len(eq.x)), order="F") if whole else values


@functools.lru_cache(maxsize=64)
def _jacobian(eq: Equations, whole: bool) -> Any:
    """d(dx)/dx or its diagonal, dense, as a function (kept, since equations are compared by identity)."""
    symbols = eq.rhs.sx_in()
    J = ca.jacobian(eq.rhs.call(symbols)[0], symbols[1])
    return ca.Function("jacobian", symbols, [ca.densify(J if whole else ca.diag(J))])
