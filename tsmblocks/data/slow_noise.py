"""White and slow noise separated in stretches of noise, and the rms of both with its 95 % interval.

A stretch is the noise that a method extracts from a signal: differences between periods or repeats, or a rest. The
noise is modelled as white noise beside first-order (Ornstein-Uhlenbeck) noise. The model is used for what the stretch
cannot show, such as its own offset, and for how much the mean square may vary; the mean square itself is that of the
data. All models on a grid count, weighted by the likelihood of the periodogram (Whittle; its expectation is exact for
the length of the stretch: Sykulski and others, The debiased Whittle likelihood, Biometrika 106 (2019)).
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

SHARES = np.r_[0.0, 0.01, 0.03, np.linspace(0.1, 0.9, 9), 0.95, 0.98, 0.995, 1.0]
"""Shares of slow noise in the variance that are tried."""
TIMES = 18
"""Correlation times that are tried, from one step to three times the longest stretch, evenly in their logarithm."""
SPREADS = (1.0, 4.0)
"""Slow noise is of one correlation time, or of two in equal parts, this many times shorter and longer. Chosen: the sum
of two comes near to noise with a broad spectrum."""
MAX_BAND_WEIGHT = 20
"""Periodogram values of a band that count at most. Chosen: noise is no sum of white and first-order noise, so that a
band is trusted to no more than 1/sqrt(20), a fifth."""
MIN_TEMPER = 0.2
"""Least power to which the likelihood is raised where the model fits badly. Chosen."""
BLOCKS = 24
"""Parts whose mean squares are compared: noise that comes in bursts varies more than the model has it. Chosen."""
MIN_SLOW_SHARE = 0.02
"""Share of slow noise that must lie below its interval for slow noise to be reported. Chosen."""
MAX_SAMPLES = 16384
"""Samples of a stretch that are taken together. Chosen: slower noise is an offset in each part."""
MIN_SAMPLES = 8
"""Samples of a part at least. Chosen."""
MAX_LINES = 3
"""Lines of hum that are looked for. Chosen: a frequency and two of its multiples."""
MIN_CYCLES = 8
"""Cycles in a stretch that hum has at least. Chosen: fewer may be slow noise."""
LINE_RATIO = 40.0
"""Power of a line over the median around it. Derived: noise reaches it once in 2^40 values."""
MIN_LINE_SHARE = 0.03
"""Share of a line in the mean square of the stretches at least. Chosen: less hardly matters."""
MIN_LINE_GAIN = 0.15
"""Variance of a line in differences, over its own, below which it cannot be seen in them. Chosen."""
HUM_BOUNDS = (0.6, 1.6)
"""Variance of hum, over that found, at both ends of the interval. Chosen: its phase decides how much of it differences
show."""
MIN_SLOPE_SHARE = 0.05
"""Share of the mean square that a slope must hold before its removal is considered. Chosen: less hardly matters."""
DRIFT_VARIANCES = 10.0
"""Variances of the slope that noise causes, above which a slope is drift. Chosen: about three standard deviations."""


@attrs.frozen(eq=False)
class Stretch:
    """Noise at even steps, shape (n,).

    ``lag`` [s] is positive where the values are differences over this time, divided so that white noise keeps its rms
    value; ``gain`` is what slow noise is multiplied with, in its variance, where samples were interpolated.
    """

    x: np.ndarray
    step: float
    lag: float = 0.0
    gain: float = 1.0

    def cut(self, first: int, last: int | None = None) -> Stretch:
        """Return a part of it."""
        return attrs.evolve(self, x=self.x[first:last])


@attrs.frozen
class Level:
    """Rms of the noise about its mean over a recording, with its 95 % interval.

    ``white`` and ``slow`` are the rms values of both kinds and ``time`` [s] the correlation time of the slow one; None
    where they are indistinguishable. ``freedom`` is the number of independent values with the same information.
    """

    floor: float
    low: float
    high: float
    freedom: float
    white: float | None
    slow: float | None
    time: float | None


@attrs.frozen(eq=False)
class Weighted:
    """Models of one set of stretches with their weights (times, shares), and what each says of the stretches."""

    times: np.ndarray
    weights: np.ndarray
    seen: np.ndarray
    """Mean square of the stretches over the variance of the noise."""
    freedom: np.ndarray
    mean_square: float
    slope: bool
    stretches: Sequence[Stretch]

    def mean(self, values: np.ndarray) -> float:
        """Mean of something over the models."""
        return float(np.sum(self.weights * values))


def level(given: Sequence[Stretch], span: float) -> Level:
    """The noise in stretches of one process, as it is about its mean over a recording of length span [s]."""
    stretches, hum = without_hum(given)
    models = weighted(stretches)
    if not models.mean_square > 0:
        return Level(0.0, 0.0, 0.0, float(sum(len(s.x) for s in stretches)), None, None, None)
    told = 1 - SHARES * variance_of_mean(models.times, span)[:, None]
    ratio = told / models.seen
    floor = np.sqrt(models.mean_square * np.exp(models.mean(np.log(ratio))))
    freedom = np.maximum(models.freedom / _burstiness(models), 1.0)
    low, high = _interval(models.weights, models.mean_square * ratio, freedom)
    kinds = _kinds(models, float(floor))
    bounds = zip((floor, min(low, floor), max(high, floor)), (1.0, *HUM_BOUNDS), strict=True)
    rms, least, most = (float(np.sqrt(v**2 + k * hum)) for v, k in bounds)
    return Level(rms, least, most, models.mean(freedom), *kinds)


def without_hum(given: Sequence[Stretch]) -> tuple[list[Stretch], float]:
    """Stretches less the lines in their spectrum, and the variance of these, seen through the differences."""
    from scipy.optimize import minimize_scalar

    stretches, variance = list(given), 0.0
    for _ in range(MAX_LINES):
        longest = max(stretches, key=lambda s: len(s.x))
        x, n = longest.x - longest.x.mean(), len(longest.x)
        if n < 64:
            break
        window = np.hanning(n)
        power = np.abs(np.fft.rfft(window * x)) ** 2
        at = MIN_CYCLES + int(np.argmax(power[MIN_CYCLES:]))
        near = np.r_[power[max(MIN_CYCLES, at - 30) : at - 3], power[at + 4 : at + 31]]
        if len(near) < 10 or power[at] < LINE_RATIO * np.median(near):
            break
        k = np.arange(n)

        def less(place: float, k: np.ndarray = k, x: np.ndarray = window * x, n: int = n) -> float:
            return -float(np.abs(x @ np.exp(-2j * np.pi * place * k / n)))

        found = minimize_scalar(less, bounds=(at - 1, at + 1), method="bounded", options={"xatol": 1e-3})
        rate = 2 * np.pi * found.x / (n * longest.step)
        size = longest.gain * (1 - np.cos(rate * longest.lag)) if longest.lag else 1.0
        rest = [_less_line(s, rate * s.step) for s in stretches]
        own = mean_square(stretches) - mean_square(rest)
        if size < MIN_LINE_GAIN or own < MIN_LINE_SHARE * mean_square(given):
            break
        stretches, variance = rest, variance + own / size
    return stretches, max(variance, 0.0)


def _less_line(s: Stretch, rate: float) -> Stretch:
    """A stretch less the sine of this rate [rad a sample] that fits it best."""
    k = rate * np.arange(len(s.x))
    basis = np.stack([np.cos(k), np.sin(k), np.ones(len(k))], axis=1)
    fitted = np.linalg.lstsq(basis, s.x, rcond=None)[0]
    return attrs.evolve(s, x=s.x - basis[:, :2] @ fitted[:2])


def weighted(given: Sequence[Stretch]) -> Weighted:
    """All models, weighted by their likelihood; less an offset in each stretch, and a slope where there is drift."""
    stretches = [s.cut(k, k + MAX_SAMPLES) for s in given for k in range(0, len(s.x), MAX_SAMPLES)]
    stretches = [s for s in stretches if len(s.x) >= MIN_SAMPLES] or list(given)
    flat = _fitted(stretches, slope=False)
    line = [_slope(s) for s in stretches]
    share = sum((q @ s.x) ** 2 for q, s in zip(line, stretches, strict=True)) / max(
        sum(float(np.sum((s.x - s.x.mean()) ** 2)) for s in stretches), 1e-300
    )
    if share < MIN_SLOPE_SHARE or min(len(s.x) for s in stretches) < 8:
        return flat
    less = [attrs.evolve(s, x=s.x - q * (q @ s.x)) for q, s in zip(line, stretches, strict=True)]
    bent = _fitted(less, slope=True)
    caused = np.sum(
        [_of_slopes(s, bent.times) for s in stretches], axis=0
    )  # variances of the slopes over that of the noise
    noise = bent.mean_square / np.maximum(bent.seen, 1e-9)
    expected = bent.mean(noise * ((1 - SHARES) * len(stretches) + SHARES * caused[:, None]))
    found = sum((q @ s.x) ** 2 for q, s in zip(line, stretches, strict=True))
    return bent if found > DRIFT_VARIANCES * expected else flat


def mean_square(stretches: Sequence[Stretch]) -> float:
    """Mean square of stretches about their means."""
    return float(np.sum([np.sum((s.x - s.x.mean()) ** 2) for s in stretches]) / sum(len(s.x) for s in stretches))


def _covariances(s: Stretch, times: np.ndarray | None) -> np.ndarray:
    """Autocovariance of a stretch of noise of variance 1, white or with pairs of correlation times; (…, n)."""
    k, g = np.arange(len(s.x)), s.lag / s.step
    if times is None:
        out = np.zeros(len(k))
        out[0] = 1.0
        if 0 < (at := round(g)) < len(k):
            out[at] = -0.5
        return out
    known = {float(time): _first_order(s, k, g, float(time)) for time in np.unique(times)}
    return np.stack([(known[float(a)] + known[float(b)]) / 2 for a, b in times])


def _first_order(s: Stretch, k: np.ndarray, g: float, time: float) -> np.ndarray:
    """Autocovariance of a stretch of first-order noise at shifts of k samples, differences being taken over g."""
    rate = s.step / time
    out = np.exp(-rate * k)
    return s.gain * (out - (np.exp(-rate * np.abs(k - g)) + np.exp(-rate * g) * out) / 2) if g > 0 else out


def _fitted(stretches: Sequence[Stretch], slope: bool) -> Weighted:
    longest = max(s.step * len(s.x) for s in stretches)
    step = min(s.step for s in stretches)
    middle = np.geomspace(step, 3 * longest, TIMES)
    times = np.concatenate([middle[:, None] * np.array([1 / k, k]) for k in SPREADS])
    count = sum(len(s.x) for s in stretches)
    square = mean_square(stretches)
    seen, spread = np.zeros((len(times), 2)), np.zeros((len(times), 3))  # for white and slow noise; the last with both
    powers, expected, weights = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    known = dict[tuple[int, float, float], tuple[np.ndarray, np.ndarray, np.ndarray]]()
    for s in stretches:
        n = len(s.x)
        edges = _band_edges(n, first=3 if slope else 1)
        if (key := (n, s.lag / s.step, s.step)) not in known:
            known[key] = _expected(s, times, edges, slope)
        own_seen, own_spread, own = known[key]
        seen, spread = seen + own_seen, spread + own_spread
        power = np.abs(np.fft.rfft(s.x - s.x.mean())) ** 2 / n
        widths = np.diff(edges)
        powers.append(np.add.reduceat(power[: edges[-1]], edges[:-1]) / widths)
        expected.append(own)
        weights.append(np.minimum(widths, MAX_BAND_WEIGHT))
    mix = np.stack([1 - SHARES, SHARES])
    p = _likelihoods(np.concatenate(powers), np.concatenate(expected, axis=2), np.concatenate(weights).astype(float))
    seen_all = seen @ mix / count
    variance = 2 * spread @ np.stack([mix[0] ** 2, mix[1] ** 2, 2 * mix[0] * mix[1]]) / count**2
    return Weighted(
        times, p, np.maximum(seen_all, 1e-6), 2 * seen_all**2 / np.maximum(variance, 1e-30), square, slope, stretches
    )


def _expected(
    s: Stretch, times: np.ndarray, edges: np.ndarray, slope: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Traces of the covariance less offset (times, 2), of its square (times, 3), periodogram (times, 2, bands)."""
    n, widths = len(s.x), np.diff(edges)
    fade = 1 - np.arange(n) / n
    weights = np.r_[1.0, 2 * fade[1:]] * n
    rows = np.vstack([_covariances(s, None), _covariances(s, times)])  # white noise first
    sums = np.cumsum(rows, axis=1)
    sums = sums + sums[:, ::-1] - rows[:, :1]
    total = sums.sum(axis=1)
    trace = n * rows[:, 0] - total / n
    if slope:
        trace -= rows @ _correlation(_slope(s))
    bands = 2 * np.fft.rfft(rows * fade, axis=1).real - rows[:, :1]
    bands = np.add.reduceat(bands[:, : edges[-1]], edges[:-1], axis=1) / widths
    own = rows**2 @ weights - 2 * np.sum(sums**2, axis=1) / n + total**2 / n**2
    both = (rows * rows[0]) @ weights - 2 * sums @ sums[0] / n + total * total[0] / n**2
    alike = np.ones(len(times))
    spread = np.stack([own[0] * alike, own[1:], both[1:]], axis=1)
    return (
        np.stack([trace[0] * alike, trace[1:]], axis=1),
        spread,
        np.stack([np.tile(bands[0], (len(times), 1)), bands[1:]], axis=1),
    )


