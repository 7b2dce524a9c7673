"""Samples that motions seldom make: spikes far off all others, and a noisy sensor that repeats one number."""

from __future__ import annotations

import numpy as np

from tsmblocks.data.table import Table, noted, plural

FAR = 0.5
"""How far off the range of all other samples a spike lies, as a share of that range."""
FEW = 0.005
"""Share of the samples up to which they are spikes, and not what was measured."""
WIDE = 2
"""Samples in a row that a spike has at most."""
SUDDEN = 3.0
"""Steps to a fault and back, beside the largest step elsewhere."""
LEAST = 50
"""Samples below which no spike is looked for."""
HUGE = 1e150
"""A number whose square still is one."""
LONG = 20
"""Equal samples in a row from which a noisy sensor has dropped out."""
SELDOM = 0.02
"""Share of equal neighbours elsewhere up to which a signal never rests, and is not rounded either."""
NOISY = 0.4
"""Share of turns in the bends of a signal from which it is noisy; those of white noise turn two times in three."""


def spikes_are_named(table: Table) -> Table:
    """One or two samples in a row far off all others are told, and stay: a fit would bend towards them."""
    for k in range(1, len(table.names)):
        values = table.values[:, k]
        at = _spikes(values)
        if not len(at):
            continue
        shown = ", ".join(f"row {table.rows[i]}: {values[i]:g}" for i in at[:3]) + (", …" if len(at) > 3 else "")
        rest = np.delete(values, at)
        table = noted(table, table.values, table.rows, (
            f"{table.names[k]} has {plural(len(at), 'spike')} ({shown}) far off all other samples, which are between "
            f"{rest.min():g} and {rest.max():g}. A true pulse may be that short. A false one weighs on all that is "
            "found: empty its cell, and it is interpolated."))  # fmt: skip
    return table


def dropouts_are_named(table: Table) -> Table:
    """A run of equal numbers in a signal that is noisy everywhere else is told: its sensor may not have measured."""
    for k in range(1, len(table.names)):
        values = table.values[:, k]
        first, last = _longest_rest(values)
        rest = np.delete(values, slice(first, last + 1))
        if last - first < LONG or not _restless(rest) or _clipped(values, first, last, rest):
            continue
        t = table.values[:, 0]
        table = noted(table, table.values, table.rows, (
            f"{table.names[k]} is {values[first]:g} all the time from {t[first]:g} s to {t[last]:g} s (rows "
            f"{table.rows[first]} to {table.rows[last]}), and noisy elsewhere. Either it stood still, or its sensor "
            "dropped out; then leave this time out: part, or --rows and --window."))  # fmt: skip
    return table


def _spikes(values: np.ndarray) -> np.ndarray:
    """Where spikes are, in order; empty where there are none, or more than a few."""
    order = np.argsort(values, kind="stable")
    few = max(int(FEW * len(values)), 1)
    if len(values) < LEAST or not np.abs(values).max() < HUGE:
        return np.array([], dtype=int)
    middle = values[order[few:-few]]
    reach = float(np.ptp(middle))
    far = (values > middle.max() + FAR * reach) | (values < middle.min() - FAR * reach)
    edges = np.flatnonzero(np.diff(np.r_[False, far, False].astype(int)))
    first, after = edges[::2], edges[1::2]
    few_and_short = 0 < far.sum() <= few and int((after - first).max()) <= WIDE
    if not (reach > 0 and few_and_short and first[0] > 0 and after[-1] < len(values)):
        return np.array([], dtype=int)
    usual = float(np.abs(np.diff(values[~far])).max())
    sudden = min(np.abs(values[first] - values[first - 1]).min(), np.abs(values[after - 1] - values[after]).min())
    return np.flatnonzero(far) if sudden > SUDDEN * usual else np.array([], dtype=int)


def _longest_rest(values: np.ndarray) -> tuple[int, int]:
    """First and last sample of the longest run of equal ones."""
    starts = np.r_[0, np.flatnonzero(values[1:] != values[:-1]) + 1, len(values)]
    k = int(np.argmax(np.diff(starts)))
    return int(starts[k]), int(starts[k + 1]) - 1


def _clipped(values: np.ndarray, first: int, last: int, rest: np.ndarray) -> bool:
    """Whether a signal comes gently to one of its ends: there is a limit, which a diagnosis may find."""
    if rest.min() < values[first] < rest.max():
        return False
    edges = [(first - 1, first), (last, last + 1)]
    steps = [abs(float(values[b] - values[a])) for a, b in edges if a >= 0 and b < len(values)]
    return max(steps, default=0.0) <= SUDDEN * float(np.quantile(np.abs(np.diff(rest)), 0.99))


def _restless(values: np.ndarray) -> bool:
    """Whether a signal is noisy, and its neighbouring samples are hardly ever equal."""
    if len(values) < 2 * LONG or float(np.mean(np.diff(values) == 0)) > SELDOM:
        return False
    bends = np.diff(values, 2)
    return float(np.mean(bends[1:] * bends[:-1] < 0)) >= NOISY
