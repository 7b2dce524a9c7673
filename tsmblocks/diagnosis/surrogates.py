"""Surrogates of a residual: the same noise without its tie to the input or to the time, for tests of significance.

Noise is seldom white, so that a test against independent samples finds structure in any recording. Surrogates keep the
autocorrelation of the residual.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tsmblocks.data.slow_noise import SHARES, Stretch, weighted_without_slopes
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import rows_of_experiments
from tsmblocks.fitting.column_space import ColumnSpace
from tsmblocks.fitting.inner_products import square

MIN_STRETCHES = 20
"""Stretches of all experiments together, at least. Chosen: their signs alone give a million surrogates."""
FOLDS = 5
"""Groups of stretches that are held out in turn. Source: Hastie et al., The Elements of Statistical Learning (2009),
7.10: five or ten."""
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
    """Noise like the residuals (n,) of some experiments, each of shape (n, draws) and with the same sums of squares.

    Its model is white noise beside slow noise, known as far as the residuals without their slopes tell: each draw has
    the model of another one of its posterior. Phases drawn for the spectrum of a residual would not do: where noise is
    so slow that a recording does not end near to where it began, all surrogates return and the residual does not.
    """
    sizes = [max(float(np.std(r)), 1e-300) for r in parts]
    model = weighted_without_slopes([Stretch(r / size, step) for r, size in zip(parts, sizes, strict=True)])
    drawn = draw.choice(model.weights.size, size=draws, p=model.weights.ravel() / model.weights.sum())
    times, shares = model.times[drawn // len(SHARES)], SHARES[drawn % len(SHARES)]
    noise = []
    for r in parts:
        white = draw.standard_normal((len(r), draws))
        slow = sum(_first_order(len(r), step / some, draw) for some in times.T) / np.sqrt(times.shape[1])
        one = np.sqrt(1 - shares) * white + np.sqrt(shares) * slow
        one -= one.mean(axis=0)
        noise.append(one * np.sqrt(square(r) / np.maximum(np.einsum("ij,ij->j", one, one), 1e-300)))
    return noise


def _first_order(n: int, rates: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    """First-order noise of variance 1 with these rates [1 / step], shape (n, draws)."""
    from scipy.signal import lfilter

    noise, kept = draw.standard_normal((n, len(rates))), np.exp(-rates)
    noise[1:] *= np.sqrt(1 - kept**2)
    for column, a in zip(noise.T, kept, strict=True):
        column[:] = lfilter([1.0], [1.0, -a], column)
    return noise


def surrogates(model: Model, base: ColumnSpace, draws: int, seed: int, *, of_time: bool) -> np.ndarray:
    """Surrogates of a model's residual with the base projected out, shape (N, draws), in single precision.

    They are the noise that the residual would be if the model were right. With ``of_time`` they are drawn anew, as
    ``slow_noise``, for effects of time; else they have lost their tie to the input.
    """
    draw, result = np.random.default_rng(seed), np.empty((len(model.r), draws), dtype=np.float32)
    for output in range(len(model.setup.outputs)):
        groups = list(rows_of_experiments(model, output).values())
        cuts = stretches_of([len(rows) for rows in groups])
        if of_time:
            step = float(np.median(np.diff(model.setup.experiments[0].t)))
            noise = slow_noise([model.r[rows] for rows in groups], step, draws, draw)
            for rows, one in zip(groups, noise, strict=True):
                result[rows] = one
            continue
        for rows, own in zip(groups, cuts, strict=True):
            for part in own:
                result[rows[part]] = rolled(model.r[rows[part]], draws, draw)
    for first in range(0, draws, COLUMNS_AT_A_TIME):  # for memory
        some = slice(first, first + COLUMNS_AT_A_TIME)
        result[:, some] = base.project_out(result[:, some].astype(float))
    return result
