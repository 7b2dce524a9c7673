"""Noise of measured inputs of any spectrum, and how likely the residual of a model is beside it.

What a filter leaves of an input's noise is seen in the residual only. Where that noise is coloured it may be much
stronger below the cut-off than above, and an effect that is not there may follow what it causes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.model import Model

BANDS_PER_DECADE = 3
"""Bands of the noise of an input in a factor of ten of the frequency. Chosen: noise has a broad spectrum."""
MOST_BANDS = 8
"""Such bands at most. Chosen: one recording does not determine more."""
LOWEST = 0.5
"""Lowest frequency of noise [1 / duration]. Chosen: slower noise is an offset."""
STEEPEST = 2.0
"""Fall of the power of noise with the frequency [power of it] at most, from what is visible. Derived: a random walk."""
MARGIN = 4.0
"""Power of the noise over that, at most. Chosen."""
MOST_NOISE = 0.05
"""Deviation of the noise of an input in a band, over that of the input, at most. Chosen: a sensor with more noise is
not used to identify a plant."""
LEAST_POWER = 1e-6
"""Power in a band [that of the visible noise] that is as good as none."""
ITERATIONS = 60
"""Steps of the estimate of a spectrum. Chosen: the likelihood then changes by less than one."""


@attrs.frozen(eq=False)
class Errors:
    """Independent errors of one input in one experiment, each as large as the visible noise makes it.

    ``causes`` (rows, k) is what each of them changes in the weighted outputs; they are ``distance`` [s] apart.
    ``share`` is the variance of the visible noise over that of the input, ``step`` [s] that of the recording,
    ``cutoff`` [Hz] where a filter has cut the noise, None where none has.
    """

    causes: np.ndarray = attrs.field(repr=False)
    distance: float
    share: float
    step: float
    cutoff: float | None


ErrorsByInput = Mapping[str, Errors]


@attrs.frozen(eq=False)
class Likelihood:
    """Residuals beside noise of the inputs of the most likely spectrum.

    ``deviance`` is minus twice the logarithm of the likelihood, ``square`` the mean square of the residuals that is
    left beside the noise [noise variances], ``noise`` the rms noise of each input, over the input's deviation.
    """

    deviance: float
    square: float
    noise: Mapping[str, float]


@attrs.frozen
class _Band:
    """A band of the noise of an input, from ``low`` to ``high`` [Hz], with the largest power [visible power]."""

    name: str
    low: float
    high: float
    most: float
    share: float


@attrs.frozen(eq=False)
class _Part:
    """One experiment: products of the causes with themselves, with the residual and with its derivatives.

    ``unknowns`` are the unknowns of the derivatives, ``bands`` the number of a band, the causes it is about, and their
    covariance at the power of the visible noise.
    """

    gram: np.ndarray
    moment: np.ndarray
    slopes: np.ndarray
    unknowns: np.ndarray
    bands: Sequence[tuple[int, slice, np.ndarray]]

    def covariance(self, power: np.ndarray) -> np.ndarray:
        """Covariance of the errors with this power in each band."""
        result = np.zeros_like(self.gram)
        for k, own, band in self.bands:
            result[own, own] += power[k] * band
        return result


def likelihood(model: Model, errors: Mapping[int, ErrorsByInput]) -> Likelihood:
    """How likely the residuals of a model are beside noise of inputs of the most likely spectrum.

    ``errors`` are by number of the experiment. The unknowns move to where the residuals are most likely beside it, as
    far as the outputs are linear in them.
    Source: Zhou, Hu, Zhou and Lange, MM algorithms for variance components models, J. Comput. Graph. Stat. 28 (2019).
    """
    bands = _bands(errors)
    parts, normal, slope = _products(model, errors, bands)
    most = np.array([band.most for band in bands])
    power, move = np.minimum(1.0, most), np.zeros(len(slope))
    for _ in range(ITERATIONS):
        gain, loss = np.zeros(len(bands)), np.full(len(bands), 1e-300)
        for part in parts:
            moment = part.moment + part.slopes @ move[part.unknowns]
            solved = _solved(part, power, np.column_stack([moment, part.gram]))
            for k, own, band in part.bands:
                gain[k] += solved[own, 0] @ band @ solved[own, 0]
                loss[k] += float(np.sum(solved[own, 1:][:, own] * band))
        power = _falling(np.clip(power * np.sqrt(gain / loss), LEAST_POWER, most), bands)
        move = _moved(parts, power, normal, slope)
    return _result(model, parts, bands, power, move, normal, slope)


def _falling(power: np.ndarray, bands: Sequence[_Band]) -> np.ndarray:
    """The power of noise that falls no faster with the frequency than noise does."""
    result = power.copy()
    for k in range(len(bands) - 2, -1, -1):
        if bands[k].name == bands[k + 1].name:
            ratio = bands[k + 1].high / bands[k].high
            result[k] = min(result[k], result[k + 1] * ratio**STEEPEST)
    return result


def _solved(part: _Part, power: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Products of the causes with values, as ``part.moment``, that become those with whitened values."""
    return np.linalg.solve(np.eye(len(part.gram)) + part.gram @ part.covariance(power), values)


