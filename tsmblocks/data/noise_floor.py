"""Noise of a signal: from differences between repeats, from rests of the inputs, or else from its fastest part.

``noise`` is about one experiment, ``noise_of_recordings`` about a signal over several.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import DataError
from tsmblocks.common.rounding import to_digits
from tsmblocks.data.fast_noise import HIGH_FREQUENCIES, fast_level, sample_to_sample_noise
from tsmblocks.data.noise_methods import REPEATS, STAND_STILL, Found, measured, of_periods, of_repeats, of_rests
from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.record import Record
from tsmblocks.data.slow_noise import Level, level, mean_square

TRUST = (REPEATS, "repeated periods", STAND_STILL, HIGH_FREQUENCIES)
"""Methods, the most reliable first."""
CONTENT = {
    REPEATS: "what differs between recordings with the same inputs",
    "repeated periods": "what differs from one period of the inputs to a later one",
    STAND_STILL: "the noise while the mechanism stands still",
    HIGH_FREQUENCIES: "fast noise only; slow noise is not included",
}
"""What noise a floor contains, by its method."""
MIN_REST_FREEDOM = 20
"""Degrees of freedom of rests from which they show the noise. Chosen: a few rests of slow noise do not."""
SAME_READING = 0.25
"""Rms of noise that leaves a reading at the same value, at most [steps of the reading]. Derived: with more, a value in
the middle of a step leaves it in one sample of 22."""
MIN_NOISE_SAMPLES = 8
"""Samples below which no noise is estimated. Chosen: the cubic of ``sample_to_sample_noise`` spans 5."""


@attrs.frozen
class Noise:
    """Noise of one signal.

    Parameters
    ----------
    name : str
        The signal.
    unit : str
        Unit of the signal, in which all rms values and ``quantum`` are; ``""`` where it is not known.
    floor : float
        Rms value of the noise about its mean over the recording, quantisation included.
    quantum : float or None
        Step of a quantised signal; None when it is continuous.
    method : str
        Where the floor comes from: ``"repeats"``, ``"repeated periods"``, ``"stand-still"`` or ``"high frequencies"``.
        The last includes only noise that changes from sample to sample, not slow noise.
    samples : int
        Samples that went into the floor.
    freedom : int
        Degrees of freedom of the floor: independent values with the same information. Slow noise has fewer than
        samples.
    low, high : float, default 0 and inf
        95 % interval of the floor. It allows for autocorrelation, for bursts and for noise that the method does not
        include: above a floor from ``"high frequencies"`` there is no bound.
    white : float or None, default None
        Rms value of the noise that differs from sample to sample; None where it is not distinct.
    slow : float or None, default None
        Rms value of the autocorrelated noise; None where none stands out from the white noise.
    slow_time : float or None, default None
        Correlation time of the slow noise [s].
    doubt : str, default ""
        Doubts about the floor, or why a more reliable estimate was not used; empty where there is no doubt.
    """

    name: str
    unit: str
    floor: float
    quantum: float | None
    method: str
    samples: int
    freedom: int
    low: float = 0.0
    high: float = np.inf
    white: float | None = None
    slow: float | None = None
    slow_time: float | None = None
    doubt: str = ""

    def __str__(self) -> str:
        """One line, as a report shows it."""
        coarse = is_coarse(self.quantum, self.floor)
        step = f"; quantised in steps of {with_unit(self.quantum or 0.0, self.unit)}" if coarse else ""
        bounds = f"{self.low:.3g} or more" if np.isinf(self.high) else f"{self.low:.3g} to {self.high:.3g}"
        kinds = ""
        if self.slow is not None and self.white is not None:
            kinds = f"; white {with_unit(self.white, self.unit)}, slow {with_unit(self.slow, self.unit)}"
            kinds += f" with a correlation time of {to_digits(self.slow_time or 0.0)} s"
        return (
            f"{self.name}: noise {with_unit(self.floor, self.unit)} rms (95 %: {bounds}), from {self.method} "
            f"({self.samples} samples, {self.freedom} degrees of freedom){kinds}{step}"
            + (f". Doubtful: {self.doubt}" if self.doubt else "")
        )


def noise(records: Record | Sequence[Record], name: str, inputs: str | Iterable[str] | None = None) -> Noise:
    """Estimate the noise floor and the quantisation of a signal.

    The methods, the first that applies being taken:

    - repeats: differences between the records;
    - repeated periods, where the inputs repeat as well: differences from one period to a later one;
    - stand-still: the signal while the inputs rest;
    - high frequencies: the error of a cubic through the two neighbours on each side.

    From each difference and rest an offset is subtracted, and a slope where there is drift; the noise that this removes
    is added. A beginning larger than noise explains is left out as a transient. What is far above the fast noise and
    has a smooth path, or does not settle, is a motion and no noise: the next method is taken, and ``doubt`` says so.
    Where the intervals of two methods exclude each other, the larger is not taken, since motion and effects that a
    model lacks can only add: ``doubt`` says so, and ``high`` is the higher of theirs.

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
        Floor with its interval, kinds of noise, quantum and method, in the signal's unit.

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
    >>> found.method, round(found.floor, 3), round(found.low, 3), found.high
    ('high frequencies', 0.019, 0.016, inf)
    """
    given = [records] if isinstance(records, Record) else list(records)
    if not given:
        raise DataError("noise needs at least one record.")
    first = given[0]
    (t, x), unit = _samples(first, name), first.unit(name)
    drives = _driving_signals(first, name, inputs)
    found = [of_repeats(given, name)] if len(given) > 1 else []
    found += [of_periods(first, name, drives), of_rests(first, name, drives)]
    fast = fast_level(t, x)
    return _taken([f for f in found if f], fast, Noise(name, unit, 0.0, quantum_of(x), HIGH_FREQUENCIES, len(x), 0))


def noise_over_recordings(records: Mapping[str, Record], name: str, unit: str, inputs: Iterable[str]) -> Noise:
    """The noise of a signal, in ``unit``, from all recordings together; recordings that repeat another are found.

    The most reliable method is used, from every recording that has it. ``inputs`` drive the experiments; those
    that a recording lacks are left out. Raises DataError as noise does.
    """
    driving = [k for k in inputs if all(k in r for r in records.values())]
    scaled = {k: r.factor(name, unit) for k, r in records.items()}
    found, fast, quanta = list[Found](), list[Level](), list[float]()
    for key, r in records.items():
        t, x = _samples(r, name)
        x = x * scaled[key]
        drives = driving or _driving_signals(r, name, None)
        own = [f for f in (of_periods(r, name, drives), of_rests(r, name, drives)) if f]
        found += [_times(f, scaled[key]) for f in own]
        fast.append(fast_level(t, x))
        quanta.append(quantum_of(x) or 0.0)
    for group in _repeating(list(records.values()), driving):
        try:
            own_found = of_repeats(group, name)
        except DataError:  # they differ too much
            continue
        found += [_times(own_found, group[0].factor(name, unit))] if own_found else []
    typical = sorted(fast, key=lambda one: one.floor)[(len(fast) - 1) // 2]
    median = float(np.median([one.floor for one in fast]))
    typical = attrs.evolve(typical, floor=median, low=min(typical.low, median))
    samples = sum(len(measured(r, name)[0]) for r in records.values())
    start = Noise(name, unit, 0.0, float(np.median(quanta)) or None, HIGH_FREQUENCIES, samples, 0)
    first = next(iter(records.values()))
    recorded_in = first.unit(name)
    shown = (1 / first.factor(name, unit), recorded_in) if recorded_in else (1.0, unit)
    return _taken(found, typical, start, shown)


def noise_of_recordings(
    records: Mapping[str, Record], name: str, unit: str, inputs: Iterable[str]
) -> tuple[float, str]:
    """Return the floor and the method of ``noise_over_recordings``."""
    found = noise_over_recordings(records, name, unit, inputs)
    return found.floor, found.method


def method_text(method: str) -> str:
    """Where a floor comes from, and what noise it contains: ``from high frequencies: a lower limit, …``."""
    return f"from {method}: {CONTENT[method]}" if method in CONTENT else method


def _taken(found: list[Found], fast: Level, start: Noise, shown: tuple[float, str] | None = None) -> Noise:
    """The noise by the first method of ``TRUST`` that is free of doubt; otherwise the fast noise.

    ``shown`` are a factor and the unit of sizes in words, by default those of the noise.
    """
    factor, unit = shown or (1.0, start.unit)
    sound = {m: own for m in TRUST if (own := [f for f in found if f.method == m and not f.doubt])}
    levels = {m: _level(own, fast.floor) for m, own in sound.items()}
    refused = _refused(found, factor, unit)
    if STAND_STILL in levels and levels[STAND_STILL].freedom < MIN_REST_FREEDOM:
        refused.append(f"{STAND_STILL}: too few independent values ({levels.pop(STAND_STILL).freedom:.0f})")
    rounding = (start.quantum or 0.0) / np.sqrt(12.0)  # a constant reading has rounding errors all the same
    if not levels:
        floor, said = max(fast.floor, rounding), "; ".join(refused)
        return attrs.evolve(
            start, floor=float(floor), freedom=int(fast.freedom), low=float(max(fast.low, rounding)), doubt=said
        )
    larger = {m: k for m, one in levels.items() for k, other in levels.items() if one.low > other.high}
    method = next(m for m in levels if m not in larger)  # an effect that the model lacks can only add
    best = levels[method]
    words = [text for text in refused if TRUST.index(text.split(":")[0]) < TRUST.index(method)]
    for m, k in larger.items():
        more, less = (with_unit(factor * levels[one].floor, unit) for one in (m, k))
        words.append(f"{m}: {more} rms, more than the {less} from {k}")
    high = max([best.high, *(levels[m].high for m in larger)])
    if best.floor < rounding:  # noise that is less than a step of the reading does not show while it stands still
        high = max(high, float(np.hypot(rounding, SAME_READING * (start.quantum or 0.0))))
    return attrs.evolve(
        start,
        floor=float(max(best.floor, rounding)),
        method=method,
        samples=sum(f.samples for f in sound[method]),
        freedom=int(best.freedom),
        low=float(max(best.low, rounding)),
        high=float(high),
        white=best.white,
        slow=best.slow,
        slow_time=best.time,
        doubt="; ".join(words),
    )


def _refused(found: Sequence[Found], factor: float, unit: str) -> list[str]:
    """Each reason why a method found no noise, with the largest of what it found for that reason [unit]."""
    largest: dict[str, float] = {}
    for one in found:
        if one.doubt:
            reason = f"{one.method}: {one.doubt}"
            largest[reason] = max(largest.get(reason, 0.0), float(np.sqrt(mean_square(one.stretches))))
    return [f"{reason} ({with_unit(factor * size, unit)} rms)" for reason, size in largest.items()]


def _level(found: Sequence[Found], fast: float) -> Level:
    """The noise that several findings of one method show together."""
    span = float(np.mean([f.span for f in found]))
    one = level([s for f in found for s in f.stretches], span)
    driven = max(f.driven for f in found)
    return attrs.evolve(one, low=float(np.sqrt(max(one.low**2 - driven**2, min(one.low, fast) ** 2))))


def _times(found: Found, factor: float) -> Found:
    """The noise found, in another unit."""
    stretches = tuple(attrs.evolve(s, x=s.x * factor) for s in found.stretches)
    return attrs.evolve(found, stretches=stretches, driven=found.driven * abs(factor))


def _repeating(records: list[Record], inputs: list[str]) -> list[list[Record]]:
    """Groups of recordings over which the inputs are the same but for their noise."""
    groups = list[list[Record]]()
    for r in records if inputs else []:
        for group in groups:
            if _same_inputs(group[0], r, inputs):
                group.append(r)
                break
        else:
            groups.append([r])
    return [group for group in groups if len(group) > 1]


def _same_inputs(one: Record, other: Record, inputs: list[str]) -> bool:
    n = min(len(one), len(other))
    if n < 0.5 * max(len(one), len(other)) or not np.allclose(
        one.t[:n] - one.t[0], other.t[:n] - other.t[0], rtol=0, atol=1e-3 * one.step
    ):
        return False
    for k in inputs:
        x, y = one[k][:n], other.values(k, one.unit(k))[:n]
        noisy = np.hypot(sample_to_sample_noise(one.t[:n], x).floor, sample_to_sample_noise(one.t[:n], y).floor)
        allowed = max(2 * noisy, 2 * (quantum_of(x) or 0.0), 1e-6 * float(np.ptp(x)))
        if not np.ptp(x) > 0 or float(np.sqrt(np.mean((x - y) ** 2))) > min(allowed, 0.1 * float(np.std(x))):
            return False
    return True


def fast_noise_of_recordings(records: Mapping[str, Record], name: str, unit: str) -> float:
    """The median over the recordings of the noise from sample to sample, rms in ``unit``, without slow noise."""
    floors = [sample_to_sample_noise(*_samples(r, name)).floor * r.factor(name, unit) for r in records.values()]
    return float(np.median(floors))


def _samples(record: Record, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values that were measured. Raises DataError for too few."""
    t, x = measured(record, name)
    if len(t) < MIN_NOISE_SAMPLES:
        raise DataError(f"{record.called}: noise needs at least {MIN_NOISE_SAMPLES} samples, there are {len(t)}.")
    return t, x


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
