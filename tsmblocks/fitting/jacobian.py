"""The Jacobian of a fit: columns of parameters common to all experiments, and of unknowns of one experiment alone.

An initial state enters the rows of its experiment only. Of many experiments, such as the pieces of a recording,
only the blocks that are not zero are stored: a matrix of thousands of rows and hundreds of columns takes as much memory
as one of a few columns.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import NamedTuple

import attrs
import numpy as np

from tsmblocks.fitting.inner_products import products


class Block(NamedTuple):
    """The rows of one experiment: ``values`` (rows, k), by the unknowns ``columns`` (k,), its own ones first."""

    rows: slice
    columns: np.ndarray
    values: np.ndarray


@attrs.frozen(eq=False)
class Jacobian:
    """A matrix (N, n) with columns that are zero outside of the rows of one experiment.

    ``common`` (N, m) holds the columns ``common_columns`` (m,), those of all experiments. ``own`` (N, k) holds in the
    rows ``rows[e]`` of an experiment the columns ``own_columns[e]``, which are zero elsewhere; where these are fewer
    than k, the rest is zero.
    """

    common: np.ndarray = attrs.field(repr=False)
    own: np.ndarray = attrs.field(repr=False)
    rows: tuple[slice, ...]
    common_columns: np.ndarray
    own_columns: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, matrix: np.ndarray | Jacobian) -> Jacobian:
        """A matrix (N, n) whose columns are all common; one of this class as it is."""
        if isinstance(matrix, cls):
            return matrix
        matrix = np.asarray(matrix, dtype=float)
        count, n = matrix.shape
        none = np.empty(0, dtype=int)
        return cls(matrix, np.zeros((count, 0)), (slice(0, count),), np.arange(n), (none,))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.common), len(self.common_columns) + sum(map(len, self.own_columns))

    @property
    def has_own(self) -> bool:
        """Whether any column belongs to one experiment alone."""
        return any(len(columns) for columns in self.own_columns)

    def blocks(self) -> Iterator[Block]:
        """The part of each experiment that is not zero."""
        for rows, columns in zip(self.rows, self.own_columns, strict=True):
            values = np.concatenate([self.own[rows, : len(columns)], self.common[rows]], axis=1)
            yield Block(rows, np.concatenate([columns, self.common_columns]), values)

    def own_blocks(self) -> Iterator[Block]:
        """The columns of each experiment alone."""
        for rows, columns in zip(self.rows, self.own_columns, strict=True):
            yield Block(rows, columns, self.own[rows, : len(columns)])

    def dense(self) -> np.ndarray:
        """The whole matrix (N, n), zeros included."""
        result = np.zeros(self.shape)
        for block in self.blocks():
            result[block.rows, block.columns] = block.values
        return result

    @functools.cached_property
    def norms(self) -> np.ndarray:
        """Norm of each column, shape (n,)."""
        result = np.empty(self.shape[1])
        result[self.common_columns] = np.sqrt(np.einsum("ij,ij->j", self.common, self.common))
        for block in self.own_blocks():
            result[block.columns] = np.sqrt(np.einsum("ij,ij->j", block.values, block.values))
        return result

    @property
    def is_finite(self) -> np.ndarray:
        """Which columns are finite, shape (n,)."""
        result = np.empty(self.shape[1], dtype=bool)
        result[self.common_columns] = np.isfinite(self.common).all(axis=0)
        for block in self.own_blocks():
            result[block.columns] = np.isfinite(block.values).all(axis=0)
        return result

    @property
    def has_finite_values(self) -> np.ndarray:
        """Which columns have a value that is finite and not zero, shape (n,)."""
        result = np.empty(self.shape[1], dtype=bool)
        result[self.common_columns] = (np.isfinite(self.common) & (self.common != 0)).any(axis=0)
        for block in self.own_blocks():
            result[block.columns] = (np.isfinite(block.values) & (block.values != 0)).any(axis=0)
        return result

    def with_finite_values(self) -> Jacobian:
        """The same with zeros instead of non-finite values."""
        common, own = (np.where(np.isfinite(part), part, 0.0) for part in (self.common, self.own))
        return attrs.evolve(self, common=common, own=own)

    def scaled(self, factors: np.ndarray) -> Jacobian:
        """Each column times a factor (n,)."""
        own = self.own.copy()
        for rows, columns in zip(self.rows, self.own_columns, strict=True):
            own[rows, : len(columns)] *= factors[columns]
        return attrs.evolve(self, common=self.common * factors[self.common_columns], own=own)

    def with_columns(self, kept: np.ndarray) -> Jacobian:
        """Some of the columns, those marked in ``kept`` (n,), renumbered in the same order."""
        number = np.cumsum(kept) - 1
        chosen = [kept[columns] for columns in self.own_columns]
        own = np.zeros((len(self.own), max((int(mask.sum()) for mask in chosen), default=0)))
        for block, mask in zip(self.own_blocks(), chosen, strict=True):
            own[block.rows, : mask.sum()] = block.values[:, mask]
        mask = kept[self.common_columns]
        columns = tuple(number[columns[mine]] for columns, mine in zip(self.own_columns, chosen, strict=True))
        return Jacobian(self.common[:, mask], own, self.rows, number[self.common_columns[mask]], columns)

    def __sub__(self, other: Jacobian) -> Jacobian:
        """The difference from one with the same columns."""
        return attrs.evolve(self, common=self.common - other.common, own=self.own - other.own)

    def __matmul__(self, vector: np.ndarray) -> np.ndarray:
        """The matrix times a vector (n,) or several (n, k)."""
        result = self.common @ vector[self.common_columns]
        for block in self.own_blocks():
            result[block.rows] += block.values @ vector[block.columns]
        return result

    def transposed_times(self, vectors: np.ndarray) -> np.ndarray:
        """The transposed matrix times a vector (N,) or several (N, k)."""
        result = np.empty((self.shape[1], *vectors.shape[1:]))
        result[self.common_columns] = self.common.T @ vectors
        for block in self.own_blocks():
            result[block.columns] = block.values.T @ vectors[block.rows]
        return result

    def normal_matrix(self) -> np.ndarray:
        """The transposed matrix times itself, shape (n, n)."""
        result = np.zeros((self.shape[1],) * 2)
        for block in self.blocks():
            result[np.ix_(block.columns, block.columns)] += products(block.values, np.zeros(len(block.values)))[1]
        return result

    def experiment_of(self, rows: slice) -> int:
        """The experiment to which some rows belong."""
        return next(e for e, own in enumerate(self.rows) if own.start <= rows.start and rows.stop <= own.stop)