def _moved(parts: Sequence[_Part], power: np.ndarray, normal: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """The move of the unknowns to the generalised least squares."""
    normal, slope = normal.copy(), slope.copy()
    for part in parts:
        taken = (
            part.slopes.T @ part.covariance(power) @ _solved(part, power, np.column_stack([part.moment, part.slopes]))
        )
        slope[part.unknowns] -= taken[:, 0]
        normal[np.ix_(part.unknowns, part.unknowns)] -= taken[:, 1:]
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    move: np.ndarray = -np.linalg.lstsq(normal / np.outer(size, size), slope / size, rcond=1e-9)[0] / size
    return move


def _result(
    model: Model,
    parts: Sequence[_Part],
    bands: Sequence[_Band],
    power: np.ndarray,
    move: np.ndarray,
    normal: np.ndarray,
    slope: np.ndarray,
) -> Likelihood:
    r = model.differences
    square, logarithm = float(r @ r + 2 * slope @ move + move @ normal @ move), 0.0
    for part in parts:
        moment = part.moment + part.slopes @ move[part.unknowns]
        covariance = part.covariance(power)
        square -= float(moment @ covariance @ _solved(part, power, moment[:, None])[:, 0])
        logarithm += float(np.linalg.slogdet(np.eye(len(part.gram)) + part.gram @ covariance)[1])
    noise = dict[str, float]()
    for band, one in zip(bands, power, strict=True):
        noise[band.name] = noise.get(band.name, 0.0) + one * band.share
    return Likelihood(square + logarithm, square / len(r), {k: float(np.sqrt(v)) for k, v in noise.items()})


def _bands(errors: Mapping[int, ErrorsByInput]) -> list[_Band]:
    """Bands of the noise of each input, the same in all experiments."""
    found = list[_Band]()
    every = [pair for one in errors.values() for pair in one.items()]
    for name in dict.fromkeys(name for name, _ in every):
        own = [one for key, one in every if key == name]
        low = min(LOWEST / (one.distance * one.causes.shape[1]) for one in own)
        high = max(0.5 / one.distance for one in own)
        count = int(np.clip(round(BANDS_PER_DECADE * np.log10(high / low)), 1, MOST_BANDS))
        visible = max(one.share for one in own), own[0].step, min(one.cutoff or 0.5 / one.step for one in own)
        found += [_band(name, a, b, *visible) for a, b in itertools.pairwise(np.geomspace(low, high, count + 1))]
    return found


def _band(name: str, low: float, high: float, visible: float, step: float, cutoff: float) -> _Band:
    share = visible * 2 * step * (high - low)
    coloured = MARGIN * max(cutoff / np.sqrt(low * high), 1.0) ** STEEPEST
    return _Band(name, low, high, min(coloured, MOST_NOISE**2 / share), share)


def _products(
    model: Model, errors: Mapping[int, ErrorsByInput], bands: Sequence[_Band]
) -> tuple[list[_Part], np.ndarray, np.ndarray]:
    """What the estimate needs of each experiment, the normal matrix of the unknowns, and the gradient."""
    rows, r, parts = model.problem.rows, model.differences, list[_Part]()
    normal, slope = np.zeros((len(model.theta),) * 2), np.zeros(len(model.theta))
    for e, block in enumerate(model.J.blocks()):
        whitening = model.problem.whitening.get(e)
        J = block.values if whitening is None else whitening.restored(block.values)
        J = np.where(np.isfinite(J), J, 0.0)
        normal[np.ix_(block.columns, block.columns)] += J.T @ J
        slope[block.columns] += J.T @ r[rows[e]]
        if e in errors:
            causes = np.concatenate([one.causes for one in errors[e].values()], axis=1)
            moments = causes.T @ np.column_stack([r[rows[e]], J])
            made = _covariances(errors[e], bands)
            parts.append(_Part(causes.T @ causes, moments[:, 0], moments[:, 1:], block.columns, made))
    return parts, normal, slope


def _covariances(errors: ErrorsByInput, bands: Sequence[_Band]) -> list[tuple[int, slice, np.ndarray]]:
    """The covariance of the errors of each input in each of its bands, at the power of the visible noise."""
    from scipy.linalg import toeplitz

    found, first = list[tuple[int, slice, np.ndarray]](), 0
    for name, one in errors.items():
        count = one.causes.shape[1]
        lags = 2 * one.distance * np.arange(count)
        for k, band in enumerate(bands):
            if band.name == name:
                values = (
                    2 * one.distance * (band.high * np.sinc(band.high * lags) - band.low * np.sinc(band.low * lags))
                )
                found.append((k, slice(first, first + count), toeplitz(values)))
        first += count
    return found
