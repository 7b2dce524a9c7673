"""Sets of parameters that a study runs: grids, sweeps, Latin hypercubes, Monte Carlo. Nothing runs here."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_integer, as_number
from tsmblocks.common.errors import ParameterError, in_words, near

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


# ---- distributions of a parameter -------------------------------------------------------------------


def _finite(value: Any) -> float:
    return as_number("a number of Uniform or Normal", value, ParameterError)


def _bound(value: Any) -> float:
    return value if isinstance(value, float) and math.isinf(value) else _finite(value)


@attrs.frozen
class Uniform:
    """A uniform distribution of a parameter.

    Parameters
    ----------
    low, high : float
        Its bounds, in the unit of the parameter.
    log : bool, default False
        Whether the logarithm is uniform; then ``low`` is above 0.

    Raises
    ------
    ParameterError
        When the bounds are not in order, or not finite.
    """

    low: float = attrs.field(converter=_finite)
    high: float = attrs.field(converter=_finite)
    log: bool = False

    def __attrs_post_init__(self) -> None:
        if not self.low < self.high or not math.isfinite(self.high - self.low):
            raise ParameterError(f"low must be below high, got low={self.low:g}, high={self.high:g}.")
        if self.log and self.low <= 0:
            raise ParameterError(f"Uniform with log=True needs low > 0, got low={self.low:g}.")

    def quantile(self, q: np.ndarray) -> np.ndarray:
        """Return quantiles of the distribution.

        Parameters
        ----------
        q : ndarray
            Probabilities, from 0 to 1.

        Returns
        -------
        ndarray
            The values, of the shape of ``q``.
        """
        if self.log:
            return self.low * (self.high / self.low) ** q
        return self.low + (self.high - self.low) * q


@attrs.frozen
class Normal:
    """A normal distribution of a parameter, truncated at bounds.

    Parameters
    ----------
    mean : float
        Mean of the distribution before it is truncated.
    deviation : float
        Standard deviation before it is truncated, above 0.
    low, high : float, default -inf and inf
        Bounds.

    Raises
    ------
    ParameterError
        When a number is not finite, or the bounds are not in order.
    """

    mean: float = attrs.field(converter=_finite)
    deviation: float = attrs.field(converter=_finite)
    low: float = attrs.field(default=-math.inf, converter=_bound)
    high: float = attrs.field(default=math.inf, converter=_bound)

    def __attrs_post_init__(self) -> None:
        if not self.deviation > 0 or not math.isfinite(self.mean + self.deviation):
            raise ParameterError(f"Normal needs a deviation > 0, got mean={self.mean:g}, deviation={self.deviation:g}.")
        if not self.low < self.high:
            raise ParameterError(f"Normal needs low < high, got low={self.low:g}, high={self.high:g}.")

    def quantile(self, q: np.ndarray) -> np.ndarray:
        """Return quantiles of the distribution.

        Parameters
        ----------
        q : ndarray
            Probabilities, from 0 to 1.

        Returns
        -------
        ndarray
            The values, of the shape of ``q``.

        Raises
        ------
        ParameterError
            When no probability lies between the bounds.
        """
        from scipy.special import ndtr, ndtri

        below, above = (float(ndtr((end - self.mean) / self.deviation)) for end in (self.low, self.high))
        if not below < above:
            raise ParameterError(
                f"Normal(mean={self.mean:g}, deviation={self.deviation:g}) has nothing between "
                f"{self.low:g} and {self.high:g}."
            )
        values = self.mean + self.deviation * ndtri(below + (above - below) * q)
        return np.clip(values, self.low, self.high)


Distribution = Uniform | Normal


# ---- plans ------------------------------------------------------------------------------------------


def table(columns: Any) -> Plan:
    """Return a plan of given sets.

    Parameters
    ----------
    columns : mapping of str to sequence, or pandas.DataFrame
        Values of each parameter, one per run.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    ParameterError
        When the columns differ in length, are empty, or hold numbers that are not finite.
    """
    if not isinstance(columns, Mapping) and not hasattr(columns, "columns"):
        raise ParameterError(f"a table maps parameters to values, one per run, got {in_words(columns)}.")
    made = {str(name): _listed(str(name), columns[name]) for name in columns}
    lengths = {name: len(v) for name, v in made.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{k} has {n}" for k, n in lengths.items())
        raise ParameterError(f"a plan needs as many values of each parameter; {counts}.")
    return _plan(made, "table")


def grid(values: Mapping[str, Any]) -> Plan:
    """Return a plan of every combination of values.

    Parameters
    ----------
    values : mapping of str to sequence
        Values of each parameter or option; the last one varies fastest.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    ParameterError
        For an empty list, for numbers that are not finite, and for more than ten million runs.

    Examples
    --------
    >>> from tsmblocks.studies import grid
    >>> plan = grid({"pid.kp": [1.0, 2.0], "pid.ki": [0.0, 5.0, 10.0]})
    >>> len(plan), plan.row(4)
    (6, {'pid.kp': 2.0, 'pid.ki': 5.0})
    """
    listed = _lists(values)
    _count(max(math.prod(map(len, listed.values())), 1))
    rows = list(itertools.product(*listed.values()))
    return _plan({name: as_column([row[k] for row in rows]) for k, name in enumerate(listed)}, "grid")


def sweep(values: Mapping[str, Any]) -> Plan:
    """Return a plan that changes one parameter at a time, the others keeping the diagram's own values.

    The first run changes nothing. For a tornado plot give the two ends of each range.

    Parameters
    ----------
    values : mapping of str to sequence of float
        Values of each parameter.

    Returns
    -------
    Plan
        The plan.

    Raises
    ------
    ParameterError
        As ``grid`` does, and for options.
    """
    listed = _lists(values)
    columns = {}
    for name, own in listed.items():
        if own.dtype.kind not in "fi":
            raise ParameterError(f"a sweep takes numbers; '{name}' has {in_words(own[0])}. Use grid.")
        before = sum(len(v) for v in itertools.islice(listed.values(), list(listed).index(name)))
        column = np.full(1 + sum(map(len, listed.values())), np.nan)
        column[1 + before : 1 + before + len(own)] = own
        columns[name] = column
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
    ParameterError
        For anything that is no distribution.
    RunError
        For a number of runs or a seed that is none.

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

    known, count = _distributions(beliefs), _count(runs)
    q = qmc.LatinHypercube(d=len(known), seed=np.random.default_rng(as_integer("seed", seed, 0))).random(count)
    return _plan({name: one.quantile(q[:, k]) for k, (name, one) in enumerate(known.items())}, "latin hypercube")


def monte_carlo(beliefs: Any, runs: int, *, seed: int = 0) -> Plan:
    """Return a plan of independent random sets.

    Parameters
    ----------
    beliefs : mapping of str to Uniform, Normal or tuple, or Fit
        Distribution of each parameter, as for ``latin_hypercube``. Of a fit, the estimates are drawn from a normal
        distribution with their covariance, within the bounds of their blocks; initial states are not varied.
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
    ParameterError
        For anything that is no distribution, and where a parameter of the fit is not identifiable.
    RunError
        For a number of runs or a seed that is none.
    """
    count, rng = _count(runs), np.random.default_rng(as_integer("seed", seed, 0))
    if hasattr(beliefs, "covariance"):
        return _plan(_of_fit(beliefs, count, rng), "monte carlo")
    known = _distributions(beliefs)
    return _plan({name: one.quantile(rng.random(count)) for name, one in known.items()}, "monte carlo")


def _of_fit(fit: Fit, runs: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    from tsmblocks.fitting.parameters import bounds_of, numbers

    kept = [k for k, one in enumerate(fit.estimates) if not one.is_start and one.name in fit.diagram.parameters]
    names = [fit.estimates[k].name for k in kept]
    if not names:
        raise ParameterError("the fit has no parameter that all experiments share, so there is nothing to vary.")
    covariance = fit.covariance[np.ix_(kept, kept)]
    free = np.isfinite(np.diag(covariance))
    held = [fit.estimates[k] for k, f in zip(kept, free, strict=True) if not f]
    open_ = [one.name for one in held if "bound" not in one.verdict]
    if open_:
        raise ParameterError(
            f"{', '.join(open_)} of the fit is not identifiable with its data, so nothing can be drawn."
        )
    root = np.linalg.cholesky(covariance[np.ix_(free, free)] + 1e-300 * np.eye(int(free.sum())))
    mean = np.array([fit.estimates[k].value for k in kept])
    declared = numbers(fit.diagram)
    low, high = np.array([bounds_of(declared[name], value) for name, value in zip(names, mean, strict=True)]).T
    made, tried = np.empty((0, len(names))), 0
    while len(made) < runs:
        if tried > MAX_DRAWS_PER_RUN * runs:
            raise ParameterError("hardly any draw of the fit's covariance lies within the bounds of its parameters.")
        drawn = np.tile(mean, (runs, 1))
        drawn[:, free] += rng.standard_normal((runs, int(free.sum()))) @ root.T
        inside = ((drawn >= low) & (drawn <= high)).all(axis=1)
        made, tried = np.vstack([made, drawn[inside]]), tried + runs
    return {name: made[:runs, k] for k, name in enumerate(names)}


def _count(runs: Any) -> int:
    """The number of runs. Raises for one that is none, or too large."""
    count = as_integer("runs", runs, 1)
    if count > MAX_RUNS:
        raise ParameterError(f"a plan of {count:,} runs is too large; {MAX_RUNS:,} are the most.")
    return count


def _plan(columns: dict[str, np.ndarray], kind: str) -> Plan:
    if not columns or not len(next(iter(columns.values()))):
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
    if isinstance(given, (str, bytes, Mapping)) or not np.iterable(given):
        raise ParameterError(f"'{name}' needs a list of values, got {in_words(given)}.")
    if getattr(given, "ndim", 1) > 1:
        raise ParameterError(f"'{name}' needs a list of values, got {in_words(given)}.")
    array = as_column(list(given))
    if array.ndim != 1 or not len(array):
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


def between(name: str, low: Any, high: Any, log: bool = False) -> Uniform:
    """A uniform distribution between two bounds. Raises ParameterError that names the parameter."""
    try:
        return Uniform(low, high, log=log)
    except ParameterError as error:
        raise ParameterError(f"bounds of '{name}': {error}") from None


def _distributions(given: Any) -> dict[str, Distribution]:
    if not isinstance(given, Mapping) or not given:
        raise ParameterError(
            f"nothing varies: write {{'tsm.theta': (4, 6)}} or {{'tsm.theta': Normal(5, 0.5)}}, got {in_words(given)}."
        )
    made: dict[str, Distribution] = {}
    for name, one in given.items():
        if isinstance(one, (tuple, list)) and len(one) == 2:
            one = between(str(name), *one)
        if not isinstance(one, (Uniform, Normal)):
            raise ParameterError(f"'{name}' varies by (low, high), Uniform or Normal, got {in_words(one)}.")
        made[str(name)] = one
    return made
