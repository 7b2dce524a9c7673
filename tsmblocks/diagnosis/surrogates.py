"""Surrogates of a residual: the same noise without its tie to the input or to the time, for tests of significance.

Noise is seldom white, so that a test against independent samples finds structure in any recording. Surrogates keep the
autocorrelation of the residual.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.noise_floor import BURST_RATIO
from tsmblocks.diagnosis.outliers import without_outliers
from tsmblocks.diagnosis.partition import rows_of_experiments
from tsmblocks.fitting.column_space import ColumnSpace
from tsmblocks.fitting.inner_products import square

MIN_STRETCHES = 20
"""Stretches of all experiments together, at least. Chosen: their signs alone give a million surrogates."""
FOLDS = 5
"""Groups of stretches that are held out in turn. Source: Hastie et al., The Elements of Statistical Learning (2009),
7.10: five or ten."""
BAND_RATIO = 1.5
"""Ratio of the ends of a band of the spectrum. Chosen: noise changes little within one."""
FIRST_CYCLES = 1.5
"""Cycles in an experiment from which its spectrum counts. Derived: the main lobe of a Hann window reaches to 2."""
MIN_VALUES = 8
"""Values of the spectrum in a band at least. Chosen: nothing stands out from the uncertain power of fewer."""
HANN_BANDWIDTH = 1.94
"""Values of a spectrum in a Hann window with the information of one. Source: Percival and Walden, Spectral Analysis for
Physical Applications (1993), 6.3."""
SLOPE_BANDS = 5
"""Lowest bands that the slope is fitted to. Chosen: nearly a decade."""
LONGER = 4
"""Length of the noise that a surrogate is cut out of, over its own. Chosen: the lowest frequency is far below one
cycle."""
COLUMNS_AT_A_TIME = 16
"""Surrogates projected at a time. Chosen: for memory."""


def stretches_of(lengths: Sequence[int]) -> list[list[slice]]:
    """Cut experiments of these lengths into stretches, a multiple of ``FOLDS`` in each.

    Stretches are as long as they can be, so that slow noise seldom reaches from one into the next.
    """
    number = FOLDS * max(1, round(MIN_STRETCHES / (FOLDS * len(lengths))))
    edges = [np.linspace(0, n, number + 1).astype(int).tolist() for n in lengths]
    return [[slice(a, b) for a, b in itertools.pairwise(cuts)] for cuts in edges]


def rolled(r: np.ndarray, draws: int, draw: np.random.Generator) -> np.ndarray:
    """A stretch of a residual (n,) that has lost its tie to the input, shape (n, draws).

    Rolled by a random distance, reversed or not, and with a random sign: the sign matters where the input is periodic,
    since a rolled residual is then still a function of it.
    """
    starts, n = draw.integers(len(r), size=draws), len(r)
    way, sign = draw.choice([-1, 1], size=draws), draw.choice([-1.0, 1.0], size=draws)
    return r[(starts + way * np.arange(n)[:, None]) % n] * sign


def slow_noise(parts: Sequence[np.ndarray], step: float, draws: int, draw: np.random.Generator) -> list[np.ndarray]:
    """Noise like the residuals (n,) of some experiments, each of shape (n, draws) and of the same variance.

    A residual that is much larger than those of other experiments is not taken for noise whole. The mean of slow noise
    differs from one experiment to the next, as an offset does.

    Its spectrum is theirs, smoothed over bands, of which each draw has another one of the posterior; below the lowest
    band its slope continues. It is cut out of longer noise: surrogates that are periodic, as those with random phases
    are, return to where they began, and slow noise does not. Outliers are white noise beside it: in the spectrum of the
    residual that has them, they would hide how slow the rest is.
    """
    smooth = [without_outliers(r) for r in parts]
    frequency, power, freedom = _bands(smooth, step)
    levels = np.log(power * freedom / draw.chisquare(freedom, (draws, len(power))))
    slope = _lowest_slope(frequency, power)
    largest = BURST_RATIO * float(np.median([np.var(r) for r in parts]))
    noise = []
    for r, rest in zip(parts, smooth, strict=True):
        f = np.log(np.fft.rfftfreq(LONGER * len(r), step)[1:])
        below = slope * np.minimum(f - np.log(frequency[0]), 0.0)
        one = np.empty((len(r), draws))
        for k, level in enumerate(levels):
            amplitude = np.exp((np.interp(f, np.log(frequency), level) + below) / 2)
            phased = amplitude * (draw.standard_normal(len(f)) + 1j * draw.standard_normal(len(f)))
            one[:, k] = np.fft.irfft(np.append(0.0, phased), LONGER * len(r))[: len(r)]
        if (outliers := np.var(r) - np.var(rest)) > 0:
            one *= np.sqrt(np.var(rest) / np.maximum(one.var(axis=0), 1e-300))
            one += np.sqrt(outliers) * draw.standard_normal(one.shape)
        noise.append(one * np.sqrt(min(np.var(r), largest) / np.maximum(one.var(axis=0), 1e-300)))
    return noise


def _bands(parts: Sequence[np.ndarray], step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles of bands [Hz], the mean power density in each relative to the variance, and its degrees of freedom.

    Each residual counts less its straight line, in a Hann window, without which power of slow noise leaks.
    """
    longest = step * max(len(r) for r in parts)
    count = max(3, int(np.log(longest / (2 * FIRST_CYCLES * step)) / np.log(BAND_RATIO)))
    edges = np.geomspace(FIRST_CYCLES / longest, 0.5 / step * (1 + 1e-9), count + 1)
    total, number = np.zeros(count), np.zeros(count)
    for r in parts:
        n = len(r)
        line, window = np.linspace(-1.0, 1.0, n), np.hanning(n)
        x = r - r.mean() - line * (line @ r) / (line @ line)
        power = np.abs(np.fft.rfft(window * x)) ** 2 / max(square(window) * square(x) / n, 1e-300)
        band = np.searchsorted(edges, np.arange(len(power)) / (n * step), side="right") - 1
        kept = (np.arange(len(power)) > FIRST_CYCLES) & (band >= 0) & (band < count)
        np.add.at(total, band[kept], power[kept])
        np.add.at(number, band[kept], 1.0)
    joined = np.minimum((np.cumsum(number) - number) // MIN_VALUES, max(number.sum() // MIN_VALUES - 1, 0))
    first = np.unique(joined, return_index=True)[1]  # bands of few values are taken together
    logs = np.log(np.sqrt(edges[:-1] * edges[1:]))
    values, powers, places = (np.add.reduceat(one, first) for one in (number, total, number * logs))
    if not np.all((values > 0) & (powers > 0)):
        return np.ones(1), np.ones(1), np.ones(1)
    return np.exp(places / values), powers / values, np.maximum(2 * values / HANN_BANDWIDTH, 1.0)


def _lowest_slope(frequency: np.ndarray, power: np.ndarray) -> float:
    """Slope of the spectrum at its low end in logarithms: from 0 of white noise to -2 of a random walk."""
    f, p = np.log(frequency[:SLOPE_BANDS]), np.log(power[:SLOPE_BANDS])
    f = f - f.mean()
    return float(np.clip(f @ p / max(float(f @ f), 1e-300), -2.0, 0.0))


def surrogates(model: Model, base: ColumnSpace, draws: int, seed: int, *, of_time: bool) -> np.ndarray:
    """Surrogates of a model's residual with the base projected out, shape (N, draws), in single precision.

    They are the noise that the residual would be if the model were right, with its sum of squares. With ``of_time``
    they are new noise, as ``slow_noise``, for effects of time; else they have lost their tie to the input.
    """
    draw, result = np.random.default_rng(seed), np.empty((len(model.r), draws), dtype=np.float32)
    for output in range(len(model.setup.outputs)):
        groups = list(rows_of_experiments(model, output).values())
        if of_time:
            step = float(np.median(np.diff(model.setup.experiments[0].t)))
            noise = slow_noise([model.r[rows] for rows in groups], step, draws, draw)
            for rows, one in zip(groups, noise, strict=True):
                result[rows] = one
            continue
        for rows, own in zip(groups, stretches_of([len(rows) for rows in groups]), strict=True):
            for part in own:
                result[rows[part]] = rolled(model.r[rows[part]], draws, draw)
    whole = square(model.r)
    for first in range(0, draws, COLUMNS_AT_A_TIME):  # for memory
        some = slice(first, first + COLUMNS_AT_A_TIME)
        left = base.project_out(result[:, some].astype(float))
        result[:, some] = left * np.sqrt(whole / np.maximum(np.einsum("ij,ij->j", left, left), 1e-300))
    return result
