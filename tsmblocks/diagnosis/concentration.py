"""Where in time most of a residual lies: a cause that acted for a while and ended again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import attrs
import numpy as np

from tsmblocks.diagnosis.segment import Trace

PARTS = 60
"""Parts of a recording whose squared residuals are added. Chosen: a fourth of a recording is resolved in fifteen."""
MOST, SHORT = 0.7, 0.25
"""Share of the variance above the noise in a part of a recording, and the longest such part [recordings], from which it
is reported. Chosen: three times as much as of a residual that is everywhere alike."""
MOVES_ELSEWHERE = 0.5
"""Share of the squared rates of the simulated signal in that part, up to which the motion is no cause of it. Chosen."""


@attrs.frozen
class Concentration:
    """A part of a recording, from ``start`` to ``stop`` [s], in which a ``share`` of an output's residual lies."""

    experiment: str
    output: str
    start: float
    stop: float
    share: float


def concentrations(traces: Iterable[Trace], floors: Mapping[str, float]) -> list[Concentration]:
    """The short parts of recordings in which most of what the last model leaves lies.

    ``floors`` are the rms noise of the outputs. Nothing of a recording that moves in that part alone, or whose residual
    is less than twice the noise.
    """
    found = (_of_trace(trace, floors.get(trace.output, 0.0)) for trace in traces if len(trace.t) > PARTS)
    return [one for one in found if one is not None]


def _of_trace(trace: Trace, floor: float) -> Concentration | None:
    parts = np.array_split(np.arange(len(trace.t)), PARTS)
    excess = _sums((trace.after - trace.measured) ** 2 - floor**2, parts)
    if not excess[-1] > len(trace.t) * floor**2:
        return None
    first, last = _shortest(excess / excess[-1])
    share, moved = ((sums[last] - sums[first]) / sums[-1] for sums in (excess, _sums(_rates(trace), parts)))
    if last - first > SHORT * PARTS or not moved <= MOVES_ELSEWHERE:
        return None
    start, stop = trace.t[parts[first][0]], trace.t[parts[last - 1][-1]]
    return Concentration(trace.experiment, trace.output, float(start), float(stop), min(float(share), 1.0))


def _sums(values: np.ndarray, parts: list[np.ndarray]) -> np.ndarray:
    """Sums of values over the first 0, 1, 2, ... parts."""
    return np.concatenate([[0.0], np.cumsum([values[one].sum() for one in parts])])


def _rates(trace: Trace) -> np.ndarray:
    """Squared rates of the simulated signal, which has no noise."""
    return np.asarray(np.gradient(trace.after, trace.t) ** 2)


def _shortest(share: np.ndarray) -> tuple[int, int]:
    """First part, and the one behind the last, of the shortest piece with at least ``MOST`` of all."""
    pieces = ((k, int(n)) for k in range(PARTS) for n in [np.argmax(share >= share[k] + MOST)] if n > k)
    return min(pieces, key=lambda one: one[1] - one[0], default=(0, PARTS))
