"""The directions in which unknowns change the residuals of a fit, and those in which they change nothing.

Unknowns of one experiment alone are eliminated experiment by experiment: an orthonormal basis of their columns is found
in the rows of that experiment, and projected out of the columns that all experiments have in common (the Schur
complement of an arrowhead matrix). The effort grows with the number of experiments, not with its square.
Source: Golub and Van Loan, Matrix Computations (2013), 5.3 and 6.3.
"""

from __future__ import annotations

import itertools

import attrs
import numpy as np

from tsmblocks.fitting.inner_products import product
from tsmblocks.fitting.jacobian import Jacobian

SUSPECT = 1e-10
"""Ratio of eigenvalues below which a product of matrices is not trusted with the smaller ones. Chosen."""
PIECE = 1000
"""Samples factorised at a time. Chosen: a block of these rows stays in the cache of the processor."""
SQUARED_EFFECT_TOLERANCE = 1e-12
"""Squared effect of a direction, as a share of the largest, below which it is not identifiable. Chosen: above rounding
of a squared matrix."""
TINY = 1e-150
"""Norm of a column up to which it counts as zero. Chosen: its square is no number."""


@attrs.frozen(eq=False)
class ColumnSpace:
    """The column space of a Jacobian J (N, n): ``basis`` (N, q), whose columns are orthonormal, is J ``turn`` (n, q).

    With a weight W that adds to J'J the columns of ``turn`` T are such that T'(J'J + W)T = 1. ``unseen`` (n, z) are
    orthonormal directions without effect, in unknowns scaled to columns of norm 1; ``scale`` (n,) are these norms.
    """

    basis: Jacobian
    turn: np.ndarray
    unseen: np.ndarray
    scale: np.ndarray

    def project_out(self, z: np.ndarray) -> np.ndarray:
        """Columns (N, m) with this space projected out."""
        return z - self.basis @ self.basis.transposed_times(z)


@attrs.frozen(eq=False)
class _Own:
    """The column space of one experiment's own columns: ``left`` (rows, r), and ``turn`` (k, r) that leads to it.

    ``unseen`` (k, k - r) are the directions without effect, ``largest`` is the largest squared effect of any.
    """

    left: np.ndarray
    turn: np.ndarray
    unseen: np.ndarray
    largest: float

    @classmethod
    def of(cls, values: np.ndarray, tolerance: float) -> _Own:
        """Of columns (rows, k) of norm 1, without directions whose squared effect is below ``tolerance``."""
        basis, triangle = np.linalg.qr(values)
        left, sizes, right = np.linalg.svd(triangle)
        largest = float(np.max(sizes, initial=0.0)) ** 2
        rank = int(np.sum(sizes**2 > tolerance * max(largest, 1e-300)))
        return cls(basis @ left[:, :rank], right[:rank].T / sizes[:rank], right[rank:].T, largest)


def column_space(
    J: Jacobian, tolerance: float, weight: np.ndarray | None = None, held: np.ndarray | None = None
) -> ColumnSpace:
    """The column space of a Jacobian, without directions whose squared effect is ``tolerance`` times the largest.

    ``weight`` (n, n) adds to J'J, and the unknowns do not move along the rows of ``held`` (m, n).
    """
    weighted = weight is not None and bool(np.any(weight))
    if held is not None and np.size(held):
        held = np.asarray(held, dtype=float)
        if not weighted and (np.count_nonzero(held, axis=1) == 1).all():
            return _without(J, np.any(held != 0, axis=0), tolerance)
    else:
        held = None
    if weighted or held is not None:
        J = Jacobian.of(J.dense())
    n, own_weight = J.shape[1], weight if weighted and weight is not None else np.zeros((J.shape[1],) * 2)
    scale = np.sqrt(J.norms**2 + np.diag(own_weight)) if weighted else J.norms
    scale = np.where(scale > TINY, scale, 1.0)
    scaled = J.scaled(1 / scale)
    experiments = [_Own.of(block.values, tolerance) for block in scaled.own_blocks()]
    common, back = _projected(scaled, experiments)
    free = _not_held(held, scale) if held is not None else np.eye(len(J.common_columns))
    own_weight = own_weight[np.ix_(J.common_columns, J.common_columns)] / np.outer(*[scale[J.common_columns]] * 2)
    values, vectors = spectrum(np.ascontiguousarray(common.T), own_weight, free)
    vectors = free @ vectors
    whole = np.zeros((n, vectors.shape[1]))  # with the unknowns of single experiments moving along at their optimum
    whole[J.common_columns] = vectors
    for columns, along in zip(J.own_columns, back, strict=True):
        whole[columns] = -along @ vectors
    lengths = np.einsum("ij,ij->j", whole, whole) if J.has_own else np.ones(len(values))
    largest = max([values.max(initial=0.0), 1e-300, *(one.largest for one in experiments)])
    seen = values > tolerance * largest * lengths
    return _joined(scaled, experiments, (common, whole[:, seen] / np.sqrt(values[seen])), whole[:, ~seen], scale)


