"""Noise of a signal: from differences between repeats, from rests of the inputs, or else from its fastest part.

``noise`` is about one experiment, ``noise_of_recordings`` about a signal over several.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import attrs
import numpy as np

from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import DataError
from tsmblocks.common.interpolation import interpolation
from tsmblocks.data.grid import stretches
from tsmblocks.data.periods import MIN_UNLIKENESS, best_period, unlikeness
from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.record import Record

HIGH_FREQUENCIES = "high frequencies"
"""Method of a floor that was estimated from sample to sample. It misses slow noise: no model may be called wrong by
it alone."""
MIN_FREEDOM = 30
"""Degrees of freedom below which an estimate is not given. Derived: its relative error, 1/sqrt(2 freedom), would be
more than an eighth."""
MAX_REPEAT_DIFFERENCE = 0.5
"""Differences between repeats, in rms values of the signal, beyond which they are not the same experiment. Chosen."""
MIN_NOISE_SAMPLES = 8
"""Samples below which no noise is estimated. Chosen: the cubic of ``sample_to_sample_noise`` spans 5."""
WINDOWS = 8
"""Parts of a period over which two periods are compared, when there are no more than two. Chosen."""
MIN_STILL_SAMPLES = 50
"""Samples for which an input must rest to count as standing still. Chosen."""
STILL_MEAN_SAMPLES = 10
"""Samples whose mean is taken when rests are searched. Chosen: it lowers white noise to a third."""
MAX_DRIVEN_SHARE = 0.5
"""Share of what differs between periods that the inputs may explain, by not quite repeating, before it is no noise.
Chosen."""


class Estimate(NamedTuple):
    """A noise floor; as in Noise."""

    floor: float
    method: str
    samples: int
    freedom: int


@attrs.frozen
class Noise:
    """Noise of one signal.

    The floor is uncertain by about 1/sqrt(2 freedom) of itself where the noise is white.

    Parameters
    ----------
    name : str
        The signal.
    unit : str
        Unit of the signal, in which ``floor`` and ``quantum`` are; ``""`` where it is not known.
    floor : float
        Rms value of the noise, quantisation included.
    quantum : float or None
        Step of a quantised signal; None when it is continuous.
    method : str
        Where the floor comes from: ``"repeated periods"``, ``"repeats"``, ``"stand-still"`` or ``"high frequencies"``.
        The last sees only what changes from sample to sample, so slow noise is missing from it.
    samples : int
        Samples that went into the floor.
    freedom : int
        Degrees of freedom of the floor.
    """

    name: str
    unit: str
    floor: float
    quantum: float | None
    method: str
    samples: int
    freedom: int

    def __str__(self) -> str:
        """One line, as a report shows it."""
        coarse = is_coarse(self.quantum, self.floor)
        step = f"; quantised in steps of {with_unit(self.quantum or 0.0, self.unit)}" if coarse else ""
        return (
            f"{self.name}: noise {with_unit(self.floor, self.unit)} rms, from {self.method} "
            f"({self.samples} samples, {self.freedom} degrees of freedom){step}"
        )


def noise(records: Record | Sequence[Record], name: str, inputs: str | Iterable[str] | None = None) -> Noise:
    """Estimate the noise floor and the quantisation of a signal.

    The methods, the first that applies being taken:

    - repeats: differences between the records, less an offset and a slope in each;
    - repeated periods, where the inputs repeat as well: differences from one period to the next, less an offset and
      a slope in each; the first period is left out, since it holds the transient. Where there are only two, the
      difference is taken in eight windows, less an offset and a slope in each, and their median counts;
    - stand-still: what moves while the inputs rest, less a parabola over each rest;
    - high frequencies: the error of a cubic through the two neighbours on each side.

    Parameters
    ----------
    records : Record or sequence of Record
        One record, or several that repeat one experiment.
    name : str
        The signal.
    inputs : str or iterable of str, default None
        Signals that drive the experiment, whose period or rest is searched; by default all others.

    Returns
    -------
    Noise
        Floor, quantum and method, in the signal's unit.

    Raises
    ------
    DataError
        When the signal is not there, has too few samples, or when the repeats differ too much to be repeats.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.arange(0, 10, 0.01)
    >>> y = np.sin(t) + np.random.default_rng(0).normal(0.0, 0.02, t.size)
    >>> found = tsm.noise(tsm.Record("sine", t, {"y": y}, {"y": "rad"}), "y")
    >>> found.method, round(found.floor, 3)
    ('high frequencies', 0.019)
    """
    given = [records] if isinstance(records, Record) else list(records)
    if not given:
        raise DataError("noise needs at least one record.")
    first = given[0]
    x, unit = _samples(first, name), first.unit(name)
    quantum = quantum_of(x)
    drives = _driving_signals(first, name, inputs)
    found = (_of_repeats(given, name) if len(given) > 1 else None) or _of_periods(first, name, drives)
    found = found or _of_rests(first, name, drives) or sample_to_sample_noise(first.t, x)
    floor = max(found.floor, (quantum or 0.0) / np.sqrt(12.0))  # a constant reading has rounding errors all the same
    return Noise(name, unit, float(floor), quantum, found.method, found.samples, found.freedom)


def noise_of_recordings(
    records: Mapping[str, Record], name: str, unit: str, inputs: Iterable[str]
) -> tuple[float, str]:
    """The noise of a signal over all recordings, in ``unit``, and the method by which most of them were estimated.

    It is the median over the recordings, those alone that have more than fast noise to go by, where there are such.
    ``inputs`` drive the experiments; those that a recording lacks are left out. Raises DataError as noise does.
    """
    driving = [k for k in inputs if all(k in r for r in records.values())]
    estimates = [(noise(r, name, inputs=driving or None), r) for r in records.values()]
    sound = [one for one in estimates if one[0].method != HIGH_FREQUENCIES] or estimates
    methods = [n.method for n, _ in sound]
    floor = float(np.median([n.floor * r.factor(name, unit) for n, r in sound]))
    return floor, max(sorted(set(methods)), key=methods.count)


def fast_noise_of_recordings(records: Mapping[str, Record], name: str, unit: str) -> float:
    """The median over the recordings of what changes from sample to sample, rms in ``unit``: no slow noise is in it."""
    floors = [sample_to_sample_noise(r.t, _samples(r, name)).floor * r.factor(name, unit) for r in records.values()]
    return float(np.median(floors))


def _samples(record: Record, name: str) -> np.ndarray:
    if len(record) < MIN_NOISE_SAMPLES:
        raise DataError(f"{record.called}: noise needs at least {MIN_NOISE_SAMPLES} samples, there are {len(record)}.")
    return record[name]


def is_coarse(quantum: float | None, floor: float) -> bool:
    """Whether a step of the reading is more than the digits a file was printed with."""
    return quantum is not None and quantum > 0.5 * floor


def with_unit(value: float, unit: str) -> str:
    """A value in three digits with its unit."""
    return f"{value:.3g} {unit}".strip()


def _driving_signals(record: Record, name: str, inputs: str | Iterable[str] | None) -> list[str]:
    if inputs is None:
        return [*(k for k in record if k != name), name]
    names = as_list(inputs)
    for k in names:
        record[k]  # an unknown name is refused here
    return names


def _of_repeats(records: list[Record], name: str) -> Estimate | None:
    first = records[0]
    t, unit = first.t, first.unit(name)
    rows = [first[name]]
    for other in records[1:]:
        own, x = other.t - other.t[0] + t[0], other.values(name, unit)
        same = len(own) == len(t) and np.allclose(own, t, rtol=0, atol=1e-3 * first.step)
        rows.append(x if same else interpolation(own, x, "linear")(t))
    shortest = min(float(r.t[-1] - r.t[0]) for r in records)
    kept = t - t[0] <= shortest + 1e-9 * first.step
    table = np.stack([row[kept] for row in rows])
    off = table - table.mean(axis=0)
    size = float(np.std(table))
    if np.sqrt(np.mean(off**2)) > MAX_REPEAT_DIFFERENCE * size > 0:
        raise DataError(
            f"these {len(records)} records do not repeat one experiment: '{name}' differs between them by "
            f"{100 * np.sqrt(np.mean(off**2)) / size:.0f} % of its rms value."
        )
    residual = np.stack([_less_trend(row, 1) for row in off])
    freedom = (len(records) - 1) * (int(kept.sum()) - 2)
    return Estimate(float(np.sqrt(np.sum(residual**2) / max(freedom, 1))), "repeats", table.size, freedom)


def _of_periods(record: Record, name: str, drives: list[str]) -> Estimate | None:
    t, x = record.t, record[name]
    moving = [k for k in drives if np.ptp(record[k]) > 0]
    lag = _common_period(record, moving, name)
    if lag is None or len(record) < MIN_FREEDOM:
        return None
    found = _between_periods(t, x, lag)
    others = [k for k in moving if k != name]
    if found and any(_driven_difference(record, k, x, lag) > MAX_DRIVEN_SHARE * found.floor for k in others):
        return None
    return found


def _driven_difference(record: Record, drive: str, x: np.ndarray, lag: float) -> float:
    """Differences of a signal between periods that an input explains by not quite repeating itself.

    A sum of tones that are no multiples of one another nearly repeats itself, and differences between such periods are
    motion. The signal is taken to follow the input in proportion. The input's own fast noise is not counted.
    """
    own = record[drive]
    between = _between_periods(record.t, own, lag)
    slow = between.floor**2 - sample_to_sample_noise(record.t, own).floor ** 2 if between else 0.0
    return float(np.sqrt(max(slow, 0.0)) * np.std(x) / np.std(own))


def _between_periods(t: np.ndarray, x: np.ndarray, lag: float) -> Estimate | None:
    """Rms of the differences from one period to the next, less an offset and a slope in each."""
    at, off = _differences(t, x, lag)
    place = np.floor((at - t[0]) / lag + 1e-9).astype(int)
    blocks = [off[place == k] for k in range(place.max() + 1) if np.count_nonzero(place == k) > 3]
    if not blocks:
        return None
    two = len(blocks) < 2 or len(blocks[1]) < 0.5 * len(blocks[0])
    blocks = np.array_split(blocks[0], WINDOWS) if two else blocks[1:]
    freedoms = np.array([len(block) - 2 for block in blocks])
    if freedoms.min() < 2 or freedoms.sum() < MIN_FREEDOM:
        return None
    squares = np.array([float(np.sum(_less_trend(block, 1) ** 2)) for block in blocks])
    count = sum(map(len, blocks))
    if not two:
        return Estimate(float(np.sqrt(squares.sum() / freedoms.sum())), "repeated periods", count, int(freedoms.sum()))
    variance = np.median(squares / (freedoms * (1 - 2 / (9 * freedoms)) ** 3))  # the median of a chi-squared
    return Estimate(float(np.sqrt(variance)), "repeated periods", count, int(freedoms.sum() * 2 / np.pi))


def _common_period(record: Record, drives: list[str], name: str) -> float | None:
    """Period [s] of the signal that repeats itself best, if the others (but the noisy one) repeat with it too."""
    lag = best_period(record.t, [record[k] for k in drives])
    if lag is not None and any(unlikeness(record.t, record[k], lag) > MIN_UNLIKENESS for k in drives if k != name):
        return None
    return lag


def _differences(t: np.ndarray, x: np.ndarray, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, and x one period later less x, divided so that white noise keeps its rms value.

    Between samples x is the cubic through the two on each side.
    """
    later = t + lag
    k = np.searchsorted(t, later + 1e-6 * lag / len(t)) - 1  # the sample just before, or at, one period later
    kept = (k >= 1) & (k + 2 < len(t)) & (later <= t[-1])
    k, later = k[kept], later[kept]
    places = k[:, None] + np.arange(-1, 3)
    w = _weights(t[places] - later[:, None])
    off = np.sum(w * x[places], axis=1) - x[: len(t)][kept]
    return t[kept], off / np.sqrt(1 + np.sum(w**2, axis=1))


