"""Covariance and confidence intervals of a least-squares fit with autocorrelated residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.fitting.inner_products import product, square
from tsmblocks.fitting.noise_model import ARModel, NoiseModels, fast_length, noise_models

RANK = 1e-24
"""Square of the smallest relative effect of a direction on the residuals that exceeds rounding. Chosen."""
SUSPECT = 1e-10
"""Ratio of eigenvalues below which a product of matrices is not trusted with the smaller ones. Chosen."""
PIECE = 1000
"""Samples factorised at a time. Chosen: a block of these rows stays in the cache of the processor."""
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
    J: np.ndarray,
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
    J, r = np.asarray(J, dtype=float), np.asarray(r, dtype=float)
    segments = [slice(0, len(r))] if segments is None else [s for s in segments if s.stop > s.start]
    _check(J, r, segments)
    rows, p = np.ascontiguousarray(J.T), J.shape[1]
    weight = np.zeros((p, p)) if prior is None else np.asarray(prior, dtype=float)
    basis, unidentifiable = _identifiable_basis(rows, weight, held)
    seen = product(np.ascontiguousarray(basis.T), rows)
    noises = noise_models(seen, r, segments)
    gains = product(basis, seen)  # the error of the estimate is this matrix times the noise
    covariance, freedom = _noise_covariance(gains, noises, segments, len(seen) / len(r))
    residual_variance = square(r) / (len(r) - len(seen))
    inverse = basis @ basis.T
    from_prior = inverse @ weight @ inverse * (residual_variance if noise is None else noise**2)
    white = residual_variance * product(gains, gains.T) + from_prior
    total = covariance + from_prior
    if ((np.diag(total) <= 0) & (np.diag(white) > 0)).any():  # rounding left nothing of noise that is all but periodic
        total = white
    return Uncertainty(
        _with_unidentifiable(total, unidentifiable), _with_unidentifiable(white, unidentifiable), freedom, noises.models
    )


def moved(
    J: np.ndarray, change: np.ndarray, *, prior: np.ndarray | None = None, held: np.ndarray | None = None
) -> np.ndarray:
    r"""How far the estimate moves, to first order, when the residuals change by ``change`` (N,), shape (p,).

    .. math:: \Delta\theta = -H^{-1} J^T \Delta r

    Other arguments as for ``uncertainty``; parameters that are held or not identifiable do not move.
    """
    rows = np.ascontiguousarray(np.asarray(J, dtype=float).T)
    basis, _ = _identifiable_basis(rows, np.zeros((len(rows), len(rows))) if prior is None else prior, held)
    return -basis @ (basis.T @ (rows @ change))


def _check(J: np.ndarray, r: np.ndarray, segments: Sequence[slice]) -> None:
    if J.ndim != 2 or r.shape != J.shape[:1]:
        raise DataError(f"a Jacobian of shape (N, p) and N residuals are needed, got shapes {J.shape} and {r.shape}.")
    if len(r) <= J.shape[1]:
        raise DataError(
            f"{len(r)} samples cannot tell how sure {J.shape[1]} parameters are: it takes more samples than parameters."
        )
    if not (np.isfinite(r).all() and np.isfinite(J).all()):
        raise DataError("residuals and their Jacobian must be finite to tell how sure a fit is.")
    if sum(s.stop - s.start for s in segments) != len(r):
        raise DataError(f"the segments must cover each of the {len(r)} residuals once.")


def _identifiable_basis(rows: np.ndarray, weight: np.ndarray, held: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """A basis B (p, q) of the identifiable directions, B'HB = 1; and which parameters are not identifiable (p,)."""
    p = len(rows)
    scale = np.sqrt(np.einsum("pn,pn->p", rows, rows) + np.diag(weight))
    scale = np.where(scale > 1e-150, scale, 1.0)
    free = np.eye(p)
    if held is not None and np.size(held):
        _, size, turn = np.linalg.svd(np.asarray(held, dtype=float) / scale)
        free = turn[int((size > 1e-10 * size.max()).sum()) :].T
        free = np.where(np.abs(free) > 1e-13, free, 0.0)  # what is held has no error at all, not one of rounding
    values, vectors = spectrum(rows / scale[:, None], weight / np.outer(scale, scale), free)
    seen = values > RANK * max(values.max(initial=0.0), 1e-300)
    unseen = free @ vectors[:, ~seen]
    basis = free @ vectors[:, seen] / np.sqrt(values[seen])
    return basis / scale[:, None], (np.abs(unseen) > MIN_UNIDENTIFIABLE_SHARE).any(axis=1)


