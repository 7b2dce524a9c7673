"""Losses on parts held out, by blocks of time: what a model leaves where it was not fitted, without fitting it anew."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.inner_products import product
from tsmblocks.fitting.residuals import Problem

BLOCKS = 72
"""Blocks of time that all experiments are cut into, about; each much longer than the noise remembers."""
FEWEST = 40
"""Samples of a block at least."""
FOLDS = 10
"""Parts held out in turn; each takes blocks from every experiment."""
FIRM = 1e-7
"""Weight, beside that of the data, that holds what a held-out part alone determines."""


@attrs.frozen(eq=False)
class TimeBlocks:
    """Which block, fold and experiment each difference (N,) belongs to; ``sizes`` (B,) are differences per block."""

    block: np.ndarray
    fold: np.ndarray
    experiment: np.ndarray
    sizes: np.ndarray

    def losses(self, r: np.ndarray) -> np.ndarray:
        """Mean square of what is left in each block, shape (B,)."""
        return np.bincount(self.block, r * r, len(self.sizes)) / self.sizes


def time_blocks(problem: Problem) -> TimeBlocks:
    """Cut all experiments into blocks of about the same length."""
    count = problem.trials[0].measured.shape[1]
    total = sum(len(trial.t) for trial in problem.trials)
    length = max(total / BLOCKS, FEWEST)
    blocks, experiments, first = [], [], 0
    for e, trial in enumerate(problem.trials):
        own = max(1, round(len(trial.t) / length))
        number = first + np.arange(len(trial.t)) * own // len(trial.t)
        blocks += [number] * count
        experiments += [np.full(len(trial.t), e)] * count
        first += own
    block = np.concatenate(blocks)
    return TimeBlocks(block, block % min(FOLDS, first), np.concatenate(experiments), np.bincount(block).astype(float))


def held_out_residuals(model: Model, part: np.ndarray, pull: np.ndarray, null: np.ndarray) -> np.ndarray:
    r"""What is left (N,) of each part by the model fitted to all others, to first order.

    .. math:: r_g - J_g (H - H_g + \Lambda)^{-1} (J^T r - J_g^T r_g + \Lambda (\theta - \theta_0))

    ``part`` (N,) numbers the parts; ``pull`` (n,) is the diagonal of :math:`\Lambda`, which draws an effect back to
    ``null`` (n,) where only the part held out shows it; without it leaving out the only such part would explode. A step
    longer than one of these sizes, beyond which nothing is linear, is cut short.
    """
    own = ~model.is_local & ~model.at_bound
    J, r = projected_jacobian(model)[:, ~model.at_bound[~model.is_local]], model.r
    pull, null, theta = pull[own], null[own], model.theta[own]
    size = np.sqrt(np.einsum("ij,ij->j", J, J))
    size = np.where(size > 0, size, 1.0)
    scaled, soft = J / size, pull / size**2 + FIRM
    force = pull * (theta - null) / size
    rows = np.ascontiguousarray(scaled.T)
    H, slope = product(rows, scaled) + np.diag(soft), rows @ r
    made = np.empty_like(r)
    for g in range(int(part.max()) + 1):
        held = part == g
        own = scaled[held]
        step = np.linalg.solve(H - own.T @ own, own.T @ r[held] - slope - force)
        farthest = float(np.max(np.abs(step) / size * np.sqrt(pull), initial=0.0))
        made[held] = r[held] + own @ (step / max(farthest, 1.0))
    return made


def projected_jacobian(model: Model) -> np.ndarray:
    """Derivatives (N, m) by the unknowns of all experiments, less what those of one experiment take up.

    Start values belong to their experiment: only its first samples tell them, so they are never held out.
    """
    return without_initial_states(model, model.J[:, ~model.is_local])


def without_initial_states(model: Model, columns: np.ndarray) -> np.ndarray:
    """Columns (N, m) less what the unknowns of each one experiment take up of them."""
    trials, segments, local = model.problem.trials, model.problem.segments, model.is_local
    made = columns.copy()
    count = trials[0].measured.shape[1]
    for e in range(len(trials)):
        rows = slice(segments[e * count].start, segments[(e + 1) * count - 1].stop)
        own = [k for k in model.problem.unknowns.columns(e) if local[k]]
        if not own:
            continue
        turn, size, _ = np.linalg.svd(model.J[rows][:, own], full_matrices=False)
        basis = turn[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
        made[rows] -= basis @ (basis.T @ made[rows])
    return made