def _likelihoods(power: np.ndarray, expected: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weights of the models (times, shares), the variance of the noise being unknown."""
    model = (1 - SHARES)[:, None] * expected[:, :1] + SHARES[:, None] * expected[:, 1:]
    model = np.maximum(model, 1e-9)
    ratio = power / model
    scale = np.sum(weights * ratio, axis=2) / weights.sum()
    if not np.all(scale > 0):
        return np.full(scale.shape, 1 / scale.size)
    cost = np.sum(weights * np.log(model), axis=2) + weights.sum() * np.log(scale)
    best = np.unravel_index(np.argmin(cost), cost.shape)
    shape = np.maximum(ratio[best] / scale[best], 1e-12)
    misfit = 2 * float(np.sum(weights * (shape - 1 - np.log(shape))))
    p = np.exp(-float(np.clip(len(weights) / max(misfit, 1e-9), MIN_TEMPER, 1.0)) * (cost - cost.min()))
    return p / p.sum()


def _interval(weights: np.ndarray, variance: np.ndarray, freedom: np.ndarray) -> tuple[float, float]:
    """Rms values between which the noise lies with 95 %: a mixture of scaled inverse chi-squared distributions."""
    from scipy.special import chdtrc

    kept = weights > 1e-4 * weights.max()
    w, v, f = weights[kept] / weights[kept].sum(), variance[kept], freedom[kept]
    grid = np.geomspace(v.min() / 10, v.max() * 1100, 600)  # 1100: freedom of 1 at 2.5 %
    below = np.sum(w * chdtrc(f, f * v / grid[:, None]), axis=1)
    at = np.interp([0.025, 0.975], below, np.log(grid))
    return float(np.exp(at[0] / 2)), float(np.exp(at[1] / 2))


def _kinds(models: Weighted, floor: float) -> tuple[float | None, float | None, float | None]:
    """Rms of white and of slow noise, and the correlation time of this; None where they are indistinguishable."""
    of_share, spread = models.weights.sum(axis=0), np.log(models.times).mean(axis=1)
    if of_share[SHARES <= MIN_SLOW_SHARE].sum() > 0.025:
        told = of_share[SHARES >= 0.5].sum() < 0.025
        return (floor if told else None), None, None
    share = float(of_share @ SHARES)
    time = float(np.exp(np.sum(models.weights * spread[:, None])))
    return floor * float(np.sqrt(1 - share)), floor * float(np.sqrt(share)), time


def _burstiness(models: Weighted) -> float:
    """How many times more the mean square varies from part to part than the models have it; 1 at least."""
    stretches = models.stretches
    count = sum(len(s.x) for s in stretches)
    shares = [min(max(1, BLOCKS * len(s.x) // count), len(s.x)) for s in stretches]
    parts = [p for s, k in zip(stretches, shares, strict=True) for p in np.array_split(s.x - s.x.mean(), k)]
    squares = np.array([np.mean(p**2) for p in parts])
    if len(squares) < 4 or not squares.mean() > 0:
        return 1.0
    width = int(np.median([len(p) for p in parts]))
    seen, variance = windows(stretches[0], width, models)
    expected = models.mean(variance / seen**2)
    found = float(np.var(squares, ddof=1) / squares.mean() ** 2)
    x = np.concatenate([s.x - s.x.mean() for s in stretches])
    heavy = (float(np.mean(x**4)) / float(np.mean(x**2)) ** 2 - 1) / 2  # 1 for normal values
    return max(1.0, found / expected, heavy if models.mean(models.freedom) > 0.3 * count else 1.0)


def windows(s: Stretch, width: int, models: Weighted) -> tuple[np.ndarray, np.ndarray]:
    """Expected mean square of a part of a stretch and its variance, of noise of variance 1; (times, shares) each."""
    part = attrs.evolve(s, x=np.zeros(width))
    fade = np.r_[1.0, 2 * (1 - np.arange(1, width) / width)] / width
    white = _covariances(part, None)
    slow = _covariances(part, models.times)
    squares = [fade @ white**2, slow**2 @ fade, slow @ (fade * white)]
    spread = (1 - SHARES) ** 2 * squares[0] + SHARES**2 * squares[1][:, None]
    spread = spread + 2 * SHARES * (1 - SHARES) * squares[2][:, None]
    return (1 - SHARES) * white[0] + SHARES * slow[:, :1], 2 * spread


def variance_of_mean(times: np.ndarray, span: float) -> np.ndarray:
    """Variance of the mean over a span of first-order noise of variance 1."""
    share = times / span
    return (2 * share * (1 - share * -np.expm1(-1 / share))).mean(axis=-1)


def _band_edges(n: int, first: int) -> np.ndarray:
    """First index of each band of a periodogram, and the end of the last: single ones, then ever wider."""
    last = n // 2 + 1
    edges = np.unique(np.round(first * 1.4 ** np.arange(np.log(last / first) / np.log(1.4) + 1)).astype(int))
    return np.append(edges[edges < last - 1], last)


def _slope(s: Stretch) -> np.ndarray:
    """A straight line of mean 0 and of length 1."""
    at = np.linspace(-1.0, 1.0, len(s.x))
    return at / np.sqrt(at @ at)


def _of_slopes(s: Stretch, times: np.ndarray) -> np.ndarray:
    """Variance of the slope of slow noise of variance 1, for each correlation time."""
    return _covariances(s, times) @ _correlation(_slope(s))


def _correlation(q: np.ndarray) -> np.ndarray:
    """Sums of products of a row with itself, shifted by 0, 1 … samples; those that are shifted count twice."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * len(q))
    found = irfft(np.abs(rfft(q, size)) ** 2, size)[: len(q)]
    return np.r_[found[0], 2 * found[1:]]
