"""One step of an implicit method as equations: the states at each stage are signals that depend on themselves.

The states of a stage solve X = x + h (a_1 k_1 + ... + gamma f(t, X)), an algebraic loop like any other: what is linear
in itself is eliminated when the kernel is made (for a linear plant a factorisation that depends on parameters alone, so
that substitution is all that is left in the run), the rest is solved by Newton's method with the exact Jacobian. Loops
of the diagram are solved together with the states. What is solved for is X - x, so that the last step is a good start.
"""

from __future__ import annotations

import functools
from typing import Any

import attrs
import casadi as ca

from tsmblocks.common.errors import RunError
from tsmblocks.engine.closure import Closure, Tear
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.loops import Loop, solved_loops
from tsmblocks.engine.methods import Method
from tsmblocks.engine.program import Program

ADVANCE = (["t", "h", "x", "d", "u", "q", "p", "guess"], ["x_next", "roots"])
"""Arguments and results of a step; ``t``, ``u`` and ``q`` are those of all instants of the method."""


@attrs.frozen(eq=False)
class StepMap:
    """A step of an implicit method: ``plain`` and ``exact`` as in ``LoopForms``, and the loops that a kernel solves."""

    plain: Any
    exact: Any
    loops: tuple[Loop, ...]


@functools.lru_cache(maxsize=64)
def step_of(eq: Equations, method: Method) -> StepMap:
    """A step of some equations (kept, since equations are compared by identity)."""
    rhs = eq.forms.open if eq.forms else eq.rhs
    return step_map(rhs, method, eq.x, len(solved_loops(eq.loops)))


def step_map(rhs: Any, method: Method, names: tuple[str, ...], first: int) -> StepMap:
    """A step of a right-hand side. ``first`` is the number of its first loop."""
    if Program(rhs).solving:
        raise RunError(
            f"locate=True does not support the method '{method.name}' with a nonlinear algebraic loop. Remove one of "
            "them, or use 'rk4'."
        )
    size = {k: rhs.size1_in(k) for k in "xduqp"}
    count = len(method.instants)
    t, h, x, d, p = ca.SX.sym("t", count), ca.SX.sym("h"), *(ca.SX.sym(k, size[k]) for k in "xdp")
    u, q = (ca.SX.sym(k, count * size[k]) for k in "uq")
    opened = "z" in rhs.name_in()  # empty where all loops are at samples
    hidden = rhs.size1_in("z") if opened else 0
    tears: list[Tear] = []
    scaled: list[Any] = []  # h times the slope of each stage
    moved = ca.SX(size["x"], 1)
    for stage, (row, offset) in enumerate(zip(method.rows, method.offsets, strict=True)):
        i = method.instants.index(offset)
        base = sum((a * k for a, k in zip(row, scaled, strict=False) if a), ca.SX.zeros(size["x"]))
        moved, z = ca.SX.sym(f"x{stage}", size["x"]), ca.SX.sym(f"z{stage}", hidden)
        inputs = [v[i * size[k] : (i + 1) * size[k]] for k, v in (("u", u), ("q", q))]
        results = rhs.call([t[i], x + moved, d, *inputs, p, *([z] if opened else [])])
        if names:
            ends = base + h * row[stage] * results[0]
            tears += [Tear(moved[k], [name], ends[k]) for k, name in enumerate(names)]
            tears += [Tear(z[k], ["a loop"], results[3][k]) for k in range(hidden)]
        scaled.append((moved - base) / row[stage])
    closure = Closure(tears, first, function="advance", eliminate=True)
    ahead = (
        x + moved
        if method.weights == method.rows[-1]
        else x + sum(b * k for b, k in zip(method.weights, scaled, strict=True))
    )
    guess = ca.SX.sym("guess", closure.size)
    given = [t, h, x, d, u, q, p, guess]
    plain, exact = (
        ca.Function("advance", given, form([ahead], guess), *ADVANCE) for form in (closure.plain, closure.exact)
    )
    return StepMap(plain, exact, tuple(solved_loops(closure.loops)))


def tangent_step(step: StepMap, q_seed: Any) -> Any:
    """A step of states and their derivatives side by side, as ``sensitivities`` carries them.

    ``q_seed`` gives the derivative of the past of delayed signals at one instant from symbols for all numbers.
    """
    t, h, x, d, u, q, p, guess = step.exact.sx_in()
    xs, ds, qs, ps = (ca.SX.sym(f"d{k}", v.shape[0]) for k, v in zip("xdqp", (x, d, q, p), strict=True))
    ahead, roots = step.exact.call([t, h, x, d, u, q, p, guess])
    along = ca.vertcat(xs, ds, q_seed(qs), ps)
    pair = ca.vertcat(ahead, ca.jtimes(ahead, ca.vertcat(x, d, q, p), along))
    count = t.shape[0]
    both_q = _interleaved(q, qs, count)
    given = [t, h, ca.vertcat(x, xs), ca.vertcat(d, ds), u, both_q, ca.vertcat(p, ps), guess]
    return ca.Function("advance", given, [pair, roots], *ADVANCE)


def _interleaved(q: Any, qs: Any, count: int) -> Any:
    """The past of delayed signals and its derivatives, instant by instant."""
    n = q.shape[0] // count
    parts = (part[i * n : (i + 1) * n] for i in range(count) for part in (q, qs))
    return ca.vertcat(ca.SX(0, 1), *parts)
