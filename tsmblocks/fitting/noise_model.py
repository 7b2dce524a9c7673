"""Noise models of residuals: an autoregressive model of each segment, corrected for the noise that the fit has removed.

A fit removes from the noise whatever its parameters can follow, above all slow noise, so the residuals look whiter and
smaller than the noise is. Its model is therefore found by restricted maximum likelihood: of the part of the noise that
the fit cannot follow.

Sources: Patterson and Thompson, Biometrika 58 (1971), on restricted likelihood; Cheang and Reinsel, J. Amer. Statist.
Assoc. 95 (2000), on its use for regressions with autoregressive noise; Hurvich and Tsai, Biometrika 76 (1989), on the
choice of the order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.fitting.inner_products import product, square
from tsmblocks.fitting.jacobian import Jacobian

LONGEST = 10_000
"""Length of one dot product. Chosen: longer ones start threads of the library."""
FEWEST = 40
"""Samples below which a segment has no separate noise model. Chosen."""
ROUNDS = 10
"""Iterations at most between the noise model and the parameters. Chosen."""
ENOUGH = 2e-3
"""Change of the parameters in an iteration, relative to their uncertainty, that ends it. Chosen."""
RIDGE = 1e-7
"""Fraction of white noise that is added: noise behind a filter would else count as predictable. Chosen."""
ROUNDING = 1e-6
"""Share of the residuals that the parameters cannot follow, below which all of them is rounding: at an optimum they can
follow none. Chosen: far below any noise."""


@attrs.frozen(eq=False)
class ARModel:
    r"""Autoregressive noise, driven by white noise e of ``variance``.

    .. math:: n_t = \sum_i a_i n_{t-i} + e_t

    ``coefficients`` holds the a_i (order,); with none, the noise is white.
    """

    coefficients: np.ndarray
    variance: float

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)

    def autocovariance(self, count: int) -> np.ndarray:
        """Covariance of two samples 0, 1, … ``count - 1`` samples apart, shape (count,).

        From the spectrum where the noise dies out within the time asked for, which is exact however the roots lie;
        else by recursion, which is off by some 1e-4 of the variance where many roots lie close together.
        """
        k = self.order
        if k == 0:
            return self.variance * np.eye(1, count)[0]
        if k > 2:
            size = fast_length(max(2 * count, 4096))
            A = np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), size)
            g = np.fft.irfft(self.variance / (A.real**2 + A.imag**2), size)
            if np.abs(g[3 * size // 8 : size // 2]).max() < 1e-9 * g[0]:
                return g[:count]
        return self._stepped(count)

    def _stepped(self, count: int) -> np.ndarray:
        """Continue the first covariances by the recursion of the noise, over twice the length each time."""
        k = self.order
        g = np.empty(max(count, k + 1))
        g[: k + 1] = _first_covariances(self.coefficients, self.variance)
        have, step = k + 1, np.eye(1, k)[0]  # g[i + shift] = step · (g[i], g[i - 1], …)
        companion = np.vstack([self.coefficients, np.eye(k - 1, k)])
        power, shift = companion, 1
        while have < len(g):
            while 2 * shift <= have - k + 1:
                power, shift = power @ power, 2 * shift
            step = power[0]
            take = min(shift, len(g) - have)
            past = g[have - shift - k + 1 : have - shift + take]
            g[have : have + take] = np.convolve(past, step, "valid")
            have += take
        return g[:count]


def _first_covariances(a: np.ndarray, variance: float) -> np.ndarray:
    """Covariances at the lags 0 to order, from the Yule-Walker equations."""
    k = len(a)
    c, lags = np.r_[1.0, -a], np.arange(k + 1)
    matrix = np.zeros((k + 1, k + 1))
    np.add.at(matrix, (np.repeat(lags, k + 1), np.abs(lags[:, None] - lags).ravel()), np.tile(c, k + 1))
    return np.linalg.solve(matrix, variance * np.eye(1, k + 1)[0])


def fast_length(n: int) -> int:
    """An even length of at least ``n`` whose Fourier transform is quick."""
    return min(f << max(math.ceil(math.log2(n / f)), 1) for f in (1, 3, 5, 9, 15))


@attrs.frozen(eq=False)
class LagProducts:
    r"""Sums :math:`G_{ij} = \sum_{t \ge k} z_{t-i} z_{t-j}^T` of signals z (m,) for lags i, j of 0 to k, over segments.

    ``first`` (k + 1, m, m) holds :math:`G_{0j}`. The others follow from it and the samples by which they differ, the
    first and last k of each segment, ``heads`` and ``tails`` (segments, k, m) with the earliest last:
    :math:`G_{i+1,j+1} = G_{ij} + h_i h_j^T - t_i t_j^T`.
    """

    first: np.ndarray
    heads: np.ndarray
    tails: np.ndarray

    @classmethod
    def of(cls, parts: Sequence[np.ndarray], order: int) -> LagProducts:
        """Of segments (m, samples). No sample before the first or after the last is made up, so a slow signal is not
        taken for one that jumps at its ends.
        """
        k, m = order, len(parts[0])
        parts = [rows for rows in parts if rows.shape[1] > k]
        first = np.zeros((k + 1, m, m))
        for rows in parts:
            n = rows.shape[1]
            if m == 1:
                first[:, 0, 0] += _lagged(rows[0], k)
                continue
            for j in range(k + 1):
                first[j] += product(rows[:, k:], rows[:, k - j : n - j].T)
        shape = (len(parts), k, m)
        heads = np.array([rows[:, :k].T[::-1] for rows in parts]).reshape(shape)
        tails = np.array([rows[:, rows.shape[1] - k :].T[::-1] for rows in parts]).reshape(shape)
        return cls(first, heads, tails)

    def along(self, outer: np.ndarray) -> np.ndarray:
        """Sums of ``G * outer`` for a symmetric ``outer`` (m, m), shape (k + 1, k + 1)."""
        k = len(self.first) - 1
        ends = np.tensordot(self.heads @ outer, self.heads, ((0, 2), (0, 2)))
        ends -= np.tensordot(self.tails @ outer, self.tails, ((0, 2), (0, 2)))
        made = np.empty((k + 1, k + 1))
        made[0] = made[:, 0] = self.first.reshape(k + 1, -1) @ outer.ravel()
        for i in range(k):
            made[i + 1, 1:] = made[i, :-1] + ends[i]
        return made

    def filtered(self, weights: np.ndarray) -> np.ndarray:
        """Sum of ``weights[i] weights[j] G[i, j]``, shape (m, m): products of the signals after a filter."""
        k, m = len(self.first) - 1, self.first.shape[1]
        half = np.tensordot(np.correlate(weights, weights, "full")[k:] * np.r_[0.5, np.ones(k)], self.first, 1)
        later = np.array([np.r_[weights[lag:], np.zeros(lag - 1)] for lag in range(1, k + 1)]).reshape(k, k)
        heads, tails = ((later @ part).reshape(-1, m) for part in (self.heads, self.tails))
        return half + half.T + heads.T @ heads - tails.T @ tails


def _lagged(row: np.ndarray, k: int) -> np.ndarray:
    """Sums of a row times itself 0 to k samples before, a part of it at a time."""
    made = np.zeros(k + 1)
    for first in range(k, len(row), LONGEST):
        part = row[first : first + LONGEST]
        made += np.correlate(row[first - k : first + len(part)], part, "valid")[::-1]
    return made


def best_order(products: np.ndarray, samples: int) -> int:
    """Order with the least corrected information criterion (AICc), all orders judged on the same ``samples``.

    ``products`` (most + 1, most + 1) are lag products of a signal. One factorisation gives every order.
    """
    most = len(products) - 1
    turned = np.r_[1 : most + 1, 0]
    factor = np.linalg.cholesky(_ridged(products)[np.ix_(turned, turned)])
    residual = np.cumsum(factor[-1, ::-1] ** 2)[::-1]
    k = np.arange(most + 1)
    return int(np.argmin(samples * np.log(residual) + 2 * (k + 1) * samples / np.maximum(samples - k - 2, 1)))


def _ridged(matrix: np.ndarray) -> np.ndarray:
    return matrix + (RIDGE * np.trace(matrix) / len(matrix) + 1e-300) * np.eye(len(matrix))


@attrs.frozen(eq=False)
class BlockLagProducts:
    """Lag products of signals z (m,) of which only some are not zero in each experiment.

    ``parts`` holds for each experiment which these are, shape (k,), and their lag products.
    """

    parts: tuple[tuple[np.ndarray, LagProducts], ...]
    count: int

    def along(self, outer: np.ndarray) -> np.ndarray:
        """As for ``LagProducts``, for ``outer`` (m, m)."""
        return np.sum([part.along(outer[np.ix_(which, which)]) for which, part in self.parts], axis=0)

    def filtered(self, weights: np.ndarray) -> np.ndarray:
        """As for ``LagProducts``, shape (m, m)."""
        result = np.zeros((self.count, self.count))
        for which, part in self.parts:
            result[np.ix_(which, which)] += part.filtered(weights)
        return result


@attrs.define(eq=False)
class _Source:
    """The data from which the noise of some segments is estimated."""

    users: list[int]  # segments that have this noise
    learnt: BlockLagProducts  # of [basis, r] over the segments it is learnt from
    used: BlockLagProducts  # the same, over its users
    samples: int
    model: Any = None
    inverse: Any = None  # information on the coefficients, inverted

    def update(self, outer: np.ndarray) -> None:
        """Fit the model again, given the mean of ``[-d, 1][-d, 1]'`` for the parameters' error d."""
        c = _ridged(self.learnt.along(outer))
        k = len(c) - 1
        normal = c[1:, 1:]
        a = np.linalg.solve(normal, c[1:, 0])
        ahead = np.r_[1.0, -a]
        variance = max(float(ahead @ c @ ahead), 0.0) / max(self.samples - 2 * k, 1)
        self.model = ARModel(a, variance)
        self.inverse = variance * np.linalg.inv(normal) if k else normal

    def whitened(self) -> np.ndarray:
        """Products of [basis, r] after the filter that makes this noise white with unit variance."""
        return self.used.filtered(np.r_[1.0, -self.model.coefficients]) / self.model.variance


@attrs.frozen(eq=False)
class NoiseModels:
    """Autoregressive model of the noise of each segment.

    ``uncertain`` holds the covariances of the coefficients, ``samples`` how many they were learnt from,
    ``source`` which estimate each segment shares with others.
    """

    models: tuple[ARModel, ...]
    uncertain: tuple[np.ndarray, ...]
    samples: tuple[int, ...]
    source: tuple[int, ...]


def noise_models(basis: Jacobian, r: np.ndarray, segments: Sequence[slice]) -> NoiseModels:
    """Models of the noise in residuals ``r`` (N,) of a fit along ``basis`` (N, q), whose columns are orthonormal.

    The order is the best by AICc up to 10 log10(n) or an eighth of the samples. Noise and the error of the
    parameters are estimated in turn (the expectation-maximisation form of restricted likelihood). Segments
    of fewer than ``FEWEST`` samples take the model of all segments together.
    """
    if square(r - basis @ basis.transposed_times(r)) <= ROUNDING**2 * square(r):
        r = np.zeros_like(r)
    sources = _sources(basis, r, segments)
    q = basis.shape[1]
    error, spread = np.zeros(q), square(r) / max(len(r) - q, 1) * np.eye(q)  # as if the noise were white
    for turn in range(ROUNDS + 1):
        outer = np.zeros((q + 1, q + 1))
        outer[:q, :q] = spread
        outer += np.outer(np.r_[-error, 1.0], np.r_[-error, 1.0])
        for source in sources:
            source.update(outer)
        if turn == ROUNDS or q == 0 or any(source.model.variance <= 0 for source in sources):
            break
        known = np.sum([source.whitened() for source in sources], axis=0)
        before = error, spread
        spread = np.linalg.inv(_ridged(known[:q, :q]))
        error = spread @ known[:q, q]
        size = np.trace(spread)
        # Norms that are the same for every orthonormal basis.
        still = np.linalg.norm(error - before[0]) <= ENOUGH * np.sqrt(max(size, 0.0))
        if still and np.linalg.norm(spread - before[1]) <= ENOUGH * size:
            break
    of = {s: source for source in sources for s in source.users}
    order = [of[s] for s in range(len(segments))]
    return NoiseModels(
        tuple(_tamed(o.model, o.samples) for o in order),
        tuple(o.inverse for o in order),
        tuple(o.samples for o in order),
        tuple(sources.index(o) for o in order),
    )


def _sources(basis: Jacobian, r: np.ndarray, segments: Sequence[slice]) -> list[_Source]:
    lengths, q = [s.stop - s.start for s in segments], basis.shape[1]
    fewest = max(FEWEST, 4 * (q + 1))
    blocks = [(np.r_[one.columns, q], np.vstack([one.values.T, r[one.rows]]), one.rows.start) for one in basis.blocks()]
    of = [basis.experiment_of(s) for s in segments]

    def learnt(some: Sequence[int], order: int) -> BlockLagProducts:
        parts = []
        for e in dict.fromkeys(of[i] for i in some):
            which, rows, first = blocks[e]
            mine = [rows[:, segments[i].start - first : segments[i].stop - first] for i in some if of[i] == e]
            parts.append((which, LagProducts.of(mine, order)))
        return BlockLagProducts(tuple(parts), q + 1)

    made = []
    for i, s in enumerate(segments):
        if lengths[i] >= fewest:
            products = learnt([i], _order([r[None, s]], lengths[i]))
            made.append(_Source([i], products, products, lengths[i]))
    short = [i for i, n in enumerate(lengths) if n < fewest]
    if short:
        k = _order([r[None, s] for s in segments], max(lengths))
        every = learnt(range(len(segments)), k)
        used = every if len(short) == len(segments) else learnt(short, k)
        made.append(_Source(short, every, used, sum(n for n in lengths if n > k)))
    return made


def _order(parts: Sequence[np.ndarray], longest: int) -> int:
    """Best order for one signal in several parts (1, samples)."""
    most = int(min(10 * np.log10(max(longest, 1)), longest / 8))
    products = LagProducts.of(parts, most).along(np.eye(1))
    if most == 0 or not products[0, 0] > 0:
        return 0
    return best_order(products, sum(max(part.shape[1] - most, 0) for part in parts))


def _tamed(model: ARModel, samples: int) -> ARModel:
    """The same noise, dying out within four times its record: slower noise is indistinguishable from growing noise."""
    limit = 1 - 0.25 / max(samples, 1)
    a = model.coefficients
    if _dies_out(a / limit ** np.arange(1, len(a) + 1)):
        return model
    largest = float(np.abs(np.linalg.eigvals(np.vstack([a, np.eye(len(a) - 1, len(a))]))).max())
    return ARModel(a * (limit / largest) ** np.arange(1, len(a) + 1), model.variance)


def _dies_out(a: np.ndarray) -> bool:
    """Whether an autoregression is stable: all its reflection coefficients are below one (step-down recursion)."""
    while len(a):
        last = a[-1]
        if not abs(last) < 1:
            return False
        a = (a[:-1] + last * a[-2::-1]) / (1 - last * last) if len(a) > 1 else a[:0]
    return True
