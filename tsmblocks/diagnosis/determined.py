"""Whether the parameters of an effect are determined by the data: clear of the values at which there is no effect."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.identifiability import SMALL, null_directions
from tsmblocks.fitting.statistics import uncertainty
from tsmblocks.fitting.summary import unknown_sizes

SIGNIFICANCE_LEVEL = 0.05
"""Probability that an effect of size zero is taken for determined. Chosen: that of the intervals that are reported."""
MIN_EIGENVALUE_SHARE = 1e-10
"""Share of a correlation matrix's largest eigenvalue below which a direction is one with another. Chosen: rounding."""


def redundant_parameters(base: Model) -> tuple[str, ...]:
    """Parameters of a base that the others make up for, such as the second of two gains in a row; the last ones of it.

    An effect behind them has a size only with these held: it is then counted in the units that they set.
    """
    unknowns = base.problem.unknowns
    null = null_directions(base.J, unknown_sizes(base.problem, base.theta, base.J), None, None)
    found = list[str]()
    for k in reversed(np.flatnonzero(~base.is_local).tolist()):
        if np.abs(null[k]).max(initial=0.0) < SMALL:
            continue
        found.append(unknowns.names[k])
        null = null @ np.linalg.svd(null[k : k + 1])[2][1:].T
    return tuple(found)


def held_directions(model: Model, names: Collection[str]) -> np.ndarray:
    """Directions (m, p) in which the unknowns of these names move."""
    return np.eye(len(model.theta))[[name in names for name in model.problem.unknowns.names]]


def is_determined(model: Model, candidate: Candidate, nulls: dict[str, float], redundant: Collection[str] = ()) -> bool:
    r"""Whether the confidence region of an effect's parameters excludes the values at which there is no effect.

    .. math:: \tfrac{1}{q} (\theta - \theta_0)^T C^{-1} (\theta - \theta_0) > F_{0.95}(q, \nu)

    and the confidence interval of at least one of them does so as well: where only a combination is clear of it, no
    size can be reported.

    ``nulls`` are those values by full name, of the parameters that have a finite one. Where there are none (a limit
    that never acts is at infinity) the effect is judged by its held-out losses alone. The covariance allows for
    autocorrelated residuals; ``redundant`` parameters of the base are held. Source: Seber and Wild, Nonlinear
    Regression (1989), 5.1.
    """
    items = model.problem.unknowns.items
    own = [k for k, item in enumerate(items) if item.parameter in nulls and item.parameter in candidate.free]
    if not own or len(model.r) <= len(model.theta):
        return True
    from scipy.special import fdtri

    bounds = np.eye(len(model.theta))[model.at_bound & ~np.isin(np.arange(len(items)), own)]
    held = np.vstack([bounds, held_directions(model, redundant)])
    estimate = uncertainty(model.J, model.r, model.problem.segments, held=held if len(held) else None)
    covariance = estimate.covariance[np.ix_(own, own)]
    seen = np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0)
    if not seen.any():
        return False
    off = np.array([model.theta[k] - nulls[items[k].parameter] for k in own])[seen]
    spread = np.sqrt(np.diag(covariance)[seen])
    values, vectors = np.linalg.eigh(covariance[np.ix_(seen, seen)] / np.outer(spread, spread))
    kept = values > MIN_EIGENVALUE_SHARE * values[-1]
    distance = (vectors[:, kept].T @ (off / spread)) ** 2 / values[kept]
    freedom = float(np.min(estimate.freedom[np.array(own)[seen]]))
    q = int(kept.sum())
    joint, single = (float(fdtri(k, min(freedom, 1e9), 1 - SIGNIFICANCE_LEVEL)) for k in (q, 1))
    return bool(distance.sum() / q > joint and np.max((off / spread) ** 2) > single)
