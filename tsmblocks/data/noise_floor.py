"""How much of a signal is noise: from what repeats, from what stands still, or else from what is too fast."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data.grid import interpolation
from tsmblocks.data.periods import UNLIKE, find_period, unlikeness
from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.record import Record

FEWEST = 30
"""Degrees of freedom below which an estimate is not given: it would be off by more than an eighth."""
SAME = 0.5
"""Differences between repeats, in rms values of the signal, beyond which they are not the same experiment."""
SHORTEST = 8
"""Samples below which noise and motion cannot be told apart at all."""
WINDOWS = 8
"""Parts of a period over which two periods are compared, when there are no more than two."""
STILL = 50
"""Samples for which an input must rest to count as standing still."""
SMOOTH = 10
"""Samples whose mean is taken when rests are looked for."""
ROUGH = 0.03
"""Error of a rate, as a share of the rate, from which steps of a reading are told."""
OVER = 20
"""Samples over which motion is measured, so that steps do not count as motion."""
DRIVEN = 0.5
"""Share of what differs between periods that the inputs may explain, by not quite repeating, before it is no noise."""
PUMPED = 0.05
"""Share of an input's path that noise may add before it is worth a word."""


@attrs.frozen
class Noise:
    """Noise of one signal, in its own ``unit``.

    ``floor`` is its rms value, quantisation included. ``quantum`` is the step of a quantised signal, None when it is
    continuous. ``method`` says where the floor comes from: ``"repeated periods"``, ``"repeats"``, ``"stand-still"``
    or ``"high frequencies"``; the last sees only what changes from sample to sample, so slow noise is missing
    from it. ``samples`` went into it, with ``freedom`` degrees of freedom left: the floor is uncertain by about
    1/sqrt(2 freedom) of itself where the noise is white.
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
        step = f"; quantised in steps of {_said(self.quantum or 0.0, self.unit)}"
        step = step if matters(self.quantum, self.floor) else ""
        return (
            f"{self.name}: noise {_said(self.floor, self.unit)} rms, from {self.method} "
            f"({self.samples} samples, {self.freedom} degrees of freedom){step}"
        )


def noise(records: Record | Sequence[Record], name: str, inputs: str | Iterable[str] | None = None) -> Noise:
    """Estimate the noise floor and the quantisation of signal ``name``.

    ``records`` is one record, or several that repeat one experiment. ``inputs`` names the signals that drive the
    experiment (all others by default): their period or rest is looked for. In order of preference:

    - repeats: what differs between the records, less an offset and a slope in each;
    - repeated periods, where the inputs repeat as well: what differs from one period to the next, less an offset and
      a slope in each; the first period is left out, since it holds the transient. Where there are only two, the
      difference is taken in eight windows, less an offset and a slope in each, and their median counts;
    - stand-still: what moves while the inputs rest, less a parabola over each rest;
    - high frequencies: what a cubic through the two neighbours on each side does not foretell.

    Raises DataError when the signal is not there, or when the repeats differ too much to be repeats.
    """
    given = [records] if isinstance(records, Record) else list(records)
    if not given:
        raise DataError("noise needs at least one record.")
    first = given[0]
    x, unit = _samples(first, name), first.unit(name)
    quantum = quantum_of(x)
    drives = _drives(first, name, inputs)
    found = (_of_repeats(given, name) if len(given) > 1 else None) or _of_periods(first, name, drives)
    found = found or _of_rests(first, name, drives) or _of_high_frequencies(first.t, x)
    floor, method, samples, freedom = found
    floor = max(floor, (quantum or 0.0) / np.sqrt(12.0))  # a reading that stands still hides its rounding
    return Noise(name, unit, float(floor), quantum, method, samples, freedom)


def fast_noise(record: Record, name: str) -> float:
    """The rms of what changes from sample to sample, in the signal's unit: the noise, where none of it is slow.

    Raises DataError when the signal is not there, or has too few samples.
    """
    return _of_high_frequencies(record.t, _samples(record, name))[0]


def _samples(record: Record, name: str) -> np.ndarray:
    if len(record) < SHORTEST:
        raise DataError(f"{record.called}: noise needs at least {SHORTEST} samples, there are {len(record)}.")
    return record[name]


def cautions(record: Record, inputs: str | Iterable[str] | None = None) -> tuple[str, ...]:
    """Say what to mind before these signals (all by default) drive a model with memory, one sentence for each.

    Hysteresis and friction integrate the path of their input. Noise and quantisation lengthen it without any
    motion, and so fake an effect; the length is compared with that of the signal filtered with zero phase. Steps
    that leave the length alone still make the rate jump.
    """
    names = record.names if inputs is None else (inputs,) if isinstance(inputs, str) else tuple(inputs)
    record = record if record.uniform else record.resampled()
    said = (_lengthened(record, name) or _rough(record, name) for name in names)
    return tuple(text for text in said if text)


def _lengthened(record: Record, name: str) -> str:
    """What to mind where noise or steps lengthen the path of a signal."""
    from tsmblocks.data.filters import FEWEST as SPECTRUM
    from tsmblocks.data.filters import choose_cutoff, low_pass

    x = record[name]
    cutoff = choose_cutoff(x, record.step) if len(x) >= SPECTRUM else None
    if cutoff is None:
        return ""
    path, smooth = np.abs(np.diff(x)).sum(), np.abs(np.diff(low_pass(x, record.step, cutoff))).sum()
    if path <= (1 + PUMPED) * smooth:
        return ""
    quantum, off = quantum_of(x), _of_high_frequencies(record.t, x)[0]
    step = f"is quantised in steps of {_said(quantum, record.unit(name))}" if quantum else ""
    why = step if matters(quantum, off) else "is noisy"
    more = f"{100 * (path / smooth - 1):.0f} %"
    return (
        f"{name} {why}: its path is {more} longer than that of the motion in it, which drives "
        f"hysteresis and friction. Filter it first: filtered('{name}')."
    )


def _rough(record: Record, name: str) -> str:
    """What to mind where steps leave the path of a signal as long as it is, but make its rate jump."""
    x = record[name]
    quantum, rough = quantum_of(x), _roughness(x)
    if quantum is None or rough <= ROUGH:
        return ""
    return (
        f"{name} is quantised in steps of {_said(quantum, record.unit(name))}, which its rate misses by "
        f"{100 * rough:.0f} %. Where the rate drives the model, filter it first: "
        f"filtered('{name}', cutoff={0.05 / record.step:.2g}), say."
    )


def _roughness(x: np.ndarray) -> float:
    """Error that rounding to steps makes in the rate, as a share of the rate; 0 where there are no steps."""
    quantum = quantum_of(x)
    if quantum is None or len(x) <= 2 * OVER:
        return 0.0
    motion = np.abs(x[OVER:] - x[:-OVER]).mean() / OVER
    return float(quantum / np.sqrt(6.0) / motion) if motion > 0 else 0.0


def matters(quantum: float | None, floor: float) -> bool:
    """Whether a step of the reading is more than the digits a file was printed with."""
    return quantum is not None and quantum > 0.5 * floor


def _said(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".strip()


Found = tuple[float, str, int, int] | None


def _drives(record: Record, name: str, inputs: str | Iterable[str] | None) -> list[str]:
    if inputs is None:
        return [*(k for k in record if k != name), name]
    names = [inputs] if isinstance(inputs, str) else list(inputs)
    for k in names:
        record[k]  # an unknown name is refused here
    return names


def _of_repeats(records: list[Record], name: str) -> Found:
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
    if np.sqrt(np.mean(off**2)) > SAME * size > 0:
        raise DataError(
            f"these {len(records)} records do not repeat one experiment: '{name}' differs between them by "
            f"{100 * np.sqrt(np.mean(off**2)) / size:.0f} % of its rms value."
        )
    rest = np.stack([_less_trend(row, 1) for row in off])
    freedom = (len(records) - 1) * (int(kept.sum()) - 2)
    return float(np.sqrt(np.sum(rest**2) / max(freedom, 1))), "repeats", table.size, freedom


def _of_periods(record: Record, name: str, drives: list[str]) -> Found:
    t, x = record.t, record[name]
    moving = [k for k in drives if np.ptp(record[k]) > 0]
    lag = _period_of(record, moving, name)
    if lag is None or len(record) < FEWEST:
        return None
    found = _between_periods(t, x, lag)
    others = [k for k in moving if k != name]
    return found if found and not any(_shares(record, k, x, lag) > DRIVEN * found[0] for k in others) else None


def _shares(record: Record, drive: str, x: np.ndarray, lag: float) -> float:
    """What an input that does not quite repeat does to a signal, if it does as much as with the whole motion.

    Tones that are no multiples of one another come nearly back, so that a period seems to be there, and what is left
    between such periods is motion. The input's own fast noise is not counted.
    """
    own = record[drive]
    between = _between_periods(record.t, own, lag)
    slow = between[0] ** 2 - _of_high_frequencies(record.t, own)[0] ** 2 if between else 0.0
    return float(np.sqrt(max(slow, 0.0)) * np.std(x) / np.std(own))


def _between_periods(t: np.ndarray, x: np.ndarray, lag: float) -> Found:
    """Rms of what differs from one period to the next, less an offset and a slope in each."""
    at, off = _differences(t, x, lag)
    place = np.floor((at - t[0]) / lag + 1e-9).astype(int)
    blocks = [off[place == k] for k in range(place.max() + 1) if np.count_nonzero(place == k) > 3]
    if not blocks:
        return None
    two = len(blocks) < 2 or len(blocks[1]) < 0.5 * len(blocks[0])
    rest = np.array_split(blocks[0], WINDOWS) if two else blocks[1:]
    freedoms = np.array([len(block) - 2 for block in rest])
    if freedoms.min() < 2 or freedoms.sum() < FEWEST:
        return None
    squares = np.array([float(np.sum(_less_trend(block, 1) ** 2)) for block in rest])
    count = sum(map(len, rest))
    if not two:
        return float(np.sqrt(squares.sum() / freedoms.sum())), "repeated periods", count, int(freedoms.sum())
    middle = np.median(squares / (freedoms * (1 - 2 / (9 * freedoms)) ** 3))  # the median of a chi-squared
    return float(np.sqrt(middle)), "repeated periods", count, int(freedoms.sum() * 2 / np.pi)


def _period_of(record: Record, drives: list[str], name: str) -> float | None:
    """Period [s] that one of these signals shows best and none of the others (but the noisy one) contradicts."""
    found = [p for k in drives if (p := find_period(record.t, record[k])) is not None]
    if not found:
        return None
    lag = min(found, key=lambda pair: pair[1])[0]
    if any(unlikeness(record.t, record[k], lag) > UNLIKE for k in drives if k != name):
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


def _of_rests(record: Record, name: str, drives: list[str]) -> Found:
    others = [k for k in drives if k != name]  # its own quiet stretches would be picked for their quiet
    still = np.full(len(record), bool(others))
    for k in others:
        still &= _resting(record[k])
    edges = np.flatnonzero(np.diff(np.r_[False, still, False].astype(int)))
    rest, samples, freedom = 0.0, 0, 0
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        x = record[name][a + (b - a) // 5 : b]  # the first part is left to settle
        if b - a < STILL:
            continue
        rest += float(np.sum(_less_trend(x, 2) ** 2))
        samples, freedom = samples + len(x), freedom + len(x) - 3
    if freedom < FEWEST:
        return None
    return float(np.sqrt(rest / freedom)), "stand-still", samples, freedom


def _resting(x: np.ndarray) -> np.ndarray:
    """Which samples lie in a stretch of ``STILL`` samples over which the signal does not leave its own noise.

    Means over some samples are looked at, whose noise is less, so that a slow turn is no rest.
    """
    if len(x) < STILL or not np.ptp(x) > 0:
        return np.full(len(x), not np.ptp(x) > 0)
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

    at = np.arange(float(len(x)))
    noise, share = _of_high_frequencies(at, x)[0], 1 / np.sqrt(SMOOTH)
    width = max(2.1 * (quantum_of(x) or 0.0), 8 * share * noise, 1e-9 * float(np.ptp(x)))
    if width > 0.1 * np.ptp(x):
        return np.zeros(len(x), dtype=bool)
    x = uniform_filter1d(x, SMOOTH) if noise > 0 else x
    span = maximum_filter1d(x, STILL, origin=-(STILL // 2)) - minimum_filter1d(x, STILL, origin=-(STILL // 2))
    begins = np.flatnonzero(span[: len(x) - STILL + 1] <= width)
    count = np.zeros(len(x) + 1)
    np.add.at(count, begins, 1)
    np.add.at(count, begins + STILL, -1)
    return np.cumsum(count)[:-1] > 0


def _of_high_frequencies(t: np.ndarray, x: np.ndarray) -> tuple[float, str, int, int]:
    """What a cubic through two neighbours on each side leaves, without the edges of jumps."""
    method = "high frequencies"
    n = len(t) - 4
    away = np.stack([t[j : j + n] for j in (0, 1, 3, 4)], axis=1) - t[2 : 2 + n, None]
    w = _weights(away)
    near = np.stack([x[j : j + n] for j in (0, 1, 3, 4)], axis=1)
    off = (x[2 : 2 + n] - np.sum(w * near, axis=1)) / np.sqrt(1 + np.sum(w**2, axis=1))
    for _ in range(3):
        off = off[np.abs(off) <= 4 * np.sqrt(np.mean(off**2))]
    return float(np.sqrt(np.mean(off**2))), method, len(t), len(off)


__all__ = ["Noise", "cautions", "fast_noise", "matters", "noise"]
