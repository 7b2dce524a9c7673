"""Tuning of the parameters of a controller: arguments, search and result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_callback, as_integer
from tsmblocks.common.errors import ParameterError, RunError, in_words
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.metrics.metrics import Metric, metrics
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path
from tsmblocks.simulation.arguments import RunOptions, as_diagram
from tsmblocks.studies import Plan, Uniform
from tsmblocks.studies.distributions import uniform_between
from tsmblocks.studies.study import signal_units
from tsmblocks.tuning.constraints import LIMIT_TOLERANCE, limit
from tsmblocks.tuning.hunting import hunting
from tsmblocks.tuning.result import Tuned
from tsmblocks.tuning.search import Search
from tsmblocks.tuning.smooth_metrics import differentiable

LOG_SCALE_RATIO = 20.0
"""Ratio of bounds above which a parameter is searched on a logarithmic scale. Chosen."""


def tune(
    diagrams: Diagram | Mapping[str, Diagram],
    free: Mapping[str, Any],
    minimise: str | Mapping[str, str],
    *,
    subject_to: str | Sequence[str] = (),
    plants: Plan | None = None,
    stop: float | None = None,
    step: float = 1e-3,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: Hold = AUTO,
    starts: int = 4,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[str, int, int], Any] | None = None,
    backend: str = "",
) -> Tuned:
    """Find parameters that make a metric small within limits, in the worst of several cases.

    The searches use exact derivatives of the runs, with peaks and shares smoothed less and less; they start at the
    diagrams' own parameters and at the best of some random sets. Every set that a search evaluates is then measured
    without smoothing, and the best is returned: it is never worse than the diagrams' own where those meet the limits.

    Parameters
    ----------
    diagrams : Diagram or dict of str to Diagram
        The closed loop, or several cases of it (different references, for example).
    free : dict of str to (float, float)
        Parameters and their bounds (low, high), in the unit of the parameter.
    minimise : str or dict of str to str
        A metric such as ``"peak_to_peak(x_ref - x_out, after=10)"``, or that with a name and a unit,
        ``{"error [deg]": "..."}``.
    subject_to : str or list of str, optional
        Limits: metrics such as ``"share(abs(u) > 23.9) <= 0.01"``, and stability margins of the loop opened at a wire,
        such as ``"phase_margin('controller -> drive') >= 45"`` in degrees. ``gain_margin`` is the smallest factor, up
        or down, that makes the loop unstable, below 1 where it is unstable already. Margins are taken at the end of
        each run, or where ``point`` says, as in ``"phase_margin('controller -> drive', point='trim') >= 45"``: "start"
        (the initial states) or "trim" (the equilibrium next to that end). Where a block on the loop is at a limit then,
        there is no margin: it counts as 0 deg, or a factor of 1.
    plants : Plan, optional
        Sets of parameters; each diagram with each set is a case.
    stop, step : float, optional
        End and step of the runs in s, as for ``simulate``; the step is 1e-3 by default.
    method : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method.
    inputs : dict of str to signal, optional
        Inputs of the diagrams, as for ``simulate``.
    hold : {"auto", "zero", "linear", "cubic"} or dict of str to these
        Interpolation between samples of the inputs, one for all or by input. By default it is found from the samples:
        zero-order hold where an input is piecewise constant, else linear or a cubic spline.
    starts, seed : int, defaults 4 and 0
        Number of searches, and seed of the random sets.
    threads : int, optional
        Number of threads. By default one for each processor.
    progress : callable, optional
        Called with a stage, how much of it is done, and of how much.
    backend : {"", "llvm", "casadi"}
        As for ``simulate``.

    Returns
    -------
    Tuned
        The parameters and the metrics before and after. ``remarks`` warn of a signal that oscillates far more than
        before (limit its ``variation``), of a parameter at its bound, and where nothing better was found.

    Raises
    ------
    ParameterError
        For an unknown parameter, bounds, metrics or limits that are not possible; before any search.
    RunError
        As for ``simulate``, and where the runs diverge with every set of parameters.
    DataError
        For missing or unsuitable inputs.

    References
    ----------
    K. Madsen, Minimax solution of non-linear equations without calculating derivatives, J. Inst. Maths Applics 16
    (1975), doi 10.1093/imamat/16.3.321.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> from tsmblocks.blocks import FirstOrderLag, Gain, Step, Sum
    >>> parts = {"r": Step(), "error": Sum(signs="+-"), "k": Gain(gain=1.0), "plant": FirstOrderLag(time_constant=0.1)}
    >>> wires = ["r -> error.plus", "error -> k -> plant -> error.minus"]
    >>> loop = tsm.Diagram(blocks=parts, wires=wires, outputs={"e": "error", "u": "k"})
    >>> found = tsm.tune(loop, {"k.gain": (0.5, 50.0)}, "final(e)", subject_to="largest(u) <= 10", stop=3.0, starts=1)
    >>> print(f"{found.values['k.gain']:.1f}, met: {found.met}")
    10.0, met: True
    """
    named, report = _named(diagrams), as_callback(progress, "stage, done and of")
    cases = _cases(named, plants)
    first = next(iter(cases.values()))
    bounds, units = _search_bounds(free, first), signal_units(first)
    goal = _goal(minimise, units)
    limits = [limit(text, units, first) for text in _listed(subject_to)]
    options = RunOptions(stop, step, 0.0, method, inputs, hold, backend=backend)
    search = Search(cases, bounds, goal, limits, options, threads)
    own = {name: first.parameters[name] for name in bounds}
    starting_points = [own, *search.promising(own, as_integer("starts", starts, 1) - 1, seed)]
    search.warn_of_step(own)
    trails, status = _searches(search, starting_points, report)
    if all(one.low <= own[name] <= one.high for name, one in bounds.items()):
        trails[0].insert(0, own)  # the result is never worse
    measured = search.measured([own, *(one for trail in trails for one in trail)])
    edges = np.cumsum([1, *map(len, trails)])
    ends = [measured.best(range(a, b)) for a, b in pairwise(edges) if a < b]
    best = measured.best(ends)
    if not np.isfinite(measured.goal[best]):
        raise RunError("no set of parameters was found with which every case runs to its end.")
    values = dict(measured.sets[best])
    texts, oscillation = ((), None) if values == own else hunting(search, own, values)
    return Tuned(
        values=values,
        diagrams={name: d.with_parameters(values) for name, d in named.items()},
        objective=goal.given_name,
        units=search.units,
        before=measured.of(0),
        after=measured.of(best),
        met=bool(measured.over[best] <= LIMIT_TOLERANCE),
        status=status,
        own=own,
        bounds={name: (one.low, one.high) for name, one in bounds.items()},
        limits=limits,
        starts=len(ends),
        agreeing=measured.agreeing(ends, best),
        idle=tuple(search.idle(values)),
        hunting=texts,
        oscillation=oscillation,
    )


def _searches(
    search: Search, starting_points: Sequence[Mapping[str, float]], report: Callable[[str, int, int], Any]
) -> tuple[list[list[dict[str, float]]], str]:
    """All sets that each search has evaluated, and how it ended."""
    trails: list[list[dict[str, float]]] = []
    try:
        for k, starting_point in enumerate(starting_points):
            report("searched", k, len(starting_points))
            trails.append([])
            search.walk(starting_point, trails[-1])
        report("searched", len(starting_points), len(starting_points))
    except KeyboardInterrupt:
        if not any(trails):
            raise
        return trails, "interrupted"
    return trails, "complete"


# ---- arguments


def _named(diagrams: Any) -> dict[str, Diagram]:
    if isinstance(diagrams, Mapping):
        if not diagrams:
            raise ParameterError("tune needs at least one diagram.")
        return {str(name): as_diagram(one) for name, one in diagrams.items()}
    one = as_diagram(diagrams)
    return {one.title or "diagram": one}


def _cases(named: dict[str, Diagram], plants: Plan | None) -> dict[str, Diagram]:
    """Every diagram with every plant."""
    if plants is None:
        return named
    if not isinstance(plants, Plan):
        raise ParameterError(f"plants is a plan such as monte_carlo gives, got {in_words(plants)}.")
    return {
        f"{name}, plant {k}": one.with_parameters(plants.row(k))
        for name, one in named.items()
        for k in range(len(plants))
    }


def _goal(given: Any, units: Mapping[str, str]) -> Metric:
    """The metric to minimise. Raises ParameterError."""
    goals = metrics(given, units) if isinstance(given, (str, Mapping)) else ()
    if len(goals) != 1:
        raise ParameterError(
            "minimise is one metric, such as 'rms(x_ref - x_out)', or with a name and a unit "
            f"{{'error [deg]': 'rms(x_ref - x_out)'}}, got {in_words(given)}."
        )
    differentiable(goals[0])
    return goals[0]


def _listed(given: Any) -> list[Any]:
    """Limits as a list, also of a single one. Raises ParameterError."""
    if isinstance(given, str):
        return [given]
    if not isinstance(given, Iterable) or isinstance(given, Mapping):
        raise ParameterError(
            f"subject_to takes a limit such as 'largest(u) <= 20', or a list of them, got {in_words(given)}."
        )
    return list(given)


def _search_bounds(free: Any, diagram: Diagram) -> dict[str, Uniform]:
    if not isinstance(free, Mapping) or not free:
        raise ParameterError(f"free maps parameters to bounds, such as {{'pid.kp': (0.1, 5.0)}}, got {in_words(free)}.")
    bounds = {}
    for name, pair in free.items():
        if name not in diagram.parameters:
            hint = near_path(str(name), diagram.parameters)
            raise ParameterError(f"diagram '{diagram.title}' has no parameter '{name}'.{hint}")
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise ParameterError(f"'{name}' needs bounds (low, high), got {in_words(pair)}.") from None
        bounds[str(name)] = uniform_between(str(name), low, high, log=low > 0 and high / low > LOG_SCALE_RATIO)
    return bounds
