"""Tracking errors: how well one signal follows another. Pure functions of arrays."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, TsmError, in_words


@attrs.frozen
class TrackingError:
    """The deviation of an output from its reference: three numbers in ``unit``, from ``after`` [s] on.

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
    """Return the largest minus the smallest value.

    Parameters
    ----------
    x : array_like, shape (N,)
        The signal.

    Returns
    -------
    float
        The range, in the unit of the signal.

    Raises
    ------
    DataError
        For anything that is no list of numbers.

    Examples
    --------
    >>> from tsmblocks.metrics.tracking import peak_to_peak
    >>> peak_to_peak([0.0, 2.0, -1.0])
    3.0
    """
    values = _signal("x", x)
    return float(values.max() - values.min())


def rms(x: Any) -> float:
    r"""Return the root mean square of a signal.

    .. math:: \sqrt{\tfrac1N \sum_k x_k^2}

    Parameters
    ----------
    x : array_like, shape (N,)
        The signal.

    Returns
    -------
    float
        The root mean square, in the unit of the signal.

    Raises
    ------
    DataError
        For anything that is no list of numbers.

    Examples
    --------
    >>> from tsmblocks.metrics.tracking import rms
    >>> rms([3.0, -3.0])
    3.0
    """
    return float(np.sqrt(np.mean(_signal("x", x) ** 2)))


def loop_area(x: Any, y: Any) -> float:
    r"""Area enclosed by the curve ``(x, y)``, in the product of their units.

    .. math:: \tfrac12 \oint (x\,dy - y\,dx)

    Positive counter-clockwise, and counted once for each turn. The last point is joined to the first.
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
    """Return how far the output of a run is from its reference.

    .. math:: e = x_{ref} - x_{out}

    Parameters
    ----------
    run : Run, Record or array_like of shape (N,)
        The run, or the reference itself.
    x_out : array_like of shape (N,) or None, default None
        The output, where ``run`` is the reference.
    t : array_like of shape (N,) or None, default None
        Time [s], needed for ``after`` with arrays.
    after : float or None, default None
        Time [s] from which on instants count, by default all.
    reference, output : str, default "x_ref" and "x_out"
        Names of the signals in the run.
    unit : str, default "rad"
        Unit of the signals where the run has none.

    Returns
    -------
    TrackingError
        Peak-to-peak, rms and largest error, in the unit of the signals.

    Raises
    ------
    DataError
        When no instant remains, and for arrays of different length.
    RunError
        For a run without these signals.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> error = tsm.tracking_error([0.0, 1.0, 2.0], [0.0, 0.5, 2.5])
    >>> error.peak_to_peak, error.largest
    (1.0, 0.5)
    """
    if x_out is None:
        t, unit = run.t, run.unit(reference) or unit
        try:
            x_ref, x_out = run[reference], run[output]
        except TsmError as fault:
            others = "Other signals are named by reference and output: tracking_error(run, reference='a', output='b')."
            raise type(fault)(f"{fault} {others}") from None
    else:
        x_ref = run
    wanted, reached = _pair("x_ref", x_ref, "x_out", x_out)
    error = wanted - reached
    first = 0.0 if t is None else float(np.asarray(t)[0])
    if after is not None:
        if t is None:
            raise DataError("tracking_error needs t (time in s) to leave out what comes before 'after'.")
        kept = np.asarray(t, dtype=float) >= after
        if not kept.any():
            raise DataError(f"no instant remains after {after:g} s; the run ends at {np.asarray(t)[-1]:g} s.")
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
