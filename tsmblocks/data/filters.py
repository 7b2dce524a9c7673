"""Filtering and differentiating with zero phase, the cut-off chosen from the data when it is not given."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common import displayed_units
from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import DataError
from tsmblocks.common.headings import heading
from tsmblocks.common.rounding import to_digits
from tsmblocks.data.grid import refuse_not_finite, refuse_uneven
from tsmblocks.data.jumps import jumps

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

MIN_FILTERED_SAMPLES = 16
"""Samples below which a signal is not filtered. Chosen: half of the spectrum, from which its noise is estimated, would
be fewer than 8 values."""
CANDIDATES = 120
"""Cut-offs compared, evenly spaced on a logarithmic axis. Chosen: neighbours differ by some per cent."""
MAX_CUTOFF = 0.4
"""Largest cut-off compared, in sampling frequencies. Chosen: a filter above it would remove next to nothing."""
HALF_POWER = np.sqrt(2.0) - 1
"""Solves (1 + this)^-1 = 1/sqrt(2): both passes of a filter together are then 3 dB down."""
QUIET_QUANTILE, NORMAL_QUANTILE = 0.75, 1.1503
"""Quantile of the magnitudes of third differences that noise is seen in, and that of a normal distribution. Chosen: a
fourth of the samples may lie at corners of a motion."""
THIRD_DIFFERENCE = np.sqrt(20.0)
"""Standard deviation of the third differences of white noise of unit variance. Derived: 1 + 9 + 9 + 1."""
NOISE_RATIO = 4.0
"""Power of the upper half of the spectrum, over that of the noise from sample to sample, at most. Chosen: noise with
heavy tails reaches half of it."""
CHI_SQUARED_MEDIAN = 0.4549
"""Median of a chi-squared variable of one degree of freedom: the power of white noise in one real coefficient."""


def low_pass(x: np.ndarray, step: float, cutoff: float, order: int = 4) -> np.ndarray:
    r"""Zero-phase Butterworth low-pass: forwards, then backwards, with the ends continued point-symmetrically.

    .. math:: |H(f)| = \left[1 + (\sqrt2 - 1) \left(\frac{\tan \pi f h}{\tan \pi f_c h}\right)^{2n}\right]^{-1}

    ``x`` (samples,), ``step`` h [s]; ``cutoff`` [Hz] is where both passes together have fallen by 3 dB, which is
    why each pass is designed with a somewhat higher one. ``order`` n is that of one pass.
    Source: Winter, Biomechanics and Motor Control of Human Movement, on cascaded filters.
    """
    from scipy.signal import butter, sosfiltfilt

    one = np.arctan(np.tan(np.pi * cutoff * step) / HALF_POWER ** (0.5 / order)) / np.pi
    reach = min(len(x) - 1, max(50, round(3.0 / (cutoff * step))))
    line = np.linspace(x[0], x[-1], len(x))  # added again after the filter, so that a slope causes no transient
    return line + sosfiltfilt(butter(order, 2 * one, output="sos"), x - line, padlen=reach)


def white_noise_power(power: np.ndarray, median: float) -> float:
    """Power of white noise in a spectrum (n,), from the median of its upper half; motion is taken to be slower.

    ``median`` is that of the power of white noise of unit power.
    """
    return float(np.median(power[len(power) // 2 :]) / median)


def _noise_at_most_times(x: np.ndarray) -> float:
    """Variance of the white noise in a signal (n,), without the few samples at which its motion has corners."""
    typical = float(np.quantile(np.abs(np.diff(x, 3)), QUIET_QUANTILE))
    return (typical / (NORMAL_QUANTILE * float(THIRD_DIFFERENCE))) ** 2


def choose_cutoff(x: np.ndarray, step: float, order: int = 4, derivative: int = 0) -> float | None:
    r"""Cut-off [Hz] of ``low_pass`` with the least expected error; None when no filter lowers the expected error.

    With :math:`c_k` the sine transform of the signal (less the line through its ends, so that neither jumps nor
    kinks at the ends are taken for fast motion) and :math:`\sigma` the noise in it, the expected square error
    of the filtered signal is, up to a constant, estimated without bias by

    .. math:: R(f_c) = \sum_k \omega_k^{2m} \left[(1 - H_k)^2 c_k^2 + \sigma^2 (2 H_k - 1)\right]

    with m the order of the ``derivative`` that is wanted (its cut-off is never above that for the signal itself,
    which is better known: fast noise weighs less in it). The noise is that of the upper half of the spectrum, and no
    more than is seen from sample to sample at most times: the corners of a trapezoid are as fast as noise, and are part
    of the motion. Slower noise counts as motion and is left in the signal.
    Source: Stein, Estimation of the mean of a multivariate normal distribution, Ann. Stat. 9 (1981).
    """
    from scipy.fft import dst

    n = len(x)
    level = x - np.linspace(x[0], x[-1], n)
    power = dst(level[1:-1], type=1, norm="ortho") ** 2
    f = np.arange(1, n - 1) / (2 * (n - 1) * step)
    noise = min(white_noise_power(power, CHI_SQUARED_MEDIAN), NOISE_RATIO * _noise_at_most_times(x))
    if noise <= (1e-12 * float(np.abs(x).max())) ** 2:
        return None
    slope = np.tan(np.pi * f * step) ** (2 * order) * HALF_POWER
    lowest = 2.0 / (n * step)
    cutoffs = np.geomspace(lowest, max(MAX_CUTOFF / step, lowest), CANDIDATES)
    weights = [(f / f[-1]) ** (2 * m) for m in {0, derivative}]
    risks = np.empty((CANDIDATES, len(weights)))
    for k, cutoff in enumerate(cutoffs):
        h = 1 / (1 + slope / np.tan(np.pi * cutoff * step) ** (2 * order))
        risk = (1 - h) ** 2 * power + noise * (2 * h - 1)
        risks[k] = [float(weight @ risk) for weight in weights]
    best = int(np.argmin(risks, axis=0).min())
    return float(cutoffs[best]) if best < CANDIDATES - 1 else None


def smoothed(x: np.ndarray, step: float, order: int = 4) -> tuple[np.ndarray, float | None]:
    """A signal (n,) low-passed between its jumps with a cut-off [Hz] that is chosen, and that; as it is with None."""
    staircase = jumps(x)
    level = x - staircase
    cutoff = choose_cutoff(level, step, order)
    return (x, None) if cutoff is None else (low_pass(level, step, cutoff, order) + staircase, cutoff)


def filtered(
    self: Record, names: str | Iterable[str] | None = None, *, cutoff: float | None = None, order: int = 4
) -> Record:
    """Return the record with signals low-passed with zero phase.

    Parameters
    ----------
    names : str, iterable of str or None, default None
        Signals to filter, by default all.
    cutoff : float or None, default None
        Frequency [Hz] at which the filter has fallen by 3 dB, below half the sampling frequency. By default it is
        chosen for each signal from its spectrum, so that the expected error (motion lost and noise kept) is
        least, and a signal that jumps is filtered between its jumps; one whose spectrum shows no noise stays as
        it is.
    order : int, default 4
        Order of the Butterworth filter, which runs forwards and backwards; from 1 to 12.

    Returns
    -------
    Record
        The filtered record.

    Raises
    ------
    DataError
        When the samples are unevenly spaced, not finite or too few, or the cut-off does not fit.
    """
    _refuse(self, cutoff, order, "filtering")
    wanted = as_list(self.names if names is None else names)
    refuse_not_finite(self, wanted, "filtering")
    signals, notes = dict(self.signals), []
    for name in wanted:
        x = self[name]
        if cutoff is None:
            smooth, chosen = smoothed(x, self.step, order)
        else:
            smooth, chosen = low_pass(x, self.step, cutoff, order), cutoff
        if chosen is None:
            notes.append(f"{name} was not filtered: no noise stands out from its motion in the spectrum.")
            continue
        signals[name] = smooth
        gone = _rms_text(x - smooth, self.unit(name))
        notes.append(f"{name} was filtered with zero phase, {_cutoff_text(chosen, cutoff)}; {gone} was removed.")
    return self._changed(*notes, signals=signals)


def differentiated(
    self: Record, signal: str, order: int = 1, *, name: str | None = None, cutoff: float | None = None
) -> Record:
    """Return the record with a derivative of a signal added.

    The signal is low-passed with zero phase, and a quintic spline through it is differentiated.

    Parameters
    ----------
    signal : str
        The signal.
    order : {1, 2}, default 1
        First or second derivative, in unit/s or unit/s^2.
    name : str or None, default None
        Name of the derivative, by default ``signal_dot`` or ``signal_ddot``.
    cutoff : float or None, default None
        Cut-off [Hz] of the low-pass, by default chosen for the derivative from the spectrum.

    Returns
    -------
    Record
        The record with one signal more.

    Raises
    ------
    DataError
        As ``filtered`` does, for another order, and for a name that is taken.
    """
    from scipy.interpolate import make_interp_spline

    if order not in (1, 2):
        raise DataError(f"{self.called}: a signal is differentiated once or twice (order = 1 or 2), got {order!r}.")
    _refuse(self, cutoff, 4, "differentiating")
    new = name or f"{signal}_{'d' * order}ot"
    if new in self:
        raise DataError(f"{self.called}: there is already a signal '{new}'; give the derivative another name.")
    refuse_not_finite(self, [signal], "differentiating")
    x, unit = self[signal], self.unit(signal)
    chosen = cutoff or choose_cutoff(x, self.step, 4, order)
    smooth = x if chosen is None else low_pass(x, self.step, chosen)
    slope = make_interp_spline(self.t, smooth, k=5)(self.t, nu=order)
    for _ in range(order if unit else 0):
        unit = displayed_units.times(unit, "s", -1)
    how = "" if chosen is None else f" after a zero-phase low-pass, {_cutoff_text(chosen, cutoff)}"
    note = f"{heading(new, unit)} is {signal} differentiated{' twice' if order == 2 else ''}{how}."
    labels = {**self.units, new: unit} if unit else self.units
    return self._changed(note, signals={**self.signals, new: slope}, units=labels)


def _cutoff_text(chosen: float, given: float | None) -> str:
    return f"cut-off {chosen:.4g} Hz" + ("" if given else " (chosen from its spectrum)")


def _rms_text(x: np.ndarray, unit: str) -> str:
    """The rms value of a signal in words, angles in degrees: ``0.061 deg rms``."""
    scale, shown = displayed_units.display_unit(unit)
    return " ".join((to_digits(scale * float(np.sqrt(np.mean(x**2)))), *shown.split(), "rms"))


def _refuse(record: Record, cutoff: float | None, order: int, what: str) -> None:
    if len(record) < MIN_FILTERED_SAMPLES:
        raise DataError(
            f"{record.called}: {what} needs at least {MIN_FILTERED_SAMPLES} samples, there are {len(record)}."
        )
    refuse_uneven(record, what)
    top = 0.5 / record.step
    if cutoff is not None and not 0 < cutoff < top:
        raise DataError(
            f"{record.called}: the cut-off must lie between 0 Hz and {top:g} Hz (half the sampling "
            f"frequency), got {cutoff:g} Hz."
        )
    if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= 12:
        raise DataError(f"{record.called}: the order of a filter is a whole number from 1 to 12, got {order!r}.")
