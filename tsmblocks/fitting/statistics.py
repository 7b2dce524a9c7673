"""Covariance and confidence intervals of a least-squares fit with autocorrelated residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.fitting.column_space import column_space
from tsmblocks.fitting.inner_products import product, square
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.noise_model import ARModel, NoiseModels, fast_length, noise_models
from tsmblocks.fitting.sample_sums import summed

RANK = 1e-24
"""Square of the smallest relative effect of a direction on the residuals that exceeds rounding. Chosen."""
MIN_UNIDENTIFIABLE_SHARE = 1e-3
"""Share of a parameter in a direction without effect from which the parameter is not identifiable. Chosen."""
LEAST_FREEDOM = 2.0
"""Degrees of freedom are not taken below this: wider tails would come from the method, not from the data. Chosen."""


@attrs.frozen(eq=False)
class Uncertainty:
    """Covariance of the parameters of a fit.

    ``covariance`` (p, p) holds for noise as autocorrelated as the residuals are, ``white`` (p, p) would for white
    noise. ``freedom`` (p,) are the degrees of freedom of the Student distribution of the intervals, ``models`` the
    noise of each segment. A parameter that is not identifiable has an infinite variance (its covariances are NaN), one
    that is held has none.
    """

    covariance: np.ndarray
    white: np.ndarray
    freedom: np.ndarray
    models: tuple[ARModel, ...]

    @property
    def errors(self) -> np.ndarray:
        """Standard deviation of each parameter, shape (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def uncertainty(
    J: np.ndarray | Jacobian,
    r: np.ndarray,
    segments: Sequence[slice] | None = None,
    *,
    prior: np.ndarray | None = None,
    noise: float | None = None,
    held: np.ndarray | None = None,
) -> Uncertainty:
    r"""Covariance of a least-squares estimate, robust to autocorrelated residuals.

    .. math:: \mathrm{cov} = H^{-1} S H^{-1}, \quad H = J^T J + P, \quad
              S = \sum_s J_s^T \Gamma_s J_s + \sigma^2 P

    ``J`` (N, p) is the Jacobian of the residuals ``r`` (N,) at the estimate. ``segments`` are the slices
    within which residuals are evenly spaced in time and correlated, one per experiment and output;
    :math:`\Gamma_s` is the covariance of the autoregressive noise of a segment (``noise_models``). ``prior``
    (p, p) is the matrix P that priors add to the normal equations and ``noise`` the :math:`\sigma` it was
    scaled with (that of the residuals by default). ``held`` (m, p) are the gradients of active bounds and
    constraints: the estimate does not move along them.

    Degrees of freedom are those of Satterthwaite: the variance of a parameter is itself uncertain, by the uncertainty
    of the noise's coefficients (delta method) and of its size. J is taken as exact, and the noise as stationary and
    independent of the signals: model errors that recur in every period, or the steps of a quantised signal where the
    model rests, are not in the covariance of the residuals.
    Raises DataError when there are no more samples than parameters, or numbers that are not finite.
    Sources: Söderström and Stoica, System Identification (1989), section 7.4; Ljung, System Identification
    (1999), section 9.3; Satterthwaite, Biometrics Bulletin 2 (1946).
    """
    J, r = Jacobian.of(J), np.asarray(r, dtype=float)
    segments = [slice(0, len(r))] if segments is None else [s for s in segments if s.stop > s.start]
    _check(J, r, segments)
    weight = None if prior is None else np.asarray(prior, dtype=float)
    space = column_space(J, RANK, weight, held)
    turn, count = space.turn, space.turn.shape[1]
    basis, sums, parts = summed(space.basis, r, segments)
    noises = noise_models(basis, sums, parts)
    covariance, freedom = _noise_covariance(turn, basis, noises, parts)
    residual_variance = square(r) / (len(r) - count)
    white = residual_variance * turn @ space.basis.normal_matrix() @ turn.T
    if weight is not None:
        inverse = turn @ turn.T
        from_prior = inverse @ weight @ inverse * (residual_variance if noise is None else noise**2)
        covariance, white = covariance + from_prior, white + from_prior
    if ((np.diag(covariance) <= 0) & (np.diag(white) > 0)).any():  # rounding left nothing of all but periodic noise
        covariance = white
    unidentifiable = (np.abs(space.unseen) > MIN_UNIDENTIFIABLE_SHARE).any(axis=1)
    return Uncertainty(
        _with_unidentifiable(covariance, unidentifiable),
        _with_unidentifiable(white, unidentifiable),
        freedom,
        noises.models,
    )


def moved(
    J: np.ndarray | Jacobian, change: np.ndarray, *, prior: np.ndarray | None = None, held: np.ndarray | None = None
) -> np.ndarray:
    r"""How far the estimate moves, to first order, when the residuals change by ``change`` (N,), shape (p,).

    .. math:: \Delta\theta = -H^{-1} J^T \Delta r

    Other arguments as for ``uncertainty``; parameters that are held or not identifiable do not move.
    """
    J = Jacobian.of(J)
    turn = column_space(J, RANK, prior, held).turn
    return -turn @ (turn.T @ J.transposed_times(change))


def _check(J: Jacobian, r: np.ndarray, segments: Sequence[slice]) -> None:
    if r.shape != J.shape[:1]:
        raise DataError(f"a Jacobian of shape (N, p) and N residuals are needed, got shapes {J.shape} and {r.shape}.")
    if len(r) <= J.shape[1]:
        raise DataError(
            f"{len(r)} samples do not determine the uncertainty of {J.shape[1]} parameters: more samples than "
            "parameters are needed."
        )
    if not (np.isfinite(r).all() and J.is_finite.all()):
        raise DataError("residuals and their Jacobian must be finite to determine the uncertainty of a fit.")
    if sum(s.stop - s.start for s in segments) != len(r):
        raise DataError(f"the segments must cover each of the {len(r)} residuals once.")


def _with_unidentifiable(covariance: np.ndarray, unidentifiable: np.ndarray) -> np.ndarray:
    made = (covariance + covariance.T) / 2
    made[unidentifiable], made[:, unidentifiable] = np.nan, np.nan
    made[unidentifiable, unidentifiable] = np.inf
    return made


def _noise_covariance(
    turn: np.ndarray, jacobian: Jacobian, noises: NoiseModels, segments: Sequence[slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (p, p) of an estimate, and the degrees of freedom of its diagonal (p,).

    The error of the estimate is ``turn`` (p, q) times the basis ``jacobian`` (N, q), transposed, times the noise, and
    in the rows of an experiment only a few columns of the basis are not zero.
    """
    basis, share = list(jacobian.blocks()), jacobian.shape[1] / jacobian.shape[0]
    p, q = turn.shape
    total, groups = np.zeros((q, q)), []
    for group in dict.fromkeys(noises.source):
        mine = [i for i, s in enumerate(noises.source) if s == group]
        model = noises.models[mine[0]]
        own, slope = np.zeros((q, q)), np.zeros((model.order, p))
        for i in mine:
            block = basis[jacobian.experiment_of(segments[i])]
            first = segments[i].start - block.rows.start
            rows = block.values[first : first + segments[i].stop - segments[i].start]
            part, changes = _quadratic(np.ascontiguousarray(rows.T), model)
            own[np.ix_(block.columns, block.columns)] += part
            there = turn[:, block.columns]
            slope += np.einsum("jpa,pa->jp", there @ changes, there)
        total += own
        known = max(noises.samples[mine[0]] * (1 - share) - 2 * model.order, 1.0)
        groups.append((np.einsum("pq,pq->p", turn @ own, turn), slope, known, noises.uncertain[mine[0]]))
    covariance = turn @ total @ turn.T
    # Squares of the variance of a parameter that is next to open overflow: it is brought near one, by powers of two.
    unit = np.exp2(np.frexp(np.diag(covariance))[1])
    doubt = np.zeros(p)
    with np.errstate(over="ignore", invalid="ignore"):  # of variances that are infinite themselves
        for v, slope, known, uncertain in groups:
            doubt += 2 * (v / unit) ** 2 / known + np.sum(slope / unit * (uncertain @ (slope / unit)), axis=0)
        freedom = 2 * (np.diag(covariance) / unit) ** 2 / np.where(doubt > 0, doubt, 1.0)
    return covariance, np.where(doubt == 0, math.inf, np.fmax(freedom, LEAST_FREEDOM))


def _quadratic(rows: np.ndarray, model: ARModel) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (q, q) of ``rows`` (q, n) times the noise, and its derivatives by the noise's coefficients."""
    q, n = rows.shape
    k = model.order
    if k == 0:
        return model.variance * product(rows, rows.T), np.zeros((0, q, q))
    size = fast_length(2 * n)
    around = np.zeros(size)
    around[:n] = model.autocovariance(n)
    around[size - n + 1 :] = around[n - 1 : 0 : -1]
    twice = np.full(size // 2 + 1, 2.0 / size)
    twice[0] = twice[-1] = 1.0 / size
    weights = np.empty((k + 1, len(twice)))  # of each frequency in the covariance, and in its derivatives
    weights[0] = np.fft.rfft(around).real * twice
    turn = np.exp(2j * np.pi / size * np.arange(len(twice)))
    A = np.fft.rfft(np.concatenate([[1.0], -model.coefficients]), size)
    now = 2 * twice * model.variance / (A.real**2 + A.imag**2) / A
    for j in range(k):
        now *= turn.conj()
        weights[j + 1] = now.real
    F, found = np.fft.rfft(rows, size), np.empty((k + 1, q, q))
    for a in range(q):
        found[:, a, a:] = product(weights, (F[a] * F[a:].conj()).real.T)
        found[:, a:, a] = found[:, a, a:]
    return found[0], found[1:]


def correlation(covariance: np.ndarray) -> np.ndarray:
    """Correlation matrix of a covariance matrix (p, p); NaN where a variance is zero or infinite."""
    spread = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        return covariance / np.outer(spread, spread)


def intervals(
    theta: np.ndarray, covariance: np.ndarray, freedom: np.ndarray | float = math.inf, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper ends (p,) of the intervals that hold each parameter with probability ``level``.

    ``covariance`` (p, p) and the degrees of ``freedom`` (one, or (p,)) are those of ``uncertainty``.
    """
    from scipy.special import ndtri, stdtrit

    tail = (1 + level) / 2
    nu = np.broadcast_to(np.asarray(freedom, dtype=float), np.shape(theta))
    wide = np.where(np.isfinite(nu), stdtrit(np.where(np.isfinite(nu), nu, 1.0), tail), ndtri(tail))
    half = wide * np.sqrt(np.diag(covariance))
    return theta - half, theta + half


def autocorrelation(r: np.ndarray, lags: int = 25) -> tuple[np.ndarray, float]:
    """Autocorrelation (lags + 1,) of residuals ``r`` (N,), and what it stays below at 19 of 20 lags for white noise.

    Residuals are taken about zero: a mean is a model error too. ``lags`` is at most a fifth of the samples; NaN where
    all residuals are zero.
    """
    n = len(r)
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.array([np.einsum("i,i->", r[k:], r[: n - k]) for k in range(min(lags, n // 5) + 1)]) / square(r)
    return rho, 1.959964 / math.sqrt(max(n, 1))
