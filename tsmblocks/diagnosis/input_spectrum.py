"""Noise of measured inputs of any spectrum, and how likely the residual of a model is beside it.

What a filter leaves of an input's noise is seen in the residual only. Where that noise is coloured it may be much
stronger below the cut-off than above, and an effect that is not there may follow what it causes.
"""

from __future__ import annotations

import functools
import math
import weakref
from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.model import Model

CORNERS_PER_DECADE = 2
"""Corner frequencies of the noise of an input in a factor of ten. Chosen: a sum of such spectra is any that falls."""
MOST_CORNERS = 7
"""Such corners at most. Chosen: one recording does not determine more."""
LOWEST = 0.5
"""Lowest corner frequency [1 / duration]. Chosen: slower noise is an offset."""
HIGHEST = 0.25
"""Highest corner frequency [1 / distance of the errors]. Chosen: noise with a higher one is white at that distance."""
MARGIN = 4.0
"""Power of the noise at the cut-off of a filter, over that of the noise above, at most. Chosen."""
LEAST_POWER = 0.25
"""Power of white noise below the cut-off, over that, at least. Chosen: noise does not end where a filter begins."""
MOST_NOISE = 0.1
"""Deviation of one part of the noise of an input, over that of the input, at most. Chosen: a sensor with more noise is
not used to identify a plant."""
NEGLIGIBLE = 1e-3
"""Variance along a direction [that of the outputs' noise] that is as good as none, at the largest power."""
MOST_LEFT = 1.5
"""Mean square of a residual that is left beside noise of the inputs [that of the outputs' noise] up to which it may be
noise. Chosen: what noise of an input causes is known as far as the model is linear."""
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

    @property
    def explains(self) -> bool:
        """Whether noise of the inputs and of the outputs may be all that the residuals hold."""
        return self.square <= MOST_LEFT


@attrs.frozen
class _Component:
    """A part of the noise of an input: white noise, or noise that falls above a ``corner`` [Hz].

    Its power at low frequencies is ``least`` to ``most`` times that of the visible noise; ``share`` is its variance at
    that power over that of the input.
    """

    input: str
    corner: float
    least: float
    most: float
    share: float

    def covariance(self, count: int, distance: float) -> np.ndarray:
        """Covariance of so many errors at a distance [s], at the power of the visible noise, that of each is 1."""
        from scipy.linalg import toeplitz

        if not math.isfinite(self.corner):
            return np.eye(count)
        rate = 2 * math.pi * self.corner * distance
        return toeplitz(rate / 2 * np.exp(-rate * np.arange(count)))


@attrs.frozen(eq=False)
class _Directions:
    """Orthonormal directions (k,) in which the noise of the inputs of one experiment moves the outputs.

    They are the ``causes`` (rows, m) times ``turn`` (m, k); ``covariances`` (k, k) are what each part of the noise
    adds along them at the power of the visible noise.
    """

    causes: np.ndarray
    turn: np.ndarray
    covariances: Mapping[int, np.ndarray]

    @classmethod
    def of(cls, errors: ErrorsByInput, components: Sequence[_Component]) -> _Directions:
        """Those of the errors of an experiment."""
        causes = np.concatenate([one.causes for one in errors.values()], axis=1)
        squares, turn = np.linalg.eigh(causes.T @ causes)
        kept = squares > max(NEGLIGIBLE / max(one.most for one in components), 1e-12 * squares[-1])
        sizes, turn = np.sqrt(squares[kept]), turn[:, kept]
        covariances, first = dict[int, np.ndarray](), 0
        for name, one in errors.items():
            count = one.causes.shape[1]
            mine = turn[first : first + count] * sizes
            for k, component in enumerate(components):
                if component.input == name:
                    covariances[k] = mine.T @ component.covariance(count, one.distance) @ mine
            first += count
        return cls(causes, turn / sizes, covariances)

    def part(self, values: np.ndarray, unknowns: np.ndarray) -> _Part:
        """Residuals and their derivatives by unknowns, ``values`` (rows, 1 + n), along the directions."""
        along = self.turn.T @ (self.causes.T @ values)
        return _Part(along[:, 0], along[:, 1:], unknowns, self.covariances)


@attrs.frozen(eq=False)
class _Part:
    """The residual (k,) of one experiment along its directions, its derivatives ``slopes`` (k, n) by ``unknowns``.

    ``covariances`` are those of the directions.
    """

    residual: np.ndarray
    slopes: np.ndarray
    unknowns: np.ndarray
    covariances: Mapping[int, np.ndarray]

    def covariance(self, power: np.ndarray) -> np.ndarray:
        """Covariance of the residual's components with this power of each part."""
        result = np.eye(len(self.residual))
        for k, own in self.covariances.items():
            result += power[k] * own
        return result

    def moved(self, move: np.ndarray) -> np.ndarray:
        """The components of the residual where the unknowns have moved."""
        return self.residual + self.slopes @ move[self.unknowns]


@attrs.frozen(eq=False)
class _Sums:
    """All experiments: of the whole residual, the normal matrix (n, n) of the unknowns, the gradient ``slope`` (n,),
    the sum of squares and the number of samples; ``parts`` are along directions of noise.
    """

    parts: Sequence[_Part]
    normal: np.ndarray
    slope: np.ndarray
    square: float
    count: int

    def left(self, power: np.ndarray, move: np.ndarray) -> tuple[float, float]:
        """The sum of squares that is left beside noise, and the logarithm of the determinant of the covariance."""
        square, logarithm = self.square + float(2 * self.slope @ move + move @ self.normal @ move), 0.0
        for part in self.parts:
            covariance, residual = part.covariance(power), part.moved(move)
            square -= float(residual @ (residual - np.linalg.solve(covariance, residual)))
            logarithm += float(np.linalg.slogdet(covariance)[1])
        return square, logarithm


