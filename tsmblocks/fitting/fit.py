"""``fit``: free parameters of a diagram found from recordings, by the method asked for, from several starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import arguments
from tsmblocks.common.arguments import as_integer
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.interrupt import InterruptFlag, defer_interrupt
from tsmblocks.fitting.divergence import raise_cause
from tsmblocks.fitting.multistart import Range, search_range, spread
from tsmblocks.fitting.optimizer import MISSED, Found, Tell, feasible_start, projected
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.setup import Data, Setup, pose
from tsmblocks.fitting.summary import summed_up
from tsmblocks.model.diagram import Diagram

METHODS = ("gauss-newton", "ipopt", "ga")
FAINT = 1e-4
"""Noise, as a share of what was measured, beside which priors hardly count."""
SCREENED, MOST_SCREENED = 64, 4096
"""Random sets priced side by side, of which the best and some others become further starts."""


def fit(
    diagram: Diagram,
    data: Data,
    *,
    free: Iterable[str] | None = None,
    bounds: Mapping[str, Any] | None = None,
    start: Mapping[str, float] | None = None,
    local: Iterable[str] = (),
    start_states: bool = False,
    constraints: Any = None,
    ties: Mapping[str, str] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    outputs: Sequence[str] | None = None,
    sigma: Any = None,
    window: Any = None,
    method: str = "gauss-newton",
    starts: int = 4,
    seed: int = 0,
    segments: int = 1,
    iterations: int | None = None,
    step: float | None = None,
    integrator: str = "rk4",
    hold: str = "linear",
    progress: Tell | None = None,
    backend: str = "",
) -> Fit:
    """Find the parameters with which a diagram comes closest to recordings, and how sure they are.

    ``data`` is a recording (``tsm.read``, a file name, a pandas frame), a list of them or a mapping by name;
    its signals are matched by name to the diagram's inputs and outputs. What is minimised is the mean
    square of the differences (paper, Eq (10)).

    What may change: ``free`` names parameters, patterns allowed (``"tsm.*"``; by default all but start values
    and what is read off a data sheet, such as the counts of an encoder). ``bounds`` maps names or patterns to
    ``(low, high)``, within what the blocks declare (and no delay shorter than a step); ``start`` gives other
    numbers to start from. Parameters in ``local`` (start values of states, say) have a value of their own in
    each experiment; ``start_states`` does that with the start value of every state. ``ties`` lets parameters
    follow others (``{"tsm.alpha2": "tsm.alpha1"}``). ``constraints`` are texts such as
    ``"alpha2 + A - abs(delta) > 0"``, a list or a mapping by name. ``priors`` maps names to ``(mean, standard
    deviation)``; they are weighed against ``sigma``, or else against what a first fit leaves that hardly heeds
    them.

    What is compared: ``outputs`` (by default all that were measured) in ``window`` (start, stop) [s], which
    may differ by experiment; the simulation runs from the start of the recording all the same.
    ``sigma`` is the noise of each output with its unit, one for all or by output (``"0.06deg"``,
    ``{"x_out": "0.06deg"}``); a number alone is in the unit of the recordings and of the diagram, and refused where
    those differ. Without it one output counts as it is, several by their spread.

    How: ``method`` is ``"gauss-newton"``, ``"ipopt"`` (with ``segments`` > 1: multiple shooting, for plants
    that run away) or ``"ga"`` (a genetic algorithm, then Nelder-Mead: the paper's route). ``starts`` > 1
    begins from the diagram's numbers and from the best of ``SCREENED`` random sets too; ``seed`` makes
    that repeatable; ``iterations`` limits each search (with ``"ga"`` each of its two stages), which then ends with
    ``status`` ``"limit"``. ``step`` [s] is that of the simulation, chosen to resolve the diagram by default;
    where the intervals do not cover the error of the step, ``notes`` say so. Numbers by which the outputs only
    jump (the instant of a step, the interval of a quantiser) have no slope: many values of them are tried.
    ``progress(stage, evaluations, rms)`` is called now and then. Ctrl-C ends the search; the best so far
    is returned with ``status`` ``"interrupted"``.

    Raises ParameterError (names, bounds, constraints that cannot be met), DataError (signals, samples), and
    NotFinite when no start can be simulated.
    """
    _check(method, segments)
    starts, seed = as_integer("starts", starts, 1), as_integer("seed", seed, 0)
    iterations = iterations if iterations is None else as_integer("iterations", iterations, 0)
    arguments.as_callback(progress, "stage, evaluations and rms")
    problem, setup = pose(
        diagram,
        data,
        free=free,
        bounds=bounds,
        start=start,
        local=local,
        start_states=start_states,
        constraints=constraints,
        ties=ties,
        priors=priors,
        sigma=sigma,
        outputs=outputs,
        window=window,
        step=step,
        integrator=integrator,
        hold=hold,
        backend=backend,
    )
    begin, found = feasible_start(problem, problem.unknowns.start), list[Found]()
    with defer_interrupt() as asked:
        search = _searcher(method, seed, segments, iterations, _told(progress, problem, asked))
        for noise in _noises(problem, sigma):
            problem = attrs.evolve(problem, noise=noise(found))
            found = search(problem, [begin] if segments > 1 else begins(problem, setup, begin, starts, seed))
            begin = found[0].theta
            if asked.stop or any(f.status == "interrupted" for f in found):
                found[0] = attrs.evolve(found[0], status="interrupted")
                break
    return summed_up(problem, setup, method, found)


def _check(method: str, segments: Any) -> None:
    if not isinstance(method, str) or method not in METHODS:
        raise RunError(f"there is no method {in_words(method)} of fitting.{near(method, METHODS)}")
    if as_integer("segments", segments, 1) > 1 and method != "ipopt":
        raise RunError(f"segments={segments} (multiple shooting) goes with method='ipopt', not with '{method}'.")


def _noises(problem: Problem, sigma: Any) -> list[Callable[[list[Found]], float]]:
    """What priors are weighed against, search by search: where no noise was given, they hardly count at first."""
    if sigma is not None or not len(problem.priors.which):
        return [lambda _: 1.0]
    free = max(problem.samples - len(problem.unknowns.items), 1)

    def left(found: list[Found]) -> float:
        squares = 2 * (found[0].cost - problem.prior_cost(found[0].theta) * (FAINT * problem.size) ** 2)
        return float(np.sqrt(max(squares / free, 0.0))) + 1e-9 * problem.size

    return [lambda _: FAINT * problem.size, left]


def _told(progress: Tell | None, problem: Problem, asked: InterruptFlag) -> Tell:
    """Progress told in the root mean square of a difference, which means something to people; stops on Ctrl-C."""

    def tell(stage: str, count: int, cost: float) -> None:
        asked.check()
        if progress is not None:
            progress(stage, count, float(np.sqrt(2 * cost / problem.samples)))

    return tell


Search = Callable[[Problem, Sequence[np.ndarray]], list[Found]]


def _searcher(method: str, seed: int, segments: int, iterations: int | None, tell: Tell) -> Search:
    """The method as a function from starts to ends, best first."""
    from tsmblocks.fitting.discontinuous import over_jumps

    one = _method(method, seed, segments)
    most: dict[str, Any] = {"tell": tell} if iterations is None else {"tell": tell, "iterations": iterations}

    def search(problem: Problem, begins: Sequence[np.ndarray]) -> list[Found]:
        ends: list[Found] = []
        for begin in begins[:1] if method == "ga" else begins:
            try:
                ends.append(one(problem, begin, **most))
            except KeyboardInterrupt:  # before the search had anything of its own
                ends.append(Found(begin, problem.cost(begin), "interrupted", 0, 1))
            if ends[-1].status == "interrupted":
                return _ranked(problem, ends)
        return _ranked(problem, over_jumps(problem, _ranked(problem, ends), **most))

    return search


def _ranked(problem: Problem, ends: list[Found]) -> list[Found]:
    """Best first; what misses a constraint last."""
    return sorted(ends, key=lambda f: (problem.violation(f.theta) > 10 * MISSED, f.cost))


def _method(method: str, seed: int, segments: int) -> Callable[..., Found]:
    """The method as a function of problem and start, with keywords ``iterations`` and ``tell``."""
    if method == "gauss-newton":
        from tsmblocks.fitting.gauss_newton import gauss_newton

        return gauss_newton
    if method == "ga":
        from tsmblocks.fitting.global_search import genetic_route

        return lambda problem, start, **most: genetic_route(problem, start, ranges(problem), seed=seed, **most)
    if segments == 1:
        from tsmblocks.fitting.single_shooting import interior_point

        return interior_point
    from tsmblocks.fitting.multiple_shooting import multiple_shooting

    return lambda problem, start, **most: multiple_shooting(problem, start, segments, **most)


def ranges(problem: Problem) -> list[Range]:
    """Where random search looks for each unknown."""
    return [search_range(item.start, item.low, item.high) for item in problem.unknowns.items]


def begins(problem: Problem, setup: Setup, begin: np.ndarray, starts: int, seed: int) -> list[np.ndarray]:
    """The diagram's own numbers, and the best of many random sets; only such as simulate to finite numbers."""
    begins = [begin] if np.isfinite(problem.cost(begin)) else []
    if starts > 1:
        tried = _scattered(problem, seed, min(max(SCREENED, 2 * starts), MOST_SCREENED))
        costs = problem.costs(tried)
        begins += [tried[k] for k in _mixed(costs)[: starts - len(begins)]]
    if not begins:
        for e, trial in enumerate(problem.trials):
            p = problem.unknowns.parameters(begin, e)
            if not np.isfinite(trial.outputs(p)).all():
                raise_cause(setup.diagram, trial, p)
        raise RunError(
            "the search cannot begin: there the simulation is so far from what was measured that the square "
            "of the difference is no number. Is a start value or a unit wrong?"
        )
    return begins


def _scattered(problem: Problem, seed: int, count: int) -> np.ndarray:
    """Random sets that meet the constraints, some of them moved there, shape (up to count, unknowns)."""
    if not problem.limits.names:
        return spread(ranges(problem), count, seed)
    drawn = spread(ranges(problem), 4 * count, seed)
    good = np.array([problem.inside(theta) for theta in drawn])
    kept = list(drawn[good][:count])
    moved = (projected(problem, theta) for theta in drawn[~good][: count - len(kept)])
    return np.array([*kept, *(theta for theta in moved if theta is not None)]).reshape(-1, drawn.shape[1])


def _mixed(costs: np.ndarray) -> list[int]:
    """Places of finite cost, the cheapest and the first drawn by turns: the cheapest alone may share one valley."""
    cheap = [int(k) for k in np.argsort(costs, kind="stable") if np.isfinite(costs[k])]
    return list(dict.fromkeys(k for pair in zip(cheap, sorted(cheap), strict=True) for k in pair))
