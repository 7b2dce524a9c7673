"""Algebraic loops that are solved while a diagram runs: a damped Newton method, and its report in a run.

A nonlinear loop is a system F(z, w) = 0 in the signals z at which it was torn; w are the numbers it reads. Its exact
Jacobian is in ``Loop.correction``, the Newton correction -F'(z)^-1 F(z). The method starts from the last solution, then
from ``STARTS``; it halves a correction that does not reduce F. Compiled kernels write it as machine code
(``loop_code``); here it is a CasADi function of the same steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

STARTS = 30
"""Starts from which the method tries again when it fails from the last solution (``start_value``). Chosen."""
MOST_ITERATIONS = 50
"""Corrections from one start. Chosen: Newton's method takes 3 to 10 where it converges."""
LEAST_SHARE = 2.0**-12
"""Share of a correction below which the method gives up from this start. Chosen."""
DECREASE = 0.02
"""Share by which a correction must reduce the sum of squares of F, times the share of the correction taken. Chosen:
small, as usual for backtracking (Nocedal and Wright, Numerical Optimization, 3.1)."""
TOLERANCE, FLOOR = 1e-8, 1e-12
"""Correction at which the method ends: a share of z, and a size that ends it where F is reduced no more (``STALLED``),
as rounding near z = 0 does. The error left is of its square. Chosen."""
STALLED = 0.25
"""Share of the sum of squares of F that counts as no reduction. Chosen: near a solution a correction leaves far less,
1/16 even at a double root. Steps of a method do not wait for it: they are small where states rest."""
RESIDUAL = 1e-5
"""Norm of F, as a share of 1 + |z|, above which a small correction is no solution: F is steep there, as a square root
is at 0, and not zero. Chosen: far above the rounding of F in loops with gains up to 1e9."""
FINITE = 1e300
"""Sum of squares of F above which a start is useless. Chosen: below the overflow."""
STATISTICS = ("solved", "iterations", "most", "failed")
"""Numbers kept after the solution of a loop: how often it was solved, iterations in all and at most, failures."""
NAME = "loop_"
"""Names of solving functions in the equations begin with this; the number of the loop follows."""


@attrs.frozen(eq=False)
class Loop:
    """An algebraic loop. ``path`` are the signals around it; ``size`` the number of signals at which it is torn.

    ``correction(z, w)`` gives the Newton correction, the sum of squares of F, and whether that may count as zero (see
    ``newton_correction``); it is None where the loop is linear and was eliminated. ``function`` is the name of the
    function that solves it: ``rhs``, ``update`` (at samples), or ``advance`` (a step of an implicit method).
    """

    path: tuple[str, ...]
    size: int
    correction: Any = attrs.field(default=None, repr=False)
    function: str = "rhs"

    @property
    def of_step(self) -> bool:
        """Whether these are the states of a step of an implicit method."""
        return self.function == "advance"

    @property
    def linear(self) -> bool:
        """Whether the loop was eliminated when the diagram was compiled."""
        return self.correction is None

    def __str__(self) -> str:
        return " -> ".join(self.path)


@attrs.frozen
class LoopReport:
    """An algebraic loop of a run.

    Parameters
    ----------
    path : tuple of str
        Signals around the loop; the first and the last are the same.
    linear : bool
        Whether it was eliminated when the diagram was compiled; then it takes no iterations.
    solved : int
        How often it was solved.
    mean_iterations, most_iterations : float, int
        Newton iterations for one solution, on average and at most.
    """

    path: tuple[str, ...]
    linear: bool
    solved: int = 0
    mean_iterations: float = 0.0
    most_iterations: int = 0

    def __str__(self) -> str:
        how = "linear, eliminated"
        if not self.linear:
            how = f"solved {self.solved} times in {self.mean_iterations:.3g} iterations, {self.most_iterations} at most"
        return f"{' -> '.join(self.path)}: {how}"


@attrs.frozen(eq=False)
class LoopForms:
    """Equations with loops as kernels take them: with the last solutions as one more argument, and the new as a result.

    ``plain`` are ``rhs`` and ``update`` with each solution as the method leaves it, ``exact`` the same with one more
    Newton correction, which is differentiated: by the implicit function theorem its derivative is that of the solution.
    ``open`` is ``rhs`` with the signals z of its loops as one more argument, and what they must equal as a result.
    """

    plain: tuple[Any, Any]
    exact: tuple[Any, Any]
    open: Any


def start_value(number: int, k: int) -> float:
    """Signal k of a loop at a start: 0, 1 or -1, then numbers between them that differ, times 10^-6 to 10^6.

    Multiples of the golden ratio spread evenly (Weyl's sequence).
    """
    if number <= 3:
        return (0.0, 1.0, -1.0)[number - 1]
    share = (0.6180339887498949 * (7 * number + k)) % 1.0
    powers = (*range(7), *range(7), *range(7), -3, -6, -3, -6, -3, -6)  # small ones last: they are seldom of use
    return (2.0 * share - 1.0) * 10.0 ** powers[number - 4]


def solved_loops(loops: Iterable[Loop]) -> list[Loop]:
    """Those loops that are solved in the kernel, in the order of their numbers."""
    return [loop for loop in loops if not loop.linear]


def region(loop: Loop) -> int:
    """Numbers that a kernel keeps for a loop: its solution and ``STATISTICS``."""
    return loop.size + len(STATISTICS)


