"""Numbers that say how well one signal follows another. Pure functions of arrays; no data files, no plots."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, in_words


@attrs.frozen
class TrackingError:
    """How far an output stays from its reference: three numbers in ``unit``, from ``after`` [s] on.

    ``peak_to_peak`` is the largest minus the smallest error, ``rms`` its root mean square, ``largest``
    the greatest magnitude.
    """

    peak_to_peak: float
    rms: float
    largest: float
    unit: str = "rad"
    after: float = 0.0

    def to(self, unit: str) -> TrackingError:
        """Return the same error in another unit, such as ``"deg"``. Raises UnitError when it does not fit."""
        k = units.factor(self.unit, unit)
        return TrackingError(k * self.peak_to_peak, k * self.rms, k * self.largest, unit, self.after)


def peak_to_peak(x: Any) -> float:
    """Largest minus smallest value, in the unit of ``x``, shape (N,). Raises DataError for what is no such list."""
    values = _signal("x", x)
    return float(values.max() - values.min())


def rms(x: Any) -> float:
    r"""Root mean square, in the unit of ``x``, shape (N,). Raises DataError for what is no such list.

    .. math:: \sqrt{\tfrac1N \sum_k x_k^2}
    """
    return float(np.sqrt(np.mean(_signal("x", x) ** 2)))


def mean_square_error(x_out: Any, model: Any) -> float:
    r"""Objective of the paper's fits, in the square of the signals' unit.

    .. math:: \tfrac1N \sum_k \left(x_{out,k} - \hat x_{out,k}\right)^2

    Source: paper, Eq (10).
    """
    measured, modelled = _pair("x_out", x_out, "model", model)
    return float(np.mean((measured - modelled) ** 2))


def loop_area(x: Any, y: Any) -> float:
    r"""Area that the curve ``(x, y)`` goes round, in the product of their units.

    .. math:: \tfrac12 \oint (x\,dy - y\,dx)

    Counted positive counter-clockwise, and once for each turn: divide by the number of periods. The
    last point is joined to the first.
    """
    a, b = _pair("x", x, "y", y)
    a, b = a - a[0], b - b[0]  # the area does not depend on the origin; rounding does
    return float(0.5 * np.sum(a * np.roll(b, -1) - b * np.roll(a, -1)))


def tracking_error(
    run: Any,
    x_out: Any = None,
    *,
    t: Any = None,
    after: float | None = None,
    reference: str = "x_ref",
    output: str = "x_out",
    unit: str = "rad",
) -> TrackingError:
    r"""How far the output of a run stays from its reference.

    .. math:: e = x_{ref} - x_{out}

    ``run`` is a Run with the signals ``reference`` and ``output``, or the reference itself as an array;
    ``x_out`` is then the output in the same ``unit``, and ``t`` the time [s] when ``after`` is used.
    Only instants from ``after`` [s] on count (all of them by default). Raises DataError when nothing is left.
    """
    if x_out is None:
        t, unit = run.t, run.unit(reference) or unit
        x_ref, x_out = run[reference], run[output]
    else:
        x_ref = run
    wanted, reached = _pair("x_ref", x_ref, "x_out", x_out)
    error = wanted - reached
    if after is None:
        first = 0.0 if t is None else float(np.asarray(t)[0])
    else:
        if t is None:
            raise DataError("tracking_error needs t (time in s) to leave out what comes before 'after'.")
        kept = np.asarray(t, dtype=float) >= after
        if not kept.any():
            raise DataError(f"no instant is left after {after:g} s; the run ends at {np.asarray(t)[-1]:g} s.")
        first, error = float(after), error[kept]
    return TrackingError(peak_to_peak(error), rms(error), float(np.abs(error).max()), unit, first)


def _signal(name: str, values: Any) -> np.ndarray:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise DataError(f"{name} must be a list of numbers, got {in_words(values)}.") from None
    if array.ndim != 1 or not array.size:
        raise DataError(f"{name} must be a list of at least one number, got shape {array.shape}.")
    return array


def _pair(name: str, values: Any, other: str, others: Any) -> tuple[np.ndarray, np.ndarray]:
    a, b = _signal(name, values), _signal(other, others)
    if a.shape != b.shape:
        raise DataError(f"{name} and {other} must be of one length, got {len(a)} and {len(b)} samples.")
    return a, b
