"""Sums over long arrays without the threads of the matrix library, which cost more than they save here."""

from __future__ import annotations

import numpy as np

BLOCK = 250_000
"""Multiplications of one matrix product: larger ones start threads of the library. Chosen."""
ROWS = 2000
"""Rows of a matrix that a vector is multiplied with at a time, for the same reason."""


def square(r: np.ndarray) -> float:
    """Sum of squares of a vector."""
    return float(np.einsum("i,i->", r, r))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``a @ b`` of two matrices, in pieces of at most ``BLOCK`` multiplications along the longest side."""
    (m, n), q = a.shape, b.shape[1]
    if m * n * q <= BLOCK:
        return a @ b
    if n > m:
        size = max(BLOCK // (m * q), 1)
        made = np.zeros((m, q))
        for first in range(0, n, size):
            made += a[:, first : first + size] @ b[first : first + size]
        return made
    size = max(BLOCK // (n * q), 1)
    return np.concatenate([a[first : first + size] @ b for first in range(0, m, size)])


def products(jacobian: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``J'r`` and ``J'J``, a few rows at a time."""
    n = jacobian.shape[1]
    gradient, matrix, size = np.zeros(n), np.zeros((n, n)), max(min(ROWS, BLOCK // max(n, 1) ** 2), 1)
    for first in range(0, len(r), size):
        part = jacobian[first : first + size]
        matrix += part.T @ part
        gradient += part.T @ r[first : first + size]
    return gradient, matrix