def _joined(
    J: Jacobian,
    experiments: list[_Own],
    projected: tuple[np.ndarray, np.ndarray],
    unseen: np.ndarray,
    scale: np.ndarray,
) -> ColumnSpace:
    """The column space of the experiments' own columns, and of the rest of the common ones.

    ``projected`` holds the common columns with the own ones projected out (N, m), and the way (n, q) to the basis of
    their space; ``unseen`` (n, z) are the directions that have no effect there.
    """
    common, way = projected
    first = np.cumsum([0, *(one.left.shape[1] for one in experiments)])
    turn = np.concatenate([np.zeros((len(way), first[-1])), way], axis=1)
    nothing, basis = [np.linalg.qr(unseen)[0] if J.has_own else unseen], np.zeros(J.own.shape)
    for rows, columns, one, begin in zip(J.rows, J.own_columns, experiments, first[:-1], strict=True):
        rank = one.left.shape[1]
        turn[columns, begin : begin + rank] = one.turn
        basis[rows, :rank] = one.left
        nothing.append(np.zeros((len(way), one.unseen.shape[1])))
        nothing[-1][columns] = one.unseen
    places = tuple(np.arange(a, b) for a, b in itertools.pairwise(first.tolist()))
    last = product(common, way[J.common_columns])
    made = Jacobian(last, basis, J.rows, np.arange(first[-1], turn.shape[1]), places)
    without = np.concatenate(nothing, axis=1)
    turn = (turn - without @ (without.T @ turn)) / scale[:, None]  # the shortest way to each column of the basis
    return ColumnSpace(made, turn, without, scale)


def _without(J: Jacobian, held: np.ndarray, tolerance: float) -> ColumnSpace:
    """The column space with some of the unknowns held, which are marked in ``held`` (n,)."""
    free = column_space(J.with_columns(~held), tolerance)
    turn, unseen = (np.zeros((len(held), part.shape[1])) for part in (free.turn, free.unseen))
    turn[~held], unseen[~held] = free.turn, free.unseen
    return attrs.evolve(free, turn=turn, unseen=unseen, scale=np.where(J.norms > TINY, J.norms, 1.0))


def _projected(J: Jacobian, experiments: list[_Own]) -> tuple[np.ndarray, list[np.ndarray]]:
    """The common columns (N, m) with the others projected out, and for each experiment what moves along (k, m)."""
    common, back = J.common.copy() if J.has_own else J.common, []
    for rows, one in zip(J.rows, experiments, strict=True):
        inside = np.zeros((one.left.shape[1], common.shape[1]))
        for _ in range(2 if len(inside) else 0):  # the second time takes what rounding has left
            part = one.left.T @ common[rows]
            common[rows] -= one.left @ part
            inside += part
        back.append(one.turn @ inside)
    return common, back


def _not_held(held: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Orthonormal directions (n, f), in scaled unknowns, along which none of the rows ``held`` changes."""
    _, size, turn = np.linalg.svd(held / scale)
    free: np.ndarray = turn[int((size > 1e-10 * size.max()).sum()) :].T
    return np.where(np.abs(free) > 1e-13, free, 0.0)  # what is held has no error at all, not one of rounding


def spectrum(rows: np.ndarray, weight: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (q,), from the least, and eigenvectors (q, q) of T'(RR' + W)T, for rows R (p, N) and T (p, q).

    Where some are so small that forming the product has lost them, they are found from factors instead.
    """
    values, vectors = np.linalg.eigh(turn.T @ (product(rows, rows.T) + weight) @ turn)
    if not len(values) or values[0] > SUSPECT * values[-1]:
        return values, vectors
    sizes, own = np.linalg.eigh(weight)
    factor = np.linalg.qr((own * np.sqrt(np.maximum(sizes, 0.0))).T @ turn, mode="r")
    for first in range(0, rows.shape[1], PIECE):
        factor = np.linalg.qr(np.vstack([factor, rows[:, first : first + PIECE].T @ turn]), mode="r")
    _, sizes, turned = np.linalg.svd(factor)
    return sizes[::-1] ** 2, turned[::-1].T
