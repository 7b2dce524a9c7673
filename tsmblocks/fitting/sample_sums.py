"""Sums over a few samples each: what a fit sees of its noise, where the sampling is far faster than its Jacobian.

An autoregressive model looks back over some tens of samples. Where these are a small part of the slowest time that
matters, it takes any slow noise for a random walk without end. Sums over several samples carry the same information
about the parameters, as long as the Jacobian hardly changes within them, and look back as much further.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.fitting.jacobian import Jacobian

MIN_KEPT = 0.99
"""Share of the square of each column that the sums have to keep. Chosen: the standard errors are then off by 0.5 % at
most, where the noise is white."""
MIN_SUMS = 500
"""Sums of a segment at least. Chosen: a Student distribution with as many degrees of freedom is a normal one."""


def summed(basis: Jacobian, r: np.ndarray, segments: Sequence[slice]) -> tuple[Jacobian, np.ndarray, list[slice]]:
    """A basis (N, q), residuals (N,) and their segments, as sums over as many samples as leave the basis as it is.

    Sums are over the root of their number of samples, so that white noise keeps its variance; the columns of the basis
    have norm 1 as before.
    """
    shortest = min((s.stop - s.start for s in segments), default=0)
    found, count = (basis, r, list(segments)), 2
    while shortest // count >= MIN_SUMS:
        fewer = _summed(basis, r, segments, count)
        if (fewer[0].norms ** 2 < MIN_KEPT * basis.norms**2).any():
            break
        found, count = fewer, 2 * count
    return found[0].scaled(basis.norms / np.maximum(found[0].norms, 1e-300)), *found[1:]


def _summed(
    basis: Jacobian, r: np.ndarray, segments: Sequence[slice], count: int
) -> tuple[Jacobian, np.ndarray, list[slice]]:
    """Sums over ``count`` samples each; the last one of a segment has the rest."""
    starts = [np.arange(s.start, s.stop, count) for s in segments]
    firsts = np.concatenate(starts)
    lasts = np.concatenate([np.r_[one[1:], s.stop] for one, s in zip(starts, segments, strict=True)])
    weight = 1 / np.sqrt(lasts - firsts)
    at = np.searchsorted(firsts, [rows.start for rows in basis.rows] + [len(r)])
    rows = tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(at))
    common, own = (np.add.reduceat(part, firsts, axis=0) * weight[:, None] for part in (basis.common, basis.own))
    ends = np.cumsum([0, *map(len, starts)])
    made = attrs.evolve(basis, common=common, own=own, rows=rows)
    return (made, np.add.reduceat(r, firsts) * weight, [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)])
