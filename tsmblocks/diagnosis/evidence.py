"""Evidence of a model error: whether the residual can be predicted, on data held out, from what was recorded.

A model error repeats with the motion; noise does not, whatever its spectrum.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import REST_HALF_RANGE
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import rows_of_experiments
from tsmblocks.diagnosis.surrogates import FOLDS, rolled, stretches_of, surrogates
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space

DRAWS = 199
"""Surrogates of the residual. Chosen: the 99 % quantile is the second largest."""
SIGNIFICANCE_LEVEL = 0.01
"""Probability that noise is taken for a model error. Chosen: below the 2 % that are allowed in all."""
MIN_PREDICTED_EXCESS = 0.05
"""Predicted part of the residual's mean square over the rest, below which a model error is not material. Chosen: the
excess below which no effect is named either."""
RIDGES = (1e-3, 1e-2, 1e-1, 1.0)
"""Ridge weights on features of unit variance, of which the best is taken, for the surrogates as well. Chosen."""
KINDS = ("shape", "rate", "turning points", "lag")
"""Kinds of features. Each kind alone is tried as well as all together: few features need few samples."""
PLAY_WIDTHS = (0.003, 0.01, 0.03, 0.08, 0.15, 0.3, 0.6)
"""Half widths of plays [half ranges of the signal]. Chosen: from far below any gap to most of the motion."""
TIME_CONSTANTS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Delays and time constants of lags [s]. Chosen: those of mechanisms."""
SMOOTHING_TIME = 0.04
"""Time [s] over which a signal is averaged before it is differentiated. Chosen: below most time constants."""
RIPPLE_COUNT = 6
"""Harmonics of a ripple over the position. Chosen."""
RIPPLE_PERIOD = 1.3
"""Longest period of a ripple [half ranges]. Chosen: incommensurate with the range."""
DIRECTION_STEEPNESS = 10.0
"""Steepness of the change of direction [1 / rms speed]. Chosen: resolved at usual sampling."""
SAME_SIGNAL = 0.9999
"""Correlation from which two signals are one for this purpose. Chosen."""

Motions = Mapping[str, Sequence[np.ndarray]]
"""Signals that the features are made of: an array for each experiment, pieces joined."""


@attrs.frozen
class Evidence:
    """How much of a residual is predicted on held-out blocks.

    ``share`` is the share of the mean square that is predicted (below zero: none), ``critical`` the share that is
    exceeded with noise alone with a probability of 1 %, ``p`` the share of surrogates that reach ``share``. ``rest`` is
    the mean square that is not predicted.
    """

    share: float
    critical: float
    p: float
    rest: float

    @property
    def predicted(self) -> float:
        """The mean square that is predicted."""
        return self.rest * self.share / (1 - self.share) if 0 < self.share < 1 else 0.0

    @property
    def significant(self) -> bool:
        """Whether the residual holds a model error."""
        return self.share > max(self.critical, 0.0)

    @property
    def material(self) -> bool:
        """Whether it is significant, and large enough to be of interest."""
        return self.significant and is_material(self.share)


def is_material(share: float) -> bool:
    """Whether a share of a mean square is large enough beside the rest to be of interest."""
    return share >= MIN_PREDICTED_EXCESS * (1 - share)


def evidence(model: Model, seed: int) -> Evidence:
    """Predict the residual of a model from its inputs and outputs, by ridge regression on held-out blocks.

    Features are powers, rates, directions, plays of several widths, lags and ripples of each signal. The share that is
    predicted is held against that of surrogates of the residual: of parts of it that have lost their tie to the motion,
    and of noise of its spectrum, which may be slower than these parts are long.
    """
    draw = np.random.default_rng(seed)
    motions = distinct_motions(model)
    slow = surrogates(model, column_space(model.J, SQUARED_EFFECT_TOLERANCE), DRAWS, seed, of_time=True)
    every = [_regression(model, output, motions, draw, slow) for output in range(len(model.setup.outputs))]
    total = np.sum([squares for _, squares in every], axis=0)
    rest = np.sum([error for error, _ in every], axis=0)
    share = 1 - rest / np.maximum(total, 1e-300)
    found, nulls = float(share[0]), share[1:].reshape(2, DRAWS)
    return Evidence(
        found,
        float(np.quantile(nulls, 1 - SIGNIFICANCE_LEVEL, axis=1, method="higher").max()),
        float((1 + np.sum(nulls >= found, axis=1).max()) / (DRAWS + 1)),
        float(rest[0] / len(model.r)) if found > 0 else model.mean_square,
    )