def _weights(away: np.ndarray) -> np.ndarray:
    """Weights of values at these distances in the polynomial through them, taken at 0; shape (places, values)."""
    w = np.ones_like(away)
    for j in range(away.shape[1]):
        for i in range(away.shape[1]):
            if i != j:
                w[:, j] *= -away[:, i] / (away[:, j] - away[:, i])
    return w


def _less_trend(x: np.ndarray, degree: int) -> np.ndarray:
    """x less the polynomial that fits it best."""
    at = np.linspace(-1, 1, len(x))
    basis = np.linalg.qr(np.vander(at, degree + 1))[0]
    return x - basis @ (basis.T @ x)


def _of_rests(record: Record, name: str, drives: list[str]) -> Estimate | None:
    others = [k for k in drives if k != name]  # rests of the signal itself would be selected for being quiet
    if not others:
        return None
    still = np.all([_resting(record[k]) for k in others], axis=0)
    rests = [(a, b) for a, b in stretches(still) if b - a >= MIN_STILL_SAMPLES]
    settled = [record[name][a + (b - a) // 5 : b] for a, b in rests]  # the signal settles during the first fifth
    samples = sum(map(len, settled))
    freedom = samples - 3 * len(settled)
    if freedom < MIN_FREEDOM:
        return None
    squares = sum(float(np.sum(_less_trend(x, 2) ** 2)) for x in settled)
    return Estimate(float(np.sqrt(squares / freedom)), "stand-still", samples, freedom)


def _resting(x: np.ndarray) -> np.ndarray:
    """Which samples lie in a rest: ``MIN_STILL_SAMPLES`` samples over which the signal does not leave its own noise.

    Moving means are compared, whose noise is less, so that a slow turn is no rest.
    """
    if len(x) < MIN_STILL_SAMPLES or not np.ptp(x) > 0:
        return np.full(len(x), not np.ptp(x) > 0)
    from scipy.ndimage import uniform_filter1d

    noise, share = sample_to_sample_noise(np.arange(float(len(x))), x).floor, 1 / np.sqrt(STILL_MEAN_SAMPLES)
    width = max(2.1 * (quantum_of(x) or 0.0), 8 * share * noise, 1e-9 * float(np.ptp(x)))
    if width > 0.1 * np.ptp(x):
        return np.zeros(len(x), dtype=bool)
    x = uniform_filter1d(x, STILL_MEAN_SAMPLES) if noise > 0 else x
    windows = np.lib.stride_tricks.sliding_window_view(x, MIN_STILL_SAMPLES)
    return np.convolve(np.ptp(windows, axis=1) <= width, np.ones(MIN_STILL_SAMPLES)) > 0.5


def sample_to_sample_noise(t: np.ndarray, x: np.ndarray) -> Estimate:
    """Error of a cubic through the two neighbours on each side, for white noise its rms; jumps are left out."""
    n = len(t) - 4
    away = np.stack([t[j : j + n] for j in (0, 1, 3, 4)], axis=1) - t[2 : 2 + n, None]
    w = _weights(away)
    near = np.stack([x[j : j + n] for j in (0, 1, 3, 4)], axis=1)
    off = (x[2 : 2 + n] - np.sum(w * near, axis=1)) / np.sqrt(1 + np.sum(w**2, axis=1))
    for _ in range(3):
        off = off[np.abs(off) <= 4 * np.sqrt(np.mean(off**2))]
    return Estimate(float(np.sqrt(np.mean(off**2))), HIGH_FREQUENCIES, len(t), len(off))
