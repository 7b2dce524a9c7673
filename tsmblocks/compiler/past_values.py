"""Past values of signals, as expressions of the numbers that the engine stores of each."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca


def interpolated_past(kept: list[Any], t: Any, delay: Any, first: Any, now: Any = None) -> Any:
    """The value of a signal ``delay`` s before ``t``: on the cubic through four instants, fewer near the start.

    Both curves are Newton polynomials of at most third order: through the stored instants, a step apart, by backward
    differences; through ``now`` and the newest stored instants, which need not be a step apart, by divided differences.

    ``kept`` are the stored numbers (``DELAY_NUMBERS``). ``first`` is the value before the start (None: the first stored
    one). ``now`` is the present value (None: it may not take part); it is the newest point where the wanted instant
    lies after all stored ones.
    """
    *values, newest, per_second, count = kept
    y0, y1, y2, y3 = values
    since = (t - delay - newest) * per_second  # steps from the newest stored instant to the wanted one

    def if_known(n: int, value: Any) -> Any:
        """A difference that needs so many instants, and counts as zero without."""
        return ca.if_else(count >= n, value, 0.0)

    d1, d2 = y3 - y2, y3 - 2 * y2 + y1
    d3 = if_known(4, (y3 - 3 * y2 + 3 * y1 - y0) / 3)
    value = y3 + since * (if_known(2, d1) + (since + 1) / 2 * (if_known(3, d2) + (since + 2) * d3))
    # ``passed``: steps from the first stored instant to the wanted one
    passed, before = ca.fmax(count - 1, 0.0) + since + _rounding(t, per_second), y3 if first is None else first
    if now is None:
        return ca.if_else(ca.floor(passed) < 0, before, value)
    # In steps: from now back to the wanted instant, and from the newest stored instant to now.
    back, away = -delay * per_second, ca.if_else(count >= 1, (t - newest) * per_second, 1.0)
    e1 = if_known(1, (now - y3) / away)
    e2 = if_known(2, (e1 - d1) / (away + 1))
    e3 = if_known(3, (e2 - d2 / 2) / (away + 2))
    recent = now + back * (e1 + (back + away) * (e2 + (back + away + 1) * e3))
    value = ca.if_else(ca.logic_or(since > 0, count < 1), recent, value)
    if first is None:
        return ca.if_else(passed < 0, ca.if_else(count < 1, now, y3), value)
    return ca.if_else(ca.floor(passed) < 0, first, value)  # rounded, as it jumps there: see ``time_jumps``


def held_past(kept: list[Any], t: Any, delay: Any, first: Any) -> Any:
    """As ``interpolated_past``, for a signal that is constant within steps: its jumps are kept."""
    y0, y1, y2, y3, newest, per_second, count = kept
    back = ca.floor((t - delay - newest) * per_second + _rounding(t, per_second))
    value = ca.if_else(back >= 0, y3, ca.if_else(back >= -1, y2, ca.if_else(back >= -2, y1, y0)))
    return ca.if_else(ca.fmax(count - 1, 0.0) + back < 0, y3 if first is None else first, value)


def mean_past(kept: list[Any], t: Any, delay: Any, first: Any, now: Any = None) -> Any:
    r"""As ``held_past``, but its mean over the step of ``t``.

    With :math:`T = (n + f) h`, :math:`0 \le f < 1`, that is :math:`(1 - f) u_{k-n} + f u_{k-n-1}` over all of step k:
    what integrates it has the exact integral at the end of the step, and a derivative by the delay. A delay of whole
    steps keeps the jumps as they are, to rounding.
    """
    *values, newest, per_second, count = kept
    # The step of t, in steps from the newest instant; where none is stored yet that is the one before the start.
    begun = ca.if_else(count >= 1, ca.floor((t - newest) * per_second + _rounding(t, per_second)), 1.0)
    back = begun - delay * per_second
    if first is None:  # the first value of the port: at the instant 0, which is kept where others before it are wanted
        first = values[3] if now is None else ca.if_else(count < 1, now, values[3])
        for n, value in enumerate(values[2:0:-1], 2):
            first = ca.if_else(count >= n, value, first)
    y0, y1, y2, y3 = (ca.if_else(count >= 4 - k, value, first) for k, value in enumerate(values))
    # Straight lines through the values, a step apart, each over the step that ends there.
    points = [first, y0, y1, y2, y3, *([] if now is None else [now])]
    lines = zip(pairwise(points), range(3, -2, -1), strict=False)
    return points[-1] + sum(_share(back + n) * (end - begin) for (begin, end), n in lines)


def _share(away: Any) -> Any:
    """Where an instant lies on the line over the step before another, ``away`` steps from that: -1 (begin) to 0."""
    return ca.fmax(ca.fmin(away, 0.0), -1.0)


def _rounding(t: Any, per_second: Any) -> Any:
    """Steps by which rounding may move an instant off the grid."""
    return 1e-10 + 4e-15 * ca.fabs(t) * per_second
