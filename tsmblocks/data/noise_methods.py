"""Data that show the noise of a signal: differences between repeats or periods, and rests of the inputs."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.common.interpolation import interpolation, polynomial_weights
from tsmblocks.data.fast_noise import sample_to_sample_noise
from tsmblocks.data.grid import stretches
from tsmblocks.data.noise_checks import settled, smooth
from tsmblocks.data.periods import MIN_UNLIKENESS, best_period, refined_lag, unlikeness
from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.record import Record
from tsmblocks.data.slow_noise import Stretch, mean_square

REPEATS = "repeats"
"""Method of a floor that is the difference between recordings with the same inputs."""
STAND_STILL = "stand-still"
"""Method of a floor that was estimated while the inputs rest."""
STILL_MOVING = "the signal still moves there: it rings or settles, or something else drives it"
"""Why a floor from stand-still is not used."""
MIN_FREEDOM = 30
"""Degrees of freedom below which an estimate is not given. Derived: its relative error, 1/sqrt(2 freedom), would be
more than an eighth."""
MAX_REPEAT_DIFFERENCE = 0.5
"""Differences between repeats, in rms values of the signal, beyond which they are not the same experiment. Chosen."""
MIN_STILL_SAMPLES = 50
"""Samples for which an input must rest to count as standing still. Chosen."""
STILL_MEAN_SAMPLES = 10
"""Samples whose mean is taken when rests are searched. Chosen: it lowers white noise to a third."""
MIN_RESTS = 3
"""Rests from which their beginnings are compared. Chosen."""
MAX_RMS_RATIO = 3.0
"""Rms of a signal in a rest over that in one of twice its length, or its fast noise, up to which it may be at rest in
both. Chosen: slow noise is larger in the longer one."""
RESPONSE_SAMPLES = 30
"""Samples for which a signal responds to an input that moves a little while it seems to rest. Chosen."""
MIN_PERIOD_SAMPLES = 4
"""Samples of a period at least. Chosen: with fewer it may be an alias."""
MAX_DRIVEN_DIFFERENCE = 0.2
"""Rms of the difference between periods that inputs explain by not quite repeating, over that of all of it, before it
is no noise. Chosen: an effect that depends on the motion, such as friction, may respond several times more."""
MAX_FOLLOWING = 0.5
"""Share of the mean square in rests that what little the inputs move there explains, before it is no noise. Chosen."""


@attrs.frozen(eq=False)
class Found:
    """The noise that one method extracts from a signal; ``span`` is the length of the recording [s].

    Each sample of the stretches comes from ``records`` samples that were compared.

    ``driven`` is the part that the inputs explain by not quite repeating, rms. ``doubt`` says why it is no noise.
    """

    method: str
    stretches: tuple[Stretch, ...]
    span: float
    driven: float = 0.0
    records: float = 1.0
    doubt: str = ""

    @property
    def samples(self) -> int:
        """All samples that went into the stretches."""
        return round(self.records * sum(len(s.x) for s in self.stretches))


def measured(record: Record, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a signal, without samples that were interpolated, which have no noise."""
    there = _there(record, name)
    return record.t[there], record[name][there]


def _there(record: Record, name: str) -> np.ndarray:
    """Which samples of a signal were measured."""
    return ~np.asarray(record.filled.get(name, np.zeros(len(record), dtype=bool)))


def of_repeats(records: list[Record], name: str) -> Found | None:
    """Differences between the records. Raises DataError where they differ too much to be repeats."""
    first = records[0]
    t, unit = first.t, first.unit(name)
    rows, gone = [first[name]], ~_there(first, name)
    for other in records[1:]:
        own, x = other.t - other.t[0] + t[0], other.values(name, unit)
        if name in other.filled:
            gone |= np.interp(t, own, other.filled[name].astype(float)) > 0
        same = len(own) == len(t) and np.allclose(own, t, rtol=0, atol=1e-3 * first.step)
        rows.append(x if same else interpolation(own, x, "linear")(t))
    shortest = min(float(r.t[-1] - r.t[0]) for r in records)
    kept = (t - t[0] <= shortest + 1e-9 * first.step) & ~gone
    table = np.stack([row[kept] for row in rows])
    off = table - table.mean(axis=0)
    size = float(np.std(table))
    if np.sqrt(np.mean(off**2)) > MAX_REPEAT_DIFFERENCE * size > 0:
        raise DataError(
            f"these {len(records)} records do not repeat one experiment: '{name}' differs between them by "
            f"{100 * np.sqrt(np.mean(off**2)) / size:.0f} % of its rms value."
        )
    contrasts = np.linalg.qr(np.vstack([np.ones(len(rows)), np.eye(len(rows))[:-1]]).T)[0][:, 1:].T @ table
    made = [Stretch(row, first.step) for row in contrasts]
    return _judged(Found(REPEATS, tuple(made), shortest, records=len(rows) / (len(rows) - 1)), _fast(first, name))


