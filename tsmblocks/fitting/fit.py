"""``fit``: estimate the free parameters of a diagram from recordings, by one method, from several starting points."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import arguments
from tsmblocks.common.arguments import as_integer
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.interrupt import InterruptFlag, defer_interrupt, without_checkpoints
from tsmblocks.common.one_thread import on_one_thread
from tsmblocks.fitting.divergence import raise_cause
from tsmblocks.fitting.memories import placed, refined
from tsmblocks.fitting.multistart import Range, search_range, spread
from tsmblocks.fitting.nearest import nearest_of
from tsmblocks.fitting.optimizer import (
    CONSTRAINT_TOLERANCE,
    OptimizerResult,
    ProgressCallback,
    feasible_start,
    is_same_optimum,
    projected,
)
from tsmblocks.fitting.recordings import Data
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.setup import Setup, pose
from tsmblocks.fitting.step_size import following
from tsmblocks.fitting.summary import summarise
from tsmblocks.model.diagram import Diagram

METHODS = ("gauss-newton", "ipopt", "ga")
NEGLIGIBLE_PRIOR_NOISE = 1e-4
"""Noise, relative to the measured signals, that weights priors in the first of two searches, so small that they hardly
count. Chosen."""
RANDOM_SETS, MAX_RANDOM_SETS = 64, 4096
"""Random sets simulated side by side, of which the best and some others become starting points. Chosen."""


@on_one_thread
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
    hold: Hold = AUTO,
    progress: ProgressCallback | None = None,
    backend: str = "",
) -> Fit:
    """Estimate parameters of a diagram from recordings, with confidence intervals.

    Minimises the mean square of the residuals (paper, Eq (10)).

    Parameters
    ----------
    diagram : Diagram
        The model, whose parameters are the first starting point.
    data : Record, path, DataFrame, list or dict of str to these
        One recording or several experiments, by name. Signals are matched by name to inputs and outputs of the diagram.
    free : list of str, optional
        Parameters to estimate, patterns allowed (``"tsm.*"``). By default all but initial states and parameters from a
        data sheet, such as the counts of an encoder.
    bounds : dict of str to (float, float), optional
        Lower and upper bounds by name or pattern, None for none; within the bounds of the blocks, and no delay shorter
        than a step.
    start : dict of str to float, optional
        Values to start from in place of those of the diagram.
    local : list of str, optional
        Parameters with a separate value in each experiment.
    start_states : bool, default False
        Estimate the initial state of every state in each experiment.
    constraints : str, list of str or dict of str to str, optional
        Inequalities and equalities such as ``"alpha2 + A - abs(delta) > 0"``, names given by the keys of a mapping.
    ties : dict of str to str, optional
        Parameters that follow others, ``{"tsm.alpha2": "tsm.alpha1"}``.
    priors : dict of str to (float, float), optional
        Mean and standard deviation by name. They are weighted against ``sigma``, or else against the residual of a
        first fit in which they hardly count.
    outputs : list of str, optional
        Outputs to compare; by default all that were measured.
    sigma : float, str or dict of str to these, optional
        Standard deviation of the noise, with a unit (``"0.06deg"``, ``{"x_out": "0.06deg"}``); a number alone is in the
        unit of recordings, diagram and all outputs, and refused where these differ. By default one output counts as it
        is, several by their spread.
    window : (float, float) or dict of str to these, optional
        Start and stop in s of the samples to compare, by experiment if they differ. The simulation runs from the start
        of the recording all the same.
    method : {"gauss-newton", "ipopt", "ga"}
        Gauss-Newton with exact sensitivities, its constrained steps solved by CasADi's DAQP; IPOPT through CasADi; or
        the paper's route, a genetic algorithm (SciPy's differential evolution) and then Nelder-Mead.
    starts : int, default 4
        Number of starting points: the diagram's parameters, and the best of 64 random sets.
    seed : int, default 0
        Seed of all random numbers: same seed, same result.
    segments : int, default 1
        With ``"ipopt"``: pieces of each experiment (multiple shooting, for plants that diverge).
    iterations : int, optional
        Limit for each search (with ``"ga"`` for each of its two stages), which then ends with ``status`` ``"limit"``.
    step : float, optional
        Step of the simulation in s; by default that of the diagram's file, else one that resolves the diagram.
        ``notes`` of the result report it where the intervals do not cover the error of the step.
    integrator : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method.
    hold : {"auto", "zero", "linear", "cubic"} or dict of str to these
        Interpolation between samples of the inputs, one for all or by input. By default it is found from the samples:
        zero-order hold where an input is piecewise constant, else linear or a cubic spline.
    progress : callable, optional
        Called as ``progress(stage, evaluations, rms)`` during the search.
    backend : {"", "llvm", "casadi"}
        Machine code or CasADi's evaluator; by default machine code where llvmlite is installed.

    Returns
    -------
    Fit
        Fitted diagram, estimates and residuals. After Ctrl-C the best so far, with ``status`` ``"interrupted"``.

    Raises
    ------
    ParameterError
        For unknown names, unsuitable bounds, and constraints that cannot be met.
    DataError
        For missing signals or unsuitable samples.
    NotFinite
        If the simulation diverges from every starting point.
    RunError
        For an unknown method or options that exclude each other.

    Notes
    -----
    Outputs may be piecewise constant in a parameter (the instant of a step, the interval of a quantiser): its
    derivative is zero or nothing, so many values of it are tried.

    References
    ----------
    J. Nocedal, S. J. Wright, Numerical Optimization, Springer (2006), chapters 10 and 18.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.arange(0, 5, 0.01)
    >>> signals = {"x_in": np.sin(2 * t), "x_out": 0.8 * np.sin(2 * t) + 0.1}
    >>> data = tsm.Record("sweep", t, signals, {"x_in": "rad", "x_out": "rad"})
    >>> fitted = tsm.fit(tsm.load("tendon_sheath_linear"), data)
    >>> round(fitted["gain.gain"].value, 6), fitted.status
    (0.8, 'converged')
    """
    _check_method(method, segments)
    starts, seed = as_integer("starts", starts, 1), as_integer("seed", seed, 0)
    report, limit = arguments.as_callback(progress, "stage, evaluations and rms"), _limit(iterations)
    options: Any = dict(outputs=outputs, window=window, step=step, integrator=integrator, hold=hold, backend=backend)
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
        **options,
    )
    follow = step is None and method == "gauss-newton"
    begin, found = feasible_start(problem, problem.unknowns.start), list[OptimizerResult]()
    samples, unweighted = problem.samples, sigma is None and len(problem.priors.which) > 0
    many = functools.partial(starting_points, starts=starts, seed=seed) if segments == 1 else None
    search = functools.partial(_search, method=method, optimizer=_method(method, seed, segments), starting_points=many)
    with defer_interrupt() as interrupt:

        def report_rms(stage: str, count: int, cost: float) -> None:
            interrupt.check()
            report(stage, count, float(np.sqrt(2 * cost / samples)))

        for _ in range(2 if unweighted else 1):
            if unweighted:
                problem = attrs.evolve(problem, noise=_prior_noise(problem, found))
            problem, setup, found = search(problem, setup, begin, {**limit, "progress": report_rms}, follow)
            begin = found[0].theta
            if interrupt.stop or any(f.status == "interrupted" for f in found):
                break
        found = _nearest(problem, setup, found, interrupt)
    return summarise(problem, setup, method, found, followed=follow)


def _check_method(method: str, segments: int) -> None:
    if not isinstance(method, str) or method not in METHODS:
        raise RunError(f"there is no method {in_words(method)} of fitting.{near(method, METHODS)}")
    if as_integer("segments", segments, 1) > 1 and method != "ipopt":
        raise RunError(f"segments={segments} (multiple shooting) needs method='ipopt', got '{method}'.")


def _limit(iterations: int | None) -> dict[str, Any]:
    """The option of a search that limits its iterations."""
    return {} if iterations is None else {"iterations": as_integer("iterations", iterations, 0)}


def _prior_noise(problem: Problem, found: list[OptimizerResult]) -> float:
    """Noise that weights the priors where none is given: so small that they hardly count, then the first residual."""
    if not found:
        return NEGLIGIBLE_PRIOR_NOISE * problem.size
    squares = 2 * (found[0].cost - problem.prior_cost(found[0].theta))
    free = max(problem.samples - len(problem.unknowns.items), 1)
    return float(np.sqrt(max(squares / free, 0.0))) + 1e-9 * problem.size


def _search(
    problem: Problem,
    setup: Setup,
    begin: np.ndarray,
    options: Mapping[str, Any],
    follow: bool,
    *,
    method: str,
    optimizer: Callable[..., OptimizerResult],
    starting_points: Callable[..., list[np.ndarray]] | None,
) -> tuple[Problem, Setup, list[OptimizerResult]]:
    """The results from all starting points, best first; with ``follow`` at a step that follows the parameters.

    Without ``starting_points`` the search begins at ``begin`` alone.
    """
    from tsmblocks.fitting.discontinuous import search_discontinuous

    ends: list[OptimizerResult] = []
    try:
        begins = [begin] if starting_points is None else starting_points(problem, setup, begin)
        for one in begins[:1] if method == "ga" else begins:
            ends.append(optimizer(problem, one, **options))
            if ends[-1].status == "interrupted":
                return problem, setup, _ranked(problem, ends)
        if method != "ga":
            ends = [refined(problem, end, lambda start: optimizer(problem, start, **options)) for end in ends]
        ends = _ranked(problem, search_discontinuous(problem, _ranked(problem, ends), **options))
        if follow:
            problem, setup, ends = _followed(problem, setup, ends, functools.partial(optimizer, **options))
    except KeyboardInterrupt:  # between searches, or before one had a first result
        with without_checkpoints():
            best, *others = _ranked(problem, ends or [OptimizerResult(begin, problem.cost(begin), "interrupted", 0, 1)])
        ends = [attrs.evolve(best, status="interrupted"), *others]
    return problem, setup, ends


def _followed(
    problem: Problem,
    setup: Setup,
    ends: list[OptimizerResult],
    search: Callable[[Problem, np.ndarray], OptimizerResult],
) -> tuple[Problem, Setup, list[OptimizerResult]]:
    """The results with the best continued at a step that follows the parameters, and those of its optimum with it."""
    finer, fine_setup, best = following(problem, setup, ends[0], search)
    if finer is problem:
        return problem, setup, ends
    others = [
        attrs.evolve(one, theta=best.theta, cost=best.cost)
        if is_same_optimum(problem, ends[0], one)
        else attrs.evolve(one, cost=finer.cost(one.theta))
        for one in ends[1:]
    ]
    return finer, fine_setup, [best, *_ranked(finer, others)]


def _nearest(
    problem: Problem, setup: Setup, found: list[OptimizerResult], interrupt: InterruptFlag
) -> list[OptimizerResult]:
    """The results with the best moved nearest to the diagram's own parameters, or marked where Ctrl-C was pressed."""
    stopped = interrupt.stop or any(f.status == "interrupted" for f in found)
    try:
        found = found if stopped else nearest_of(problem, setup, found)
    except KeyboardInterrupt:
        stopped = True
    return [attrs.evolve(found[0], status="interrupted"), *found[1:]] if stopped or interrupt.stop else found


