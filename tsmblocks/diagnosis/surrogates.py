"""Surrogates of a residual: the same noise without its tie to the input or to the time, for tests of significance.

Noise is seldom white, so that a test against independent samples finds structure in any recording. Surrogates keep the
autocorrelation of the residual.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import rows_of_experiments
from tsmblocks.fitting.column_space import ColumnSpace

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


def without_phase(r: np.ndarray, draws: int, draw: np.random.Generator) -> np.ndarray:
    """A residual (n,) of one experiment that has lost its tie to the time but kept its spectrum, shape (n, draws).

    Source: Theiler et al., Physica D 58 (1992), 77-94, doi 10.1016/0167-2789(92)90102-S.
    """
    spectrum = np.fft.rfft(r)
    phase = np.exp(2j * np.pi * draw.random((len(spectrum), draws)))
    phase[0] = draw.choice([-1.0, 1.0], size=draws)
    if len(r) % 2 == 0:
        phase[-1] = draw.choice([-1.0, 1.0], size=draws)
    return np.fft.irfft(spectrum[:, None] * phase, len(r), axis=0)


def surrogates(model: Model, base: ColumnSpace, draws: int, seed: int, *, of_time: bool) -> np.ndarray:
    """Surrogates of a model's residual with the base projected out, shape (N, draws), in single precision.

    They are the noise that the residual would be if the model were right. With ``of_time`` they have lost their tie to
    the time, for effects of time; else to the input.
    """
    draw, result = np.random.default_rng(seed), np.empty((len(model.r), draws), dtype=np.float32)
    for output in range(len(model.setup.outputs)):
        groups = list(rows_of_experiments(model, output).values())
        cuts = stretches_of([len(rows) for rows in groups])
        for rows, own in zip(groups, cuts, strict=True):
            if of_time:
                result[rows] = without_phase(model.r[rows], draws, draw)
            else:
                for part in own:
                    result[rows[part]] = rolled(model.r[rows[part]], draws, draw)
    for first in range(0, draws, COLUMNS_AT_A_TIME):  # for memory
        some = slice(first, first + COLUMNS_AT_A_TIME)
        result[:, some] = base.project_out(result[:, some].astype(float))
    return result