def _regression(
    model: Model, output: int, motions: Motions, draw: np.random.Generator, slow: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squared error and sum of squares, each (1 + 2 draws,), of one output's residual and of its surrogates.

    ``slow`` (N, draws) are those of its spectrum.
    """
    groups, kinds = list(rows_of_experiments(model, output).values()), _kinds(motions)
    cuts, count = stretches_of([len(rows) for rows in groups]), len(kinds) + 1
    gram, moment = np.zeros((FOLDS, count, count)), np.zeros((FOLDS, count, 1 + 2 * DRAWS))
    squares = np.zeros(1 + 2 * DRAWS)
    for k, (rows, own, columns) in enumerate(zip(groups, cuts, _features(model, motions), strict=True)):
        z = np.column_stack([*columns, np.ones(len(rows))])
        for j, part in enumerate(own):
            r = model.r[rows[part]]
            both = np.column_stack([r, rolled(r, DRAWS, draw), slow[rows[part]]])
            fold = (j + k) % FOLDS
            gram[fold] += z[part].T @ z[part]
            moment[fold] += z[part].T @ both
            squares += np.einsum("ij,ij->j", both, both)
    if not len(kinds):  # nothing moves
        return squares, squares
    sets = [np.arange(count), *(np.append(np.flatnonzero(kinds == k), count - 1) for k in range(len(KINDS)))]
    errors = [_held_out_error(gram[:, own][:, :, own], moment[:, own], squares) for own in sets]
    return np.min(errors, axis=0), squares


def _held_out_error(gram: np.ndarray, moment: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Sum of squared errors (D,) of the best ridge regression, from moments of each fold (F, p, p), (F, p, D).

    Features are scaled to unit variance by their moments; the last one is the constant.
    """
    total, moments = gram.sum(axis=0), moment.sum(axis=0)
    n = total[-1, -1]
    variance = np.diag(total) / n - (total[-1] / n) ** 2
    scale = np.sqrt(np.maximum(variance, 1e-12 * np.maximum(np.diag(total) / n, 1e-300)))
    scale[-1] = 1.0
    centred = np.eye(len(total))
    centred[-1, :-1] = -total[-1, :-1] / n
    turn = centred / scale
    gram, moment = turn.T @ gram @ turn, turn.T @ moment
    total, moments = gram.sum(axis=0), moment.sum(axis=0)
    best = np.full(len(squares), np.inf)
    for ridge in RIDGES:
        weights = np.full(len(total), ridge * n)
        weights[-1] = 0.0
        error = squares.copy()
        for g, b in zip(gram, moment, strict=True):
            w = np.linalg.solve(total - g + np.diag(weights) + 1e-9 * n * np.eye(len(total)), moments - b)
            error += np.einsum("ij,ij->j", w, g @ w - 2 * b)
        best = np.minimum(best, error)
    return best


# ---- features -------------------------------------------------------------------------------------


def _features(model: Model, motions: Motions) -> Iterator[list[np.ndarray]]:
    """Features of the motions, a list of columns (n,) for each experiment, the same ones in each."""
    scales = {name: scale(values) for name, values in motions.items()}
    for k, t in enumerate(times(model)):
        signals = [_of_signal(t, values[k], *scales[name]) for name, values in motions.items()]
        yield [one for signal in signals for kind in signal for one in kind]


def _kinds(motions: Motions) -> np.ndarray:
    """The kind of each feature, shape (p,)."""
    some = np.linspace(0.0, 1.0, 8)
    of_signal = [k for k, kind in enumerate(_of_signal(some, some, 0.5, 0.5)) for _ in kind]
    return np.array(of_signal * len(motions), dtype=int)


def distinct_motions(model: Model) -> Motions:
    """Inputs and simulated outputs that move, without those that are proportional to one before them."""
    chosen: dict[str, Sequence[np.ndarray]] = {}
    for name, values in _motions(model).items():
        joined = np.concatenate(values)
        others = (np.concatenate(other) for other in chosen.values())
        if np.ptp(joined) > 2 * REST_HALF_RANGE and not any(_same(joined, other) for other in others):
            chosen[name] = values
    return chosen


def _motions(model: Model) -> Motions:
    """Inputs and simulated outputs."""
    result: dict[str, list[np.ndarray]] = {}
    for name in model.diagram.inputs:
        unit = model.diagram.unit(name)
        values = [np.interp(one.t, one.record.t, one.record.values(name, unit)) for one in model.setup.experiments]
        result[f"input {name}"] = _joined(values, model)
    theta, unknowns = model.theta, model.problem.unknowns
    runs = [one.outputs(unknowns.parameters(theta, e)) for e, one in enumerate(model.setup.experiments)]
    for i, name in enumerate(model.setup.outputs):
        result[f"output {name}"] = _joined([run[:, i] for run in runs], model)
    return result


def times(model: Model) -> list[np.ndarray]:
    """Times [s] of the residual of one output, an array for each experiment."""
    return _joined([one.t for one in model.setup.experiments], model)


def _joined(values: list[np.ndarray], model: Model) -> list[np.ndarray]:
    """Arrays of pieces joined to those of experiments."""
    lengths = [len(rows) for rows in rows_of_experiments(model, 0).values()]
    return np.split(np.concatenate(values), np.cumsum(lengths)[:-1])


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return abs(float(np.corrcoef(one, other)[0, 1])) > SAME_SIGNAL


def scale(values: Sequence[np.ndarray]) -> tuple[float, float]:
    """Middle and half range of a signal over all experiments."""
    low, high = min(float(x.min()) for x in values), max(float(x.max()) for x in values)
    return (low + high) / 2, (high - low) / 2


def _of_signal(t: np.ndarray, x: np.ndarray, middle: float, reach: float) -> list[list[np.ndarray]]:
    """Features of one signal in one experiment, a list for each of ``KINDS``."""
    from scipy.signal import lfilter

    h = float(np.median(np.diff(t)))
    s, v, a = derivatives(t, x, middle, reach)
    side = np.tanh(DIRECTION_STEEPNESS * v)
    shape, lags = [s, s**2, s**3, s**4, s**5], list[np.ndarray]()
    for k in range(1, RIPPLE_COUNT + 1):
        phase = 2 * np.pi * k * s / RIPPLE_PERIOD
        shape += [np.sin(phase), np.cos(phase)]
    rates = [v, v * abs(v), abs(v), side, side * s, side * s**2, v * s, v * s**2, a, a * s]
    plays = [s - _play(s, half_width) for half_width in PLAY_WIDTHS]
    plays += [plays[3] * s, plays[3] * side, plays[3] ** 2, plays[5] * s, plays[5] ** 2, plays[1] * s]
    for time in TIME_CONSTANTS:
        late = min(max(1, int(time / h)), len(s) - 1)
        share = h / (time + h)
        lags.append(np.concatenate([np.full(late, s[0]), s[:-late]]) - s)
        lags.append(lfilter([share], [1, share - 1], s, zi=[(1 - share) * s[0]])[0] - s)
    return [shape, rates, plays, lags]


def derivatives(t: np.ndarray, x: np.ndarray, middle: float, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position [half ranges], speed and acceleration [their rms] of one signal in one experiment, smoothed."""
    from scipy.ndimage import uniform_filter1d

    h = float(np.median(np.diff(t)))
    width = max(3, int(SMOOTHING_TIME / h) | 1)
    smooth = uniform_filter1d(x, width)
    v = uniform_filter1d(np.gradient(smooth, h), width)
    a = uniform_filter1d(np.gradient(v, h), width)
    return (smooth - middle) / reach, v / max(float(np.std(v)), 1e-300), a / max(float(np.std(a)), 1e-300)


def _play(x: np.ndarray, half_width: float) -> np.ndarray:
    """The output of a play that starts in its middle."""
    y, m = [], float(x[0])
    for value in x.tolist():
        m = min(max(m, value - half_width), value + half_width)
        y.append(m)
    return np.array(y)