def spectrum(rows: np.ndarray, weight: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (q,), from the least, and eigenvectors (q, q) of T'(RR' + W)T, for rows R (p, N) and T (p, q).

    Where some are so small that forming the product has lost them, they are found from factors instead.
    """
    values, vectors = np.linalg.eigh(turn.T @ (product(rows, rows.T) + weight) @ turn)
    if not len(values) or values[0] > SUSPECT * values[-1]:
        return values, vectors
    sizes, own = np.linalg.eigh(weight)
    factor = np.linalg.qr((own * np.sqrt(np.maximum(sizes, 0.0))).T @ turn, mode="r")
    for first in range(0, rows.shape[1], PIECE):
        factor = np.linalg.qr(np.vstack([factor, rows[:, first : first + PIECE].T @ turn]), mode="r")
    _, sizes, turned = np.linalg.svd(factor)
    return sizes[::-1] ** 2, turned[::-1].T


def _with_unidentifiable(covariance: np.ndarray, unidentifiable: np.ndarray) -> np.ndarray:
    made = (covariance + covariance.T) / 2
    made[unidentifiable], made[:, unidentifiable] = np.nan, np.nan
    made[unidentifiable, unidentifiable] = np.inf
    return made


def _noise_covariance(
    gains: np.ndarray, noises: NoiseModels, segments: Sequence[slice], share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (p, p) of ``gains`` (p, N) times the noise, and the degrees of freedom of its diagonal (p,)."""
    p = len(gains)
    total, groups = np.zeros((p, p)), []
    for group in dict.fromkeys(noises.source):
        mine = [i for i, s in enumerate(noises.source) if s == group]
        model = noises.models[mine[0]]
        v, slope = np.zeros(p), np.zeros((model.order, p))
        for i in mine:
            part, more = _quadratic(gains[:, segments[i]], model)
            total += part
            v += np.diag(part)
            slope += more
        known = max(noises.samples[mine[0]] * (1 - share) - 2 * model.order, 1.0)
        groups.append((v, slope, known, noises.uncertain[mine[0]]))
    # Squares of the variance of a parameter that is next to open overflow: it is brought near one, by powers of two.
    unit = np.exp2(np.frexp(np.diag(total))[1])
    doubt = np.zeros(p)
    with np.errstate(over="ignore", invalid="ignore"):  # of variances that are infinite themselves
        for v, slope, known, uncertain in groups:
            doubt += 2 * (v / unit) ** 2 / known + np.sum(slope / unit * (uncertain @ (slope / unit)), axis=0)
        freedom = 2 * (np.diag(total) / unit) ** 2 / np.where(doubt > 0, doubt, 1.0)
    return total, np.where(doubt == 0, math.inf, np.fmax(freedom, LEAST_FREEDOM))


def _quadratic(rows: np.ndarray, model: ARModel) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of ``rows`` (p, n) times the noise, and the slopes of its diagonal by the noise's coefficients."""
    p, n = rows.shape
    k = model.order
    if k == 0:
        return model.variance * product(rows, rows.T), np.zeros((0, p))
    size = fast_length(2 * n)
    around = np.zeros(size)
    around[:n] = model.autocovariance(n)
    around[size - n + 1 :] = around[n - 1 : 0 : -1]
    twice = np.full(size // 2 + 1, 2.0 / size)
    twice[0] = twice[-1] = 1.0 / size
    F = np.fft.rfft(rows, size)
    weighted = F * (np.fft.rfft(around).real * twice)
    total = product(weighted.view(float), F.view(float).T)
    power = (F * F.conj()).real
    turn = np.exp(2j * np.pi / size * np.arange(len(twice)))
    A = np.fft.rfft(np.concatenate([[1.0], -model.coefficients]), size)
    now = 2 * twice * model.variance / (A.real**2 + A.imag**2) / A
    slopes = np.empty((k, p))
    for j in range(k):
        now *= turn.conj()
        slopes[j] = power @ now.real
    return total, slopes


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