def _fast(record: Record, name: str) -> float:
    return sample_to_sample_noise(*measured(record, name)).floor


def _judged(found: Found, fast: float) -> Found | None:
    """The noise found, less a transient; with a doubt where it is no noise, None where there is too little of it."""
    first, still = settled(found.stretches, fast)
    kept = attrs.evolve(found, stretches=tuple(s.cut(first) for s in found.stretches))
    if kept.samples < MIN_FREEDOM:
        return None
    if not still:
        return attrs.evolve(kept, doubt="the noise found does not settle")
    if smooth(kept.stretches, fast):
        return attrs.evolve(kept, doubt="the noise found has a smooth path, as motion has")
    return kept


def of_periods(record: Record, name: str, drives: list[str]) -> Found | None:
    """Differences between periods a third of the recording apart, so that slow noise is in them."""
    moving = [k for k in drives if np.ptp(record[k]) > 0]
    lag = _common_period(record, moving, name)
    if lag is None or lag < MIN_PERIOD_SAMPLES * record.step or len(record) < MIN_FREEDOM:
        return None
    span = float(record.t[-1] - record.t[0])
    others, fast = [k for k in moving if k != name], _fast(record, name)
    for apart in dict.fromkeys([max(1, round(span / (3 * lag))), 1]):
        total = refined_lag(record.t, [record[k] for k in others or moving], apart * lag)
        made = _difference_stretch(record, name, total)
        found = _judged(Found("repeated periods", (made,), span), fast) if len(made.x) >= MIN_FREEDOM else None
        if found is None:
            continue
        kept = len(found.stretches[0].x)
        driven = max([_driven_difference(record, k, name, total, kept) for k in others], default=0.0)
        if driven <= MAX_DRIVEN_DIFFERENCE * np.sqrt(mean_square(found.stretches)):
            return attrs.evolve(found, driven=driven)
    return None


def _difference_stretch(record: Record, name: str, lag: float) -> Stretch:
    _, off, gain = _differences(record.t, record[name], lag, record.filled.get(name))
    return Stretch(off, record.step, lag, gain)


def _driven_difference(record: Record, drive: str, name: str, lag: float, kept: int) -> float:
    """Rms of the last ``kept`` differences of a signal between periods that an input explains by not quite repeating.

    A sum of tones that are no multiples of one another nearly repeats itself, and differences between such periods are
    motion. The signal is taken to follow the input in proportion. The input's own fast noise is not counted.
    """
    own = _difference_stretch(record, drive, lag).x[-kept:]
    slow = float(np.var(own)) - _fast(record, drive) ** 2
    return float(np.sqrt(max(slow, 0.0)) * np.std(record[name]) / np.std(record[drive]))


def _common_period(record: Record, drives: list[str], name: str) -> float | None:
    """Period [s] of the signal that repeats itself best, if the others (but the noisy one) repeat with it too."""
    lag = best_period(record.t, [record[k] for k in drives])
    if lag is not None and any(unlikeness(record.t, record[k], lag) > MIN_UNLIKENESS for k in drives if k != name):
        return None
    return lag


