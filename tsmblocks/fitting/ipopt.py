"""IPOPT through CasADi around numeric functions: what single and multiple shooting share.

The solver is handed cost, gradient and Gauss-Newton matrix as they come from the engine's lanes, so
nothing is differentiated numerically and no simulation becomes a graph of expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import attrs
import casadi as ca
import numpy as np

from tsmblocks.fitting.optimizer import ProgressCallback

OPTIONS = {
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


@attrs.frozen(eq=False)
class Point:
    """What is known at one place: cost, gradient (n,), matrix (n, n), constraints (m,) and their slopes (m, n)."""

    cost: float
    gradient: np.ndarray
    matrix: np.ndarray
    values: np.ndarray
    slopes: np.ndarray


class Target(Protocol):
    """What is to be made least."""

    def point(self, z: np.ndarray) -> Point:
        """Everything at ``z``; a cost that is not finite makes the solver step back."""
        ...

    def curve(self, z: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Second derivatives of the constraints, weighted by ``forces`` (m,), shape (n, n)."""
        ...


@attrs.frozen(eq=False)
class Box:
    """Bounds (n,), which constraints are equalities (m,), and the size of a sensible change of each variable (n,)."""

    low: np.ndarray
    high: np.ndarray
    equal: np.ndarray
    size: np.ndarray


@attrs.frozen(eq=False)
class Solved:
    """Where the solver ended: ``word`` is its own for why, ``stopped`` says that Ctrl-C did.

    ``best`` is the best place met on the way that meets the constraints, ``last`` the latest iterate.
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
        """The word in the terms of a search."""
        if self.stopped:
            return "interrupted"
        if self.word in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return "converged"
        return "limit" if self.word == "Maximum_Iterations_Exceeded" else "stalled"


class _Watched(ca.Callback):
    """A numeric function for a solver."""

    def __init__(self, name: str, take: list[tuple[int, int]], give: list[Any], compute: Callable[..., Any]) -> None:
        ca.Callback.__init__(self)
        self.take, self.give, self.compute = take, give, compute
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.take)

    def get_n_out(self) -> int:
        return len(self.give)

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense(*self.take[k])

    def get_sparsity_out(self, k: int) -> Any:
        return self.give[k]

    def eval(self, given: Any) -> list[Any]:
        return [ca.DM(v) for v in self.compute(*(np.asarray(g) for g in given))]


class _Memo:
    """The last point asked for, the best point met so far, and whether to stop. In the solver's own scale."""

    def __init__(
        self, target: Target, start: np.ndarray, box: Box, scale: float, tell: ProgressCallback | None
    ) -> None:
        self.target, self.box, self.scale, self.tell = target, box, scale, tell
        self.z, self.last = start, target.point(start)
        self.best, self.least, self.stop = start, self.last.cost, False
        self.latest = start
        self.evaluations, self.history = 2, [self.last.cost]

    def at(self, scaled: np.ndarray) -> Point:
        """Everything at a place, computed once. Ctrl-C is kept, and ends the search at the next iteration."""
        z = np.clip(scaled.ravel() * self.box.size, self.box.low, self.box.high)
        if not np.array_equal(z, self.z) and not self.stop:
            try:
                self.last, self.z = self.target.point(z), z
                self.evaluations += 2
            except KeyboardInterrupt:
                self.stop = True
        return self.last

    def cost(self, x: Any, _: Any) -> list[Any]:
        return [self.scale * self.at(x).cost]

    def gradient(self, x: Any, _: Any) -> list[Any]:
        found = self.at(x)
        return [self.scale * found.cost, self.scale * found.gradient * self.box.size]

    def constraints(self, x: Any) -> list[Any]:
        return [self.at(x).values]

    def slopes(self, x: Any, _: Any) -> list[Any]:
        found = self.at(x)
        return [found.values, found.slopes * self.box.size]

    def matrix(self, x: Any, _: Any, weight: Any, forces: Any) -> list[Any]:
        found, size = self.at(x), self.box.size
        whole = float(np.ravel(weight)[0]) * self.scale * found.matrix + self.target.curve(self.z, forces.ravel())
        return [ca.triu(ca.DM(whole * np.outer(size, size)))]

    def told(self, x: Any, *_: Any) -> list[Any]:
        found = self.at(x)
        missed = np.where(self.box.equal, np.abs(found.values), -np.minimum(found.values, 0.0))
        if found.cost <= self.least and missed.max(initial=0.0) <= 1e-7:
            self.best, self.least = self.z, found.cost
        self.history.append(found.cost)
        self.latest = self.z
        try:
            if self.tell is not None:
                self.tell("ipopt", self.evaluations, found.cost)
        except KeyboardInterrupt:
            self.stop = True
        return [float(self.stop)]


def solve(
    target: Target, start: np.ndarray, box: Box, *, scale: float, iterations: int, tell: ProgressCallback | None = None
) -> Solved:
    """Search from ``start``; ``scale`` is the factor that makes costs of the order of the number of samples."""
    memo, n, m = _Memo(target, start, box, scale, tell), len(start), len(box.equal)
    one, tall, wide = ca.Sparsity.dense(1, 1), ca.Sparsity.dense(n, 1), ca.Sparsity.dense(m, n)
    f = _Watched("cost", [(n, 1), (0, 0)], [one], memo.cost)
    g = _Watched("limits", [(n, 1)], [ca.Sparsity.dense(m, 1)], memo.constraints)
    helpers = {
        "grad_f": _Watched("grad_f", [(n, 1), (0, 0)], [one, tall], memo.gradient),
        "jac_g": _Watched("jac_g", [(n, 1), (0, 0)], [ca.Sparsity.dense(m, 1), wide], memo.slopes),
        "hess_lag": _Watched("hess_lag", [(n, 1), (0, 0), (1, 1), (m, 1)], [ca.Sparsity.upper(n)], memo.matrix),
        "iteration_callback": _Watched("told", [(n, 1), (1, 1), (m, 1), (n, 1), (m, 1), (0, 1)], [one], memo.told),
    }
    x, rest = ca.MX.sym("x", n), ca.MX.sym("p", 0, 0)
    options: dict[str, Any] = {**OPTIONS, **helpers, "ipopt.max_iter": iterations}
    task: Any = {"x": x, "f": f(x, rest), "g": g(x) if m else ca.MX(0, 1)}
    solver = ca.nlpsol("fit", "ipopt", task, options)
    with np.errstate(over="ignore", invalid="ignore"):
        answer = solver(
            x0=start / box.size,
            lbx=box.low / box.size,
            ubx=box.high / box.size,
            lbg=np.zeros(m),
            ubg=np.where(box.equal, 0.0, np.inf),
        )
    z = memo.best if memo.stop else np.clip(np.asarray(answer["x"]).ravel() * box.size, box.low, box.high)
    stats = solver.stats()
    return Solved(
        z,
        memo.best,
        memo.latest,
        str(stats["return_status"]),
        int(stats["iter_count"]),
        memo.evaluations,
        tuple(memo.history),
        memo.stop,
    )
