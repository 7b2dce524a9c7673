"""Sets of parameters that a study runs: grids, sweeps, Latin hypercubes, Monte Carlo. Nothing runs here."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_integer
from tsmblocks.common.errors import ParameterError, in_words, near
from tsmblocks.studies.distributions import distributions

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

MAX_RUNS = 10_000_000
"""Runs of one plan at most. Chosen: a gigabyte of parameters and metrics."""
MAX_DRAWS_PER_RUN = 1000
"""Draws for each run, after which draws within the bounds count as too rare. Chosen: a second of work."""


@attrs.frozen(eq=False)
class Plan:
    """Sets of parameters, one per run.

    Parameters
    ----------
    columns : mapping of str to ndarray, each of shape (runs,)
        Values of each parameter; NaN is the diagram's own value.
    kind : str, default "table"
        How the plan was made: grid, sweep, latin hypercube, monte carlo or table.
    """

    columns: Mapping[str, np.ndarray]
    kind: str = "table"

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that vary."""
        return tuple(self.columns)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of a parameter, shape (runs,). Raises ParameterError with the near miss."""
        if name not in self.columns:
            raise ParameterError(f"the plan does not vary '{name}'.{near(name, self.columns)}")
        return self.columns[name]

    def row(self, run: int) -> dict[str, Any]:
        """Return the parameters of one run, without those that keep the diagram's own values.

        Parameters
        ----------
        run : int
            Number of the run, from 0.

        Returns
        -------
        dict of str to value
            Values by parameter.
        """
        made = {name: plain(values[run]) for name, values in self.columns.items()}
        return {name: v for name, v in made.items() if not (isinstance(v, float) and math.isnan(v))}


def plain(value: Any) -> Any:
    """A NumPy scalar as the Python value it is."""
    return value.item() if hasattr(value, "item") else value


def table(columns: Any) -> Plan:
    """Return a plan of given sets.

    Raises ParameterError when columns differ in length, are empty, or hold numbers that are not finite.

    Parameters
    ----------
    columns : mapping of str to sequence, or pandas.DataFrame
        Values of each parameter, one per run.

    Returns
    -------
    Plan
        The plan.
    """
    if not isinstance(columns, Mapping) and not hasattr(columns, "columns"):
        raise ParameterError(f"a table maps parameters to values, one per run, got {in_words(columns)}.")
    made = {str(name): _listed(str(name), columns[name]) for name in columns}
    if len({len(v) for v in made.values()}) > 1:
        counts = ", ".join(f"{k} has {len(v)}" for k, v in made.items())
        raise ParameterError(f"a plan needs as many values of each parameter; {counts}.")
    return _plan(made, "table")


def grid(values: Mapping[str, Any]) -> Plan:
    """Return a plan of every combination of values.

    Raises ParameterError for an empty list, for numbers that are not finite, and for more than ten million runs.

    Parameters
    ----------
    values : mapping of str to sequence
        Values of each parameter or option; the last one varies fastest.

    Returns
    -------
    Plan
        The plan.

    Examples
    --------
    >>> from tsmblocks.studies import grid
    >>> plan = grid({"pid.kp": [1.0, 2.0], "pid.ki": [0.0, 5.0, 10.0]})
    >>> len(plan), plan.row(4)
    (6, {'pid.kp': 2.0, 'pid.ki': 5.0})
    """
    listed = _lists(values)
    _count(math.prod(map(len, listed.values())))
    columns = map(as_column, zip(*itertools.product(*listed.values()), strict=True))
    return _plan(dict(zip(listed, columns, strict=True)), "grid")


def sweep(values: Mapping[str, Any]) -> Plan:
    """Return a plan that changes one parameter at a time, the others keeping the diagram's own values.

    The first run changes nothing. For a tornado plot give the two ends of each range. Raises ParameterError as ``grid``
    does, and for options.

    Parameters
    ----------
    values : mapping of str to sequence of float
        Values of each parameter.

    Returns
    -------
    Plan
        The plan.
    """
    listed = _lists(values)
    columns, runs = {}, 1
    for name, given in listed.items():
        if given.dtype.kind != "f":
            raise ParameterError(f"a sweep takes numbers; '{name}' has {in_words(given[0])}. Use grid.")
        columns[name] = np.full(1 + sum(map(len, listed.values())), np.nan)
        columns[name][runs : runs + len(given)] = given
        runs += len(given)
    return _plan(columns, "sweep")


def latin_hypercube(beliefs: Mapping[str, Any], runs: int, *, seed: int = 0) -> Plan:
    """Return a plan of random sets spread evenly: in each of ``runs`` equally likely intervals one value per parameter.

    Parameters
    ----------
    beliefs : mapping of str to Uniform, Normal or tuple
        Distribution of each parameter; ``(low, high)`` is uniform.
    runs : int
        Number of runs.
    seed : int, default 0
        Seed of the random numbers.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    ParameterError, RunError
        For anything that is no distribution; for a number of runs or a seed that is none.

    References
    ----------
    McKay, Beckman and Conover, Technometrics 21 (1979), doi 10.1080/00401706.1979.10489755.

    Examples
    --------
    >>> from tsmblocks.studies import Normal, latin_hypercube
    >>> plan = latin_hypercube({"pid.kp": (1.0, 3.0), "theta": Normal(5.0, 0.5)}, runs=50, seed=1)
    >>> bool(((plan["pid.kp"] > 1.0) & (plan["pid.kp"] < 3.0)).all())
    True
    """
    from scipy.stats import qmc

    known, count = distributions(beliefs), _count(runs)
    q = qmc.LatinHypercube(d=len(known), seed=np.random.default_rng(as_integer("seed", seed, 0))).random(count)
    return _plan({name: one.quantile(q[:, k]) for k, (name, one) in enumerate(known.items())}, "latin hypercube")


def monte_carlo(beliefs: Any, runs: int, *, seed: int = 0) -> Plan:
    """Return a plan of independent random sets.

    Parameters
    ----------
    beliefs : mapping of str to Uniform, Normal or tuple, or Fit
        Distribution of each parameter, as for ``latin_hypercube``. Of a fit, the estimates are drawn from a normal
        distribution with their covariance, within the bounds of their blocks; initial states are not varied.
    runs, seed : int
        As for ``latin_hypercube``.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    ParameterError, RunError
        As ``latin_hypercube`` does; ParameterError where a parameter of the fit is not identifiable.
    """
    count, rng = _count(runs), np.random.default_rng(as_integer("seed", seed, 0))
    if hasattr(beliefs, "covariance"):
        return _plan(_drawn_from_fit(beliefs, count, rng), "monte carlo")
    known = distributions(beliefs)
    return _plan({name: one.quantile(rng.random(count)) for name, one in known.items()}, "monte carlo")


def _drawn_from_fit(fit: Fit, runs: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draws of the estimates of a fit; an estimate at a bound keeps its value."""
    from tsmblocks.fitting.parameters import bounds_of, numbers

    kept = [k for k, one in enumerate(fit.estimates) if not one.is_start and one.name in fit.diagram.parameters]
    estimates = [fit.estimates[k] for k in kept]
    if not estimates:
        raise ParameterError("the fit has no parameter that all experiments share, so no parameter can be varied.")
    covariance = fit.covariance[np.ix_(kept, kept)]
    free = np.isfinite(np.diag(covariance))
    unknown = [one.name for one, f in zip(estimates, free, strict=True) if not f and "bound" not in one.verdict]
    if unknown:
        raise ParameterError(
            f"{', '.join(unknown)} of the fit is not identifiable with its data, so no values can be drawn."
        )
    root = np.linalg.cholesky(covariance[np.ix_(free, free)] + 1e-300 * np.eye(int(free.sum())))
    mean = np.array([one.value for one in estimates])
    declared = numbers(fit.diagram)
    low, high = np.array([bounds_of(declared[one.name], one.value) for one in estimates]).T
    made, tried = np.empty((0, len(mean))), 0
    while len(made) < runs:
        if tried > MAX_DRAWS_PER_RUN * runs:
            raise ParameterError("hardly any draw of the fit's covariance lies within the bounds of its parameters.")
        drawn = np.tile(mean, (runs, 1))
        drawn[:, free] += rng.standard_normal((runs, len(root))) @ root.T
        inside = ((drawn >= low) & (drawn <= high)).all(axis=1)
        made, tried = np.vstack([made, drawn[inside]]), tried + runs
    return {one.name: made[:runs, k] for k, one in enumerate(estimates)}