def likelihood(model: Model, errors: ErrorsOfInputs) -> Likelihood:
    """How likely the residuals of a model are beside noise of inputs of the most likely spectrum.

    The unknowns move to where the residuals are most likely beside it, as far as the outputs are linear in them.
    Source: Zhou, Hu, Zhou and Lange, MM algorithms for variance components models, J. Comput. Graph. Stat. 28 (2019).
    """
    components, sums = errors.components, _sums(model, errors.directions)
    most = np.array([one.most for one in components])
    least = np.array([one.least for one in components])
    power, move = np.minimum(1.0, most), np.zeros(len(model.theta))
    for _ in range(ITERATIONS):
        gain, loss = np.zeros(len(components)), np.full(len(components), 1e-300)
        normal, slope = sums.normal.copy(), sums.slope.copy()
        for part in sums.parts:
            inverse = np.linalg.inv(part.covariance(power))
            solved = inverse @ part.moved(move)
            for k, own in part.covariances.items():
                gain[k] += solved @ own @ solved
                loss[k] += float(np.sum(inverse * own))
            taken = part.slopes - inverse @ part.slopes
            slope[part.unknowns] -= taken.T @ part.residual
            normal[np.ix_(part.unknowns, part.unknowns)] -= taken.T @ part.slopes
        power = np.clip(power * np.sqrt(gain / loss), least, most)
        move = _least_squares(normal, slope)
    noise = dict[str, float]()
    for one, value in zip(components, power, strict=True):
        noise[one.input] = noise.get(one.input, 0.0) + value * one.share
    square, logarithm = sums.left(power, move)
    return Likelihood(square + logarithm, square / sums.count, {k: float(np.sqrt(v)) for k, v in noise.items()})


def _least_squares(normal: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """The move of the unknowns to the least squares."""
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    move: np.ndarray = -np.linalg.lstsq(normal / np.outer(size, size), slope / size, rcond=1e-9)[0] / size
    return move


def _components(errors: Mapping[int, ErrorsByInput]) -> list[_Component]:
    """The parts of the noise of each input, the same in all experiments."""
    found = list[_Component]()
    every = [pair for one in errors.values() for pair in one.items()]
    for name in dict.fromkeys(name for name, _ in every):
        own = [one for key, one in every if key == name]
        low = min(LOWEST / (one.distance * one.causes.shape[1]) for one in own)
        high = max(min(HIGHEST / one.distance for one in own), low)
        count = int(np.clip(1 + round(CORNERS_PER_DECADE * math.log10(high / low)), 1, MOST_CORNERS))
        density, cutoff = max(one.share * one.step for one in own), min(one.cutoff or 0.5 / one.step for one in own)
        found.append(_Component(name, math.inf, LEAST_POWER, MARGIN, 2 * density * cutoff))
        for corner in np.geomspace(low, high, count):
            share = math.pi * density * corner
            most = min(MARGIN * (1 + (cutoff / corner) ** 2), MOST_NOISE**2 / share)
            found.append(_Component(name, float(corner), 0.0, most, share))
    return found


def _sums(model: Model, directions: Mapping[int, _Directions]) -> _Sums:
    """What the estimate needs of all experiments."""
    rows, r, parts = model.problem.rows, model.differences, list[_Part]()
    normal, slope = np.zeros((len(model.theta),) * 2), np.zeros(len(model.theta))
    for e, block in enumerate(model.J.blocks()):
        whitening = model.problem.whitening.get(e)
        J = block.values if whitening is None else whitening.restored(block.values)
        J = np.where(np.isfinite(J), J, 0.0)
        normal[np.ix_(block.columns, block.columns)] += J.T @ J
        slope[block.columns] += J.T @ r[rows[e]]
        if e in directions:
            parts.append(directions[e].part(np.column_stack([r[rows[e]], J]), block.columns))
    return _Sums(parts, normal, slope, float(r @ r), len(r))


@attrs.frozen(eq=False)
class ErrorsOfInputs:
    """Errors of the inputs of all experiments, by number, and how likely residuals of models are beside them."""

    by_experiment: Mapping[int, ErrorsByInput] = attrs.field(repr=False)
    _known: weakref.WeakKeyDictionary[Model, Likelihood] = attrs.field(factory=weakref.WeakKeyDictionary, repr=False)

    def __bool__(self) -> bool:
        """Whether any input is noisy."""
        return bool(self.by_experiment)

    @functools.cached_property
    def components(self) -> Sequence[_Component]:
        """The parts that the noise of the inputs may have."""
        return _components(self.by_experiment)

    @functools.cached_property
    def directions(self) -> Mapping[int, _Directions]:
        """The directions in which it moves the outputs, by number of the experiment."""
        return {e: _Directions.of(one, self.components) for e, one in self.by_experiment.items()}

    def likelihood(self, model: Model) -> Likelihood:
        """That of a model, which is found once."""
        if model not in self._known:
            self._known[model] = likelihood(model, self)
        return self._known[model]