def _differences(
    t: np.ndarray, x: np.ndarray, lag: float, filled: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Times, x a lag later less x, divided so that white noise keeps its rms value, and the gain of slow noise.

    Differences that read a sample which was ``filled`` are left out.

    Between samples x is the cubic through the two on each side, which lessens white noise, and slow noise hardly.
    """
    later = t + lag
    k = np.searchsorted(t, later + 1e-6 * lag / len(t)) - 1  # the sample just before, or at, one period later
    kept = (k >= 1) & (k + 2 < len(t)) & (later <= t[-1])
    if filled is not None:
        read = np.clip(k[:, None] + np.arange(-1, 3), 0, len(t) - 1)
        kept &= ~filled & ~filled[read].any(axis=1)
    k, later = k[kept], later[kept]
    places = k[:, None] + np.arange(-1, 3)
    w = polynomial_weights(t[places] - later[:, None])
    off = np.sum(w * x[places], axis=1) - x[: len(t)][kept]
    size = 1 + np.sum(w**2, axis=1)
    return t[kept], off / np.sqrt(size), float(2 / np.mean(size)) if len(size) else 1.0


def of_rests(record: Record, name: str, drives: list[str]) -> Found | None:
    """The signal while the inputs rest."""
    others = [k for k in drives if k != name]  # rests of the signal itself would be selected for being quiet
    if not others:
        return None
    still = np.all([_resting(record[k]) for k in others], axis=0)
    rests = [(a, b) for a, b in stretches(still) if b - a >= MIN_STILL_SAMPLES]
    made, moving, fast = list[Stretch](), list[Stretch](), _fast(record, name)
    there = _there(record, name)
    late = [slice(a + (b - a) // 5, b) for a, b in rests]  # the signal settles during the first fifth
    for rest in _settled_together([Stretch(record[name][k][there[k]], record.step) for k in late], fast):
        first, still = settled([rest], fast)
        (made if still else moving).append(rest.cut(first))
    made, settling = _with_settling_apart(made, fast)
    moving += settling
    found = Found(STAND_STILL, tuple(made), float(record.t[-1] - record.t[0]))
    if found.samples - len(made) < MIN_FREEDOM:
        found = attrs.evolve(found, stretches=tuple(moving))
        return attrs.evolve(found, doubt=STILL_MOVING) if moving else None
    if smooth(made, fast) or any(_follows(record, k, name, rests) for k in others):
        return attrs.evolve(found, doubt=STILL_MOVING)
    return found


def _with_settling_apart(rests: list[Stretch], fast: float) -> tuple[list[Stretch], list[Stretch]]:
    """The rests without the short ones in which the signal still settles, far above the longest; and those."""
    if not rests:
        return [], []
    longest = max(rests, key=lambda one: len(one.x))
    most = MAX_RMS_RATIO**2 * max(mean_square([longest]), fast**2)

    def settles(one: Stretch) -> bool:
        return 2 * len(one.x) <= len(longest.x) and mean_square([one]) > most

    return [one for one in rests if not settles(one)], [one for one in rests if settles(one)]


def _settled_together(rests: list[Stretch], fast: float) -> list[Stretch]:
    """Rests without the time in which all of them together show that the signal still settles after a motion.

    The rest of a transient may be as large as noise in each of them, but is at the beginning of all. It is looked
    for in those that are as long as most.
    """
    if len(rests) < MIN_RESTS:
        return rests
    usual = int(np.median([len(s.x) for s in rests]))
    first, _ = settled([s.cut(0, usual) for s in rests if len(s.x) >= usual], fast)
    return [s.cut(first) for s in rests if len(s.x) - first >= MIN_FREEDOM // 2]


def _follows(record: Record, drive: str, name: str, rests: list[tuple[int, int]]) -> bool:
    """Whether the signal follows in the rests what little the input moves there: its response to it is fitted."""
    rows, values = list[np.ndarray](), list[np.ndarray]()
    for a, b in rests:
        late = np.lib.stride_tricks.sliding_window_view(record[drive][a:b], RESPONSE_SAMPLES)
        rows.append(late - late.mean(axis=0))
        values.append(record[name][a + RESPONSE_SAMPLES - 1 : b])
    inputs, x = np.vstack(rows), np.concatenate([v - v.mean() for v in values])
    if len(x) < 10 * RESPONSE_SAMPLES or not np.ptp(inputs) > 0:
        return False
    left = x - inputs @ np.linalg.lstsq(inputs, x, rcond=None)[0]
    return float(left @ left) < (1 - MAX_FOLLOWING) * float(x @ x)


def _resting(x: np.ndarray) -> np.ndarray:
    """Which samples lie in a rest: ``MIN_STILL_SAMPLES`` samples over which the signal stays within its noise.

    Moving means are compared, whose noise is less, so that a slow turn is no rest.
    """
    if len(x) < MIN_STILL_SAMPLES or not np.ptp(x) > 0:
        return np.full(len(x), not np.ptp(x) > 0)
    from scipy.ndimage import uniform_filter1d

    noise, share = sample_to_sample_noise(np.arange(float(len(x))), x).floor, 1 / np.sqrt(STILL_MEAN_SAMPLES)
    if np.median(np.abs(np.diff(x))) == 0:  # a held command has no noise, however often it steps
        noise = 0.0
    width = max(2.1 * (quantum_of(x) or 0.0), 8 * share * noise, 1e-9 * float(np.ptp(x)))
    if width > 0.1 * np.ptp(x):
        return np.zeros(len(x), dtype=bool)
    x = uniform_filter1d(x, STILL_MEAN_SAMPLES) if noise > 0 else x
    windows = np.lib.stride_tricks.sliding_window_view(x, MIN_STILL_SAMPLES)
    still = np.convolve(np.ptp(windows, axis=1) <= width, np.ones(MIN_STILL_SAMPLES)) > 0.5
    return still & (np.abs(np.diff(x, prepend=x[0])) <= width)  # rests on both sides of a step are two
