"""What a candidate gains by its size, beyond what its states gain that may begin anywhere.

The fit of a memory chooses where it begins in each experiment. What fades from there follows slow noise, whatever the
size of the effect: only what the size gains beyond that is evidence of it.
"""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.diagnosis.own_instants import falls, regular
from tsmblocks.fitting.column_space import ColumnSpace

MAX_VALUES = 20_000_000
"""Samples times initial states in all experiments, at most, for which this is computed. Chosen: for memory, 160 MB; of
so many experiments each is short, and a fading memory no slow function."""
LEVEL = 0.05
"""Probability that the size gains as much in noise. Source: convention."""


@attrs.frozen(eq=False)
class SizeBeyondStates:
    """Falls of the sum of squares by the size alone: ``gain`` of the residual, ``noise_gains`` (D,) of surrogates."""

    gain: float
    noise_gains: np.ndarray

    @property
    def is_noise(self) -> bool:
        """Whether the size gains no more than it does in noise."""
        return self.gain <= float(np.quantile(self.noise_gains, 1 - LEVEL))


def size_beyond_states(
    by_size: np.ndarray, by_state: np.ndarray, owner: np.ndarray, base: ColumnSpace, r: np.ndarray, noise: np.ndarray
) -> SizeBeyondStates:
    """The gains of an effect's sizes, beyond those of its states, in a residual ``r`` (N,) and surrogates of it (N, D).

    ``by_size`` (N, k) are changes of the outputs by the sizes, ``by_state`` (N, S) by states that begin elsewhere;
    ``owner`` (N,) is the number of the experiment of each sample, each with its own states. The base is projected out,
    as it is from ``noise``.
    """
    parts = [np.where(owner[:, None] == e, by_state, 0.0) for e in range(int(owner.max()) + 1)]
    columns = np.concatenate([*parts, by_size], axis=1)
    first = columns.shape[1] - by_size.shape[1]
    whole, inside = columns.T @ columns, base.basis.transposed_times(columns)
    g = np.empty((len(whole), 1 + noise.shape[1]))
    g[:, 0] = columns.T @ r - inside.T @ base.basis.transposed_times(r)
    g[:, 1:] = columns.astype(noise.dtype).T @ noise
    m = regular(whole - inside.T @ inside, whole)
    gains = falls(m, g) - falls(m[:first, :first], g[:first])
    return SizeBeyondStates(float(gains[0]), gains[1:])
