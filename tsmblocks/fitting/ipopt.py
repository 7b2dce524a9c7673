"""Fits by IPOPT through CasADi, each experiment in one piece; and the solver, which multiple shooting uses too.

Cost, gradient and Gauss-Newton matrix come from the compiled simulation, so nothing is differentiated numerically and
no simulation becomes a graph of expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common.interrupt import without_checkpoints
from tsmblocks.fitting.optimizer import OptimizerResult, ProgressCallback, no_progress
from tsmblocks.fitting.residuals import Problem

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "show_eval_warnings": False,
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "ipopt.tol": 1e-9,
    "ipopt.acceptable_tol": 1e-7,
    "ipopt.nlp_scaling_method": "none",
    "ipopt.bound_relax_factor": 0.0,
    "error_on_fail": False,
}
"""Options of CasADi and IPOPT. Chosen: silent; tolerances far below any standard error at costs scaled to the number of
samples; and no relaxed bounds, beyond which a simulation may be impossible."""
FEASIBLE = 1e-7
"""Constraint violation up to which an iterate may be the best. Chosen: that of IPOPT's acceptable tolerance."""
CHANGE = 100.0
"""Scale of an unknown, in changes that move all outputs by one unit. Chosen."""


@attrs.frozen(eq=False)
class Point:
    """A program at one place: cost, gradient (n,), matrix (n, n), constraint values (m,) and Jacobian (m, n)."""

    cost: float
    gradient: np.ndarray
    matrix: np.ndarray
    values: np.ndarray
    jacobian: np.ndarray


@attrs.frozen(eq=False)
class Program:
    """A nonlinear program: the least cost within bounds (n,), with values >= 0, or = 0 where ``equal`` (m,).

    ``point`` evaluates it, ``curvature`` gives the second derivatives (n, n) of the constraints weighted by multipliers
    (m,). ``size`` (n,) scales the variables, and costs are scaled to the number of ``samples`` at the start.
    """

    point: Callable[[np.ndarray], Point]
    curvature: Callable[[np.ndarray, np.ndarray], np.ndarray]
    low: np.ndarray
    high: np.ndarray
    equal: np.ndarray
    size: np.ndarray
    samples: int


@attrs.frozen(eq=False)
class Solved:
    """Where the solver ended: ``word`` is its own for why, ``stopped`` says that Ctrl-C did.

    ``best`` is the feasible iterate of the lowest cost, ``last`` the latest iterate.
    """

    z: np.ndarray
    best: np.ndarray
    last: np.ndarray
    word: str
    iterations: int
    evaluations: int
    history: tuple[float, ...]
    stopped: bool

    @property
    def status(self) -> str:
        """The status as other searches name it."""
        if self.stopped:
            return "interrupted"
        if self.word in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return "converged"
        return "limit" if self.word == "Maximum_Iterations_Exceeded" else "stalled"


class _Function(ca.Callback):
    """A numeric function for the solver, with dense arguments and sparsities of its results."""

    def __init__(self, name: str, shapes: list[tuple[int, int]], results: list[Any], compute: Any) -> None:
        ca.Callback.__init__(self)
        self.shapes, self.results, self.compute = shapes, results, compute
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.shapes)

    def get_n_out(self) -> int:
        return len(self.results)

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense(*self.shapes[k])

    def get_sparsity_out(self, k: int) -> Any:
        return self.results[k]

    def eval(self, given: Any) -> list[Any]:
        return [ca.DM(v) for v in self.compute(*(np.asarray(g) for g in given))]


class _Evaluator:
    """A program in the solver's scale: the last point, the iterates, the best of them, and whether to stop."""

    def __init__(self, program: Program, start: np.ndarray, first: Point, progress: ProgressCallback) -> None:
        self.program, self.progress = program, progress
        self.scale = max(program.samples, 1) / max(2 * first.cost, 1e-300)
        self.z = self.best = self.last = start
        self.point, self.lowest, self.stop = first, first.cost, False
        self.evaluations, self.history = 2, [first.cost]

    def at(self, scaled: np.ndarray) -> Point:
        """The program at a place, computed once. Ctrl-C is kept, and ends the search at the next iteration."""
        z = np.clip(scaled.ravel() * self.program.size, self.program.low, self.program.high)
        if not np.array_equal(z, self.z) and not self.stop:
            try:
                self.point, self.z = self.program.point(z), z
                self.evaluations += 2
            except KeyboardInterrupt:
                self.stop = True
        return self.point

    def cost(self, x: Any, _: Any) -> list[Any]:
        return [self.scale * self.at(x).cost]

    def gradient(self, x: Any, _: Any) -> list[Any]:
        point = self.at(x)
        return [self.scale * point.cost, self.scale * point.gradient * self.program.size]

    def constraints(self, x: Any) -> list[Any]:
        return [self.at(x).values]

    def jacobian(self, x: Any, _: Any) -> list[Any]:
        point = self.at(x)
        return [point.values, point.jacobian * self.program.size]

    def matrix(self, x: Any, _: Any, weight: Any, multipliers: Any) -> list[Any]:
        point, size = self.at(x), self.program.size
        curvature = self.program.curvature(self.z, multipliers.ravel())
        whole = float(np.ravel(weight)[0]) * self.scale * point.matrix + curvature
        return [ca.triu(ca.DM(whole * np.outer(size, size)))]

    def iteration(self, x: Any, *_: Any) -> list[Any]:
        point = self.at(x)
        violations = np.where(self.program.equal, np.abs(point.values), -np.minimum(point.values, 0.0))
        if point.cost <= self.lowest and violations.max(initial=0.0) <= FEASIBLE:
            self.best, self.lowest = self.z, point.cost
        self.history.append(point.cost)
        self.last = self.z
        try:
            self.progress("ipopt", self.evaluations, point.cost)
        except KeyboardInterrupt:
            self.stop = True
        return [float(self.stop)]