def reports(loops: Sequence[Loop], kept: Sequence[np.ndarray]) -> tuple[LoopReport, ...]:
    """The report of a run on its loops; ``kept`` are the ``STATISTICS`` of those solved in the kernel."""
    made, numbers = [], iter(kept)
    for loop in loops:
        if loop.linear:
            made.append(LoopReport(loop.path, True))
        else:
            solved, iterations, most, _ = next(numbers)
            made.append(LoopReport(loop.path, False, int(solved), float(iterations / max(solved, 1)), int(most)))
    return tuple(made)


def newton_correction(z: Any, w: Any, step: Any, f: Any, jacobian: Any = None) -> Any:
    """The function ``Loop.correction``. Where F' is infinite the correction is 0, but solves nothing unless F is 0.

    Without the Jacobian, as in steps of a method, whose F' is near 1, the residual alone is looked at, which is faster.
    """
    size = ca.sumsqr(f)
    near = size <= RESIDUAL**2 * (1 + ca.sumsqr(z))
    if jacobian is not None:
        undefined = ca.logic_not(ca.sumsqr(jacobian) < np.inf)
        step = ca.if_else(ca.logic_and(size == 0, undefined), 0, step)
        near = ca.logic_or(size <= FLOOR**2, ca.logic_and(near, ca.mmax(ca.fabs(step)) > 0))
    return ca.Function("correction", [z, w], [step, size, near])


def solving_function(number: int, correction: Any, *, of_step: bool = False) -> Any:
    """The solution of a loop as a function of the last one and of w, with the number of iterations.

    It is not inlined, so that kernels can recognise it by its name. Its derivative counts as 0 (see ``LoopForms``); it
    is a function of scalars around one of matrices since CasADi 3.8 leaves the derivative of the latter undefined then.
    """
    n, m = correction.size1_in(0), correction.size1_in(1)
    guess, w = ca.MX.sym("guess", n), ca.MX.sym("w", m)
    one = _iteration(correction, of_step)
    state = one.fold(6)(_begin(guess, w))
    most = (1 + STARTS) * MOST_ITERATIONS
    rest = one.fold(most)(state)
    state = ca.if_else(state[-1 - m], state, rest, True)  # evaluated only where some are left
    inner = ca.Function("newton", [guess, w], [state[:n], state[-2 - m]], {"never_inline": True})
    scalars = ca.SX.sym("guess", n), ca.SX.sym("w", m)
    options: dict[str, Any] = {"never_inline": True, "is_diff_in": [False, False]}
    return ca.Function(f"{NAME}{number}", scalars, inner.call(scalars), ["guess", "w"], ["root", "count"], options)


def _begin(guess: Any, w: Any) -> Any:
    """State of the method before its first iteration."""
    start = ca.if_else(ca.fabs(guess) < np.inf, guess, 0)
    undefined = 1 - ca.mmin(ca.vertcat(1, w <= np.inf))  # NaN is not
    nothing = ca.MX.ones(guess.shape[0]) * np.nan
    return ca.vertcat(nothing, start, start, start, 0 * guess, np.inf, 1, 0, 0, 0, undefined, w)


def _iteration(correction: Any, of_step: bool) -> Any:
    """One evaluation of F and what follows from it, as a function from state to state (order: see ``names``).

    ``root`` is the result, ``c`` the candidate, ``z`` the last accepted point with its correction ``dz`` and sum of
    squares ``merit``, ``share`` the part of the correction taken.
    """
    n, m = correction.size1_in(0), correction.size1_in(1)
    names = {"root": n, "guess": n, "c": n, "z": n, "dz": n, "merit": 1, "share": 1}
    names |= {"tries": 1, "start": 1, "count": 1, "done": 1, "w": m}
    old = {k: ca.SX.sym(k, size) for k, size in names.items()}
    root, guess, c, z, dz, merit, share, tries, start, count, done, w = old.values()
    step, size, near = correction.call([c, w])
    floor = FLOOR if of_step else ca.if_else(size > STALLED * merit, FLOOR, 0.0)
    small = ca.logic_and(near, ca.mmin(ca.fabs(step) <= TOLERANCE * (ca.fabs(c) + ca.fabs(guess)) + floor))
    accepted = ca.logic_and(size <= (1 - DECREASE * share) * merit, size < FINITE)
    z, dz, merit = (ca.if_else(accepted, a, b) for a, b in ((c, z), (step, dz), (size, merit)))
    share = ca.if_else(accepted, ca.fmin(4 * share, 1), share / 2)
    tries = tries + 1
    failed = ca.logic_and(ca.logic_not(small), ca.logic_or(share < LEAST_SHARE, tries >= MOST_ITERATIONS))
    again = start + failed
    other = ca.SX.zeros(n)
    for number in range(1, STARTS + 1):
        other = ca.if_else(again == number, ca.SX([start_value(number, k) for k in range(n)]), other)
    new = {
        "root": ca.if_else(small, c + step, root),
        "guess": guess,
        "c": ca.if_else(failed, other, z + share * dz),
        "z": ca.if_else(failed, other, z),
        "dz": ca.if_else(failed, 0, dz),
        "merit": ca.if_else(failed, np.inf, merit),
        "share": ca.if_else(failed, 1, share),
        "tries": ca.if_else(failed, 0, tries),
        "start": again,
        "count": count + 1,
        "done": ca.logic_or(small, again > STARTS),
        "w": w,
    }
    state = ca.vertcat(*old.values())
    kept = ca.vertcat(*(ca.if_else(done, old[k], v) for k, v in new.items()))
    return ca.Function("iteration", [state], [kept])
