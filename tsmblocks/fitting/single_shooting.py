"""Fits by IPOPT with one shot per experiment: constraints with their true curvature, costs from the engine."""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.fitting.ipopt import Box, Point, solve
from tsmblocks.fitting.optimizer import OptimizerResult, ProgressCallback
from tsmblocks.fitting.residuals import Problem

SIZE = 100.0
"""A sensible change of an unknown, in changes that move all outputs by one unit. Chosen."""


@attrs.frozen(eq=False)
class _Shot:
    """A problem as IPOPT sees it."""

    problem: Problem
    bend: Any  # (unknowns, forces) -> second derivatives of the constraints

    def point(self, z: np.ndarray) -> Point:
        limits = self.problem.constraints
        return Point(*self.problem.normal(z), limits.values(z), limits.slopes(z))

    def curve(self, z: np.ndarray, forces: np.ndarray) -> np.ndarray:
        return np.asarray(self.bend(z, forces))


def interior_point(
    problem: Problem, start: np.ndarray, *, iterations: int = 200, tell: ProgressCallback | None = None
) -> OptimizerResult:
    """Search with IPOPT from ``start``, which must be in the bounds and simulate to finite numbers.

    After Ctrl-C, or when the solver gives up between the constraints, the best so far is returned.
    """
    unknowns, target = problem.unknowns, _Shot(problem, bending(problem))
    cost, _, matrix = problem.normal(start)
    box = Box(unknowns.low, unknowns.high, problem.constraints.equal, sizes(matrix, start))
    scale = max(problem.samples, 1) / max(2 * cost, 1e-300)
    ended = solve(target, start, box, scale=scale, iterations=iterations, tell=tell)
    cost, best, status = problem.cost(ended.z), problem.cost(ended.best), ended.status
    if problem.violation(ended.z) > 1e-6 * (1 + np.abs(ended.z).max()) or (best < cost and status != "converged"):
        ended, cost = attrs.evolve(ended, z=ended.best), best
        status = "stalled" if status == "converged" else status
    return OptimizerResult(ended.z, cost, status, ended.iterations, ended.evaluations, ended.history)


def bending(problem: Problem) -> Any:
    """The second derivatives of the constraints as a function of unknowns and forces."""
    z, forces = ca.SX.sym("z", len(problem.unknowns.items)), ca.SX.sym("forces", len(problem.constraints.names))
    weighted = ca.dot(forces, problem.constraints.symbolic(z)) if problem.constraints.names else ca.SX(0)
    return ca.Function("bend", [z, forces], [ca.densify(ca.hessian(weighted, z)[0])])


def sizes(matrix: np.ndarray, start: np.ndarray) -> np.ndarray:
    """A sensible change of each unknown, by what the outputs feel of it."""
    feel = np.sqrt(np.diag(matrix))
    return np.where(feel > 0, SIZE / np.where(feel > 0, feel, 1), np.maximum(np.abs(start), 1))
