"""A recording made ready: what a measured input's noise would do to a model with memory is taken out first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import attrs
import numpy as np

from tsmblocks.data.filters import MIN_SAMPLES
from tsmblocks.data.resampling import evenly_sampled

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

SHORTEST = 0.25
"""Time [s] that a rest lasts at least; turning points of a motion are shorter."""
TUBE = 6.0
"""Width of the band that a resting signal stays in, in rms values of its noise."""
SLOW = 0.5
"""Distance between the means of thirds of a stretch, in the same, above which it may be slow motion and no rest ..."""
PLAIN = 2.0
"""... and is, where it is as many times the rms of what a parabola leaves of the stretch: slow noise is left by one.
This counts for stretches of ``LONG`` only: turns of a motion do not stay in the band for so long."""
LONG = 1.5
"""Time [s] that a stretch lasts in which noise may be slow."""
AGAIN = 8
"""Part of a stretch of slow motion after which a rest is looked for again."""
SHORTEST_REST = 8
"""Samples of a rest at least."""
BLEND = 3
"""Samples of motion over which the offset of a rest that was held fades out."""


def conditioned(record: Record, inputs: Iterable[str]) -> Record:
    """See Record.conditioned."""
    if len(record) < MIN_SAMPLES:
        return record
    even = evenly_sampled(record)
    names = [k for k in inputs if k in even and np.ptp(even[k]) > 0]
    if not names:
        return even
    made = even.filtered(names)
    signals, notes = dict(made.signals), []
    for name in names:
        noise = float(np.sqrt(np.mean((made[name] - even[name]) ** 2)))
        signals[name], share = held_still(made[name], made.step, noise)
        if share:
            notes.append(f"{name} was held still where it rests ({100 * share:.0f} % of the samples).")
    return attrs.evolve(made, signals=signals, notes=(*made.notes, *notes))


def all_conditioned(records: Mapping[str, Record], inputs: Iterable[str]) -> dict[str, Record]:
    """Every record conditioned."""
    names = tuple(inputs)
    return {name: conditioned(record, names) for name, record in records.items()}


def held_still(x: np.ndarray, step: float, noise: float) -> tuple[np.ndarray, float]:
    """The signal (n,) with its rests held at their means, and the share of samples that rest.

    ``step`` [s] is the time between samples, ``noise`` the rms value of the noise. Hysteresis and friction integrate
    the path of their input, so noise at rest would move what has come to rest.
    """
    found = rests(x, noise, max(round(SHORTEST / step), SHORTEST_REST), round(LONG / step)) if noise > 0 else []
    made, moving = x.copy(), np.ones(len(x), dtype=bool)
    for rest in found:
        made[rest], moving[rest] = x[rest].mean(), False
    for rest in found:
        for edge, way in ((rest.start, -1), (rest.stop - 1, 1)):
            for k in range(1, BLEND + 1):
                at = edge + way * k
                if 0 <= at < len(x) and moving[at]:
                    made[at] += (made[edge] - x[edge]) * (1 - k / (BLEND + 1))
    return made, float(1 - moving.mean())


def rests(x: np.ndarray, noise: float, shortest: int, long: int) -> list[slice]:
    """Stretches of at least ``shortest`` samples in which a signal (n,) with noise of this rms value stays where it is.

    A signal that stays in a narrow band only because it moves slowly does not rest. In ``long`` samples and more noise
    may be slow.
    """
    found, first = list[slice](), 0
    while first + shortest <= len(x):
        window = x[first : first + shortest]
        if np.ptp(window) > TUBE * noise:
            first += 1
            continue
        low, high, last = window.min(), window.max(), first + shortest
        while last < len(x) and max(high, x[last]) - min(low, x[last]) <= TUBE * noise:
            low, high, last = min(low, x[last]), max(high, x[last]), last + 1
        if not _moves(x[first:last], noise, last - first >= long):
            found.append(slice(first, last))
            first = last
        else:
            first += max((last - first) // AGAIN, 1)
    return found


def _moves(x: np.ndarray, noise: float, long: bool) -> bool:
    """Whether a stretch (n,) moves slowly: as a ramp or a turn does, and not as slow noise does in a long one."""
    cut = len(x) // 3
    apart = float(np.ptp([x[:cut].mean(), x[cut:-cut].mean(), x[-cut:].mean()]))
    if apart <= SLOW * noise:
        return False
    if not long:
        return True
    s = np.linspace(-1.0, 1.0, len(x))
    parabola = np.column_stack([np.ones_like(s), s, s * s])
    left = x - parabola @ np.linalg.lstsq(parabola, x, rcond=None)[0]
    return apart > PLAIN * float(np.sqrt(np.mean(left * left)))
