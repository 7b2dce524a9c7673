"""Cross-validation: losses on held-out time blocks, computed without refitting the model."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.inner_products import product, square
from tsmblocks.fitting.residuals import Problem

TARGET_BLOCK_COUNT = 72
"""Time blocks into which all experiments together are cut, about. Source: the method's prototype, in which 72 blocks
gave sets of indistinguishable effects with 1.2 to 3.6 members, and 8 blocks useless ones."""
MIN_BLOCK_SAMPLES = 40
"""Samples of a time block at least. Chosen: a block must be longer than the autocorrelation of the noise."""
FOLD_COUNT = 10
"""Cross-validation folds. Source: Hastie et al., The Elements of Statistical Learning (2009), 7.10: five or ten."""
REGULARIZATION = 1e-7
"""Ridge on the scaled normal equations (their diagonal is 1), for directions that only the held-out fold determines.
Chosen: far above rounding, far below the weight of the data."""


@attrs.frozen(eq=False)
class TimeBlocks:
    """The time block, fold and experiment of each residual (N,); ``sizes`` (B,) are the residuals in each block."""

    block: np.ndarray
    fold: np.ndarray
    experiment: np.ndarray
    sizes: np.ndarray

    def losses(self, r: np.ndarray) -> np.ndarray:
        """Mean square of the residual ``r`` (N,) in each block, shape (B,)."""
        return np.bincount(self.block, r * r, len(self.sizes)) / self.sizes


def time_blocks(problem: Problem) -> TimeBlocks:
    """Cut all experiments into time blocks of about the same length; each fold takes blocks from every experiment."""
    count = problem.experiments[0].measured.shape[1]
    total = sum(len(experiment.t) for experiment in problem.experiments)
    length = max(total / TARGET_BLOCK_COUNT, MIN_BLOCK_SAMPLES)
    blocks, experiments, first = [], [], 0
    for e, experiment in enumerate(problem.experiments):
        own = max(1, round(len(experiment.t) / length))
        number = first + np.arange(len(experiment.t)) * own // len(experiment.t)
        blocks += [number] * count
        experiments += [np.full(len(experiment.t), e)] * count
        first += own
    block = np.concatenate(blocks)
    return TimeBlocks(
        block, block % min(FOLD_COUNT, first), np.concatenate(experiments), np.bincount(block).astype(float)
    )


def held_out_residuals(model: Model, fold: np.ndarray, ridge: np.ndarray, null: np.ndarray) -> np.ndarray:
    r"""Residuals (N,) of each fold by the model fitted to all others, to first order.

    .. math:: r_g - J_g (H - H_g + \Lambda)^{-1} (J^T r - J_g^T r_g + \Lambda (\theta - \theta_0))

    ``fold`` (N,) numbers the folds; ``ridge`` (n,) is the diagonal of :math:`\Lambda`, which shrinks an effect to
    ``null`` (n,) where only the held-out fold excites it: without it the step would grow without bound. A step longer
    than the size of an effect, beyond which the model is not linear, is shortened. Of the unknowns of single
    experiments those of effects (with a ridge) are held out as well: otherwise an effect with a size in each would be
    judged on the samples it was fitted to.

    They are no smaller than those of the fit: to first order an initial state at its bound would move beyond it.
    """
    columns, J = _held_out_columns(model, (~model.is_local | (ridge > 0)) & ~model.at_bound)
    r, ridge, null, theta = model.r, ridge[columns], null[columns], model.theta[columns]
    size = np.sqrt(np.einsum("ij,ij->j", J, J))
    size = np.where(size > 0, size, 1.0)
    scaled, diagonal = J / size, ridge / size**2 + REGULARIZATION
    ridge_gradient = ridge * (theta - null) / size
    rows = np.ascontiguousarray(scaled.T)
    H, gradient = product(rows, scaled) + np.diag(diagonal), rows @ r
    result = np.empty_like(r)
    for g in range(int(fold.max()) + 1):
        held_out = fold == g
        own = scaled[held_out]
        step = np.linalg.solve(H - own.T @ own, own.T @ r[held_out] - gradient - ridge_gradient)
        relative_length = float(np.max(np.abs(step) / size * np.sqrt(ridge), initial=0.0))
        result[held_out] = r[held_out] + own @ (step / max(relative_length, 1.0))
    return result * np.sqrt(max(square(r) / max(square(result), 1e-300), 1.0))


def projected_jacobian(model: Model) -> np.ndarray:
    """Jacobian (N, m) by the parameters common to all experiments, with those of single experiments projected out.

    Initial states belong to one experiment and are determined by its first samples, so they are never held out.
    """
    return without_initial_states(model, model.J.common)


def without_initial_states(model: Model, columns: np.ndarray) -> np.ndarray:
    """Columns (N, m) with the columns of the unknowns of single experiments projected out."""
    return _projected(model, columns, np.zeros(len(model.theta), dtype=bool))


def _held_out_columns(model: Model, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The unknowns ``held`` (n,) as indices (m,), and their columns (N, m) with all other own columns projected out."""
    common = held[model.J.common_columns]
    indices, columns = [model.J.common_columns[common]], [model.J.common[:, common]]
    for block in model.J.own_blocks():
        own = held[block.columns]
        if own.any():
            wide = np.zeros((len(model.r), int(own.sum())))
            wide[block.rows] = block.values[:, own]
            indices.append(block.columns[own])
            columns.append(wide)
    return np.concatenate(indices), _projected(model, np.concatenate(columns, axis=1), held)


def _projected(model: Model, columns: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Columns (N, m) with the columns of single experiments projected out, but for those of unknowns ``held`` (n,)."""
    result = columns.copy()
    for block in model.J.own_blocks():
        others = block.values[:, ~held[block.columns]]
        if others.size:
            left_vectors, size, _ = np.linalg.svd(others, full_matrices=False)
            basis = left_vectors[:, size > 1e-9 * max(float(size.max()), 1e-300)]
            result[block.rows] -= basis @ (basis.T @ result[block.rows])
    return result
