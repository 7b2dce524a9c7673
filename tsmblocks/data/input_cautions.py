"""Cautions on signals that drive a model: noise and quantisation that lengthen their path or disturb their rate."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tsmblocks.common.arguments import as_list
from tsmblocks.common.interpolation import is_held
from tsmblocks.common.rounding import to_digits
from tsmblocks.data.fast_noise import sample_to_sample_noise
from tsmblocks.data.filters import MIN_FILTERED_SAMPLES, smoothed
from tsmblocks.data.noise_floor import is_coarse, with_unit
from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.record import Record
from tsmblocks.data.resampling import evenly_sampled

MAX_RATE_ERROR = 0.03
"""Error that quantisation makes in a rate, as a share of the rate, from which it is reported. Chosen: a rate that is
used as an input of friction should be better known than the friction it finds."""
RATE_SPAN = 20
"""Samples over which motion is measured, so that steps of the reading do not count as motion. Chosen."""
MAX_ADDED_PATH = 0.05
"""Share of an input's path that noise may add before it is reported. Chosen: a loss that scales with the path is
then wrong by as much."""

FILTER = "Filter it first: "
FILTER_INPUT = "If it is an input of the model, filter it first (an output stays as it is): "
"""Advice on a signal that drives a model, and on one that may."""


def cautions(record: Record, inputs: str | Iterable[str] | None = None) -> tuple[str, ...]:
    """Return cautions on signals that drive a model with memory.

    Hysteresis and friction integrate the path of their input. Noise and quantisation lengthen it without any motion,
    and so imitate an effect; the length is compared with that of the signal filtered with zero phase. Quantisation that
    does not lengthen the path still makes the rate jump.

    Parameters
    ----------
    record : Record
        The recording.
    inputs : str, iterable of str or None, default None
        Signals that drive the model. By default all are examined, and the advice is only about those that drive it:
        a measured output stays as it is, since filtering it would distort a fit.

    Returns
    -------
    tuple of str
        A sentence for each signal that needs one.

    Raises
    ------
    DataError
        For an unknown signal.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.arange(0, 10, 0.01)
    >>> x = np.sin(t) + np.random.default_rng(0).normal(0.0, 0.01, t.size)
    >>> (text,) = tsm.data.cautions(tsm.Record("sine", t, {"x_in": x}, {"x_in": "rad"}))
    >>> text[:70]
    'x_in is noisy: its path is 91 % longer than that of the motion in it, '
    """
    record = evenly_sampled(record)
    names = [name for name in as_list(record.names if inputs is None else inputs) if not is_held(record[name])]
    sentences = (_long_path(record, name) or _rough_rate(record, name) for name in names)
    said = tuple(text for text in sentences if text)
    return said if inputs is not None else tuple(text.replace(FILTER, FILTER_INPUT) for text in said)


def _long_path(record: Record, name: str) -> str:
    """The caution where noise or steps lengthen the path of a signal."""
    x = record[name]
    made, cutoff = smoothed(x, record.step) if len(x) >= MIN_FILTERED_SAMPLES else (x, None)
    if cutoff is None:
        return ""
    path, smooth = np.abs(np.diff(x)).sum(), np.abs(np.diff(made)).sum()
    if path <= (1 + MAX_ADDED_PATH) * smooth:
        return ""
    quantum = quantum_of(x)
    coarse = is_coarse(quantum, sample_to_sample_noise(record.t, x).floor)
    why = f"is quantised in steps of {with_unit(quantum or 0.0, record.unit(name))}" if coarse else "is noisy"
    return (
        f"{name} {why}: its path is {100 * (path / smooth - 1):.0f} % longer than that of the motion in it, which "
        f"drives hysteresis and friction. {FILTER}filtered('{name}')."
    )


def _rough_rate(record: Record, name: str) -> str:
    """The caution where steps do not lengthen the path of a signal, but make its rate jump."""
    x = record[name]
    quantum = quantum_of(x)
    if quantum is None or len(x) <= 2 * RATE_SPAN:
        return ""
    motion = np.abs(x[RATE_SPAN:] - x[:-RATE_SPAN]).mean() / RATE_SPAN
    error = quantum / np.sqrt(6.0) / motion if motion > 0 else 0.0  # of rounding, as a share of the rate
    if error <= MAX_RATE_ERROR:
        return ""
    return (
        f"{name} is quantised in steps of {with_unit(quantum, record.unit(name))}, which makes its rate wrong by "
        f"{100 * error:.0f} %. Where the rate drives the model, filter it first: "
        f"filtered('{name}', cutoff={to_digits(0.05 / record.step)}), for example, above the frequencies of its motion."
    )
