"""Whether the parameters of an effect are determined by the data: clear of the values at which there is no effect."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import experiment_of
from tsmblocks.fitting.identifiability import SMALL, null_directions
from tsmblocks.fitting.statistics import Uncertainty, uncertainty
from tsmblocks.fitting.summary import unknown_sizes

SIGNIFICANCE_LEVEL = 0.05
"""Probability that an effect of size zero is taken for determined. Chosen: that of the intervals that are reported."""
INTERVAL = 2.0
"""Half of a confidence interval over the standard deviation. Source: 95 %, normal."""
SMALL_ANGLE = 1e-6
"""Part of a direction without effect from which an initial state that shows by an effect alone is in it. Chosen: beyond
rounding; a small turn of the phase of a ripple changes the smaller one of its amplitudes much."""
ALONE = 0.999
"""Length of an unknown in the space of directions without effect from which it has none alone. Chosen: rounding."""
MAX_WIDENING = 10.0
"""Interval of a parameter of the base beside effects, over that without them, from which it is lost. Chosen: effects
that share with it what it explains widen it by a few times."""
ROUNDED = 1e6
"""Interval of a parameter over its value from which only rounding makes it finite. Chosen: far beyond those of weak
data, and below those seen of sums of 10,000 steps (1e8)."""
END_SHARE = 0.03
"""Share of a recording at its ends in which a change is none in time. Chosen: initial states, and the constant form of
an effect, make up for it there."""
MIN_EIGENVALUE_SHARE = 1e-10
"""Share of a correlation matrix's largest eigenvalue below which a direction is one with another. Chosen: rounding."""


def redundant_parameters(model: Model, base: Model) -> tuple[str, ...]:
    """Parameters of a base that the others of it make up for, such as the second of two gains in a row, or that values
    of an effect in each experiment make up for, such as a common offset beside separate ones; the last ones of it.

    An effect behind them has a size only with these held: it is then counted in the units that they set. A single
    parameter of an effect that one of the base makes up for adds nothing, and has no size. An initial state that shows
    by the effect alone, such as the angle at which a recording of the speed begins, is held where it is redundant.
    """
    names, known = model.problem.unknowns.names, set(base.problem.unknowns.names)
    null_of_base, local = directions_without_effect(base), base.is_local
    alone = np.linalg.norm(np.linalg.qr(null_of_base)[0], axis=1) > ALONE
    idle = {name for name, own in zip(base.problem.unknowns.names, local & alone, strict=True) if own}
    found, null = _held_back(base, null_of_base, known), directions_without_effect(model)
    found += _held_back(model, null, idle, idle)
    for k in (k for k, name in enumerate(names) if name in found):
        null = _without(null, k)
    single = [name not in known and not local for name, local in zip(names, model.is_local, strict=True)]
    null = null[:, np.abs(null[single]).max(axis=0, initial=0.0) < SMALL]
    return (*found, *_held_back(model, null, known))


def directions_without_effect(model: Model) -> np.ndarray:
    """Directions without any effect on the residual of a model (n, q), in shares of the sizes of its unknowns."""
    return null_directions(model.J, unknown_sizes(model.problem, model.theta, model.J), None, None)


def _without(null: np.ndarray, k: int) -> np.ndarray:
    """Those of the directions (n, q) that leave unknown ``k`` as it is."""
    return null @ np.linalg.svd(null[k : k + 1])[2][1:].T if np.abs(null[k]).max(initial=0.0) > 0 else null


def _held_back(model: Model, null: np.ndarray, known: set[str], local: Collection[str] = ()) -> list[str]:
    """The last unknowns of all experiments among ``known`` that are held so that nothing moves along directions.

    Of those of single experiments the ones in ``local`` are held as well.
    """
    names, found = model.problem.unknowns.names, list[str]()
    may = ~model.is_local | np.isin(names, list(local))
    for k in reversed(np.flatnonzero(may).tolist()):
        least = SMALL_ANGLE if names[k] in local else SMALL
        if names[k] in known and np.abs(null[k]).max(initial=0.0) >= least:
            found.append(names[k])
            null = _without(null, k)
    return found