def _count(runs: Any) -> int:
    """The number of runs. Raises for one that is none, or too large."""
    count = as_integer("runs", runs, 1)
    if count > MAX_RUNS:
        raise ParameterError(f"a plan of {count:,} runs is too large; {MAX_RUNS:,} are the most.")
    return count


def _plan(columns: dict[str, np.ndarray], kind: str) -> Plan:
    if not columns:
        raise ParameterError("a plan needs at least one parameter with at least one value.")
    for column in columns.values():
        column.flags.writeable = False
    return Plan(columns, kind)


def _lists(values: Any) -> dict[str, np.ndarray]:
    if not isinstance(values, Mapping):
        raise ParameterError(
            f"a plan maps parameters to values, such as {{'pid.kp': [1, 1.5, 2]}}, got {in_words(values)}."
        )
    return {str(name): _listed(str(name), given) for name, given in values.items()}


def _listed(name: str, given: Any) -> np.ndarray:
    """Values of one parameter, in a row; numbers must be finite."""
    if isinstance(given, (str, bytes, Mapping)) or not np.iterable(given) or getattr(given, "ndim", 1) > 1:
        raise ParameterError(f"'{name}' needs a list of values, got {in_words(given)}.")
    array = as_column(list(given))
    if not len(array):
        raise ParameterError(f"'{name}' needs a list of at least one value, got {in_words(given)}.")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ParameterError(f"'{name}' has a value that is not finite.")
    return array


def as_column(values: Sequence[Any]) -> np.ndarray:
    """Numbers as floats; anything else (texts and switches of options) as objects."""
    if all(isinstance(v, (int, float, np.number)) and not isinstance(v, bool) for v in values):
        return np.array(values, dtype=float)
    made = np.empty(len(values), dtype=object)
    made[:] = values
    return made
