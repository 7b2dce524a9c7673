"""Measured inputs prepared for a model with memory, which would follow their noise: low-passed, held while at rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common.interpolation import is_held
from tsmblocks.data.filters import MIN_FILTERED_SAMPLES
from tsmblocks.data.resampling import evenly_sampled

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

MIN_REST_TIME = 0.25
"""Time [s] that a rest lasts at least. Chosen: turning points of a motion are shorter."""
MIN_REST_SAMPLES = 8
"""Samples of a rest at least, whatever their step. Chosen: fewer have no mean to hold the signal at."""
REST_BAND = 6.0
"""Width of the band that a resting signal stays in, in rms values of its noise. Chosen: plus or minus 3 of them, which
white noise leaves in 3 samples of 1000."""
MOTION_SHIFT = 0.5
"""Range of the means of the thirds of a stretch, in rms values of the noise, above which it may be slow motion. Chosen:
white noise stays well below it."""
MOTION_TO_PARABOLA = 2.0
"""The same, in rms values of the residual of a parabola, above which a long stretch is motion. Chosen: a parabola
follows a motion, and does not follow slow noise. Turns of a motion do not stay in the band for so long."""
SLOW_NOISE_TIME = 1.5
"""Time [s] that a stretch lasts at least in which noise may be slow. Chosen: longer than a turn of a motion."""
MOTION_STRIDE = 8
"""Part (1/8) of a stretch of slow motion after which the search for a rest continues. Chosen for speed."""
BLEND_SAMPLES = 3
"""Samples of motion over which the offset of a rest that was held decays to zero. Chosen."""


def conditioned(self: Record, names: Iterable[str]) -> Record:
    """Return the record with measured inputs prepared for a model with memory, as a diagnosis does.

    Signals are low-passed with zero phase, and held constant while they rest, since hysteresis and friction would
    follow their noise. A signal whose spectrum shows no noise stays as it is; uneven samples are resampled first.

    Parameters
    ----------
    names : iterable of str
        The inputs; those that are missing, constant, or held from jump to jump, are left out.

    Returns
    -------
    Record
        The conditioned record.
    """
    if len(self) < MIN_FILTERED_SAMPLES:
        return self
    even = evenly_sampled(self)
    moving = [k for k in names if k in even and np.ptp(even[k]) > 0 and not is_held(even[k])]
    if not moving:
        return even
    made = even.filtered(moving)
    signals, notes = dict(made.signals), []
    for name in moving:
        noise = float(np.sqrt(np.mean((made[name] - even[name]) ** 2)))
        signals[name], share = held_at_rest(made[name], made.step, noise)
        if share:
            where = f"where it moves no more than its noise ({100 * share:.0f} % of the samples)"
            notes.append(f"{name} was held constant {where}.")
    return made._changed(*notes, signals=signals)


def all_conditioned(records: Mapping[str, Record], inputs: Iterable[str]) -> dict[str, Record]:
    """Every record conditioned."""
    names = tuple(inputs)
    return {name: conditioned(record, names) for name, record in records.items()}


def held_at_rest(x: np.ndarray, step: float, noise: float) -> tuple[np.ndarray, float]:
    """Return the signal (n,) with its rests held at their means, and the share of samples at rest.

    ``step`` [s] is the time between samples, ``noise`` the rms value of the noise. Hysteresis and friction integrate
    the path of their input, so noise at rest would move a model that is at rest.
    """
    resting = (
        rests(x, noise, max(round(MIN_REST_TIME / step), MIN_REST_SAMPLES), round(SLOW_NOISE_TIME / step))
        if noise > 0
        else []
    )
    made, moving = x.copy(), np.ones(len(x), dtype=bool)
    for rest in resting:
        made[rest], moving[rest] = x[rest].mean(), False
    for rest in resting:
        for edge, direction in ((rest.start, -1), (rest.stop - 1, 1)):
            for k in range(1, BLEND_SAMPLES + 1):
                at = edge + direction * k
                if 0 <= at < len(x) and moving[at]:
                    made[at] += (made[edge] - x[edge]) * (1 - k / (BLEND_SAMPLES + 1))
    return made, float(1 - moving.mean())


def rests(x: np.ndarray, noise: float, shortest: int, long: int) -> list[slice]:
    """Stretches of at least ``shortest`` samples in which a signal (n,) with noise of this rms value rests.

    A signal that stays in a narrow band only because it moves slowly does not rest. Noise may be slow in stretches of
    ``long`` samples and more.
    """
    resting, first = list[slice](), 0
    while first + shortest <= len(x):
        window = x[first : first + shortest]
        if np.ptp(window) > REST_BAND * noise:
            first += 1
            continue
        low, high, last = window.min(), window.max(), first + shortest
        while last < len(x) and max(high, x[last]) - min(low, x[last]) <= REST_BAND * noise:
            low, high, last = min(low, x[last]), max(high, x[last]), last + 1
        if not _moves(x[first:last], noise, last - first >= long):
            resting.append(slice(first, last))
            first = last
        else:
            first += max((last - first) // MOTION_STRIDE, 1)
    return resting


def _moves(x: np.ndarray, noise: float, long: bool) -> bool:
    """Whether a stretch (n,) is a slow ramp or turn, and not slow noise, which only a long one may be."""
    cut = len(x) // 3
    apart = float(np.ptp([x[:cut].mean(), x[cut:-cut].mean(), x[-cut:].mean()]))
    if apart <= MOTION_SHIFT * noise:
        return False
    if not long:
        return True
    s = np.linspace(-1.0, 1.0, len(x))
    parabola = np.column_stack([np.ones_like(s), s, s * s])
    residual = x - parabola @ np.linalg.lstsq(parabola, x, rcond=None)[0]
    return apart > MOTION_TO_PARABOLA * float(np.sqrt(np.mean(residual * residual)))