def uncertainty_of_effects(model: Model, base: Model) -> Uncertainty:
    """The uncertainty of a model that adds effects to a base, from which they are judged and their sizes reported.

    Parameters of the base that are redundant or at a bound are held there. Those of effects never are: a shape that
    went to a bound is as uncertain as the others, and the strength with it.
    """
    known, redundant = set(base.problem.unknowns.names), redundant_parameters(model, base)
    names = model.problem.unknowns.names
    held = [name in redundant or (bool(at) and name in known) for name, at in zip(names, model.at_bound, strict=True)]
    directions = np.eye(len(names))[np.array(held, dtype=bool)]
    return uncertainty(model.J, model.r, model.problem.segments, held=directions if len(directions) else None)


def lost_parameters(model: Model, base: Model) -> list[str]:
    """Parameters of a base that are not determined any more in a model that adds effects to it.

    Their intervals are many times as wide as without the effects, and wider than their values: the effects do not add
    to the base then, but take its place. One that goes to zero since an effect explains more than it keeps its width.
    One that a parameter of an effect makes up for exactly is redundant, not lost, even if rounding hides that.
    """
    before, after = (
        dict(zip(one.problem.unknowns.names, uncertainty_of_effects(one, base).errors, strict=True))
        for one in (base, model)
    )
    known = dict(zip(model.problem.unknowns.names, model.theta, strict=True))
    return [
        name
        for name, local in zip(base.problem.unknowns.names, base.is_local, strict=True)
        if not local and name in known and np.isfinite(after[name]) and before[name] > 0
        if after[name] > MAX_WIDENING * before[name]
        if 1 < INTERVAL * after[name] / max(abs(known[name]), before[name]) < ROUNDED
    ]


def instants_are_determined(model: Model, candidate: Candidate, base: Model) -> bool:
    """Whether the instants of a sudden change are: their confidence intervals lie well inside the recording.

    A change that ends again near the end of a recording, or is there from near its beginning, is another effect. Of
    separate ones those of the experiment count in which its first size is largest: where it is next to nothing, so are
    they.
    """
    items, experiments = model.problem.unknowns.items, model.problem.experiments
    wanted = {f"{candidate.block}.{name}" for name in candidate.trials.refine}
    instants = [k for k, item in enumerate(items) if item.parameter in wanted]
    if not instants:
        return True
    size = f"{candidate.block}.{next(iter(candidate.trials.strengths), '')}"
    sizes = {item.experiment: abs(model.theta[k]) for k, item in enumerate(items) if item.parameter == size}
    place = max(sizes, key=lambda name: sizes[name], default="")
    errors = uncertainty_of_effects(model, base).errors
    for k in (k for k in instants if items[k].experiment in ("", place)):
        where = [one.t for one in experiments if items[k].experiment in ("", one.name, experiment_of(one.name))]
        first, last = min(t[0] for t in where), max(t[-1] for t in where)
        margin = END_SHARE * (last - first) + INTERVAL * errors[k]
        if not first + margin < model.theta[k] < last - margin:
            return False
    return True


def is_determined(model: Model, candidate: Candidate, nulls: dict[str, float], base: Model) -> bool:
    r"""Whether the confidence region of an effect's parameters excludes the values at which there is no effect.

    .. math:: \tfrac{1}{q} (\theta - \theta_0)^T C^{-1} (\theta - \theta_0) > F_{0.95}(q, \nu)

    and the confidence interval of at least one of them does so as well, at a level that allows for the largest of q
    (Sidak, 1967): where only a combination is clear of it, no size can be reported.

    ``nulls`` are those values by full name, of the parameters that have a finite one. Where there are none (a limit
    that never acts is at infinity) the effect is judged by its held-out losses alone. The covariance C is that of
    ``uncertainty_of_effects``, for autocorrelated residuals. Source: Seber and Wild, Nonlinear Regression (1989), 5.1.
    """
    items = model.problem.unknowns.items
    own = [k for k, item in enumerate(items) if item.parameter in nulls and item.parameter in candidate.free]
    if not own or len(model.r) <= len(model.theta):
        return True
    from scipy.special import fdtri

    estimate = uncertainty_of_effects(model, base)
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
    levels = ((q, 1 - SIGNIFICANCE_LEVEL), (1, (1 - SIGNIFICANCE_LEVEL) ** (1 / q)))
    joint, single = (float(fdtri(k, min(freedom, 1e9), level)) for k, level in levels)
    return bool(distance.sum() / q > joint and np.max((off / spread) ** 2) > single)