def solve(program: Program, start: np.ndarray, first: Point, *, iterations: int, progress: ProgressCallback) -> Solved:
    """Search from ``start``, where the program is ``first``."""
    evaluator, n, m = _Evaluator(program, start, first, progress), len(start), len(program.equal)
    one, column, values = (ca.Sparsity.dense(k, 1) for k in (1, n, m))
    upper, wide = ca.Sparsity.upper(n), ca.Sparsity.dense(m, n)
    f = _Function("cost", [(n, 1), (0, 0)], [one], evaluator.cost)
    g = _Function("constraints", [(n, 1)], [values], evaluator.constraints)
    state = [(n, 1), (1, 1), (m, 1), (n, 1), (m, 1), (0, 1)]
    functions: dict[str, Any] = {
        "grad_f": _Function("grad_f", [(n, 1), (0, 0)], [one, column], evaluator.gradient),
        "jac_g": _Function("jac_g", [(n, 1), (0, 0)], [values, wide], evaluator.jacobian),
        "hess_lag": _Function("hess_lag", [(n, 1), (0, 0), (1, 1), (m, 1)], [upper], evaluator.matrix),
        "iteration_callback": _Function("iteration", state, [one], evaluator.iteration),
    }
    x, rest = ca.MX.sym("x", n), ca.MX.sym("p", 0, 0)
    task: Any = {"x": x, "f": f(x, rest), "g": g(x) if m else ca.MX(0, 1)}
    solver = ca.nlpsol("fit", "ipopt", task, {**OPTIONS, **functions, "ipopt.max_iter": iterations})
    size, upper_values = program.size, np.where(program.equal, 0.0, np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        answer = solver(
            x0=start / size, lbx=program.low / size, ubx=program.high / size, lbg=np.zeros(m), ubg=upper_values
        )
    ended = np.clip(np.asarray(answer["x"]).ravel() * size, program.low, program.high)
    stats = solver.stats()
    return Solved(
        evaluator.best if evaluator.stop else ended,
        evaluator.best,
        evaluator.last,
        str(stats["return_status"]),
        int(stats["iter_count"]),
        evaluator.evaluations,
        tuple(evaluator.history),
        evaluator.stop,
    )


def interior_point(
    problem: Problem, start: np.ndarray, *, iterations: int = 200, progress: ProgressCallback = no_progress
) -> OptimizerResult:
    """Search with IPOPT from ``start``, which must be in the bounds and simulate to finite numbers.

    After Ctrl-C, or when the solver gives up between the constraints, the best so far is returned.
    """
    unknowns, constraints = problem.unknowns, problem.constraints

    def point(z: np.ndarray) -> Point:
        return Point(*problem.normal(z), constraints.values(z), constraints.jacobian(z))

    first, curvature = point(start), constraint_curvature(problem)
    size = sizes(first.matrix, start)
    program = Program(point, curvature, unknowns.low, unknowns.high, constraints.equal, size, problem.samples)
    ended = solve(program, start, first, iterations=iterations, progress=progress)
    with without_checkpoints():
        cost, best, status = problem.cost(ended.z), problem.cost(ended.best), ended.status
    if problem.violation(ended.z) > 1e-6 * (1 + np.abs(ended.z).max()) or (best < cost and status != "converged"):
        ended, cost = attrs.evolve(ended, z=ended.best), best
        status = "stalled" if status == "converged" else status
    return OptimizerResult(ended.z, cost, status, ended.iterations, ended.evaluations, ended.history)


def constraint_curvature(problem: Problem) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The second derivatives of the constraints as a function of unknowns and multipliers."""
    z, weights = ca.SX.sym("z", len(problem.unknowns.items)), ca.SX.sym("weights", len(problem.constraints.names))
    weighted = ca.dot(weights, problem.constraints.symbolic(z)) if problem.constraints.names else ca.SX(0)
    hessian = ca.Function("hessian", [z, weights], [ca.densify(ca.hessian(weighted, z)[0])])
    return lambda theta, multipliers: np.asarray(hessian(theta, multipliers))


def sizes(matrix: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Scale of each unknown, by how much the outputs depend on it."""
    sensitivity = np.sqrt(np.diag(matrix))
    scale = CHANGE / np.where(sensitivity > 0, sensitivity, 1)
    return np.where(sensitivity > 0, scale, np.maximum(np.abs(start), 1))
