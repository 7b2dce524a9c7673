"""A small integrator of its own for block tests, so that they do not lean on the engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tsmblocks.common.errors import ParameterError
from tsmblocks.model.block import Block, leaves, signals


class Bench:
    """The equations of one block as functions of t, states and inputs, formed through its symbols."""

    def __init__(self, block: Block) -> None:
        self.p: list[Any] = []
        self.p0: list[float] = []

        def symbol(name: str, value: Any) -> Any:
            self.p.append(ca.SX.sym(name))
            self.p0.append(float(value))
            return self.p[-1]

        twin = block.with_symbols(symbol)
        self.t = ca.SX.sym("t")
        self.x = ca.SX.sym("x", len(block.states))
        self.u = ca.SX.sym("u", len(block.read_names))
        self.reads = block.read_names
        x = signals(list(block.states), ca.vertsplit(self.x) if block.states else [])
        u = signals(block.read_names, ca.vertsplit(self.u) if block.read_names else [])
        self.names = list(block.states)
        self.x0 = np.array([leaf for s in block.states.values() for _, leaf in leaves(float(s.start))])
        rates, fresh = twin.derivatives(self.t, x, u), twin.updates(self.t, x, u)
        self.outlets = list(block.outports)
        y = twin.outputs(self.t, x, u)
        assert set(y) == set(self.outlets)
        assert set(rates) | set(fresh) == set(self.names)
        self.rate_of = ca.vertcat(*(rates.get(k, 0.0) for k in self.names))
        self.fresh_of = ca.vertcat(*(fresh.get(k, getattr(x, k)) for k in self.names))
        self.y_of = ca.vertcat(*(y[k] for k in self.outlets))
        args = [self.t, self.x, self.u, ca.vertcat(*self.p)]
        self.rate = ca.Function("rate", args, [self.rate_of])
        self.fresh = ca.Function("fresh", args, [self.fresh_of])
        self.y = ca.Function("y", args, [self.y_of])
        everything = ca.vertcat(self.rate_of, self.fresh_of, self.y_of)
        self.everything = ca.Function("everything", args, [everything])
        slots = ca.vertcat(self.x, self.u, *self.p)
        self.slopes = ca.Function("slopes", args, [ca.jacobian(everything, slots)])
        self.uses = (
            dict(zip(map(str, self.p), ca.which_depends(everything, ca.vertcat(*self.p), 1, False), strict=True))
            if self.p
            else {}
        )


def flat(value: ca.DM) -> np.ndarray:
    """A column as a one-dimensional array."""
    return value.full().ravel()


def simulate(
    block: Block, inputs: Mapping[str, Callable[[float], float]], stop: float, step: float
) -> dict[str, np.ndarray]:
    """Outputs and states on the grid, with RK4; memory moves on once per step."""
    bench = Bench(block)
    t, x, u, p = ca.SX.sym("t"), bench.x, ca.SX.sym("u", len(bench.reads), 3), ca.vertcat(*bench.p)
    m = bench.fresh(t, x, u[:, 0], p)
    k1 = bench.rate(t, m, u[:, 0], p)
    k2 = bench.rate(t, m + step / 2 * k1, u[:, 1], p)
    k3 = bench.rate(t, m + step / 2 * k2, u[:, 1], p)
    k4 = bench.rate(t, m + step * k3, u[:, 2], p)
    new = m + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    advance = ca.Function("advance", [t, x, u, p], [new, bench.y(t, x, u[:, 0], p)])
    grid = np.arange(round(stop / step) + 1) * step
    read = {k: np.array([[f(s) for s in (a, a + step / 2, a + step)] for a in grid]) for k, f in inputs.items()}
    assert set(read) == set(bench.reads)
    now, numbers = bench.x0, np.array(bench.p0)
    xs, ys = [], []
    for k, at in enumerate(grid):
        xs.append(now)
        now, y = map(flat, advance(at, now, np.array([read[name][k] for name in bench.reads]), numbers))
        ys.append(y)
    table = dict(zip(bench.outlets, np.array(ys).T, strict=True))
    return {"t": grid, **table, **{f"x.{k}": v for k, v in zip(bench.names, np.array(xs).T, strict=True)}}


def sample(block: Block, **inputs: Any) -> dict[str, np.ndarray]:
    """Outputs of a sampled block, sample by sample: outputs from the old state, then the update."""
    bench = Bench(block)
    now, numbers, ys = bench.x0, np.array(bench.p0), []
    for k in range(len(next(iter(inputs.values())))):
        u = np.array([inputs[name][k] for name in bench.reads], dtype=float)
        ys.append(flat(bench.y(k * block.period, now, u, numbers)))  # type: ignore[attr-defined]
        now = flat(bench.fresh(k * block.period, now, u, numbers))  # type: ignore[attr-defined]
    return dict(zip(bench.outlets, np.array(ys).T, strict=True))


def value(block: Block, states: Mapping[str, float] | None = None, /, **inputs: float) -> dict[str, float]:
    """Outputs of a block at one instant."""
    x = signals(list(block.states), [(states or {}).get(k, s.start) for k, s in block.states.items()])
    u = signals(block.read_names, [inputs[k] for k in block.read_names])
    return {k: float(v) for k, v in block.outputs(0.0, x, u).items()}


def rates(block: Block, states: Mapping[str, float], /, **inputs: float) -> dict[str, float]:
    """Rates of a block's states at one instant."""
    x = signals(list(block.states), [states[k] for k in block.states])
    u = signals(block.read_names, [inputs[k] for k in block.read_names])
    return {k: float(v) for k, v in block.derivatives(0.0, x, u).items()}


def assert_sound(block: Block) -> None:
    """Finite with finite slopes at rest and far out, every parameter in use, and words on everything."""
    bench = Bench(block)
    idle = [name for name, used in bench.uses.items() if not used]
    starts = {str(s.start) for s in symbolic_states(block)}
    assert not [name for name in idle if name not in starts], idle
    rng = np.random.default_rng(0)
    sizes = (len(bench.names), len(bench.reads))
    for scale in (0.0, 1e-9, 1e-3, 1.0, 1e3, 1e6):
        for _ in range(10):
            x, u = (scale * rng.choice([-1.0, 0.0, 0.3, 1.0], size=n) for n in sizes)
            point = (0.0, x, u, np.array(bench.p0))
            assert np.isfinite(bench.everything(*point).full()).all(), (block, point)
            assert np.isfinite(bench.slopes(*point).full()).all(), (block, point)
    assert len(block.symbol) <= 12
    assert block.symbol
    assert block.source
    assert ".. math::" in (type(block).__doc__ or "")
    for thing in (*block.fields().values(), *block.inports.values(), *block.outports.values(), *block.states.values()):
        assert thing.about


def symbolic_states(block: Block) -> list[Any]:
    """The states of the block's twin, whose start values may be parameters."""
    return list(block.with_symbols(lambda name, _: ca.SX.sym(name)).states.values())


def refuses(message: str, cls: type[Block], **values: Any) -> None:
    """The block refuses these values, in exactly these words."""
    with pytest.raises(ParameterError) as caught:
        cls(**values)
    assert str(caught.value) == message