def _ranked(problem: Problem, ends: list[OptimizerResult]) -> list[OptimizerResult]:
    """Results by cost, lowest first; those that violate a constraint come last."""
    return sorted(ends, key=lambda f: (problem.violation(f.theta) > 10 * CONSTRAINT_TOLERANCE, f.cost))


def _method(method: str, seed: int, segments: int) -> Callable[..., OptimizerResult]:
    """The method as a function of problem and start, with keywords ``iterations`` and ``progress``."""
    if method == "gauss-newton":
        from tsmblocks.fitting.gauss_newton import gauss_newton

        return gauss_newton
    if method == "ga":
        from tsmblocks.fitting.genetic_route import genetic_route

        return lambda problem, start, **options: genetic_route(problem, start, ranges(problem), seed=seed, **options)
    if segments == 1:
        from tsmblocks.fitting.ipopt import interior_point

        return interior_point
    from tsmblocks.fitting.multiple_shooting import multiple_shooting

    return functools.partial(multiple_shooting, segments=segments)


def ranges(problem: Problem) -> list[Range]:
    """The range of each unknown in a random search."""
    return [search_range(item.start, item.low, item.high) for item in problem.unknowns.items]


def starting_points(problem: Problem, setup: Setup, begin: np.ndarray, starts: int, seed: int) -> list[np.ndarray]:
    """The start of the diagram and the best of many random sets; only those whose simulation is finite."""
    begins = [begin] if np.isfinite(problem.cost(begin)) else []
    if starts > 1:
        tried = _scattered(problem, seed, min(max(RANDOM_SETS, 2 * starts), MAX_RANDOM_SETS))
        costs = problem.costs(tried)
        begins += [tried[k] for k in _mixed(costs)[: starts - len(begins)]]
    begins = [placed(problem, one) for one in begins]
    if not begins:
        for e, experiment in enumerate(problem.experiments):
            p = problem.unknowns.parameters(begin, e)
            if not np.isfinite(experiment.outputs(p)).all():
                raise_cause(setup.diagram, experiment, p)
        raise RunError(
            "the search cannot begin: at its start the simulation is so far from the measurement that the squared "
            "residual overflows. Is an initial state or a unit wrong?"
        )
    return begins


def _scattered(problem: Problem, seed: int, count: int) -> np.ndarray:
    """Random sets that meet the constraints, some of them moved there, shape (up to count, unknowns)."""
    if not problem.constraints.names:
        return spread(ranges(problem), count, seed)
    drawn = spread(ranges(problem), 4 * count, seed)
    good = np.array([problem.inside(theta) for theta in drawn])
    kept = list(drawn[good][:count])
    moved = (projected(problem, theta) for theta in drawn[~good][: count - len(kept)])
    return np.array([*kept, *(theta for theta in moved if theta is not None)]).reshape(-1, drawn.shape[1])


def _mixed(costs: np.ndarray) -> list[int]:
    """Indices of finite cost, alternately the lowest cost and the first drawn: the lowest may all share one minimum."""
    cheap = [int(k) for k in np.argsort(costs, kind="stable") if np.isfinite(costs[k])]
    return list(dict.fromkeys(k for pair in zip(cheap, sorted(cheap), strict=True) for k in pair))
