"""The step of a Gauss-Newton method: a small strictly convex quadratic program, solved by CasADi's DAQP."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from tsmblocks.common.errors import RunError

TOLERANCE = 1e-10
"""A constraint violated by less counts as met, relative to its bound and to the unconstrained step (no unit).

Chosen: below it DAQP sees rounding, since its rows are divided by their norms.
"""
SINGULAR = 1e-15
"""Smallest eigenvalue of a matrix relative to its largest (no unit). Chosen: anything less is rounding."""
CONDITION = 1e-8
"""As ``SINGULAR``, where constraints are active.

Chosen: DAQP identified the active set of 5,000 random programs down to 1e-9, and failed on some from 1e-10 on.
"""


class Infeasible(RunError):
    """No point satisfies all constraints of a step."""


def quadratic_step(
    matrix: np.ndarray, gradient: np.ndarray, rows: np.ndarray, bounds: np.ndarray, equal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    r"""Minimise a strictly convex quadratic function under linear constraints: step d (n,) and multipliers (m,).

    .. math:: \min_d \tfrac12 d^T H d + g^T d \quad\text{subject to}\quad R d \ge b

    H is ``matrix`` (n, n), g ``gradient`` (n,), R ``rows`` (m, n), b ``bounds`` (m,); rows that are ``equal`` (m,) hold
    with equality, and multipliers of the others are at least 0. Without an active constraint this is the Newton step.
    Otherwise DAQP (CasADi) finds the active set, on which the step is then solved for again: near a singular H the
    solver alone loses half of the digits. Raises Infeasible if no step meets all constraints.
    Source: Arnström, Bemporad and Axehill, IEEE Trans. Autom. Control 67 (2022) 4362 (DAQP).
    """
    values, vectors = np.linalg.eigh(matrix)
    newton = -(vectors / np.maximum(values, SINGULAR * values[-1]) @ vectors.T) @ gradient
    multipliers = np.zeros(len(bounds))
    if not _violated(newton, rows, bounds, equal).any():
        return newton, multipliers
    lifted = matrix + max(0.0, CONDITION * values[-1] - values[0]) * np.eye(len(gradient))
    active = _active_set(lifted, gradient, rows, bounds, equal)
    step, multipliers[active] = _on_active_set(lifted, gradient, rows[active], bounds[active])
    if _violated(step, rows, bounds, equal).any():
        raise Infeasible("no step meets all constraints at once.")
    return step, multipliers


def reduced_step(
    matrix: np.ndarray,
    gradient: np.ndarray,
    rows: np.ndarray,
    bounds: np.ndarray,
    equal: np.ndarray,
    own: Sequence[np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """``quadratic_step`` of an arrowhead matrix: the unknowns ``own[e]`` meet none of ``own[f]`` in it.

    Those that no constraint limits are eliminated, one group after the other (Schur complement).
    Source: Nocedal and Wright, Numerical Optimization (2006), 10.3.
    """
    limited = np.any(rows != 0, axis=0)
    groups = [free for columns in own if len(free := columns[~limited[columns]])]
    if not groups:
        return quadratic_step(matrix, gradient, rows, bounds, equal)
    kept = np.ones(len(gradient), dtype=bool)
    kept[np.concatenate(groups)] = False
    if not kept.any():
        kept[groups.pop()] = True
    reduced, slope, largest = matrix[np.ix_(kept, kept)], gradient[kept], float(np.diag(matrix).max())
    solved = []
    for columns in groups:
        values, vectors = np.linalg.eigh(matrix[np.ix_(columns, columns)])
        border = np.concatenate([matrix[columns][:, kept], gradient[columns, None]], axis=1)
        turned = vectors.T @ border / np.sqrt(np.maximum(values, SINGULAR * largest))[:, None]
        reduced = reduced - turned[:, :-1].T @ turned[:, :-1]
        slope = slope - turned[:, :-1].T @ turned[:, -1]
        solved.append((vectors / np.sqrt(np.maximum(values, SINGULAR * largest)), turned))
    step = np.zeros(len(gradient))
    step[kept], multipliers = quadratic_step(reduced, slope, rows[:, kept], bounds, equal)
    for columns, (vectors, turned) in zip(groups, solved, strict=True):
        step[columns] = -vectors @ (turned[:, -1] + turned[:, :-1] @ step[kept])
    return step, multipliers


def _violated(step: np.ndarray, rows: np.ndarray, bounds: np.ndarray, equal: np.ndarray) -> np.ndarray:
    """Which constraints a step misses by more than rounding."""
    slack = rows @ step - bounds
    missed = np.where(equal, np.abs(slack), -slack)
    return ~(missed <= TOLERANCE * (np.abs(rows) @ np.abs(step) + np.abs(bounds)))  # NaN counts as missed


def _active_set(
    matrix: np.ndarray, gradient: np.ndarray, rows: np.ndarray, bounds: np.ndarray, equal: np.ndarray
) -> list[int]:
    """Linearly independent constraints that are active at the solution, by DAQP.

    The equalities are eliminated before: where they leave a single direction, on which bounds touch, DAQP took a
    program that a point satisfies for infeasible. Its tolerance is not relative: of rows that are much shorter than 1
    it sees no violation. All have norm 1 here.
    """
    norms = np.linalg.norm(rows, axis=1)
    norms[norms == 0] = 1.0
    rows, bounds = rows / norms[:, None], bounds / norms
    held = _independent(rows, np.flatnonzero(equal))
    basis, triangle = np.linalg.qr(rows[held].T, mode="complete")
    fixed, free = basis[:, : len(held)], basis[:, len(held) :]
    start = fixed @ np.linalg.solve(triangle[: len(held)].T, bounds[held])
    across = rows @ free
    norms = np.linalg.norm(across, axis=1)
    limits = np.flatnonzero(~equal & (norms > TOLERANCE))
    if not len(limits):
        return list(held)
    scale = norms[limits, None]
    left = (bounds - rows @ start)[limits] / scale[:, 0]
    try:
        solved = _solver(len(limits), free.shape[1])(
            h=free.T @ matrix @ free, g=free.T @ (gradient + matrix @ start), a=across[limits] / scale, lba=left
        )
    except RuntimeError:
        raise Infeasible("no step meets all constraints at once.") from None
    return [*held, *limits[np.asarray(solved["lam_a"]).ravel() != 0]]


def _independent(rows: np.ndarray, which: np.ndarray) -> np.ndarray:
    """As many of some rows as are linearly independent: an equality that others imply has no multiplier."""
    if len(which) < 2:
        return which[rows[which].any(axis=1)]
    from scipy.linalg import qr

    triangle, order = qr(rows[which].T, mode="r", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    return which[order[: np.count_nonzero(sizes > TOLERANCE * sizes[0])]]


@functools.cache
def _solver(constraints: int, unknowns: int) -> Any:
    """DAQP for programs of a shape."""
    import casadi as ca

    shapes = {"h": ca.Sparsity.dense(unknowns, unknowns), "a": ca.Sparsity.dense(constraints, unknowns)}
    return ca.conic("step", "daqp", shapes, {"daqp": {"primal_tol": TOLERANCE}, "print_time": False})


def _on_active_set(
    matrix: np.ndarray, gradient: np.ndarray, rows: np.ndarray, bounds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The step with linearly independent constraints held, and their multipliers, by the null space of the rows."""
    basis, triangle = np.linalg.qr(rows.T, mode="complete")
    held, free = basis[:, : len(rows)], basis[:, len(rows) :]
    triangle = triangle[: len(rows)]
    step = held @ np.linalg.solve(triangle.T, bounds)
    step = step - free @ np.linalg.solve(free.T @ matrix @ free, free.T @ (gradient + matrix @ step))
    return step, np.linalg.solve(triangle, held.T @ (gradient + matrix @ step))
