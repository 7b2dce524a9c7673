"""Sums over long arrays that leave the threads of the matrix library asleep: waking them costs more than it saves."""

from __future__ import annotations

import numpy as np


def square(r: np.ndarray) -> float:
    """Sum of squares of a vector."""
    return float(np.einsum("i,i->", r, r))
